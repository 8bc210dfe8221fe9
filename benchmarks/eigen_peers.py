"""Modes of a free block beside what other programs take for them: same mesh, same ten-node tetrahedra, one thread each.

Run from the project's root with the extra ``bench`` and CalculiX's ``ccx``: ``python benchmarks/eigen_peers.py`` prints
the table and writes ``eigen_peers.csv`` beside itself; with sizes and programs, as in ``eigen_peers.py 50k CalculiX``,
it renews their rows alone. Each runs in a process of its own; seconds are of the processor. What takes more than twenty
minutes of it, or more memory than there is, has its row say so.
"""

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import assembly_peers
import numpy as np
from assembly_peers import LAM, MU, NU, RHO, E
from table_format import renew_rows

SIZE = (0.1, 0.09, 0.08)  # m
EDGES = {
    "10k": 1.3e-2,
    "50k": 7.2e-3,
    "100k": 5.55e-3,
    "200k": 4.36e-3,
}  # of the tetrahedra [m], by the number of unknowns
MODES = 20
MOST_SECONDS = 1200
COLUMNS = ("unknowns", "program", "assemble", "factor", "iterate", "total", "memory_mb", "digits", "note")
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OPENBLAS", "OMP", "MKL", "NUMEXPR")}


class Clock:
    """Processor time between two laps."""

    def __init__(self) -> None:
        self.last = time.process_time()

    def lap(self) -> float:
        """Seconds since the last lap."""
        last, self.last = self.last, time.process_time()
        return self.last - last


def assembled(mesh):
    """K and M as this project assembles them."""
    from fmd.fem.assembly import assemble
    from fmd.fem.material import Material
    from fmd.fem.mesh import SolidMesh

    return assemble(SolidMesh(mesh["points"], mesh["cells"], "tetra", {}, {}), 2, Material(E, NU, RHO))


def ours(mesh, factorise):
    """Assemble, factorise and iterate as `fmd modes` does."""
    from fmd.reduction.eigen import FreeBodySolver

    clock = Clock()
    fe = assembled(mesh)
    fe.M  # noqa: B018
    assembly = clock.lap()
    solver = FreeBodySolver(fe, factorise=factorise)
    factor = clock.lap()
    pairs = solver.modes(MODES)
    figures = pairs.factor
    note = f"{figures.solver}, {figures.order} order, {figures.nonzeros / 1e6:.4g} million nonzeros"
    return pairs.omega / (2 * np.pi), assembly, factor, clock.lap(), note


def fmd(mesh):
    """What a scene takes by itself."""
    from fmd.reduction.factor.factor import factorise

    return ours(mesh, factorise)


def fmd_cholmod(mesh):
    """The same with cvxopt's CHOLMOD."""
    from fmd.reduction.factor.factor import factorise

    return ours(mesh, partial(factorise, solver="cholesky"))


def eigsh_default(mesh):
    """SciPy as documented: a shift, and nothing else."""
    from scipy.sparse.linalg import eigsh

    clock = Clock()
    fe = assembled(mesh)
    M = fe.M
    assembly = clock.lap()
    eigenvalues = np.sort(eigsh(fe.K, MODES + 6, M, sigma=-3.5e9, return_eigenvectors=False))
    return np.sqrt(eigenvalues[6:]) / (2 * np.pi), assembly, None, clock.lap(), "factor within iterate"


def ngsolve(mesh):
    """NGSolve's matrices and sparse Cholesky factor behind `eigsh`."""
    import ngsolve as ng
    from scipy.sparse.linalg import LinearOperator, eigsh

    net = assembly_peers.ngsolve_mesh(mesh["points"], mesh["cells"])
    clock = Clock()
    space = ng.VectorH1(net, order=2)
    u, v = space.TnT()

    def eps(w):
        return 0.5 * (ng.Grad(w) + ng.Grad(w).trans)

    stiffness = 2 * MU * ng.InnerProduct(eps(u), eps(v)) + LAM * ng.div(u) * ng.div(v)
    a = ng.BilinearForm(stiffness * ng.dx, symmetric=True).Assemble()
    m = ng.BilinearForm(RHO * u * v * ng.dx, symmetric=True).Assemble()
    shift = -3.5e9
    shifted = ng.BilinearForm(space, symmetric=True)
    shifted += stiffness * ng.dx - shift * RHO * u * v * ng.dx
    shifted.Assemble()
    assembly = clock.lap()
    inverse = shifted.mat.Inverse(inverse="sparsecholesky")
    factor = clock.lap()
    x, y = a.mat.CreateColVector(), a.mat.CreateColVector()

    def operator(mat):
        def apply(f):
            x.FV().NumPy()[:] = f
            y.data = mat * x
            return y.FV().NumPy().copy()

        return LinearOperator((space.ndof, space.ndof), apply, dtype=float)

    start = np.random.default_rng(0).standard_normal(space.ndof)
    settings = {"sigma": shift, "OPinv": operator(inverse), "v0": start, "return_eigenvectors": False}
    eigenvalues = np.sort(eigsh(operator(a.mat), MODES + 6, operator(m.mat), **settings))
    return np.sqrt(eigenvalues[6:]) / (2 * np.pi), assembly, factor, clock.lap(), "sparsecholesky behind eigsh"


def sfepy(mesh):
    """SfePy's terms and its eigensolver, which is SciPy's."""
    from scipy.sparse.linalg import eigsh

    assemble_both, _ = assembly_peers.sfepy(mesh["points"], mesh["cells"], "tet10")
    clock = Clock()
    K, M, _ = assemble_both()
    assembly = clock.lap()
    eigenvalues = np.sort(eigsh(K, MODES + 6, M, sigma=-3.5e9, return_eigenvectors=False))
    return np.sqrt(eigenvalues[6:]) / (2 * np.pi), assembly, None, clock.lap(), "SciPy's SuperLU, factor within iterate"


def calculix(mesh):
    """CalculiX, the whole run of ``ccx``; its C3D10 has scikit-fem's order of nodes."""
    from fmd.fem.mesh import SolidMesh
    from fmd.fem.space import Discretisation

    space = Discretisation(SolidMesh(mesh["points"], mesh["cells"], "tetra", {}, {}), 2)
    rows = ["*NODE"]
    rows += [f"{k + 1},{x:.12e},{y:.12e},{z:.12e}" for k, (x, y, z) in enumerate(space.x)]
    rows.append("*ELEMENT,TYPE=C3D10,ELSET=ALL")
    rows += [",".join(map(str, (k + 1, *(nodes + 1)))) for k, nodes in enumerate(space.element_nodes)]
    rows += ["*MATERIAL,NAME=STEEL", "*ELASTIC", f"{E},{NU}", "*DENSITY", f"{RHO}"]
    rows += [
        "*SOLID SECTION,ELSET=ALL,MATERIAL=STEEL",
        "*STEP",
        "*FREQUENCY,SOLVER=SPOOLES",
        f"{MODES + 6}",
        "*END STEP",
    ]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "block.inp").write_text("\n".join(rows) + "\n")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(["ccx", "block"], cwd=folder, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        lines = [line.split() for line in Path(folder, "block.dat").read_text().splitlines()]
    found = [float(line[3]) for line in lines if len(line) == 5 and line[0].isdigit()][: MODES + 6]
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return np.array(found[6:]), None, None, spent, "whole run, SPOOLES"


PROGRAMS = {
    "fmd": fmd,
    "fmd, CHOLMOD": fmd_cholmod,
    "SciPy eigsh": eigsh_default,
    "NGSolve": ngsolve,
    "CalculiX": calculix,
    "SfePy": sfepy,
}


def measure(file, name):
    """One program, in this process; prints one line of JSON."""
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))
    with np.load(file) as mesh:
        frequencies, assembly, factor, iterate, note = PROGRAMS[name](dict(mesh))
    who = resource.RUSAGE_CHILDREN if name == "CalculiX" else resource.RUSAGE_SELF
    memory = resource.getrusage(who).ru_maxrss / 1024
    seconds = {"assemble": assembly, "factor": factor, "iterate": iterate}
    print(json.dumps({"hz": frequencies.tolist(), "memory_mb": memory, "note": note, **seconds}))


def row(file, unknowns, name, reference):
    """One program in a process of its own, as a row of the table; and its frequencies."""
    if name == "CalculiX" and shutil.which("ccx") is None:
        return {"unknowns": unknowns, "program": name, "note": "ccx is not installed"}, None
    command = [sys.executable, __file__, "measure", str(file), name]
    done = subprocess.run(command, check=False, capture_output=True, text=True, env={**os.environ, **ONE_THREAD})
    if done.returncode:
        killed = f"ended by signal {-done.returncode}; {MOST_SECONDS} processor seconds are the limit"
        last = (done.stderr.strip().splitlines() or [killed])[-1]
        return {"unknowns": unknowns, "program": name, "note": last[:100]}, None
    found = json.loads(done.stdout.splitlines()[-1])
    seconds = {part: found[part] for part in ("assemble", "factor", "iterate") if found[part] is not None}
    hz = np.array(found["hz"])
    apart = np.abs(hz / (hz if reference is None else reference) - 1).max()
    return {
        "unknowns": unknowns,
        "program": name,
        **{part: f"{value:.3g}" for part, value in seconds.items()},
        "total": f"{sum(seconds.values()):.3g}",
        "memory_mb": f"{found['memory_mb']:.0f}",
        "digits": "" if reference is None else f"{min(-np.log10(apart), 15):.0f}",
        "note": found["note"],
    }, hz


def main():
    """Measure what is asked for and write the table."""
    if sys.argv[1:2] == ["measure"]:
        measure(sys.argv[2], sys.argv[3])
        return
    sizes = [size for size in EDGES if size in sys.argv] or list(EDGES)
    names = [name for name in PROGRAMS if name in sys.argv] or list(PROGRAMS)
    path = Path(__file__).with_suffix(".csv")
    for size in sizes:
        from fmd.meshes.bar import tetrahedral_bar

        points, cells = tetrahedral_bar(*SIZE, EDGES[size])[:2]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "mesh.npz")
            np.savez(file, points=points, cells=cells)
            edges = np.concatenate([cells[:, pair] for pair in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))])
            unknowns = 3 * (len(points) + len(np.unique(np.sort(edges, axis=1), axis=0)))
            reference = None
            for name in dict.fromkeys(["fmd", *names]):
                new, hz = row(file, unknowns, name, reference)
                reference = hz if reference is None else reference
                print(*(f"{new.get(column, ''):>12}" for column in COLUMNS), flush=True)
                renew_rows(path, [dict.fromkeys(COLUMNS, "") | new], ("unknowns", "program"), place)


def place(row):
    """Where a row stands in the table."""
    return int(row["unknowns"]), list(PROGRAMS).index(row["program"])


if __name__ == "__main__":
    main()

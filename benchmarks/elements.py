"""Hexahedra side by side: cantilevers beside CalculiX' on the same meshes, and the propeller.

Run from the project's root: ``python benchmarks/elements.py [cantilevers] [propeller]``; each part prints its table
and writes it beside itself. CalculiX (``apt-get install calculix-ccx``) gets the same nodes, elements and nodal forces;
without it its columns are empty. Processor seconds on one thread.
"""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from table_format import machine, write_rows
from threadpoolctl import threadpool_limits

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import ERROR_BUDGET
from fmd.accuracy.quantities import find_counterparts
from fmd.core.cache import Cache
from fmd.fem.assembly import _mass, _stiffness, assemble
from fmd.fem.markers import face_marker
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.fem.space import Discretisation
from fmd.meshes.bar import hexahedral_bar
from fmd.reduction.factor.factor import factorise

HERE = Path(__file__).parent
METAL = Material(1.0, 0.3, 1.0)
LENGTH = 10.0
MODES = 24
OFFERED = 34  # modes of the quadratic mesh that the others' are matched with
REPEATS = 3


# Cantilevers -------------------------------------------------------------------------------------------------------


def straight(x):
    """Leave a bar of length 10 and section 1 × 1 as it is."""
    return x


def skewed(x):
    """Shear the elements by 30 degrees."""
    return x + np.outer(x[:, 1], [np.tan(np.pi / 6), 0, 0])


def twisted(x):
    """Turn the section by 90 degrees from end to end."""
    angle = np.pi / 2 * x[:, 0] / LENGTH
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([x[:, 0], c * x[:, 1] - s * x[:, 2], s * x[:, 1] + c * x[:, 2]], axis=1)


def thin(x):
    """Take a fiftieth of the depth."""
    return x * [1.0, 0.02, 1.0]


def tapered(x):
    """Tilt the planes between elements alternately, so that they are trapezoids."""
    planes = np.unique(x[:, 0].round(9))
    number = np.searchsorted(planes, x[:, 0] - 1e-6)
    inner = (number > 0) & (number < len(planes) - 1)
    return x + np.outer(inner * (-1.0) ** number * 0.5 * (planes[1] - planes[0]) * x[:, 1], [1.0, 0, 0])


SHAPES = (straight, skewed, twisted, thin, tapered)


def cantilever(shape, divisions):
    """Mesh a bar of a shape."""
    points, *rest = hexahedral_bar(LENGTH, 1.0, 1.0, divisions)
    return SolidMesh(shape(np.array(points)), *rest)


def loads(space):
    """Return the clamped nodes and the nodal forces (n_nodes, 3) of a unit force along y over the other end."""
    clamp, end = (face_marker(space, space.mesh.faces[name]) for name in ("x-", "x+"))
    f = np.zeros((len(space.x), 3))
    f[end.nodes, 1] = end.translation_weights
    return clamp.nodes, f


def compliance(mesh, order, formulation="enhanced"):
    """Return the deflection of the end."""
    fe = assemble(mesh, order, METAL, formulation)
    clamped, f = loads(fe.discretisation)
    free = np.ones(f.shape, dtype=bool)
    free[clamped] = False
    free = free.ravel()
    f = f.ravel()[free]
    return float(f @ factorise(fe.K[free][:, free].tocsc()).solve(f))


def compliance_by_calculix(mesh, element):
    """Return the deflection of the end by CalculiX' element."""
    space = Discretisation(mesh, 1)
    clamped, f = loads(space)
    x, cells = mesh.points, mesh.cells
    at = cKDTree(x).query(space.x)[1]  # CalculiX has the mesh's own numbers of the nodes
    lines = ["*NODE, NSET=ALL", *(f"{k + 1},{a:.12e},{b:.12e},{c:.12e}" for k, (a, b, c) in enumerate(x.tolist()))]
    lines += [f"*ELEMENT, TYPE={element}, ELSET=BAR"]
    lines += [",".join(map(str, (k + 1, *(cell + 1)))) for k, cell in enumerate(cells)]
    lines += ["*BOUNDARY", *(f"{k + 1},1,3" for k in at[clamped])]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{METAL.E},{METAL.nu}", "*SOLID SECTION, ELSET=BAR, MATERIAL=M"]
    lines += ["*STEP", "*STATIC", "*CLOAD"]
    lines += [f"{at[k] + 1},2,{f[k, 1]:.12e}" for k in np.flatnonzero(f[:, 1])]
    lines += ["*NODE PRINT, NSET=ALL", "U", "*END STEP", ""]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bar.inp").write_text("\n".join(lines))
        subprocess.run(["ccx", "bar"], cwd=folder, check=True, capture_output=True)
        rows = [line.split() for line in (Path(folder) / "bar.dat").read_text().splitlines()]
    u = np.array([[float(v) for v in row] for row in rows if len(row) == 4 and row[0].isdigit()])
    return float(f[:, 1] @ u[at, 2])


def cantilevers():
    """Compare compliances with those of a fine mesh of quadratic elements."""
    ccx = shutil.which("ccx") is not None
    for shape in SHAPES:
        exact = compliance(cantilever(straight if shape is tapered else shape, (60, 6, 6)), 2)
        for layers in (1, 3):
            mesh = cantilever(shape, (10 * layers, layers, layers))
            row = [compliance(mesh, 1, formulation) / exact for formulation in ("plain", "enhanced")]
            row += [compliance_by_calculix(mesh, name) / exact for name in ("C3D8", "C3D8I")] if ccx else []
            yield [f"{shape.__name__}, {layers} layer{'s' * (layers > 1)}", *(f"{value:.4f}" for value in row)]


# The propeller -----------------------------------------------------------------------------------------------------


def propeller():
    """Compare plain and enhanced elements with quadratic ones on the propeller's mesh."""
    runs = {
        "plain": ("body.propeller.mesh.formulation=plain",),
        "enhanced": (),
        "hex20": ("body.propeller.mesh.order=2", f"body.propeller.modes.count={OFFERED}"),
    }
    exact = None
    for name, overrides in reversed(runs.items()):
        run = Pipeline(load_scene("propeller", overrides), Cache(None))
        part = run.parts["propeller"]
        matrices = []
        for _ in range(REPEATS):
            space = Discretisation(part.mesh, part.order, part.formulation)
            space.element_nodes  # noqa: B018
            tick = time.process_time()
            _stiffness(space, part.material), _mass(space, part.material)
            matrices.append(time.process_time() - tick)
        fe, solver = part.fe, part.model.solver
        tick = time.process_time()
        pairs = solver.modes(OFFERED if exact is None else MODES)
        modes = time.process_time() - tick
        spin = (fe.m @ (fe.x * [1.0, 1.0, 0.0]))[:, :, None]
        u = solver.static_response(spin)[:, :, 0]
        if exact is None:
            exact = fe, pairs, u
            yield [name, "", "", "", "", "", "", f"{min(matrices):.2g}", f"{modes:.3g}"]
            continue
        theirs, their_pairs, their_u = exact
        numbers, _ = find_counterparts(fe.x, pairs.shapes, theirs.x, theirs.m, their_pairs.shapes, their_pairs.omega)
        errors = pairs.omega / their_pairs.omega[numbers] - 1
        corners = cKDTree(theirs.x).query(fe.x)[1]
        apart = np.linalg.norm(u - their_u[corners]) / np.linalg.norm(their_u[corners])
        stated = {row.name: row.numerical for row in ERROR_BUDGET.of(run).rows}
        of_frequencies = max(total for quantity, total in stated.items() if "frequency" in quantity)
        figures = (
            *(np.abs(errors).max(), np.sqrt(np.mean(errors**2)), apart),
            *(of_frequencies, stated["tip, deflection"], stated["propeller.joint, von Mises stress"]),
        )
        yield [name, *(f"{100 * figure:.2g} %" for figure in figures), f"{min(matrices):.2g}", f"{modes:.3g}"]


PARTS = {
    "cantilevers": (cantilevers, ("cantilever", "plain", "enhanced", "CalculiX C3D8", "CalculiX C3D8I")),
    "propeller": (
        propeller,
        (
            *("element", "largest error of 24 frequencies", "rms error", "spin displacement"),
            *("stated: worst frequency", "stated: tip deflection", "stated: joint stress", "K + M, s", "modes, s"),
        ),
    ),
}


def main(names):
    """Measure the parts that are named, or all, and write their tables."""
    for name, (measure, header) in PARTS.items():
        if names and name not in names:
            continue
        rows = []
        with threadpool_limits(1):
            for row in measure():
                print(name, *row, sep="  ", flush=True)
                rows.append(dict(zip(header, row, strict=True)))
        write_rows(HERE / f"elements-{name}.csv", rows, f"{machine()}, one thread")


if __name__ == "__main__":
    main(sys.argv[1:])

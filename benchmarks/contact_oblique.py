"""A cantilever whose mitre slips on a wall, beside whole elements and NLstep, written to contact_oblique.csv.

Run from the project's root: ``python benchmarks/contact_oblique.py [NLSTEP]``. The cantilever is that of example 04 of
NLstep (github.com/maltekrack/NLstep): steel of 320 × 50 × 30 mm, 2,652 nodes of hexahedra, whose end is cut aslant; a
strip of 12 facets of the cut is pressed on a wall by 0.4 MPa, friction 0.36, and 25 N shake the beam at the frequency
of the second mode of the held strip, 5 % of which is damped, in proportion to the mass. Here it begins at rest under
the pressure, and the force is a sine.

Whole elements are of this file: incompatible modes (Taylor, Beresford & Wilson 1976), all unknowns in time by Hilber,
Hughes and Taylor, Signorini's and Coulomb's conditions at the end of each step by sweeps over the nodes. With the
folder NLSTEP, a copy of its repository, GNU Octave runs NLstep's own integrator on massless-boundary Craig–Bampton
models of these matrices.
"""

import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.io import loadmat, savemat
from scipy.sparse.linalg import eigsh, splu
from table_format import HERE, write_rows

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache

TABLE = HERE / "contact_oblique.csv"
E, NU, RHO, MU, PRESSURE, FORCE, RATIO = 210e9, 0.3, 9000.0, 0.36, 0.4e6, 25.0, 0.05
COUNTS = (16, 11, 12)
OUT = np.array([7.0, 4.0, 0.0]) / np.sqrt(65.0)  # of the cut
AXES = np.stack([-OUT, [-OUT[1], OUT[0], 0.0], [0.0, 0.0, 1.0]])  # of forces on the beam: the wall's push, and aside
PERIODS, STEPS, OUTPUTS = 3, 512, 128  # steps and outputs a period
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])


@dataclass(frozen=True)
class History:
    """What a march gives at its times: a row each."""

    force: np.ndarray  # on the beam along AXES [N], shape (times, 3)
    heat: np.ndarray  # friction's work [J]
    seconds: float  # of the processor, for the march alone


@dataclass(frozen=True)
class Whole:
    """The mesh, and matrices of the coordinates that aren't clamped."""

    x: np.ndarray  # nodes [m]
    cells: np.ndarray
    K: Any
    M: Any
    B: np.ndarray  # numbers of the strip's coordinates, three a node
    areas: np.ndarray  # of the strip's nodes [m²]
    shaken: int  # number of the coordinate that the force acts on
    strip: np.ndarray  # numbers of nodes
    node: int


def make_whole() -> Whole:
    """Make the mesh as the example has it, and assemble its matrices."""
    axes = [np.arange(n + 1) for n in COUNTS]
    i, j, k = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
    s, t = np.maximum(i - 11, 0) / 5, j / 11
    x = 1e-3 * np.stack([300 / 11 * np.minimum(i, 11) + 20 * s, t * (50 - 35 * s), -2.5 * k], axis=1)
    number = np.arange(len(x)).reshape(np.add(COUNTS, 1))
    cells = np.stack(
        [number[a : a + COUNTS[0], b : b + COUNTS[1], c : c + COUNTS[2]].ravel() for a, b, c in CORNERS], axis=1
    )
    cells = cells[:, [4, 5, 6, 7, 0, 1, 2, 3]]  # z goes down
    strip = np.flatnonzero((i >= 15) & (j == 11))
    places = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), 24)
    rows, columns = np.repeat(places, 24), np.tile(places, (1, 24)).ravel()
    free = np.flatnonzero(np.repeat(i > 0, 3))
    K, M = (
        sp.csc_matrix((values.ravel(), (rows, columns)), shape=(x.size, x.size))[free][:, free]
        for values in elements(x[cells])
    )
    at = np.full(x.size, -1)
    at[free] = np.arange(len(free))
    areas = 2.5e-3 * np.hypot(4e-3, 7e-3) / np.where(np.isin(k[strip], (0, 12)), 4, 2)
    node = int(np.flatnonzero((i == 9) & (j == 0) & (k == 6))[0])
    return Whole(x, cells, K, M, at[3 * strip[:, None] + np.arange(3)].ravel(), areas, at[3 * node + 1], strip, node)


def elements(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness and mass of hexahedra with incompatible modes, shape (n, 24, 24)."""
    lame, G = E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)
    D = np.diag([2 * G] * 3 + [G] * 3)
    D[:3, :3] += lame
    signs = 2 * CORNERS - 1

    def slopes(xi: np.ndarray) -> np.ndarray:
        factors = 1 + signs * xi
        return np.stack([signs[:, a] * np.prod(np.delete(factors, a, 1), 1) / 8 for a in range(3)])

    def strains(gradients: np.ndarray) -> np.ndarray:
        B = np.zeros((*gradients.shape[:1], 6, gradients.shape[2], 3))
        for row, (a, b) in enumerate([(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]):
            B[:, row, :, b] += gradients[:, a]
            if a != b:
                B[:, row, :, a] += gradients[:, b]
        return B.reshape(len(B), 6, -1)

    middle = slopes(np.zeros(3)) @ x
    K, M = np.zeros((len(x), 33, 33)), np.zeros((len(x), 8, 8))
    for xi in product((-(3**-0.5), 3**-0.5), repeat=3):
        J = slopes(np.array(xi)) @ x
        volume, N = np.linalg.det(J), np.prod(1 + signs * xi, 1) / 8
        bubbles = (np.linalg.det(middle) / volume)[:, None, None] * np.linalg.inv(middle) @ np.diag(-2 * np.array(xi))
        B = np.concatenate([strains(np.linalg.inv(J) @ slopes(np.array(xi))), strains(bubbles)], axis=2)
        K += volume[:, None, None] * (B.transpose(0, 2, 1) @ D @ B)
        M += RHO * volume[:, None, None] * np.outer(N, N)
    outer, across = K[:, :24, :24], K[:, :24, 24:]
    K = outer - across @ np.linalg.solve(K[:, 24:, 24:], across.transpose(0, 2, 1))
    return K, np.kron(M, np.eye(3))


def our_march(whole: Whole, omega: float, count: int, folder: Path, keys: dict[str, Any]) -> History:
    """March the scene with some modes."""
    lines = ["*NODE", *(f"{n + 1},{x:.12g},{y:.12g},{z:.12g}" for n, (x, y, z) in enumerate(whole.x))]
    lines += ["*ELEMENT,TYPE=C3D8,ELSET=E"]
    lines += [f"{n + 1},{','.join(map(str, cell + 1))}" for n, cell in enumerate(whole.cells)]
    for name, nodes in {"STRIP": whole.strip, "CLAMP": np.flatnonzero(whole.x[:, 0] == 0)}.items():
        lines += [f"*NSET,NSET={name}", *(f"{n + 1}," for n in nodes)]
    (folder / "beam.inp").write_text("\n".join(lines) + "\n", encoding="utf-8")
    body = {
        "mesh": {"file": str(folder / "beam.inp"), "unit": "m"},
        "E": E,
        "nu": NU,
        "rho": RHO,
        "modes": {"count": count, "damping": {"alpha": 2 * RATIO * omega}, "enrich": "none"},
        "support": [{"face": "CLAMP"}],
        "marker": {
            "clamp": {"face": "CLAMP"},
            "strip": {"face": "STRIP"},
            "shaken": {"at": whole.x[whole.node].tolist()},
        },
    }
    clamp, strip = whole.x[whole.x[:, 0] == 0].mean(axis=0), whole.x[whole.strip].mean(axis=0)
    pressed = {"type": "point force", "marker": "beam.strip", "direction": OUT.tolist()}
    shaken = {"type": "point force", "marker": "beam.shaken", "direction": [0, 1, 0]}
    scene = {
        "title": "mitre",
        "body": {"beam": body},
        "ground": {"wall": {"at": strip.tolist()}, "clamp": {"at": clamp.tolist()}},
        "joint": {"hold": {"type": "fixed", "parent": "ground.clamp", "child": "beam.clamp"}},
        "drive": {
            "pressed": pressed | {"force": PRESSURE * whole.areas.sum()},
            "shaken": shaken | {"force": {"formula": f"{FORCE}*sin({float(omega)!r}*t)", "unit": "N"}},
        },
        "contact": {"wall": {"between": ["ground.wall", "beam.strip"], "normal": (-OUT).tolist(), "friction": MU}},
        "simulation": {
            "duration": PERIODS * 2 * np.pi / omega,
            "output_step": 2 * np.pi / omega / OUTPUTS,
            "gravity": [0, 0, 0],
            "step": "auto",
            "tip": "beam.shaken",
            "start": "equilibrium",
            "run": [keys],
        },
    }
    run = Pipeline(load_scene(scene), Cache(None))
    _ = run.system, run.start
    begin = time.process_time()
    own = run.motion.contacts["wall"]
    return History(own.force @ AXES.T, own.friction_work, time.process_time() - begin)


def whole_march(whole: Whole, omega: float, alpha: float = -0.05) -> History:
    """March all unknowns by Hilber, Hughes and Taylor; the seconds are without the sweeps of the contact."""
    n, h, damping = len(whole.areas), 2 * np.pi / omega / STEPS, 2 * RATIO * omega
    beta, gamma, c = (1 - alpha) ** 2 / 4, 0.5 - alpha, 1 + alpha
    picked = sp.csc_matrix((np.ones(3 * n), (whole.B, np.arange(3 * n))), shape=(whole.K.shape[0], 3 * n))
    B = (picked @ sp.block_diag([AXES.T] * n)).tocsc()
    matrix = (whole.M * (1 + c * damping * gamma * h) + c * beta * h**2 * whole.K).tocsc()
    solver = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0)
    X = solver.solve(B.toarray())
    D = c * beta * h**2 * (B.T @ X)
    lam = np.zeros((n, 3))
    lam[:, 0] = PRESSURE * whole.areas
    steady, shaken = -(B @ lam.ravel()), np.zeros(len(X))
    shaken[whole.shaken] = FORCE
    u, v, a, residual = np.zeros((4, len(X)))
    strip, work, seconds = np.zeros((n, 3)), 0.0, 0.0
    forces, heats = [lam.sum(axis=0)], [0.0]
    for k in range(1, PERIODS * STEPS + 1):
        begin = time.process_time()
        load = steady + shaken * np.sin(omega * k * h)
        u, v = u + h * v + h**2 * (0.5 - beta) * a, v + h * (1 - gamma) * a
        a = solver.solve(alpha * residual - c * (damping * (whole.M @ v) + whole.K @ u - load))
        moved = (B.T @ (u + beta * h**2 * a)).reshape(n, 3)
        moved[:, 1:] -= strip[:, 1:]  # the gap, and the slip in this step
        seconds += time.process_time() - begin
        sweep(D, moved, lam)
        work -= np.sum(lam[:, 1:] * (moved + (D @ lam.ravel()).reshape(n, 3))[:, 1:])
        begin = time.process_time()
        a += c * (X @ lam.ravel())
        u, v = u + beta * h**2 * a, v + gamma * h * a
        strip = (B.T @ u).reshape(n, 3)
        residual = damping * (whole.M @ v) + whole.K @ u - load - B @ lam.ravel()
        seconds += time.process_time() - begin
        if k % (STEPS // OUTPUTS) == 0:
            forces.append(lam.sum(axis=0))
            heats.append(work)
    return History(np.array(forces), np.array(heats), seconds)


def sweep(D: np.ndarray, y: np.ndarray, lam: np.ndarray, friction: float = MU) -> None:
    """Change forces node by node until each is on its cone for ``y + D λ``, the gap and the slip."""
    rows = D.reshape(len(lam), 3, -1)
    steps = [1 / np.linalg.eigvalsh(D[k : k + 3, k : k + 3])[-1] for k in range(0, len(D), 3)]
    for _ in range(2000):
        before = lam.copy()
        for k, step in enumerate(steps):
            normal, *aside = lam[k] - step * (y[k] + rows[k] @ lam.ravel())
            normal, size = max(normal, 0.0), np.hypot(*aside)
            share = friction * normal / size if size > friction * normal else 1.0
            lam[k] = normal, share * aside[0], share * aside[1]
        if np.abs(lam - before).max() <= 1e-8 * np.abs(lam).max():
            return
    raise RuntimeError("sweeps don't settle")


CLASS = """classdef CMS_ROM < handle
properties
M
K
D
n
nb
nonlinear_elements
end
methods
function b = isMasslessBoundaryROM(obj)
b = true;
end
end
end
"""
CODE = """
addpath('{source}'); addpath('{folder}'); load('{folder}/in.mat');
m = CMS_ROM; m.M = M; m.K = K; m.D = damping*M; m.n = size(M, 1); m.nb = nb;
for k = 1:nb/3
  m.nonlinear_elements{{k}} = struct('type', '3D', 'preload', preload(k), 'frictionCoefficient', mu, 'area', areas(k));
end
S.eliminatePresumedStickingContacts = true; S.verbosity = 0; begin_ = cputime;
[Q, U, L] = sim_contact3D(t, zeros(m.n, 1), zeros(m.n, 1), m, S, @(t) row*sin(omega*t));
seconds = cputime - begin_;
save('-v7', '{folder}/out.mat', 'Q', 'L', 'seconds');
"""


def nlstep(whole: Whole, omega: float, count: int, source: Path, folder: Path) -> History:
    """March a massless-boundary Craig–Bampton model (Monjaraz-Tec, Gross & Krack 2022) by NLstep."""
    inner = np.setdiff1d(np.arange(whole.K.shape[0]), whole.B)
    nb, Kii, Kib = len(whole.B), whole.K[inner][:, inner].tocsc(), whole.K[inner][:, whole.B].toarray()
    squares, modes = eigsh(Kii, count, whole.M[inner][:, inner], sigma=0)
    static = -splu(Kii).solve(Kib)
    static -= modes @ (modes.T @ (whole.M[inner][:, whole.B] + whole.M[inner][:, inner] @ static))
    turn, forced = np.kron(np.eye(nb // 3), AXES.T), np.searchsorted(inner, whole.shaken)
    outer = whole.K[whole.B][:, whole.B] + Kib.T @ static + static.T @ (Kib + Kii @ static)
    across = turn.T @ (Kib.T + (Kii @ static).T) @ modes
    K = np.block([[turn.T @ outer @ turn, across], [across.T, np.diag(squares)]])
    given = {"M": np.diag(np.repeat([0.0, 1.0], [nb, count])), "K": K, "damping": 2 * RATIO * omega, "nb": float(nb)}
    given |= {"areas": whole.areas, "preload": PRESSURE * whole.areas, "mu": MU, "omega": omega}
    given |= {"row": FORCE * np.concatenate([static[forced] @ turn, modes[forced]])[:, None]}
    given |= {"t": np.linspace(0, PERIODS * 2 * np.pi / omega, PERIODS * STEPS + 1)}
    savemat(folder / "in.mat", given)
    (folder / "CMS_ROM.m").write_text(CLASS, encoding="utf-8")
    (folder / "go.m").write_text(CODE.format(source=source / "SRC", folder=folder), encoding="utf-8")
    subprocess.run(["octave-cli", "-q", str(folder / "go.m")], cwd=folder, capture_output=True, check=True)
    found = loadmat(folder / "out.mat")
    lam, moved = (np.asarray(found[key])[:nb].reshape(nb // 3, 3, -1) for key in "LQ")
    work = np.cumsum(np.einsum("ikt,ikt->t", lam[:, 1:, 1:], np.diff(moved[:, 1:], axis=2)))
    force = lam.sum(axis=0).T + np.array([PRESSURE * whole.areas.sum(), 0.0, 0.0])
    every = STEPS // OUTPUTS
    return History(force[::every], np.append(0.0, -work)[::every], float(found["seconds"].item()))


def main() -> None:
    """Compare all marches with that of the whole elements, and write their table."""
    whole = make_whole()
    inner = np.setdiff1d(np.arange(whole.K.shape[0]), whole.B)
    omega = float(np.sqrt(eigsh(whole.K[inner][:, inner], 2, whole.M[inner][:, inner], sigma=0)[0][1]))
    reference = whole_march(whole, omega)
    marches = {"whole elements": reference}
    with tempfile.TemporaryDirectory(prefix="fmd-contact-") as scratch:
        folder, step = Path(scratch), 2 * np.pi / omega / STEPS
        for count in (5, 20) if len(sys.argv) > 1 else ():
            marches[f"NLstep, {count} modes"] = nlstep(whole, omega, count, Path(sys.argv[1]).resolve(), folder)
        for count in (5, 20):
            keys = {"integrator": "generalized-alpha", "step": step}
            marches[f"fmd, {count} modes, generalised-α"] = our_march(whole, omega, count, folder, keys)
        keys = {"integrator": "central-difference"}
        marches["fmd, 20 modes, central differences"] = our_march(whole, omega, 20, folder, keys)
    rows = []
    for name, march in marches.items():
        off = np.sqrt(np.mean((march.force - reference.force) ** 2, axis=0)) / np.abs(reference.force).max(axis=0)
        row = {"march": name, "mean_force_N": f"{march.force[:, 0].mean():.4g}"}
        row |= {"pressing_rms": f"{off[0]:.2g}", "aside_rms": f"{off[1]:.2g}", "heat_J": f"{march.heat[-1]:.4g}"}
        rows.append(row | {"seconds": f"{march.seconds:.2g}"})
        print(rows[-1], flush=True)
    write_rows(TABLE, rows)


if __name__ == "__main__":
    main()

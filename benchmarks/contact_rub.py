"""A blade that rubs on an oval casing, beside whole elements, written to contact_rub.csv.

Run from the project's root: ``python benchmarks/contact_rub.py``. As example 03 of NLstep (github.com/
maltekrack/NLstep), NASA's rotor 37, whose matrices it doesn't have: a blade that is clamped at its root and doesn't
turn, and a casing that turns about it, with a gap but for two lobes where it reaches as far into the blade's tip
(Piollet, Nyssen & Batailly, J Sound Vib 460, 2019), friction 0.15. Here the blade is a plate of steel, 100 mm high from
a radius of 200 mm, 40 mm long, 4 mm thick at its root and 2 mm at its tip, 40° aslant, and leans back by 20°, of
hexahedra; the casing turns at 800 rad/s, and one lobe passes in the march. Its triangles' corners are outwards of it by
two thirds of what their sides are inwards.

Whole elements are those of ``contact_oblique.py``, marched by Hilber, Hughes and Taylor.
"""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from contact_oblique import CORNERS, NU, RHO, E, History, elements, sweep
from scipy.sparse.linalg import splu
from table_format import HERE, write_rows

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache

TABLE = HERE / "contact_rub.csv"
GAP, WIDTH, SPEED, FRICTION = 0.3e-3, 0.15, 800.0, 0.15
SPAN, STEPS, OUTPUTS, START = 0.2 * np.pi / SPEED, 512, 128, 0.38 * np.pi
ROOT, TIP, CHORD, COUNTS = 0.2, 0.3, 0.04, (14, 8, 2)  # elements outwards, along, and through the thickness
AROUND, ROWS = 120, 7  # corners of the casing's triangles


def gap(angle: np.ndarray) -> np.ndarray:
    """Return how far the casing is from the tip at an angle of it [m], along its radius."""
    return GAP * (1.0 - 2.0 * np.exp(-(((np.mod(angle, np.pi) / np.pi - 0.5) / WIDTH) ** 2)))


class Blade:
    """Mesh, matrices of what isn't clamped, and the nodes of the tip that touch."""

    def __init__(self) -> None:
        i, j, k = (a.ravel() for a in np.meshgrid(*[np.arange(n + 1) for n in COUNTS], indexing="ij"))
        out, along, across = i / COUNTS[0], CHORD * (j / COUNTS[1] - 0.5), (4e-3 - 2e-3 * i / COUNTS[0]) * (k / 2 - 0.5)
        turn = np.deg2rad(40.0)
        y = along * np.sin(turn) + across * np.cos(turn) - 0.36 * (TIP - ROOT) * out
        z = along * np.cos(turn) - across * np.sin(turn)
        self.x = np.stack([np.sqrt((ROOT + (TIP - ROOT) * out) ** 2 - y**2), y, z], axis=1)
        number = np.arange(len(self.x)).reshape(np.add(COUNTS, 1))
        n = COUNTS
        self.cells = np.stack([number[a : a + n[0], b : b + n[1], c : c + n[2]].ravel() for a, b, c in CORNERS], axis=1)
        if np.linalg.det(self.x[self.cells[0][[1, 3, 4]]] - self.x[self.cells[0][0]]) < 0:
            self.cells = self.cells[:, [4, 5, 6, 7, 0, 1, 2, 3]]
        places = (3 * self.cells[:, :, None] + np.arange(3)).reshape(len(self.cells), 24)
        rows, columns = np.repeat(places, 24), np.tile(places, (1, 24)).ravel()
        free, size = np.flatnonzero(np.repeat(i > 0, 3)), self.x.size
        self.K, self.M = (
            sp.csc_matrix((values.ravel(), (rows.ravel(), columns)), shape=(size, size))[free][:, free]
            for values in elements(self.x[self.cells])
        )
        at = np.full(size, -1)
        at[free] = np.arange(len(free))
        half = np.where(np.isin(j, (0, COUNTS[1])), 0.5, 1.0) * np.where(k == 1, 1.0, 0.5)  # of a facet's area
        self.root = np.average(self.x[i == 0], axis=0, weights=half[i == 0])
        self.clamped, self.tip = np.flatnonzero(i == 0), np.flatnonzero(i == COUNTS[0])
        self.B = at[3 * self.tip[:, None] + np.arange(3)].ravel()
        self.angle = np.arctan2(self.x[self.tip, 1], self.x[self.tip, 0])
        c, s, o = np.cos(self.angle), np.sin(self.angle), 0 * self.angle
        inwards, around = np.stack([-c, -s, o], axis=1), np.stack([-s, c, o], axis=1)
        self.axes = np.stack([inwards, np.cross(inwards, around), around], axis=1)  # of the casing's forces, by node


def whole_march(blade: Blade, alpha: float = -0.05) -> History:
    """March all unknowns."""
    n, h = len(blade.tip), SPAN / STEPS
    beta, gamma, c = (1 - alpha) ** 2 / 4, 0.5 - alpha, 1 + alpha
    picked = sp.csc_matrix((np.ones(3 * n), (blade.B, np.arange(3 * n))), shape=(blade.K.shape[0], 3 * n))
    B = (picked @ sp.block_diag([axes.T for axes in blade.axes])).tocsc()
    matrix = (blade.M + c * beta * h**2 * blade.K).tocsc()
    solver = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0)
    X = solver.solve(B.toarray())
    D = c * beta * h**2 * (B.T @ X)
    lam, (u, v, a, residual) = np.zeros((n, 3)), np.zeros((4, len(X)))
    forces, heats, strip, work, seconds = [np.zeros(3)], [0.0], np.zeros((n, 3)), 0.0, 0.0
    for k in range(1, STEPS + 1):
        begin = time.process_time()
        u, v = u + h * v + h**2 * (0.5 - beta) * a, v + h * (1 - gamma) * a
        a = solver.solve(alpha * residual - c * (blade.K @ u))
        moved = (B.T @ (u + beta * h**2 * a)).reshape(n, 3)
        moved[:, 0] += gap(START + SPEED * k * h + blade.angle)
        moved[:, 1:] -= strip[:, 1:]
        moved[:, 2] += SPEED * TIP * h  # the tip's way along the casing
        seconds += time.process_time() - begin
        sweep(D, moved, lam, FRICTION)
        work -= np.sum(lam[:, 1:] * (moved + (D @ lam.ravel()).reshape(n, 3))[:, 1:])
        begin = time.process_time()
        a += c * (X @ lam.ravel())
        u, v = u + beta * h**2 * a, v + gamma * h * a
        strip = (B.T @ u).reshape(n, 3)
        residual = blade.K @ u - B @ lam.ravel()
        seconds += time.process_time() - begin
        if k % (STEPS // OUTPUTS) == 0:
            forces.append(np.einsum("pa,pac->c", lam, blade.axes))
            heats.append(work)
    return History(np.array(forces), np.array(heats), seconds)


def our_march(blade: Blade, count: int, folder: Path, keys: dict[str, Any]) -> History:
    """March the scene with some modes; the casing is a rigid body of triangles on a driven hinge."""
    lines = ["*NODE", *(f"{n + 1},{x:.12g},{y:.12g},{z:.12g}" for n, (x, y, z) in enumerate(blade.x))]
    lines += ["*ELEMENT,TYPE=C3D8,ELSET=E"]
    lines += [f"{n + 1},{','.join(map(str, cell + 1))}" for n, cell in enumerate(blade.cells)]
    for name, nodes in {"TIP": blade.tip, "CLAMP": blade.clamped}.items():
        lines += [f"*NSET,NSET={name}", *(f"{n + 1}," for n in nodes)]
    (folder / "fe.inp").write_text("\n".join(lines) + "\n", encoding="utf-8")
    angle = np.linspace(-0.25, SPEED * SPAN + 0.02, AROUND)
    corners = []
    r = TIP * (1.0 + (angle[1] - angle[0]) ** 2 / 12.0) + gap(START + angle)
    for z in np.linspace(-0.017, 0.017, ROWS):
        corners += [f"v {a:.12g} {b:.12g} {z:.12g}" for a, b in zip(r * np.cos(angle), r * np.sin(angle), strict=True)]
    firsts = (np.arange(1, AROUND) + AROUND * np.arange(ROWS - 1)[:, None]).ravel()
    sides = [(k, k + AROUND, k + 1, k + AROUND + 1) for k in firsts]
    corners += [f"f {a} {b} {c}\nf {c} {b} {d}" for a, b, c, d in sides]
    (folder / "casing.obj").write_text("\n".join(corners) + "\n", encoding="utf-8")
    stiff = {"E": 1e6 * E, "nu": NU}
    body = {
        "mesh": {"file": str(folder / "fe.inp"), "unit": "m"},
        "E": E,
        "nu": NU,
        "rho": RHO,
        "modes": {"count": count, "enrich": "none"},
        "support": [{"face": "CLAMP"}],
        "marker": {"clamp": {"face": "CLAMP"}, "tip": {"face": "TIP"}},
    }
    casing = {
        "shape": "rigid",
        "mass": 1.0,
        "inertia": [1.0, 1.0, 1.0],
        "marker": {"axis": {"at": [0, 0, 0]}},
        "surface": {"wall": {"type": "file", "file": str(folder / "casing.obj"), "unit": "m"} | stiff},
    }
    scene = {
        "title": "rub",
        "body": {"blade": body, "casing": casing},
        "ground": {"clamp": {"at": blade.root.round(9).tolist()}, "axis": {"at": [0, 0, 0]}},
        "joint": {
            "hold": {"type": "fixed", "parent": "ground.clamp", "child": "blade.clamp"},
            "turn": {"type": "revolute", "parent": "ground.axis", "child": "casing.axis", "axis": [0, 0, 1]},
        },
        "drive": {"turn": {"type": "motion", "joint": "turn", "angle": {"formula": f"-{SPEED!r}*t", "unit": "rad"}}},
        "contact": {"rub": {"between": ["casing.wall", "blade.tip"], "friction": FRICTION}},
        "simulation": {
            "duration": SPAN,
            "output_step": SPAN / OUTPUTS,
            "gravity": [0, 0, 0],
            "step": "auto",
            "tip": "blade.tip",
            "run": [keys],
        },
    }
    run = Pipeline(load_scene(scene), Cache(None))
    _ = run.system, run.start
    begin = time.process_time()
    own = run.motion.contacts["rub"]
    return History(own.force, own.friction_work, time.process_time() - begin)


def main() -> None:
    """Compare all marches with that of the whole elements, and write their table."""
    blade = Blade()
    marches = {"whole elements": (reference := whole_march(blade))}
    with tempfile.TemporaryDirectory(prefix="fmd-contact-") as scratch:
        folder = Path(scratch)
        for count in (5, 20):
            keys = {"integrator": "central-difference"}
            marches[f"fmd, {count} modes, central differences"] = our_march(blade, count, folder, keys)
    rows = []
    for name, march in marches.items():
        off = np.sqrt(np.mean((march.force - reference.force) ** 2, axis=0)) / np.abs(reference.force).max(axis=0)
        row = {"march": name, "largest_force_N": f"{np.linalg.norm(march.force, axis=1).max():.4g}"}
        row |= {"outwards_rms": f"{off[0]:.2g}", "around_rms": f"{off[1]:.2g}", "heat_J": f"{march.heat[-1]:.4g}"}
        row |= {"impulse_Ns": f"{-march.force[:, 0].sum() * SPAN / OUTPUTS:.4g}"}
        rows.append(row | {"seconds": f"{march.seconds:.2g}"})
        print(rows[-1], flush=True)
    write_rows(TABLE, rows)


if __name__ == "__main__":
    main()

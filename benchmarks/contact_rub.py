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
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from contact_oblique import CORNERS, NU, RHO, E, History, elements, sweep
from table_format import HERE, write_rows

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.reduction.factor.factor import factorise

TABLE = HERE / "contact_rub.csv"
WIDTH, FRICTION, STEPS, OUTPUTS = 0.15, 0.15, 512, 128
ROOT, TIP, CHORD, COUNTS = 0.2, 0.3, 0.04, (14, 8, 2)  # elements outwards, along, and through the thickness


@dataclass(frozen=True)
class Casing:
    """Rigid casing about the z axis that turns, and begins with its lobe before the blade."""

    gap: float  # beside the lobes, and the depth of these [m]
    speed: float  # [rad/s]
    start: float  # its angle at first [rad]
    turn: float  # its turn in the march [rad]
    radius: Callable[[Any], Any]  # of the blade's tip over z [m]
    slope: Callable[[Any], Any]  # the radius' derivative
    heights: tuple[float, float]  # where it begins and ends [m]
    corners: tuple[int, int]  # of its triangles around and along

    @property
    def span(self) -> float:
        """Time of the march [s]."""
        return self.turn / self.speed

    def wider(self, angle: Any) -> Any:
        """Return how much wider than the tip the casing is at an angle of it [m], along its radius."""
        return self.gap * (1.0 - 2.0 * np.exp(-(((np.mod(angle, np.pi) / np.pi - 0.5) / WIDTH) ** 2)))

    def triangles(self, first: float, last: float) -> str:
        """Return a file of triangles for where the blade comes by, its places at angles from the first to the last."""
        (around, along), (low, high) = self.corners, self.heights
        angle, lines = np.linspace(first - 0.02, self.turn + last + 0.02, around), []
        for z in np.linspace(low, high, along):
            r = self.radius(z) * (1.0 + (angle[1] - angle[0]) ** 2 / 12.0) + self.wider(self.start + angle)
            lines += [
                f"v {a:.12g} {b:.12g} {z:.12g}" for a, b in zip(r * np.cos(angle), r * np.sin(angle), strict=True)
            ]
        firsts = (np.arange(1, around) + around * np.arange(along - 1)[:, None]).ravel()
        sides = [(k, k + around, k + 1, k + around + 1) for k in firsts]
        lines += [f"f {a} {b} {c}\nf {c} {b} {d}" for a, b, c, d in sides]
        return "\n".join(lines) + "\n"


class Blade:
    """Mesh, matrices of what isn't clamped, and the points of the tip that touch."""

    element, damping = "C3D8", 0.0  # its kind, and the damping over the mass [1/s]
    x: np.ndarray  # nodes [m]
    cells: np.ndarray
    clamped: np.ndarray  # nodes
    tip: np.ndarray  # nodes of the face that touches
    points: np.ndarray  # those of them that have forces
    B: np.ndarray  # the points' coordinates among those of the matrices
    K: Any
    M: Any
    density: float

    def place(self, casing: Casing) -> None:
        """Find where the points are about the casing's axis, and the directions of its forces on them."""
        at = self.x[self.points]
        self.casing, self.angle, radius = casing, np.arctan2(at[:, 1], at[:, 0]), np.hypot(at[:, 0], at[:, 1])
        c, s, o, slope = np.cos(self.angle), np.sin(self.angle), 0 * self.angle, casing.slope(at[:, 2])
        self.share = 1.0 / np.hypot(1.0, slope)  # of the radial gap that is along the normal
        self.off, self.way = radius - casing.radius(at[:, 2]), radius * casing.speed
        inwards, around = self.share[:, None] * np.stack([-c, -s, slope], axis=1), np.stack([-s, c, o], axis=1)
        self.axes = np.stack([inwards, np.cross(inwards, around), around], axis=1)

    def gaps(self, t: float) -> np.ndarray:
        """Return the gaps of the undeformed blade along the normals [m], shape (points,)."""
        casing = self.casing
        return self.share * (casing.wider(casing.start + casing.speed * t + self.angle) - self.off)


class Plate(Blade):
    """Plate of hexahedra, aslant and leant back, whose tip is on a cylinder."""

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
        self.clamped, self.tip, self.density = np.flatnonzero(i == 0), np.flatnonzero(i == COUNTS[0]), RHO
        self.points, self.B = self.tip, at[3 * self.tip[:, None] + np.arange(3)].ravel()
        heights = -0.017, 0.017
        self.place(
            Casing(0.3e-3, 800.0, 0.38 * np.pi, 0.2 * np.pi, lambda z: TIP + 0 * z, np.zeros_like, heights, (120, 7))
        )


def whole_march(blade: Blade, alpha: float = -0.05) -> History:
    """March all unknowns; the seconds are without the sweeps of the contact."""
    n, h, damping = len(blade.points), blade.casing.span / STEPS, blade.damping
    beta, gamma, c = (1 - alpha) ** 2 / 4, 0.5 - alpha, 1 + alpha
    picked = sp.csc_matrix((np.ones(3 * n), (blade.B, np.arange(3 * n))), shape=(blade.K.shape[0], 3 * n))
    B = (picked @ sp.block_diag([axes.T for axes in blade.axes])).tocsc()
    begin = time.process_time()
    solve = factorise((blade.M * (1 + c * damping * gamma * h) + c * beta * h**2 * blade.K).tocsr()).solve
    X = np.concatenate([solve(B[:, k : k + 24].toarray()) for k in range(0, 3 * n, 24)], axis=1)
    seconds = time.process_time() - begin
    D = c * beta * h**2 * (B.T @ X)
    lam, (u, v, a, residual) = np.zeros((n, 3)), np.zeros((4, len(X)))
    forces, heats, strip, work = [np.zeros(3)], [0.0], np.zeros((n, 3)), 0.0
    for k in range(1, STEPS + 1):
        begin = time.process_time()
        u, v = u + h * v + h**2 * (0.5 - beta) * a, v + h * (1 - gamma) * a
        a = solve(alpha * residual - c * (damping * (blade.M @ v) + blade.K @ u))
        moved = (B.T @ (u + beta * h**2 * a)).reshape(n, 3)
        moved[:, 0] += blade.gaps(k * h)
        moved[:, 1:] -= strip[:, 1:]
        moved[:, 2] += blade.way * h  # the tip's way along the casing
        seconds += time.process_time() - begin
        sweep(D, moved, lam, FRICTION)
        work -= np.sum(lam[:, 1:] * (moved + (D @ lam.ravel()).reshape(n, 3))[:, 1:])
        begin = time.process_time()
        a += c * (X @ lam.ravel())
        u, v = u + beta * h**2 * a, v + gamma * h * a
        strip = (B.T @ u).reshape(n, 3)
        residual = damping * (blade.M @ v) + blade.K @ u - B @ lam.ravel()
        seconds += time.process_time() - begin
        if k % (STEPS // OUTPUTS) == 0:
            forces.append(np.einsum("pa,pac->c", lam, blade.axes))
            heats.append(work)
    return History(np.array(forces), np.array(heats), seconds)


def our_march(blade: Blade, count: int, folder: Path, keys: dict[str, Any]) -> History:
    """March the scene with some modes; the casing is a rigid body of triangles on a driven hinge."""
    casing = blade.casing
    lines = ["*NODE", *(f"{n + 1},{x:.12g},{y:.12g},{z:.12g}" for n, (x, y, z) in enumerate(blade.x))]
    lines += [f"*ELEMENT,TYPE={blade.element},ELSET=E"]
    lines += [f"{n + 1},{','.join(map(str, cell + 1))}" for n, cell in enumerate(blade.cells)]
    for name, nodes in {"TIP": blade.tip, "CLAMP": blade.clamped}.items():
        lines += [f"*NSET,NSET={name}", *(f"{n + 1}," for n in nodes)]
    (folder / "fe.inp").write_text("\n".join(lines) + "\n", encoding="utf-8")
    triangles = casing.triangles(blade.angle.min(), blade.angle.max())
    (folder / "casing.obj").write_text(triangles, encoding="utf-8")
    clamp, wall = {"at": blade.x[blade.clamped[0]].tolist()}, {"type": "file", "file": str(folder / "casing.obj")}
    body = {
        "mesh": {"file": str(folder / "fe.inp"), "unit": "m"},
        "E": E,
        "nu": NU,
        "rho": blade.density,
        "modes": {"count": count, "enrich": "none", "damping": blade.damping and {"alpha": blade.damping}},
        "support": [{"face": "CLAMP"}],
        "marker": {"clamp": clamp, "tip": {"face": "TIP"}},
    }
    rigid = {
        "shape": "rigid",
        "mass": 1.0,
        "inertia": [1.0, 1.0, 1.0],
        "marker": {"axis": {"at": [0, 0, 0]}},
        "surface": {"wall": wall | {"unit": "m", "E": 1e6 * E, "nu": NU}},
    }
    angle = {"formula": f"-{casing.speed!r}*t", "unit": "rad"}
    scene = {
        "title": "rub",
        "body": {"blade": body, "casing": rigid},
        "ground": {"clamp": clamp, "axis": {"at": [0, 0, 0]}},
        "joint": {
            "hold": {"type": "fixed", "parent": "ground.clamp", "child": "blade.clamp"},
            "turn": {"type": "revolute", "parent": "ground.axis", "child": "casing.axis", "axis": [0, 0, 1]},
        },
        "drive": {"turn": {"type": "motion", "joint": "turn", "angle": angle}},
        "contact": {"rub": {"between": ["casing.wall", "blade.tip"], "friction": FRICTION}},
        "simulation": {
            "duration": casing.span,
            "output_step": casing.span / OUTPUTS,
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


def write_table(table: Path, reference: History, marches: dict[str, History], span: float) -> None:
    """Write what the marches give beside that of the whole elements."""
    rows = []
    for name, march in ({"whole elements": reference} | marches).items():
        off = np.sqrt(np.mean((march.force - reference.force) ** 2, axis=0)) / np.abs(reference.force).max(axis=0)
        row = {"march": name, "largest_force_N": f"{np.linalg.norm(march.force, axis=1).max():.4g}"}
        row |= {"outwards_rms": f"{off[0]:.2g}", "around_rms": f"{off[1]:.2g}", "heat_J": f"{march.heat[-1]:.4g}"}
        row |= {"impulse_Ns": f"{-march.force[:, 0].sum() * span / OUTPUTS:.4g}"}
        rows.append(row | {"seconds": f"{march.seconds:.2g}"})
        print(rows[-1], flush=True)
    write_rows(table, rows)


def main() -> None:
    """Compare all marches with that of the whole elements, and write their table."""
    blade, marches = Plate(), {}
    with tempfile.TemporaryDirectory(prefix="fmd-contact-") as scratch:
        for count in (5, 20):
            keys = {"integrator": "central-difference"}
            marches[f"fmd, {count} modes, central differences"] = our_march(blade, count, Path(scratch), keys)
    write_table(TABLE, whole_march(blade), marches, blade.casing.span)


if __name__ == "__main__":
    main()

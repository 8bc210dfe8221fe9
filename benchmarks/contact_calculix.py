"""Pressed blocks, a pin in a bore and an interference fit beside CalculiX, written to contact_calculix.csv.

Run from the project's root: ``python benchmarks/contact_calculix.py``; it takes ``ccx`` (2.20). Both programs have the
same hexahedra (C3D8I, and ours with enhanced strains), in N and mm. Of each case a row has the force on the body that
is driven, the mean and the largest pressure of the points that touch, and how far pressures at nodes differ, as a root
of the mean square over the largest; the fit has Lamé's pressure of a thick ring on a thick tube, too. CalculiX has
contact of nodes on surfaces, with a spring of 10⁷ N/mm³ for a hard one, and of surfaces on surfaces where parts overlap
as drawn, from which the other doesn't converge.
"""

import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from table_format import HERE, write_rows

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array, IntArray
from fmd.core.cache import Cache
from fmd.integrators.protocol import evaluate

TABLE = HERE / "contact_calculix.csv"
PASSES = 50
Sets = dict[str, Callable[[Array], Any]]


@dataclass(frozen=True)
class Part:
    """A block of hexahedra, mapped to its shape, with sets of nodes, and how these are held.

    A joint carries it by ``carried``, a set whose mean stays where it is; a closed part's second coordinate goes round.
    """

    counts: tuple[int, int, int]
    shape: Callable[[Array], Array]
    sets: Sets
    held: dict[str, str]
    E: float
    nu: float
    carried: str
    closed: bool = False

    @property
    def unit(self) -> Array:
        """Places of the nodes in the unit cube, shape (n, 3)."""
        axes = [np.linspace(0.0, 1.0, n + 1) for n in self.counts]
        axes[1] = axes[1][: len(axes[1]) - self.closed]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    @property
    def cells(self) -> IntArray:
        """Corners of the elements, shape (n, 8)."""
        counts = np.add(self.counts, (1, 1 - self.closed, 1))
        number = np.arange(np.prod(counts)).reshape(counts)
        number = np.concatenate([number, number[:, :1]], axis=1) if self.closed else number
        low, high = slice(None, -1), slice(1, None)
        ring = [(low, low), (high, low), (high, high), (low, high)]
        return np.stack([number[i, j, k].ravel() for k in (low, high) for i, j in ring], axis=1)

    def deck(self, name: str, first: int) -> list[str]:
        """Return nodes, elements and sets, numbered from ``first`` on, their names with the part's."""
        u = self.unit
        x = self.shape(u).round(12)
        lines = [f"*NODE,NSET=ALL{name}"]
        lines += [f"{first + k},{x:.12g},{y:.12g},{z:.12g}" for k, (x, y, z) in enumerate(x)]
        lines += [f"*ELEMENT,TYPE=C3D8I,ELSET=E{name}"]
        lines += [f"{first + k},{','.join(str(first + n) for n in row)}" for k, row in enumerate(self.cells)]
        for own, where in self.sets.items():
            lines += [f"*NSET,NSET={own}{name}", *(f"{first + n}," for n in np.flatnonzero(where(u)))]
        return lines


@dataclass(frozen=True)
class Case:
    """Two parts that touch; the first is driven by a distance along an axis, if any."""

    name: str
    parts: tuple[Part, Part]
    faces: tuple[str, str]
    axis: int = 0
    drive: float = 0.0
    exact: float | None = None


def end(axis: int, at: float) -> Callable[[Array], Any]:
    """Return what tells the nodes at an end of the unit cube."""
    return lambda u: np.abs(u[:, axis] - at) < 1e-9


def box(size: tuple[float, float, float], corner: tuple[float, float, float]) -> Callable[[Array], Array]:
    """Return the map of a block."""
    return lambda u: np.array(corner) + u * size


def ring(inner: float, outer: float, angles: tuple[float, float], width: float) -> Callable[[Array], Array]:
    """Return the map of a part of a ring: the radius by the first coordinate, the angle by the second."""

    def place(u: Array) -> Array:
        r, angle = inner + u[:, 0] * (outer - inner), angles[0] + u[:, 1] * (angles[1] - angles[0])
        return np.stack([r * np.cos(angle), r * np.sin(angle), width * u[:, 2]], axis=1)

    return place


def cases() -> list[Case]:
    """Return all cases."""
    steel, brass = (210e3, 0.3), (100e3, 0.35)
    low, high = end(2, 0.0), end(2, 1.0)
    sets: Sets = {"TOUCH": low, "DRIVEN": high}
    block = Part((8, 8, 8), box((40, 40, 40), (0, 0, 0)), sets, {"DRIVEN": "xyz"}, *steel, "DRIVEN")
    sets = {"TOUCH": high, "HELD": low}
    foot = Part((8, 8, 4), box((40, 40, 15), (0, 0, -15)), sets, {"HELD": "xyz"}, *brass, "HELD")
    whole, inside, outside = (0.0, 2 * np.pi), end(0, 0.0), end(0, 1.0)
    sets = {"TOUCH": outside, "DRIVEN": inside}
    pin = Part((5, 120, 1), ring(4.0, 9.98, whole, 2.0), sets, {"DRIVEN": "xyz"}, *steel, "DRIVEN", closed=True)
    sets, turned = {"TOUCH": inside, "HELD": outside}, (np.pi / 120, 2 * np.pi + np.pi / 120)
    bore = Part((7, 120, 1), ring(10.0, 25.0, turned, 2.0), sets, {"HELD": "xyz"}, *steel, "HELD", closed=True)
    a, b, c, overlap = 10.0, 20.0, 40.0, 0.02
    inner, outer = ring(a, b, whole, 8.0), ring(b - overlap, c, whole, 8.05)
    held = {"SIDE": "y", "TOP": "x", "MIDDLE": "z"}
    tube = Part((6, 48, 2), inner, _free(outside, inside), held, *steel, "BACK", closed=True)
    hub = Part((10, 48, 2), outer, _free(inside, outside), held, *steel, "BACK", closed=True)
    (E, _), k = steel, (b**2 + a**2) / (b**2 - a**2) + (c**2 + b**2) / (c**2 - b**2)
    return [
        Case("blocks", (block, foot), ("TOUCH", "TOUCH"), axis=2, drive=-0.02),
        Case("pin in bore", (pin, bore), ("TOUCH", "TOUCH"), axis=1, drive=-0.03),
        Case(
            "interference fit",
            (tube, hub),
            ("TOUCH", "TOUCH"),
            exact=E * overlap / (b * k),
        ),
    ]


def _free(touch: Callable[[Array], Any], away: Callable[[Array], Any]) -> Sets:
    """Return sets of a ring that is held away from its contact as symmetry lets it be."""
    middle = end(2, 0.5)
    return {
        "TOUCH": touch,
        "BACK": end(2, 0.0),
        "MIDDLE": lambda u: away(u) & middle(u),
        "SIDE": lambda u: away(u) & middle(u) & ((2 * u[:, 1]) % 1.0 < 1e-9),
        "TOP": lambda u: away(u) & middle(u) & ((2 * u[:, 1] + 0.5) % 1.0 < 1e-9),
    }


def place_parts(case: Case, folder: Path) -> tuple[Pipeline, dict[str, Array]]:
    """Return the scene of a case, and where each body's frame is in its mesh [m]."""
    scene: dict[str, Any] = {"title": case.name, "body": {}, "joint": {}, "ground": {}}
    for k, part in enumerate(case.parts):
        path = folder / f"part{k}.inp"
        path.write_text("\n".join(part.deck(str(k), 1)) + "\n", encoding="utf-8")
        scene["body"][f"p{k}"] = {
            "mesh": {"file": str(path), "unit": "mm"},
            "E": part.E * 1e6,
            "nu": part.nu,
            "rho": 7850.0,
            "modes": {"count": 2, "enrich": "none"},
            "support": [{"face": f"{name}{k}", "fixed": list(axes)} for name, axes in part.held.items()],
            "marker": {"carried": {"face": f"{part.carried}{k}"}, "touch": {"face": f"{case.faces[k]}{k}"}},
        }
        scene["joint"][f"j{k}"] = {"type": "fixed", "parent": f"ground.g{k}", "child": f"p{k}.carried"}
        scene["ground"][f"g{k}"] = {"at": [0.0, 0.0, 0.0]}
    scene["contact"] = {"fit": {"between": ["p1.touch", "p0.touch"]}}
    scene["simulation"] = {"duration": "1 us", "output_step": "1 us", "step": "auto", "gravity": [0.0, 0.0, 0.0]}
    scene["simulation"] |= {"tip": "p0.touch", "run": [{"integrator": "central-difference"}]}
    drawn = Pipeline(load_scene(scene), Cache(None))
    origins = {name: whole.markers["carried"].position for name, whole in drawn.wholes.items()}
    for k in range(2):
        place = origins[f"p{k}"].copy()
        place[case.axis] += 1e-3 * case.drive * (k == 0)
        scene["ground"][f"g{k}"]["at"] = place.round(12).tolist()
    return Pipeline(load_scene(scene), Cache(None)), origins


def find_rest(run: Pipeline, origins: dict[str, Array]) -> tuple[float, Array, Array]:
    """Find the modes at rest; return the force on the driven body [N], places [mm] and pressures [MPa] of points."""
    p, n = run.system.parameters, run.mechanism.n
    q, M = run.start[0].copy(), run.system.mass_matrix(run.start[0])
    modes = np.concatenate([run.mechanism.modes_of(link) for link in range(2)])

    def forces(x: Array) -> Array:
        q[run.mechanism.position_shift + modes], a = x, np.zeros(n)
        evaluate(p, 0.0, q, np.zeros(n), a)
        return np.asarray((M @ a)[modes])

    table, counted = p.contact, p.contact.areas > 0.0
    largest = max(np.abs(own.points.shapes).max() for own in run.mechanism.contacts)
    x, stiffness = np.zeros(len(modes)), np.concatenate([link.omega for link in run.mechanism.links]) ** 2
    for _ in range(PASSES):  # Newton's method; forces are linear as long as the same points touch
        now, whole = forces(x), np.abs(table.force).sum() * largest
        if np.abs(now).max() < 1e-9 * whole:
            break
        steps = 1e-6 * np.diag(whole / stiffness)
        jacobian = np.stack([(forces(x + step) - now) / step.sum() for step in steps], axis=1)
        x += np.linalg.solve(jacobian, -now)
    else:
        raise RuntimeError("the modes don't come to rest")
    (touching,) = (own for own in run.mechanism.contacts if own.pairs)
    driven = [link.name for link in run.mechanism.links].index("p0")
    pressures = 1e-6 * table.force[counted, 0] / table.areas[counted]
    points = touching.points
    places = points.x[points.faces["touch"]] + origins[touching.body]
    return float(np.linalg.norm(table.push[driven, :3])), 1e3 * places, pressures


def by_calculix(case: Case, folder: Path) -> tuple[float, list[Array], list[Array]]:
    """Return the force on the driven body [N], and places [mm] and pressures [MPa] of nodes of each part."""
    first = [1, 1 + len(case.parts[0].unit)]
    lines = list[str]()
    for k, part in enumerate(case.parts):
        lines += part.deck(str(k), first[k])
        lines += [f"*MATERIAL,NAME=M{k}", "*ELASTIC", f"{part.E},{part.nu}"]
        lines += [f"*SOLID SECTION,ELSET=E{k},MATERIAL=M{k}"]
    for k, part in enumerate(case.parts):
        lines += [f"*SURFACE,NAME=S{k},TYPE=ELEMENT", *_facets(part, case.faces[k], first[k])]
    lines += ["*SURFACE INTERACTION,NAME=HARD", "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR", "1e7,0.01"]
    lines += [f"*CONTACT PAIR,INTERACTION=HARD,TYPE={'NODE' if case.drive else 'SURFACE'} TO SURFACE", "S0,S1"]
    lines += ["*STEP,INC=100", "*STATIC", "0.2,1.,1e-5,0.2" if case.drive else "1.,1."]
    lines += ["*BOUNDARY"]
    for k, part in enumerate(case.parts):
        for name, axes in part.held.items():
            for axis in axes:
                moved = case.drive if name == "DRIVEN" and "xyz".index(axis) == case.axis else 0.0
                lines += [f"{name}{k},{'xyz'.index(axis) + 1},,{moved}"]
    lines += ["*NODE FILE", "RF,U", "*CONTACT FILE", "CDIS,CSTR", "*END STEP"]
    (folder / "job.inp").write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = subprocess.run(["ccx", "job"], cwd=folder, capture_output=True, text=True, check=False)
    blocks = _read_frd(folder / "job.frd")
    if "CONTACT" not in blocks:
        raise RuntimeError(done.stdout[-3000:])
    values, forces = blocks["CONTACT"], blocks["FORC"]
    places, pressures, force = [], [], 0.0
    for k, part in enumerate(case.parts):
        nodes = np.flatnonzero(part.sets[case.faces[k]](part.unit))
        places.append(part.shape(part.unit)[nodes])
        pressures.append(np.array([values.get(first[k] + n, [0.0] * 6)[3] for n in nodes]))
        if "DRIVEN" in part.sets:
            driven = np.flatnonzero(part.sets["DRIVEN"](part.unit))
            force = abs(sum(forces[first[k] + n][case.axis] for n in driven))
    return force, places, pressures


_FACES = {(0, 1, 2, 3): 1, (4, 5, 6, 7): 2, (0, 1, 4, 5): 3, (1, 2, 5, 6): 4, (2, 3, 6, 7): 5, (0, 3, 4, 7): 6}


def _facets(part: Part, name: str, first: int) -> list[str]:
    """Return the element faces on a set of nodes."""
    on = part.sets[name](part.unit)[part.cells]
    return [
        f"{first + k},S{number}"
        for k, row in enumerate(on)
        for corners, number in _FACES.items()
        if row[list(corners)].all()
    ]


def _read_frd(path: Path) -> dict[str, dict[int, list[float]]]:
    """Return the values by node of each block of the last step."""
    blocks: dict[str, dict[int, list[float]]] = {}
    name = ""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        if line.startswith(" -4"):
            name = line.split()[1]
            blocks[name] = {}
        elif line.startswith(" -1") and name:
            values = [float(line[k : k + 12]) for k in range(13, len(line.rstrip()), 12)]
            blocks[name][int(line[3:13])] = values
        elif line.startswith(" -3"):
            name = ""
    return blocks


def compare(case: Case, folder: Path) -> dict[str, str]:
    """Return the row of a case."""
    ours, places, mine = find_rest(*place_parts(case, folder))
    theirs, of_nodes, pressures = by_calculix(case, folder)
    (k,) = (k for k in range(2) if pressures[k].any())
    other = pressures[k][cKDTree(of_nodes[k]).query(places)[1]]
    rms = np.sqrt(np.mean((mine - other) ** 2)) / other.max()
    forces = (f"{ours:.5g}", f"{theirs:.5g}") if case.drive else ("", "")
    row = {"case": case.name, "force_N": forces[0], "calculix_force_N": forces[1]}
    row |= {"mean_MPa": f"{mine[mine > 0].mean():.4g}", "calculix_mean_MPa": f"{other[other > 0].mean():.4g}"}
    row |= {"largest_MPa": f"{mine.max():.4g}", "calculix_largest_MPa": f"{other.max():.4g}"}
    return row | {"rms_of_largest": f"{rms:.2g}", "exact_MPa": "" if case.exact is None else f"{case.exact:.4g}"}


def main() -> None:
    """Compare all cases, and write their table."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="fmd-contact-") as scratch:
        for number, case in enumerate(cases()):
            folder = Path(scratch) / str(number)
            folder.mkdir()
            rows.append(compare(case, folder))
            print(rows[-1], flush=True)
    write_rows(TABLE, rows)


if __name__ == "__main__":
    main()

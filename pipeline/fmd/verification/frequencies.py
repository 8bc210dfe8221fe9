"""Cases of free and supported bodies at rest: beams, plates, a box, the paper's Table 1."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.fem.material import Material
from fmd.scene.scene import load_scene
from fmd.verification.case import Figure, VerificationCase, make_figures, open_scene
from fmd.verification.closed_forms import free_box, plate_shear, supported_plate, timoshenko_free, timoshenko_supported

STEEL = Material(210e9, 0.3, 7800.0)  # of models/verification
_ENDS = 'body.beam.support=[{face="x-", fixed=["y"]}, {face="x+", fixed=["y"]}]'
_ABAQUS_SCENE = """
title = "Free box from an Abaqus input file"
[body.box]
mesh = { file = "box.inp", unit = "mm" }
E = "210 GPa"
nu = 0.3
rho = "7800 kg/m^3"
modes = { count = 6 }
"""
_FREE_PLATE = ('body.plate.width="10 mm"', "body.plate.mesh.divisions=[16, 16, 1]", "body.plate.support=[]")


def _mode_figures(published: Array, ours: Array, tolerance: float) -> list[Figure]:
    return make_figures([f"mode {k + 1} [Hz]" for k in range(len(published))], ours, published, tolerance)


def _table_1(cache: Cache | None) -> list[Figure]:
    run = open_scene("beam", cache)
    assert run.scene.reference is not None
    return _mode_figures(np.array(run.scene.reference.frequencies), run.modes.frequencies_hz, 5e-3)


def _free_beam(cache: Cache | None) -> list[Figure]:
    run = open_scene("verification/beam", cache)
    return _mode_figures(timoshenko_free(1.0, 0.1, STEEL, 3), run.modes.frequencies_hz, 3e-3)


def _supported_beam(cache: Cache | None) -> list[Figure]:
    run = open_scene("verification/beam", cache, [_ENDS])
    return _mode_figures(timoshenko_supported(1.0, 0.1, STEEL, 3), run.modes.frequencies_hz, 3e-3)


def _supported_plate(cache: Cache | None) -> list[Figure]:
    ours = open_scene("verification/plate", cache).modes.frequencies_hz
    bending = [(1, 1), (1, 2), (2, 1), (2, 2), (1, 3), (3, 1)]
    exact = [(supported_plate(1.0, 0.1, STEEL, m, n), f"bending ({m}, {n}) [Hz]") for m, n in bending]
    exact += [(plate_shear(1.0, STEEL, m, n), f"shear ({m}, {n}) [Hz]") for m, n in ((1, 0), (0, 1))]
    exact.sort()
    return make_figures([name for _, name in exact], ours, [value for value, _ in exact], 2e-3)


def _free_plate(cache: Cache | None) -> list[Figure]:
    run = open_scene("verification/plate", cache, _FREE_PLATE)
    side, thickness = 1.0, 0.01
    rigidity = STEEL.E * thickness**3 / (12 * (1 - STEEL.nu**2))
    scale = np.sqrt(rigidity / (STEEL.rho * thickness)) / side**2
    published = [13.489, 19.789, 24.432, 35.024, 35.024, 61.526]
    names = [f"ω a² √(ρh/D), mode {k + 1}" for k in range(6)]
    return make_figures(names, run.modes.omega[:6] / scale, published, 0.012)


def _fv52(cache: Cache | None) -> list[Figure]:
    run = open_scene("verification/fv52", cache)
    published = np.array([45.897, 109.44, 109.44, 167.89, 193.59, 206.19, 206.19])
    figures = _mode_figures(published, run.modes.frequencies_hz, 0.025)
    return [*figures, Figure("rigid motions left", float(run.modes.n_rigid), 3.0, 0.0)]


def _box(cache: Cache | None) -> list[Figure]:
    run = open_scene("verification/box", cache)
    return _mode_figures(free_box((0.1, 0.07, 0.05), STEEL, 6, 11), run.modes.frequencies_hz, 1e-3)


def _abaqus_box(cache: Cache | None) -> list[Figure]:
    with TemporaryDirectory(prefix="fmd-") as folder:
        write_abaqus_box(Path(folder) / "box.inp", [np.linspace(0, *own) for own in ((100, 9), (70, 7), (50, 6))])
        scene = Path(folder) / "box.toml"
        scene.write_text(_ABAQUS_SCENE, encoding="utf-8")
        run = SolvedScene(load_scene(scene), cache).run
        figures = _mode_figures(free_box((0.1, 0.07, 0.05), STEEL, 6, 11), run.modes.frequencies_hz, 1e-3)
        return [*figures, Figure("volume [m³]", run.mesh.volume, 0.1 * 0.07 * 0.05, 1e-9)]


def write_abaqus_box(path: Path, borders: Sequence[Array], top: float = np.inf) -> None:
    """Write a box of 20-node bricks between borders along x, y and z to an Abaqus file in their unit.

    The nodes at the first x are the set LEFT, and facets at the last z whose middles are less than ``top`` off the
    axes along x and y the surface TOP.
    """
    number: dict[tuple[int, ...], int] = {}
    elements: list[list[int]] = []
    around = ((0, 0), (1, 0), (1, 1), (0, 1))
    corners = np.array([(x, y, z) for z in (0, 1) for x, y in around])
    edges = [(k, (k + 1) % 4) for k in range(4)]
    edges += [(4 + a, 4 + b) for a, b in edges] + [(k, k + 4) for k in range(4)]
    local = np.concatenate([2 * corners, [corners[a] + corners[b] for a, b in edges]])  # in half elements
    divisions = [len(own) - 1 for own in borders]
    facets = []
    for cell in np.ndindex(*divisions):
        places = 2 * np.array(cell) + local
        off = max(abs(own[k] + own[k + 1]) / 2 for own, k in zip(borders[:2], cell[:2], strict=True))
        facets += [len(elements) + 1] if cell[2] == divisions[2] - 1 and off < top else []
        elements.append([number.setdefault(tuple(place), len(number) + 1) for place in places.tolist()])
    axes = [np.interp(np.arange(2 * len(own) - 1) / 2, np.arange(len(own)), own) for own in borders]
    lines = ["*HEADING", "box", "*NODE"]
    lines += [f"{k}, " + ", ".join(f"{axes[a][x]:.12g}" for a, x in enumerate(place)) for place, k in number.items()]
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=BOX")
    for k, nodes in enumerate(elements, 1):  # at most 16 numbers in a line
        lines += [f"{k}, " + ", ".join(map(str, nodes[:15])) + ",", ", ".join(map(str, nodes[15:]))]
    lines.append("*NSET, NSET=LEFT")
    lines += [f"{k}," for place, k in number.items() if place[0] == 0]
    lines += ["*SURFACE, NAME=TOP, TYPE=ELEMENT", *(f"{k}, S2" for k in facets)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


HUANG = "Huang, J Appl Mech 28 (1961)"
_SRINIVAS = "Srinivas et al., J Sound Vib 12 (1970)"
_VISSCHER = "Visscher et al., J Acoust Soc Am 90 (1991)"
CASES = (
    VerificationCase("table-1", "the paper's beam, free", "Miao et al., Comput Mech 41 (2008), Table 1", _table_1),
    VerificationCase("beam-free", "thick beam, free", HUANG, _free_beam),
    VerificationCase("beam-supported", "thick beam, simply supported", HUANG, _supported_beam),
    VerificationCase("plate-free", "thin square plate, free", "Leissa, J Sound Vib 31 (1973)", _free_plate),
    VerificationCase("plate-supported", "thick plate, supported", _SRINIVAS, _supported_plate),
    VerificationCase("fv52", "solid plate on its lower edges", "NAFEMS FV52", _fv52),
    VerificationCase("box-free", "box, free", _VISSCHER, _box),
    VerificationCase("box-abaqus", "box, free, from an Abaqus file", _VISSCHER, _abaqus_box),
)

"""Error of natural frequencies against the time they take, for each element and mesh of beam and propeller.

Run from the project's root: ``python benchmarks/modes.py``. Writes ``modes.csv`` and a chart of each scene.
"""

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from threadpoolctl import threadpool_limits

sys.path.append(str(Path(__file__).parents[1]))
from benchmarks.table_format import machine, write_rows
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.render.plane_charts import draw_work_precision
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline

_IN_PLANE = 0.5  # share of a mode's movement along y: above 0.8 in the plane, in all other modes below 0.25
_REFINED = (1.0, 1.5, 2.0)  # meshes of a reference, in elements each way
_SHORT = 2.0  # s, below which a time is measured twice


@dataclass(frozen=True)
class ModeStudyRow:
    """Largest relative error of one mesh, and processor time of assembly and modes, the less of two short runs."""

    scene: str
    element: str
    mesh: str
    unknowns: int
    seconds: float
    error: float


@dataclass(frozen=True)
class ModeStudy:
    """A scene, its meshes with overrides, three meshes of each of two elements as references, and what is compared."""

    scene: str
    meshes: tuple[tuple[str, str, tuple[str, ...]], ...]
    references: tuple[tuple[tuple[str, ...], ...], ...]
    frequencies: Callable[[Pipeline], Array]


@dataclass(frozen=True)
class ConvergedFrequencies:
    """Limits of frequencies [Hz], how far two elements differ on them, and unknowns of the finest mesh."""

    frequencies: Array
    uncertainty: float
    unknowns: int


def _beam(element: str, *counts: float) -> tuple[str, ...]:
    """Return the beam's overrides for numbers of hexahedra along x, y and z, or a size of tetrahedra [mm]."""
    size = f"divisions={list(counts)}" if len(counts) == 3 else f"size='{counts[0]:g} mm'"
    return f"body.beam.mesh={{{_KEYS[element]},{size}}}", "body.beam.modes.family=any", "body.beam.modes.count=20"


def _propeller(element: str, *counts: float) -> tuple[str, ...]:
    """Return the propeller's overrides for counts of elements.

    They are along the chord, across the joint and the gap, through the sleeve, along joint and blade.
    """
    chord, across, gap, sleeve, joint, blade = counts
    mesh = f"{_KEYS[element]},sleeve=[{6 * (across + gap)},{chord},{sleeve}],growth=4.0"
    return (
        f"body.propeller.mesh={{{mesh},joint=[{chord},{across},{joint}],blade=[{chord},{across},{blade}]}}",
        "body.propeller.seat='43.636363636 deg'",  # the ready scene's, of 8 elements of 66 around
        "body.propeller.modes.count=6",
    )


def _in_plane(run: Pipeline) -> Array:
    """Return the first five frequencies of bending along y, on a mesh of any symmetry."""
    shapes = run.modes.shapes
    share = np.einsum("nj,nj->j", shapes[:, 1], shapes[:, 1]) / np.einsum("naj,naj->j", shapes, shapes)
    return np.asarray(run.modes.frequencies_hz[share > _IN_PLANE][:5])


# Elements by name, with the keys of a scene's mesh that choose them.
_KEYS = {
    "hex8": "element='hexahedron',order=1",
    "plain hex8": "element='hexahedron',order=1,formulation='plain'",
    "hex20": "element='hexahedron',order=2",
    "tet4": "element='tetrahedron',order=1",
    "tet10": "element='tetrahedron',order=2",
}
_BEAM_MESHES = {
    "hex8": ((30, 3, 1), (60, 3, 1), (120, 3, 1), (200, 3, 1), (240, 4, 1), (300, 5, 2)),
    "plain hex8": ((60, 5, 2), (120, 10, 4), (240, 20, 8), (300, 24, 10)),
    "hex20": ((16, 2, 1), (24, 2, 1), (24, 3, 1), (30, 3, 1), (36, 3, 1), (48, 4, 1), (60, 5, 2), (90, 8, 3)),
    "tet4": ((5.0,), (3.0,), (2.0,), (1.5,)),
    "tet10": ((20.0,), (15.0,), (12.0,), (10.0,), (8.0,), (6.0,), (4.0,)),
}
_LINEAR = ((5, 4, 2, 2, 6, 14), (10, 8, 3, 3, 12, 27), (15, 12, 4, 4, 18, 36))
_PROPELLER_MESHES = {
    "hex8": ((4, 2, 1, 2, 4, 9), *_LINEAR[:1], (8, 4, 2, 3, 8, 20), *_LINEAR[1:]),
    "plain hex8": _LINEAR,
    "hex20": (
        *((4, 1, 1, 1, 3, 6), (4, 2, 1, 1, 4, 9), (4, 2, 1, 2, 4, 9), (4, 3, 1, 2, 4, 9), (5, 3, 1, 3, 5, 11)),
        *((5, 4, 2, 3, 5, 11), (6, 4, 2, 3, 6, 12), (8, 5, 2, 4, 8, 15)),
    ),
    "tet4": _LINEAR[:2],
    "tet10": ((4, 2, 1, 2, 4, 9), (6, 4, 2, 3, 6, 12), (9, 6, 3, 4, 9, 18)),
}


def _mode_study(
    scene: str,
    overrides: Callable[..., tuple[str, ...]],
    meshes: Mapping[str, Sequence[Sequence[float]]],
    references: Sequence[Sequence[tuple[str, ...]]],
    frequencies: Callable[[Pipeline], Array],
) -> ModeStudy:
    """Name the meshes of a study, and make the overrides of each."""
    rows = ((element, counts) for element, several in meshes.items() for counts in several)
    named = ((name, " × ".join(f"{n:g}" for n in counts) + " mm" * (len(counts) == 1), counts) for name, counts in rows)
    return ModeStudy(
        scene,
        tuple((name, mesh, overrides(name, *counts)) for name, mesh, counts in named),
        tuple(tuple(one) for one in references),
        frequencies,
    )


STUDIES = (
    _mode_study(
        "beam",
        _beam,
        _BEAM_MESHES,
        (
            [_beam("hex20", *(round(n * k) for n in (60, 6, 2))) for k in _REFINED],
            [_beam("tet10", 5.0 / k) for k in _REFINED],
        ),
        _in_plane,
    ),
    _mode_study(
        "propeller",
        _propeller,
        _PROPELLER_MESHES,
        (
            [_propeller("hex20", *(round(n * k) for n in (6, 4, 2, 2, 6, 10))) for k in _REFINED],
            [_propeller("tet10", *(round(n * k) for n in (4, 4, 2, 2, 6, 8))) for k in _REFINED],
        ),
        lambda run: run.modes.frequencies_hz[:6],
    ),
)


def extrapolate(frequencies: Array) -> Array:
    """Extrapolate frequencies (3, n) on meshes of 1, 1.5 and 2 times as many elements each way by ``f + c hᵖ``.

    The order p is each one's own, at most 8: 4 where all is smooth, less where there is a re-entrant corner
    (Babuška & Osborn 1991).
    """
    h = 1 / np.array(_REFINED)

    def limit(f: Array) -> float:
        ratio = (f[0] - f[1]) / (f[1] - f[2])
        p = float(brentq(lambda p: (h[0] ** p - h[1] ** p) / (h[1] ** p - h[2] ** p) - ratio, 0.5, 8.0))
        return float(f[2] - (f[1] - f[2]) / ((h[1] / h[2]) ** p - 1))

    return np.array([limit(f) for f in frequencies.T])


def converged_frequencies(study: ModeStudy) -> ConvergedFrequencies:
    """Extrapolate the frequencies to meshes without end, by each of two elements."""
    limits, unknowns = [], []
    for meshes in study.references:
        runs = [Pipeline(load_scene(study.scene, mesh), Cache(None)) for mesh in meshes]
        limits.append(extrapolate(np.stack([study.frequencies(run) for run in runs])))
        unknowns.append(3 * len(runs[-1].fe.x))
    apart = np.abs(limits[1] / limits[0] - 1).max()
    return ConvergedFrequencies(limits[0], float(apart), unknowns[0])


def measure_meshes(study: ModeStudy, reference: ConvergedFrequencies) -> Iterator[ModeStudyRow]:
    """Solve on each mesh and measure time and error; the mesh is made before the clock starts."""
    for element, mesh, overrides in study.meshes:
        seconds: list[float] = []
        while len(seconds) < (2 if seconds[:1] < [_SHORT] else 1):
            run = Pipeline(load_scene(study.scene, overrides), Cache(None))
            run.mesh  # noqa: B018
            tick = time.process_time()
            run.modes  # noqa: B018
            seconds.append(time.process_time() - tick)
        error = float(np.abs(study.frequencies(run) / reference.frequencies - 1).max())
        yield ModeStudyRow(study.scene, element, mesh, 3 * len(run.fe.x), min(seconds), error)


def write_study(rows: list[ModeStudyRow], references: dict[str, ConvergedFrequencies], folder: Path) -> None:
    """Write the rows as CSV and a chart of each scene."""
    limits = [
        f"{scene}: {' '.join(f'{hertz:.4f}' for hertz in found.frequencies)} Hz, the limit by up to {found.unknowns} "
        f"unknowns, good to {found.uncertainty:.0e}"
        for scene, found in references.items()
    ]
    write_rows(folder / "modes.csv", rows, f"{machine()}, one thread", *limits, digits=4)
    for scene in references:
        curves: dict[str, list[tuple[float, float]]] = {}
        for row in rows:
            if row.scene == scene:
                curves.setdefault(row.element, []).append((row.seconds, row.error))
        draw_work_precision(
            {element: np.array(points) for element, points in curves.items()},
            folder / f"modes-{scene}.png",
            title=f"{scene}: processor time of assembly and modes against error",
            error_label="largest relative error of the frequencies",
        )


def main() -> None:
    """Measure both scenes, and write ``modes.csv`` and the charts beside this file."""
    with threadpool_limits(1):
        references = {study.scene: converged_frequencies(study) for study in STUDIES}
        rows = [row for study in STUDIES for row in measure_meshes(study, references[study.scene])]
    write_study(rows, references, Path(__file__).parent)


if __name__ == "__main__":
    main()

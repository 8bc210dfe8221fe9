"""Error of natural frequencies against the time they take, for each element and mesh."""

from __future__ import annotations

import csv
import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from pipeline.cache import Cache
from pipeline.checks import Array
from pipeline.files import whole_file
from pipeline.scene import load_scene
from pipeline.stages import Pipeline

WANTED = 1e-3
_IN_PLANE = 0.6  # share of a mode's movement that makes it one in the plane; the others have below 0.45
_ORDER_OF_CONVERGENCE = 4  # of frequencies by elements of order 2


@dataclass(frozen=True)
class ModeRow:
    """One mesh.

    Attributes
    ----------
    scene, element, mesh : str
        What was solved.
    unknowns : int
        How many.
    seconds : float
        Processor time of assembly and modes, the less of two runs.
    error : float
        Largest relative error of the frequencies.
    """

    scene: str
    element: str
    mesh: str
    unknowns: int
    seconds: float
    error: float


@dataclass(frozen=True)
class Study:
    """The meshes of a scene.

    Attributes
    ----------
    scene : str
        Its name.
    meshes : tuple
        Element, mesh as it is told, and override of the scene, coarse to fine.
    references : tuple
        The override of a mesh and of one finer by ``refined`` in every direction, for the reference.
    refined : float
        Ratio of their elements' sizes.
    frequencies : callable
        From a pipeline to the frequencies that are compared [Hz].
    """

    scene: str
    meshes: tuple[tuple[str, str, tuple[str, ...]], ...]
    references: tuple[tuple[str, ...], tuple[str, ...]]
    refined: float
    frequencies: Callable[[Pipeline], Array]


@dataclass(frozen=True)
class Reference:
    """A converged solution.

    Attributes
    ----------
    frequencies : ndarray
        [Hz]
    uncertainty : float
        Largest relative difference to the next coarser solution over what one refinement gains.
    unknowns : int
        How many.
    """

    frequencies: Array
    uncertainty: float
    unknowns: int


def _bar(order: int, divisions: tuple[int, int, int]) -> tuple[str, ...]:
    return (f"body.beam.mesh={{element='hexahedron',order={order},divisions={list(divisions)}}}", *_ANY)


def _tetrahedra(order: int, millimetres: float) -> tuple[str, ...]:
    return (f"body.beam.mesh={{element='tetrahedron',order={order},size='{millimetres:g} mm'}}", *_ANY)


def _propeller(order: int, refinement: float) -> tuple[str, ...]:
    """Make the committed scene's counts finer, but for those around: a joint's width hangs on them."""
    axial, radial, outward, blade = (max(1, round(n * refinement)) for n in (10, 3, 12, 27))
    across = 8
    mesh = f"order={order},sleeve=[66,{axial},{radial}],joint=[{axial},{across},{outward}]"
    return (
        f"body.propeller.mesh={{{mesh},blade=[{axial},{across},{blade}],growth=4.0}}",
        "body.propeller.modes.count=6",
    )


def _in_plane(run: Pipeline) -> Array:
    """First five frequencies of bending along y, whatever the mesh's symmetry."""
    shapes = run.modes.shapes
    share = np.einsum("nj,nj->j", shapes[:, 1], shapes[:, 1]) / np.einsum("naj,naj->j", shapes, shapes)
    return np.asarray(run.modes.frequencies_hz[share > _IN_PLANE][:5])


_ANY = ("body.beam.modes.family=any", "body.beam.modes.count=20")
_BARS = (
    ("hex8", 1, ((60, 5, 2), (120, 10, 4), (160, 12, 5))),
    ("hex20", 2, ((16, 2, 1), (24, 2, 1), (24, 3, 1), (30, 3, 1), (36, 3, 1), (48, 4, 1), (60, 5, 2))),
)
_TETS = (("tet4", 1, (5.0, 3.0, 2.0)), ("tet10", 2, (20.0, 15.0, 12.0, 10.0, 8.0, 6.0, 4.0)))
STUDIES = (
    Study(
        "beam",
        (
            *((name, " × ".join(map(str, n)), _bar(order, n)) for name, order, meshes in _BARS for n in meshes),
            *((name, f"{size:g} mm", _tetrahedra(order, size)) for name, order, sizes in _TETS for size in sizes),
        ),
        (_bar(2, (80, 6, 2)), _bar(2, (120, 9, 3))),
        1.5,
        _in_plane,
    ),
    Study(
        "propeller",
        tuple(
            (("hex8", "hex20")[order - 1], f"paper's × {share:g}", _propeller(order, share))
            for order, shares in ((1, (0.5, 1.0, 1.5)), (2, (0.25, 0.35, 0.5, 0.75)))
            for share in shares
        ),
        (_propeller(2, 0.75), _propeller(2, 1.0)),
        4 / 3,
        lambda run: run.modes.frequencies_hz[:6],
    ),
)


def reference_of(study: Study) -> Reference:
    """Solve on the two finest meshes."""
    coarse, fine = (Pipeline(load_scene(study.scene, mesh), Cache(None)) for mesh in study.references)
    found = study.frequencies(fine)
    gained = study.refined**_ORDER_OF_CONVERGENCE - 1
    apart = np.abs(study.frequencies(coarse) / found - 1).max()
    return Reference(found, float(apart / gained), 3 * len(fine.fe.x))


def measure(study: Study, reference: Reference) -> Iterator[ModeRow]:
    """Solve on each mesh; the mesh is made before the clock runs."""
    for element, mesh, overrides in study.meshes:
        seconds = []
        for _ in range(2):
            run = Pipeline(load_scene(study.scene, overrides), Cache(None))
            run.mesh  # noqa: B018
            tick = time.process_time()
            run.modes  # noqa: B018
            seconds.append(time.process_time() - tick)
        error = float(np.abs(study.frequencies(run) / reference.frequencies - 1).max())
        yield ModeRow(study.scene, element, mesh, 3 * len(run.fe.x), min(seconds), error)


def fastest(rows: list[ModeRow], error: float = WANTED) -> ModeRow | None:
    """The row that takes least time among those within an error."""
    return min((row for row in rows if row.error <= error), key=lambda row: row.seconds, default=None)


def write_study(rows: list[ModeRow], references: dict[str, Reference], folder: Path) -> list[str]:
    """Write the rows as CSV and a chart of each scene; return the files' names."""
    from pipeline.render.precision_chart import draw_work_precision

    folder.mkdir(parents=True, exist_ok=True)
    files = ["modes.csv"]
    with whole_file(folder / "modes.csv") as part, part.open("w", newline="") as file:
        file.write(f"# {platform.machine()}, {platform.system()}, Python {platform.python_version()}, one thread\n")
        for scene, reference in references.items():
            hertz = " ".join(f"{frequency:.4f}" for frequency in reference.frequencies)
            file.write(f"# {scene}: {hertz} Hz by {reference.unknowns} unknowns, good to {reference.uncertainty:.0e}\n")
        table = csv.writer(file, lineterminator="\n")
        table.writerow([field.name for field in fields(ModeRow)])
        table.writerows([f"{x:.4g}" if isinstance(x, float) else x for x in astuple(row)] for row in rows)
    for scene in references:
        curves: dict[str, list[tuple[float, float]]] = {}
        for row in rows:
            if row.scene == scene:
                curves.setdefault(row.element, []).append((row.seconds, row.error))
        files.append(f"modes-{scene}.png")
        draw_work_precision(
            {element: np.array(points) for element, points in curves.items()},
            folder / files[-1],
            title=f"{scene}: processor time of assembly and modes against error",
            error_label="largest relative error of the frequencies",
        )
    return files


def print_study(rows: list[ModeRow], references: dict[str, Reference], folder: Path, files: list[str]) -> None:
    """Print a table of each scene and what is fastest within the wanted error."""
    console = Console()
    for scene, reference in references.items():
        title = f"{scene}: the reference has {reference.unknowns} unknowns and is good to {reference.uncertainty:.0e}"
        table = Table("element", "mesh", "unknowns", "seconds", "error", title=title, title_justify="left")
        own = [row for row in rows if row.scene == scene]
        for row in own:
            table.add_row(row.element, row.mesh, str(row.unknowns), f"{row.seconds:.3f}", f"{row.error:.1e}")
        console.print(table)
        best = fastest(own)
        if best:
            console.print(f"fastest within {WANTED:g}: {best.element}, {best.mesh}, {best.seconds:.3f} s")
    console.print(f"in {folder}/: {', '.join(files)}")

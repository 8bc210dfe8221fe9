"""Stated against true errors source by source, written to error_sources.csv, and large deflection to deflection.csv.

Each case is compared, source by source, with a run that is much finer in this source alone: more elements, more modes,
or a time integration that is refined. The error of stress recovery is part of what a finer mesh changes, so that both
are stated together. Run from the project's root: ``python benchmarks/error_sources.py``.
"""

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from table_format import write_rows
from true_errors import true_errors

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.error_estimates import Row
from fmd.core.cache import Cache
from fmd.core.limits.errors import SAFETY

_TABLE = Path(__file__).parent / "error_sources.csv"
_ROUND_OFF = 1e-7
_AUTO = 'simulation.run=[{integrator="auto"}]'
_BAR = """
title = "Bar"
[body.bar]
shape = "bar"
length = "300 mm"
depth = "20 mm"
width = "12 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = {{ element = "hexahedron", order = 2, divisions = [12, 2, 1] }}
modes = {{ count = 5, boundary = "{boundary}", enrich = "inertia", damping = 0.01 }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
element = {{ middle = {{ at = ["150 mm", "9 mm", "5 mm"] }}, root = {{ at = ["20 mm", "9 mm", "5 mm"] }} }}
[body.load]
shape = "point"
mass = "0.1 kg"
marker = {{ at = {{ at = ["0 m", "0 m", "0 m"] }} }}
[joint.root]
type = "{joint}"
parent = "ground"
child = "bar.root"
[joint.hold]
type = "fixed"
parent = "bar.tip"
child = "load.at"
[drive.push]
type = "point force"
marker = "bar.tip"
direction = [0, 1, 0.3]
force = {{ formula = "40*sin(2*pi*12*t)", unit = "N" }}
[simulation]
duration = "0.05 s"
output_step = "0.5 ms"
tip = "bar.tip"
run = [{{ integrator = "auto" }}]
"""
_HINGE = 'revolute"\naxis = [0, 0, 1]\nspring = "200 N m'


@dataclass(frozen=True)
class Case:
    """Scene of a comparison, and what makes it finer in mesh, modes and time."""

    name: str
    scene: str
    own: tuple[str, ...]
    mesh: tuple[str, ...]
    modes: tuple[str, ...]


def _bar(name: str, *own: str, joint: str = "fixed", boundary: str = "joint", divisions: str = "[36, 4, 3]") -> Case:
    finer = "{element='hexahedron', order=2, divisions=" + divisions + "}"
    mesh, modes = (f"body.bar.mesh={finer}",), ("body.bar.modes.count=10", "body.bar.modes.enrich=ritz")
    return Case(name, _BAR.format(joint=joint, boundary=boundary), own, mesh, modes)


CASES = (
    _bar("bar of hex20"),
    _bar("bar of hex8", "body.bar.mesh={order=1, divisions=[40, 4, 3]}"),
    _bar("bar of tet10", "body.bar.mesh={element='tetrahedron', order=2, size='11 mm'}"),
    _bar("bar on a hinge", joint=_HINGE),
    _bar("flat bar", "body.bar.depth=60 mm", "body.bar.width=5 mm", "body.bar.mesh.divisions=[12, 3, 1]"),
    Case(
        "beam",
        "beam-paper",
        ("body.beam.modes.enrich=inertia", "simulation.duration=0.1 s", _AUTO),
        ("body.beam.mesh.divisions=[72, 6, 2]",),
        ("body.beam.modes.count=10", "body.beam.modes.enrich=ritz"),
    ),
    Case(
        "spin-up",
        "spin-up",
        ("body.beam.mesh.divisions=[24, 1, 1]",),
        ("body.beam.mesh.divisions=[96, 3, 3]",),
        ("body.beam.modes.count=8", "body.beam.modes.enrich=ritz"),
    ),
)
_TIME = ("simulation.error=1e-7",)


@dataclass(frozen=True)
class Compared:
    """Stated and true relative error of a quantity by one source."""

    scene: str
    source: str
    kind: str
    quantity: str
    stated: float
    true: float


def kind_of(quantity: str) -> str:
    """Return the kind of a quantity: frequency, mass, spot stress, largest stress, tip, energy or joint."""
    if "stress" in quantity:
        return "spot stress" if "." in quantity.partition(",")[0] else "largest stress"
    named = ("frequency", "mass", "tip", "energy")
    return next((kind for kind in named if kind in quantity), "joint")


def compare(case: Case, folder: Path) -> Iterator[Compared]:
    """Compare a case with its finer runs, source by source, where the true error is above round-off."""
    scene = case.scene
    if "\n" in scene:
        (folder / "bar.toml").write_text(scene)
        scene = str(folder / "bar.toml")

    def make(*overrides: str) -> Pipeline:
        return Pipeline(load_scene(scene, [*case.own, *overrides]), Cache(None))

    run = make()
    rows = state_errors(run).rows
    finer = {"mesh": make(*case.mesh), "modes": make(*case.modes), "time": make(*_TIME)}
    for source, other in finer.items():
        true = true_errors(run, other)
        for row in rows:
            stated = _stated(row, source)
            if stated and true[row.name] > _ROUND_OFF:
                yield Compared(case.name, source, kind_of(row.name), row.name, stated, true[row.name])


def _stated(row: Row, source: str) -> float:
    """Return the stated error of a quantity by a source; that of stress recovery is the mesh's too."""
    names = {"mesh": ("discretisation", "recovery"), "modes": ("truncation",), "time": ("time",)}[source]
    return SAFETY * math.hypot(*(part for name in names if isinstance(part := row.parts[name], float)), 0.0)


def main() -> None:
    """Compare all cases and write the table."""
    found: list[Compared] = []
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            rows = list(compare(case, Path(folder)))
            found += rows
            for row in rows:
                print(row, flush=True)
    write_rows(_TABLE, found)


if __name__ == "__main__":
    main()

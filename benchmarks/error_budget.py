"""The error budget against true errors: each scene against a much finer run of it, written to error_budget.csv.

The finer runs have smaller or quadratic elements, several times the modes with load-dependent vectors, and a time
integration with a shorter step or refined until two marches agree.

Where errors of opposite signs cancel, a true error is small by chance and says nothing of what was to be expected. That
is so where a third run, finer than the one that is judged and coarser than the reference, is no nearer to the
reference. Such quantities are marked.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from table_format import renew_rows

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import ERROR_BUDGET, true_errors

_TABLE = Path(__file__).parent / "error_budget.csv"
_AUTO = ('simulation.run=[{integrator="auto"}]', "simulation.error=1e-6")
_CLOSER = (*_AUTO[:1], "simulation.error=1e-5")
_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Case:
    """What is compared: overrides of the scene for the run, for the reference and for a run between both, if any."""

    name: str
    scene: str
    own: tuple[str, ...]
    finer: tuple[str, ...]
    between: tuple[str, ...]


def _beam(name: str, *own: str, length: str = "340 mm") -> Case:
    finer = ("body.beam.mesh.divisions=[96, 8, 2]", "body.beam.modes.count=16", "body.beam.modes.enrich=ritz", *_AUTO)
    between = (
        "body.beam.mesh.divisions=[64, 6, 2]",
        "body.beam.modes.count=10",
        "body.beam.modes.enrich=ritz",
        *_CLOSER,
    )
    place = (f"body.beam.length={length}",)
    return Case(name, "beam-paper", (*own, *place), (*finer, *place), (*between, *place))


def _mesh(order: int, sleeve: list[int], joint: list[int], blade: list[int]) -> str:
    return f"body.propeller.mesh={{order={order}, sleeve={sleeve}, joint={joint}, blade={blade}, growth=4.0}}"


_THREE = (
    "body.propeller.blades=3",
    "body.propeller.seat=90 deg",  # of a joint: else it would follow from the numbers of elements
    "simulation.output_step=0.2 ms",
    "body.propeller.modes.count=12",
    'simulation.run=[{integrator="central-difference"}]',
)
_MORE = ("body.propeller.modes.count=26", "body.propeller.modes.enrich=ritz")
_REFERENCE = (*_THREE, _mesh(2, [30, 5, 2], [5, 6, 6], [5, 6, 12]), *_MORE, "simulation.step=0.4 us")
_LINEAR_BETWEEN = (*_THREE, _mesh(1, [36, 6, 3], [6, 9, 9], [6, 9, 18]), *_MORE, "simulation.step=0.5 us")
_QUADRATIC_BETWEEN = (*_THREE, _mesh(2, [24, 4, 2], [4, 4, 4], [4, 4, 8]), *_MORE, "simulation.step=0.5 us")
_FOUR = (
    "body.propeller.blades=4",
    "body.propeller.seat=70 deg",
    "simulation.output_step=0.2 ms",
    "body.propeller.modes.count=10",
    'simulation.run=[{integrator="central-difference"}]',
)
_FOUR_REFERENCE = (
    *_FOUR,
    _mesh(2, [48, 6, 2], [6, 7, 7], [6, 7, 14]),
    "body.propeller.modes.count=20",
    "body.propeller.modes.enrich=ritz",
    "simulation.step=0.5 us",
)
_WHOLE = (
    "body.propeller.modes.count=48",
    "body.propeller.modes.enrich=ritz",
    'simulation.run=[{integrator="central-difference", step="0.5 us"}]',
)
_SEAT = "body.propeller.seat=43.636363636363637 deg"  # 8 of the 66 elements around
_WHOLE_BETWEEN = (_SEAT, _mesh(2, [42, 6, 2], [6, 5, 8], [6, 5, 18]), *_WHOLE)
CASES = (
    Case("rod-slider", "rod-slider", (), (*_AUTO[:1], "simulation.error=1e-9"), ("simulation.step=0.25 ms",)),
    _beam("beam"),
    _beam("beam, inertia", "body.beam.modes.enrich=inertia"),
    _beam("beam, ritz", "body.beam.modes.enrich=ritz", "body.beam.mesh.divisions=[24, 2, 1]", *_AUTO[:1]),
    _beam(
        "beam of 300 mm",
        "body.beam.mesh.divisions=[30, 3, 1]",
        "body.beam.modes.count=8",
        "body.beam.modes.enrich=inertia",
        length="300 mm",
    ),
    Case(
        "spin-up",
        "spin-up",
        ("body.beam.mesh.divisions=[24, 1, 1]",),
        ("body.beam.mesh.divisions=[96, 3, 3]", "body.beam.modes.count=8", "body.beam.modes.enrich=ritz", *_AUTO),
        ("body.beam.mesh.divisions=[64, 2, 2]", "body.beam.modes.count=6", "body.beam.modes.enrich=ritz", *_CLOSER),
    ),
    Case(
        "three blades, linear",
        "propeller",
        (*_THREE, _mesh(1, [24, 4, 2], [4, 6, 6], [4, 6, 12])),
        _REFERENCE,
        _LINEAR_BETWEEN,
    ),
    Case(
        "three blades, quadratic",
        "propeller",
        (*_THREE, _mesh(2, [18, 2, 1], [2, 4, 3], [2, 4, 6])),
        _REFERENCE,
        _QUADRATIC_BETWEEN,
    ),
    Case(
        "propeller",
        "propeller",
        (),
        ("body.propeller.mesh.order=2", *_WHOLE),
        _WHOLE_BETWEEN,
    ),
    Case(
        "propeller, quadratic",
        "propeller",
        (_SEAT, _mesh(2, [30, 5, 1], [5, 4, 6], [5, 4, 13])),
        ("body.propeller.mesh.order=2", *_WHOLE),
        _WHOLE_BETWEEN,
    ),
    # Added when the estimates had been made.
    Case(
        "further: beam of tet10",
        "beam-paper",
        ('body.beam.mesh={element="tetrahedron", order=2, size="16 mm"}', "body.beam.modes.enrich=inertia"),
        (
            'body.beam.mesh={element="tetrahedron", order=2, size="5 mm"}',
            "body.beam.modes.count=16",
            "body.beam.modes.enrich=ritz",
            *_AUTO,
        ),
        (),
    ),
    Case(
        "further: beam of hex8",
        "beam-paper",
        ("body.beam.mesh={order=1, divisions=[80, 8, 2]}", "body.beam.modes.enrich=inertia"),
        (
            "body.beam.mesh={order=2, divisions=[64, 6, 2]}",
            "body.beam.modes.count=14",
            "body.beam.modes.enrich=ritz",
            *_AUTO,
        ),
        (),
    ),
    Case(
        "further: spin-up of 16 x 2 x 2",
        "spin-up",
        ("body.beam.mesh.divisions=[16, 2, 2]",),
        ("body.beam.mesh.divisions=[80, 3, 3]", "body.beam.modes.count=8", "body.beam.modes.enrich=ritz", *_AUTO),
        (),
    ),
    Case(
        "further: four blades, quadratic",
        "propeller",
        (*_FOUR, _mesh(2, [32, 3, 2], [3, 5, 4], [3, 5, 8])),
        _FOUR_REFERENCE,
        (),
    ),
    Case(
        "further: four blades, linear",
        "propeller",
        (*_FOUR, _mesh(1, [40, 6, 2], [6, 6, 8], [6, 6, 16])),
        _FOUR_REFERENCE,
        (),
    ),
)


@dataclass(frozen=True)
class Compared:
    """Stated and true relative error of a quantity, and whether the true one is small by chance."""

    scene: str
    quantity: str
    stated: float
    true: float
    by_chance: bool


def compare(case: Case) -> list[Compared]:
    """Stated and true relative error of each quantity of a scene, but for those that are exact."""
    run, finer = (Pipeline(load_scene(case.scene, overrides)) for overrides in (case.own, case.finer))
    true = true_errors(run, finer)
    closer = true_errors(Pipeline(load_scene(case.scene, case.between)), finer) if case.between else {}
    return [
        Compared(case.name, row.name, row.numerical, true[row.name], closer.get(row.name, 0.0) >= true[row.name])
        for row in ERROR_BUDGET.of(run).rows
        if true[row.name] > _ROUND_OFF
    ]


def main(names: list[str]) -> None:
    """Compare all cases, or those that are named, and put them into the table."""
    order = [case.name for case in CASES]
    for case in CASES:
        if names and case.name not in names:
            continue
        found = compare(case)
        for row in found:
            print(f"{row.scene}: {row.quantity:45s} {row.stated:.1e} {row.true:.1e}{', by chance' * row.by_chance}")
        renew_rows(_TABLE, found, ("scene",), lambda row: order.index(row["scene"]))


if __name__ == "__main__":
    main(sys.argv[1:])

"""The error budget of a run: the relative error of each of its results, source by source."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from fmd.accuracy.error_estimates import MORE_OF_MESH, MORE_OF_MODEL, NO_LIMIT, NO_PART, SOURCES, Row
from fmd.accuracy.missed_peaks import largest_between
from fmd.accuracy.ply_stress import PLY_ROWS, ply_row
from fmd.accuracy.quantities import name_of_whole
from fmd.accuracy.requested_stress import EXTREMES, request_key
from fmd.accuracy.time_limit import TimeLimit
from fmd.core.data_classes import dataclass
from fmd.core.limits.errors import LEAST_PART_OF_RUN, LEAST_SECONDS, SAFETY, TIMES_RUN, WHOLE_SECONDS
from fmd.scene.scene import Scene
from fmd.stages.pipeline import Pipeline
from fmd.stages.stage import ALL_PACKAGES, ALL_SOURCES, Stage

if TYPE_CHECKING:
    from fmd.accuracy.corner_stress import CornerStress
    from fmd.accuracy.model_errors import ModelError


@dataclass(frozen=True)
class Budget:
    """Error budget of all of a run's quantities."""

    rows: tuple[Row, ...]
    # Of single joints and markers, by the names of variables in files; no required accuracy counts them.
    details: tuple[Row, ...] = ()
    safety: float = SAFETY  # factor on the root of the sum of the squares of a row's estimates
    model: tuple[ModelError, ...] = ()  # what the model leaves out, cause by cause
    left_out: tuple[str, ...] = ()  # estimates that the time limit left out, with the reason
    seconds: float = 0.0  # time that the estimates took [s]
    # Stated error of the coordinates by time integration, by the measure of ``auto``; none without an estimate.
    integration: float | None = None
    corners: tuple[CornerStress, ...] = ()  # largest stresses that have no limit

    @property
    def worst(self) -> Row:
        """Row with the largest total."""
        return max(self.rows, key=lambda row: row.total)

    def results(self, scene: Scene) -> list[Row]:
        """Return the rows that count: not those of modes that only serve the basis."""
        asked = {f"{name}, frequency": body.modes.count for name, body in scene.flexible.items()}

        def counts(name: str) -> bool:
            label, _, number = name.rpartition(" ")
            return label not in asked or int(number) <= asked[label]

        return [row for row in self.rows if counts(row.name)]

    def summary(self) -> dict[str, Any]:
        """Return the budget as plain numbers and texts."""
        return {
            "safety": self.safety,
            "rows": [row.summary() for row in self.rows],
            "details": [row.summary() for row in self.details],
            "model": [asdict(cause) for cause in self.model],
            "left_out": list(self.left_out),
            "seconds": self.seconds,
            "integration": self.integration,
        }


def state_errors(run: Pipeline, seconds: float = math.inf) -> Budget:
    """State the errors of a scene's first run, within a time limit [s]; a budget that is whole is kept.

    Of one that isn't, the next call makes all estimates anew.
    """
    return ERROR_BUDGET.of(run, lambda run: _estimate(run, seconds))


def read_kept_errors(run: Pipeline) -> None:
    """Read the budget of a scene's first run from the cache if it is kept, and compute nothing."""
    if ERROR_BUDGET.applies(run) and run.store.cache.holds(ERROR_BUDGET.key(run)):
        state_errors(run)


def allowed_seconds(run: Pipeline) -> float:
    """Return the time that a budget may take by default [s]: three times that of the run.

    Where both would take more than 40 s it is what the run leaves of these, but 0.3 times what it took at least.
    """
    taken = sum(run.log.seconds.values())
    return max(min(TIMES_RUN * taken, WHOLE_SECONDS - taken), LEAST_PART_OF_RUN * taken, LEAST_SECONDS)


def _estimate(run: Pipeline, seconds: float = math.inf) -> Budget:
    from fmd.accuracy.estimators import Estimates

    run.fine_motion  # noqa: B018 - no estimate, and reported in any case: the clock starts behind it
    limit = TimeLimit(seconds)
    estimates = Estimates(run, limit)
    by_source = estimates.by_source()
    limitless = {
        f"{corner.body}, {what}": f"not estimated: {corner.text}"
        for corner in estimates.corners
        for what in EXTREMES.values()
    } | {
        ply_row(corner.body, name): f"not estimated: {corner.text}" for corner in estimates.corners for name in PLY_ROWS
    }
    rows: list[Row] = []
    details: list[Row] = []
    for name, quantity in estimates.quantities.items():
        parts = {source: by_source.get(source, {}).get(name, NO_PART) for source in SOURCES}
        if name in estimates.model.missing:
            parts[MORE_OF_MODEL] = estimates.model.missing[name]
        if estimates.mesh_left_out and quantity.kind != "geometry":
            parts[MORE_OF_MESH] = estimates.mesh_left_out
        if isinstance(estimates.pair, str) and name.rpartition(".")[2] in PLY_ROWS:  # no patch of elements tells it
            parts[MORE_OF_MESH] = estimates.pair
        if name in limitless:
            parts[NO_LIMIT] = limitless[name]
        over_time = not (quantity.largest or name in estimates.of_mesh)
        correction = estimates.corrections.get(name, 0.0)
        kind = details if name in estimates.details else rows
        kind.append(Row(name, quantity.unit, quantity.scale, over_time, parts, correction))
    largest = largest_between(run)

    def with_peak(row: Row) -> Row:
        return replace(row, between=max(largest.get(row.name, 0.0) - row.value, 0.0) if row.value else 0.0)

    causes, left_out = tuple(estimates.model.causes), tuple(estimates.left_out)
    return Budget(
        tuple(map(with_peak, _join_pieces(rows))),
        tuple(map(with_peak, details)),
        model=causes,
        left_out=left_out,
        seconds=limit.spent,
        integration=estimates.of_integration,
        corners=tuple(estimates.corners),
    )


def _join_pieces(rows: list[Row]) -> list[Row]:
    """Return the rows with those of a part's pieces as one: of the piece with the largest value, masses added up.

    Frequencies of pieces with fixed interfaces are no results, and have no rows.
    """
    joined: dict[str, Row] = {}
    for row in rows:
        name = name_of_whole(row.name)
        if name == row.name:
            joined[name] = row
        elif ", frequency" not in name:
            before = joined.get(name, replace(row, value=0.0, correction=0.0))
            largest = row if row.value > before.value else before
            value, correction = largest.value, largest.correction
            if name.endswith(", mass"):
                value, correction = row.value + before.value, row.correction + before.correction
            joined[name] = replace(largest, name=name, value=value, correction=correction)
    return list(joined.values())


ERROR_BUDGET: Stage[Budget] = Stage(
    "error budget",
    _estimate,
    ("mesh", "assembly", "modes", "body", "surface", "stress", "inertia"),  # of each part; the rest: own stages
    lambda run: run.inputs | request_key(run.scene),
    ALL_SOURCES,
    ALL_PACKAGES,
    # Matrices tell nothing of their own error, and motions are sensitive after a shock.
    applies=lambda run: not run.scene.contact and all(part.has_mesh for part in run.wholes.values()),
    lasts=lambda budget: not budget.left_out,
)
"""Stage of a run: ``ERROR_BUDGET.of(run)`` is the budget of the scene's first run."""

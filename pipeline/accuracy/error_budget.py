"""The error budget of a run: what each of its results is off by, source by source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.accuracy.error_estimates import NO_PART, SAFETY, SOURCES, Row
from pipeline.accuracy.estimators import Estimates
from pipeline.accuracy.quantities import of_the_mesh, of_the_motion, of_the_stress
from pipeline.core.cache import stage_key

if TYPE_CHECKING:
    from pipeline.stages.pipeline import Pipeline


@dataclass(frozen=True)
class Budget:
    """The budget of all of a run's quantities.

    Attributes
    ----------
    rows : tuple of Row
    safety : float
        What the root of the sum of a row's estimates' squares is multiplied by.
    """

    rows: tuple[Row, ...]
    safety: float = SAFETY

    @property
    def worst(self) -> Row:
        """The row with the largest total."""
        return max(self.rows, key=lambda row: row.total)

    def summary(self) -> dict[str, Any]:
        """Plain numbers and texts."""
        rows = [
            {"quantity": row.name, "value": row.value, "unit": row.unit, "over_time": row.over_time}
            | {**row.parts, "total": row.total}
            for row in self.rows
        ]
        return {"safety": self.safety, "rows": rows}


def budget_key(run: Pipeline) -> str:
    """Key that the budget is kept under."""
    return stage_key("error budget", run.inputs, ("pipeline", "meshes"), ("numpy", "scipy", "scikit-fem", "gmsh"))


def budget_of(run: Pipeline) -> Budget:
    """The budget of the scene's first run, kept like other stages."""
    return run.keeper.kept("error budget", budget_key(run), lambda: _made(run))


def true_errors(run: Pipeline, finer: Pipeline) -> dict[str, float]:
    """Relative errors of a run's quantities against those of a much finer run of the same scene.

    Frequencies are matched by their modes' shapes, element stress by place.
    """
    found, motion = Estimates(run).found, finer.first_motion
    places = {name: part.element_places for name, part in run.parts.items() if part.elements}
    exact = of_the_mesh(finer, run) | of_the_motion(finer, motion, finer.fine_motion)
    if run.parts:
        exact |= of_the_stress(finer, motion, np.arange(len(motion.times)), places=places)
    return {name: quantity.error(exact[name]) for name, quantity in found.items()}


def _made(run: Pipeline) -> Budget:
    estimates = Estimates(run)
    by_source = estimates.by_source()
    rows = []
    for name, quantity in estimates.found.items():
        parts = {source: by_source.get(source, {}).get(name, NO_PART) for source in SOURCES}
        over_time = not (quantity.largest or name in estimates.of_mesh)
        rows.append(Row(name, quantity.unit, quantity.scale, over_time, parts))
    return Budget(tuple(rows))

"""The error budget of a run: the relative error of each of its results, source by source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.accuracy.error_estimates import NO_PART, SAFETY, SOURCES, Row
from pipeline.accuracy.estimators import Estimates
from pipeline.accuracy.quantities import mesh_quantities, motion_quantities, stress_quantities
from pipeline.stages.pipeline import Pipeline
from pipeline.stages.stage import Stage


@dataclass(frozen=True)
class Budget:
    """Error budget of all of a run's quantities.

    Attributes
    ----------
    rows : tuple of Row
    safety : float
        Factor on the root of the sum of the squares of a row's estimates.
    """

    rows: tuple[Row, ...]
    safety: float = SAFETY

    @property
    def worst(self) -> Row:
        """Row with the largest total."""
        return max(self.rows, key=lambda row: row.total)

    def summary(self) -> dict[str, Any]:
        """Return the budget as plain numbers and texts."""
        rows = [
            {"quantity": row.name, "value": row.value, "unit": row.unit, "over_time": row.over_time}
            | {**row.parts, "total": row.total}
            for row in self.rows
        ]
        return {"safety": self.safety, "rows": rows}


def true_errors(run: Pipeline, finer: Pipeline) -> dict[str, float]:
    """Return the relative errors of a run's quantities against those of a much finer run of the same scene.

    Frequencies are matched by their modes' shapes, element stress by place.
    """
    quantities, motion = Estimates(run).quantities, finer.motion
    places = {name: part.element_places for name, part in run.parts.items() if part.elements}
    exact = mesh_quantities(finer, run) | motion_quantities(finer, motion, finer.fine_motion)
    if run.parts:
        exact |= stress_quantities(finer, motion, np.arange(len(motion.times)), places=places)
    return {name: quantity.error(exact[name]) for name, quantity in quantities.items()}


def _estimate(run: Pipeline) -> Budget:
    estimates = Estimates(run)
    by_source = estimates.by_source()
    rows = []
    for name, quantity in estimates.quantities.items():
        parts = {source: by_source.get(source, {}).get(name, NO_PART) for source in SOURCES}
        over_time = not (quantity.largest or name in estimates.of_mesh)
        rows.append(Row(name, quantity.unit, quantity.scale, over_time, parts))
    return Budget(tuple(rows))


def _inputs(run: Pipeline) -> dict[str, Any]:
    return run.inputs


ERROR_BUDGET: Stage[Budget] = Stage(
    "error budget",
    _estimate,
    ("mesh", "assembly", "modes", "body", "surface", "stress"),  # of each part; the rest is in stages of its own
    _inputs,
    ("pipeline", "meshes"),
    ("numpy", "scipy", "scikit-fem", "gmsh"),
)
"""Stage of a run: ``ERROR_BUDGET.of(run)`` is the budget of the scene's first run."""

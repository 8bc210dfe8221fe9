"""A motion as a notebook shows it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pipeline.core.html import facts, scaled
from pipeline.integrators.protocol import Trajectory


def motion_table(trajectory: Trajectory, final: Mapping[str, Any]) -> str:
    """Tell in a table of HTML how a motion was computed and where it ends."""
    ratio = f" {trajectory.substeps}:1" if trajectory.substeps > 1 else ""
    work = f"{trajectory.evaluations} + {trajectory.fast_evaluations} solutions in {scaled(trajectory.seconds, 's')}"
    rows = [("method", trajectory.integrator + ratio), ("step", scaled(trajectory.step, "s")), ("work", work)]
    for name, value in final.items():
        inner = value.items() if isinstance(value, Mapping) else [("", value)]
        rows += [(f"{name} {key}".replace("_", " ").rstrip(), f"{figure:.6g}") for key, figure in inner]
    return facts(rows, f"motion, {len(trajectory.times)} output times; where it ends")

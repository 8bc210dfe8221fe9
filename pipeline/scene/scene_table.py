"""A scene as a table of HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.core.html import facts, scaled
from pipeline.scene.simulation import Simulation


def scene_table(
    title: str,
    file: str,
    bodies: Mapping[str, Any],
    joints: Mapping[str, Any],
    drives: Mapping[str, Any],
    simulation: Simulation | None,
    outputs: Sequence[Any],
) -> str:
    """Return a scene's bodies, joints, drives, runs and outputs as a table of HTML."""
    rows = [
        ("bodies", _kinds(bodies, "shape")),
        ("joints", "; ".join(f"{name}: {j.type}, {j.parent} → {j.child}" for name, j in joints.items())),
        ("drives", _kinds(drives, "type")),
        ("outputs", ", ".join(getattr(output, "file", "") for output in outputs)),
    ]
    if simulation is not None:
        spans = f"{scaled(simulation.duration, 's')}, output every {scaled(simulation.output_step, 's')}"
        methods = ", ".join(
            f"{run.integrator} {run.substeps}:1" if hasattr(run, "substeps") else run.integrator
            for run in simulation.run
        )
        rows[3:3] = [("simulation", spans), ("runs", methods)]
    return facts([(name, text) for name, text in rows if text], f"{title} ({file})")


def _kinds(table: Mapping[str, Any], key: str) -> str:
    return ", ".join(f"{name}: {getattr(value, key)}" for name, value in table.items())

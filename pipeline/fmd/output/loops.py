"""Figures and warnings about a mechanism's loops: gaps, reactions, redundant constraints, a start that was moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.limits.mechanism import MOVED_BY_CLOSING
from fmd.dynamics.compiler.closures import closed_distances
from fmd.stages.assembly import constraint_rank, given_joints
from fmd.stages.pipeline import Pipeline


def loop_figures(run: Pipeline) -> dict[str, Any]:
    """Return the largest gap, and the largest force and moment of each joint that closes a loop."""
    if not run.mechanism.closures:
        return {}
    first = run.motion
    joints = {
        name: {
            "largest_force_n": float(np.linalg.norm(wrench[:, 1, :3], axis=1).max()),
            "largest_moment_n_m": float(np.linalg.norm(wrench[:, 1, 3:], axis=1).max()),
        }
        for name, wrench in first.closing_reactions.items()
    }
    return {"constraint_residual": first.constraint_residual, "closing_joints": joints}


def loop_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Return warnings about redundant constraints, and joints that don't start as given."""
    mechanism, system, (q, v) = run.mechanism, run.system, run.start
    if not mechanism.closures:
        return []
    found = []
    rows, rank = len(system.compiled.rows), constraint_rank(system, q)
    if rank < rows:
        text = (
            f"{rows - rank} of the {rows} constraints of {', '.join(run.divided_scene.closing)} are redundant: the "
            "motion is right, but how these joints share their load is not known; the smallest reactions are stated"
        )
        found.append({"code": "redundant-constraints", "text": text})
    for name, distance in closed_distances(mechanism.rigid).items():
        text = f"joint.{name} is closed over {distance:.2g} m that no motion closes: a mesh gives centres of faces so"
        found.append({"code": "closed-distance", "text": text})
    if run.scene.repeats:  # which moves all joints
        return found
    given_q, given_v = given_joints(run.divided_scene, mechanism)
    positions = ("angle", "position", given_q, q, mechanism.layout.position)
    keys = (positions, ("rate", "rate", given_v, v, mechanism.layout.rate))
    for k, link in enumerate(mechanism.links):
        joint = run.divided_scene.joint[link.joint_name]
        for turning, sliding, given, taken, places in keys:
            key, at = turning if link.unit == "rad" else sliding, int(places[k])
            if (
                link.unit
                and link.n_rates
                and key in joint.model_fields_set
                and abs(given[at] - taken[at]) > MOVED_BY_CLOSING
            ):
                unit = f"{link.unit}/s" if key == "rate" else link.unit
                text = (
                    f"joint.{link.joint_name}.{key} is {taken[at]:.6g} {unit} at the start in place of "
                    f"{given[at]:.6g}: the loops don't close otherwise"
                )
                found.append({"code": "start-moved", "text": text})
    return found

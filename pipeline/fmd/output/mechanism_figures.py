"""Figures and warnings about a mechanism: its loops, coupled coordinates in sub-cycled runs, a periodic start."""

from typing import Any

import numpy as np

from fmd.core.limits.mechanism import MOVED_BY_CLOSING
from fmd.core.limits.stability import GROWS, MULTIPLIER_DECIMALS, SHOWN_MULTIPLIERS, STRONG
from fmd.dynamics.compiler.closures import closed_distances
from fmd.dynamics.vibration import inertial_coupling
from fmd.stages.assembly import constraint_rank
from fmd.stages.closing_ways import describe_ways
from fmd.stages.loop_closing import given_joints
from fmd.stages.pipeline import Pipeline


def coupling_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of sub-cycled runs whose slow and fast coordinates couple through the mass matrix almost wholly."""
    found = []
    for label, plan in run.plans.items():
        system = plan.system
        if plan.integrator.substeps == 1 or not 0 < system.n_slow < system.n:
            continue
        beta = inertial_coupling(system.linear_matrices[0], system.n_slow)
        if beta > STRONG:
            text = (
                f"{label}: slow and fast coordinates share almost all of their inertia (β = {beta:.5g}, 1 - β² = "
                f"{1 - beta**2:.2g}), so this run's error can be far larger than that of central differences with the "
                "same fast step; compare it with a run by a method without sub-cycling, or take that"
            )
            found.append({"code": "inertial-coupling", "run": label, "text": text})
    return found


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
                    f"{given[at]:.6g}: so the loops close"
                )
                found.append({"code": "start-moved", "text": text})
    if ways := describe_ways(run.divided_scene, mechanism):
        text = f"the loops close far from where joints start, and not in one way: {ways}; the first is taken"
        found.append({"code": "closing-ways", "text": text})
    return found


def periodic_figures(run: Pipeline) -> dict[str, Any]:
    """Return period, gap, multipliers and work of a scene's periodic start."""
    if not run.scene.repeats:
        return {}
    motion, multipliers = run.periodic, run.multipliers
    return {
        "periodic": {
            "period_s": motion.period,
            "gap": motion.gap,
            "multipliers": [{"modulus": float(abs(mu)), "angle_rad": float(np.angle(mu))} for mu in multipliers.values],
            "marched_periods": motion.marches,
            "marched_for_multipliers": multipliers.marches,
        }
    }


def periodic_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of a periodic motion from which small disturbances grow: nothing settles at it by itself."""
    if not run.scene.repeats:
        return []
    largest = float(np.abs(run.multipliers.values).max(initial=0.0))
    if largest <= 1.0 + GROWS:
        return []
    text = (
        f"the periodic motion is unstable: a small disturbance grows {largest:.4g}-fold in each period, so no motion "
        "settles at it; runs leave it sooner or later"
    )
    return [{"code": "periodic-unstable", "text": text}]


def describe_periodic(figures: dict[str, Any]) -> str:
    """Write what a run tells of its periodic start."""
    moduli = [row["modulus"] for row in figures["multipliers"]]
    shown = ", ".join(f"{round(modulus, MULTIPLIER_DECIMALS):.4g}" for modulus in moduli[:SHOWN_MULTIPLIERS])
    more = " …" if len(moduli) > SHOWN_MULTIPLIERS else ""
    text = (
        f"repeats after {figures['period_s']:.6g} s within {figures['gap']:.1g}; Floquet multipliers of moduli "
        f"{shown or 'none'}{more}"
    )
    if moduli and 0.0 < moduli[0] < 1.0 - GROWS:
        periods = np.log(1000.0) / -np.log(moduli[0])
        text += f": a march from elsewhere settles to a thousandth in {max(periods, 1.0):.3g} periods"
    return text

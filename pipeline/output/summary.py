"""Figures of a run in plain numbers, as ``summary.json`` holds them."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline import __version__
from pipeline.accuracy.error_budget import ERROR_BUDGET
from pipeline.output.explain import STAGES
from pipeline.output.frequencies import frequencies_by_body, frequency_table, mode_warnings
from pipeline.recovery.motion import Motion
from pipeline.stages.pipeline import Pipeline


def summarise(run: Pipeline, files: list[str], budget: bool) -> dict[str, Any]:
    """Gather a run's figures; the keys about modes and stress are there if the scene has a flexible body."""
    summary: dict[str, Any] = {"scene": run.scene.name, "version": __version__}
    if run.parts:
        summary |= frequency_table(run)
        summary["bodies"] = {name: own | _body(run, name) for name, own in frequencies_by_body(run).items()}
    summary["warnings"] = [*mode_warnings(run), *_motion_warnings(run)]
    first = run.motion
    limits = [plan.integrator.largest_step(plan.system) for plan in run.plans.values()]
    summary["largest_stable_step_s"] = 2.0 / run.system.highest_frequency if run.system.n else None
    summary["integrations"] = [
        {
            "integrator": motion.trajectory.integrator,
            "step_s": motion.trajectory.step,
            "substeps": motion.trajectory.substeps,
            "seconds": motion.trajectory.seconds,
            "ratio_to_plain": motion.trajectory.seconds / first.trajectory.seconds,
            "evaluations": motion.trajectory.evaluations,
            "fast_evaluations": motion.trajectory.fast_evaluations,
            "growth": run.plans[label].growth,
            "largest_stable_step_s": limit if np.isfinite(limit) else None,
            "stability_margin": limit / motion.trajectory.step if np.isfinite(limit) else None,
            **motion.differences(first),
            "final": motion.final() | _former_names(motion),
        }
        for (label, motion), limit in zip(run.motions.items(), limits, strict=True)
    ]
    summary["final"] = first.final() | _former_names(first)
    summary["joint_units"] = {joint: first.joint_unit(joint) for joint in first.joints}
    summary["tip"] = summary["final"]["tip"]
    summary["left_out_modes"] = run.left_out
    if len(first.tip_link.omega):
        summary["peak_tip_deflection_m"] = float(run.fine_motion.tip_size.max())
    histories = _element_histories(run)
    for name, values in histories.items():
        reference = values[next(iter(values))]
        for row, history in zip(summary["integrations"], values.values(), strict=True):
            apart = float(np.abs(history - reference).max() / reference.max()) if reference.any() else 0.0
            row.setdefault("element_stress_difference", {})[name] = apart
        ends = {"largest_pa": float(reference.max()), "at_the_end_pa": float(reference[-1])}
        summary.setdefault("element_stress", {})[name] = ends
    meshed = [name for name, part in run.parts.items() if part.has_mesh]
    if meshed:
        stress = run.stress_of(meshed[0])
        time, node, value = stress.worst()
        body = run.bodies[meshed[0]]
        place = body.origin + body.x[stress.nodes[node]]
        summary["worst_stress"] = {"time_s": time, "von_mises_pa": value, "position_m": place.tolist()}
    if budget and len(meshed) == len(run.parts):  # matrices alone tell nothing of their own error
        summary["error_budget"] = ERROR_BUDGET.of(run).summary()
    return summary | {
        "files": files,
        "seconds": dict(run.log.seconds),
        "stages_run": list(run.log.run),
        "stages_cached": list(run.log.cached),
        "stages_skipped": [stage for stage in STAGES if stage not in run.log.seconds],
    }


def _motion_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warnings about results that can't be right, each a text and a code."""
    acts = any(not activity.quiet.all() for activity in run.mechanism.activities)
    return [
        {
            "code": "load-without-motion",
            "text": f"{motion.trajectory.integrator}: a load acts, but nothing moves; check its place and direction, "
            "and what the joints leave free",
        }
        for motion in run.motions.values()
        if acts and motion.trajectory.q.size and not np.ptp(motion.trajectory.q, axis=0).any()
    ]


def _former_names(motion: Motion) -> dict[str, float]:
    """Names that a single flexible body on a hinge had in ``final`` until 0.1; they go with the next release."""
    final, across = motion.final(), motion.deflection_across_arm
    if len(motion.mechanism.links) > 1 or across is None or not len(motion.tip_link.omega):
        return {}
    (angle,), (rate,) = final["joint_positions"].values(), final["joint_rates"].values()
    return {
        "joint_angle_rad": angle,
        "joint_rate_rad_s": rate,
        "tip_deflection_m": float(across[-1]),
        "strain_energy_j": final["potential_energy_j"],
    }


def _element_histories(run: Pipeline) -> dict[str, dict[str, Any]]:
    """Von Mises stress of each named element over each run."""
    names = [f"{body}.{element}" for body, part in run.parts.items() for element in part.elements]
    return {name: run.element_stress(name) for name in names}


def _body(run: Pipeline, name: str) -> dict[str, Any]:
    """Figures of a flexible body: mass, frequencies in its frame, coupling, and the effect of its spin."""
    body, spin = run.bodies[name], run.spin[name]
    return {
        "frequencies_in_frame_hz": body.frequencies_hz.tolist(),
        "coupling": body.coupling,
        "prescribed": run.parts[name].joint.prescribed,
        "mass_kg": body.gram.mass,
        "mesh_notes": list(run.parts[name].mesh_notes),
        "largest_spin_rad_s": spin.largest_rate,
        "critical_spin_rad_s": spin.critical_rate if np.isfinite(spin.critical_rate) else None,
        "stiffened": spin.stiffened,
    }

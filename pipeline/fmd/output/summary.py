"""Figures of a run in plain numbers, as ``summary.json`` holds them."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from fmd.accuracy.contact_errors import contact_errors
from fmd.accuracy.deflection import deflection_warnings, stretching_warnings
from fmd.accuracy.error_budget import ERROR_BUDGET, Budget, state_errors
from fmd.accuracy.solved_scene import SolvedScene
from fmd.accuracy.time_limit import TIME_IS_SHORT
from fmd.accuracy.uncertain_results import uncertain_warnings
from fmd.core.limits.errors import MORE_TIME, SAFETY, TOO_LARGE
from fmd.core.limits.mesh import PIECES_DEFLECTIONS, PIECES_FREQUENCIES
from fmd.core.version import __version__
from fmd.output.contacts import contact_figures, contact_step_warnings, contact_warnings
from fmd.output.explain import STAGES
from fmd.output.figure_errors import figure_errors
from fmd.output.frequencies import frequencies_by_body, frequency_table, mode_warnings
from fmd.output.gear_teeth import gear_teeth_figures, gear_teeth_warnings
from fmd.output.histories import missed_peak_warnings
from fmd.output.mechanism_figures import (
    coupling_warnings,
    loop_figures,
    loop_warnings,
    periodic_figures,
    periodic_warnings,
)
from fmd.output.output_kinds import kind_of
from fmd.output.stress_warnings import stress_warnings
from fmd.output.variable_errors import why_no_budget
from fmd.stages.division import part_of
from fmd.stages.part import FlexiblePart
from fmd.stages.pipeline import Pipeline
from fmd.stages.plan import repeat_choice
from fmd.stages.signals import find_idle_drives, find_jumping_tables

UNMET, UNMOVED = "accuracy-not-met", "load-without-motion"
"""Codes of warnings of results that fail a check."""


def summarise_solved(
    solved: SolvedScene, files: Sequence[str] = (), budget: bool = False, budget_seconds: float = math.inf
) -> dict[str, Any]:
    """Gather the figures of a scene as it is computed, of one without a simulation those of its first body's modes.

    Parameters and keys are those of `summarise`; rounds of refinement are under ``"accuracy"``.
    """
    run = solved.run
    if not run.scene.moves:
        return {**frequency_table(run), "seconds": dict(run.log.seconds)}
    summary, settings = summarise(run, list(files), budget, budget_seconds), solved.settings
    if settings.unmet:
        summary["warnings"].append({"code": UNMET, "text": settings.unmet})
    return summary | ({"accuracy": settings.refinement} if settings.refinement else {})


def summarise(run: Pipeline, files: list[str], budget: bool, budget_seconds: float = math.inf) -> dict[str, Any]:
    """Gather a run's figures within some seconds; those of modes and stress are there if there is a flexible body."""
    summary: dict[str, Any] = {"scene": run.scene.name, "version": __version__}
    if run.wholes:
        summary |= frequency_table(run)
        summary["bodies"] = {name: own | _body(run, name) for name, own in frequencies_by_body(run).items()}
    summary["warnings"] = run_warnings(run)
    first = run.motion
    summary |= loop_figures(run) | periodic_figures(run) | contact_figures(run) | gear_teeth_figures(run)
    summary["largest_stable_step_s"] = run.system.largest_step if run.system.n else None
    summary["integrations"] = _integrations(run)
    summary["final"] = first.final()
    summary["joint_units"] = {joint: first.joint_unit(joint) for joint in first.joints}
    summary["tip"] = dict(summary["final"]["tip"])
    summary["left_out_modes"] = _left_out_modes(run)
    if len(first.tip_link.omega):
        summary["peak_tip_deflection_m"] = float(run.fine_motion.tip_size.max())
    histories = _element_histories(run)
    for name, values in histories.items():
        reference = values[next(iter(values))]
        for row, history in zip(summary["integrations"], values.values(), strict=True):
            apart = float(np.abs(history - reference).max() / reference.max()) if reference.any() else 0.0
            row.setdefault("element_stress_difference", {})[name] = apart
        instants = next(iter(run.at_instants.element_stress(name).values()))
        ends = {"largest_pa": float(instants.max()), "at_the_end_pa": float(reference[-1])}
        summary.setdefault("element_stress", {})[name] = ends
    found = {name: run.stress_of(name).worst() for name, part in run.wholes.items() if part.has_stress}
    if found:
        worst = {name: _worst_stress(run, name, *found[name]) for name in found}
        where = max(worst, key=lambda name: worst[name]["value_pa"])
        largest = {"body": where, "von_mises_pa": worst[where]["value_pa"]}
        summary["worst_stress"] = largest | {key: worst[where][key] for key in ("time_s", "position_m")} | worst
    of_stress = stress_warnings(run, found)
    summary["warnings"] += of_stress + [each for each in missed_peak_warnings(run) if each not in of_stress]
    stated = state_errors(run, budget_seconds) if budget and ERROR_BUDGET.applies(run) else None
    if budget and run.scene.contact:
        of_contacts = contact_errors(run, budget_seconds)
        rows = {name: {key: error.summary() for key, error in own.items()} for name, own in of_contacts.items()}
        summary["contact_errors"] = rows
        summary["warnings"] += contact_step_warnings(run, of_contacts)
    for output in run.scene.output:
        if summarise_output := kind_of(output).summarise:
            for key, values in summarise_output(run, output).items():
                summary.setdefault(key, {}).update(values)
    _state_figures(summary, stated)
    summary["stated_errors"] = figure_errors(run, summary)
    if budget and stated is None:
        summary["warnings"].append({"code": "no-error-budget", "text": f"no errors are stated: {why_no_budget(run)}"})
    if stated is not None:
        summary["error_budget"] = stated.summary()
        if stated.integration is not None:  # what a third march tells, and not what the method's own two did
            summary["integrations"][0]["error"] = stated.integration
        summary["warnings"] += [*uncertain_warnings(run.scene, stated), *_budget_warnings(run, stated, budget_seconds)]
    return summary | {
        "files": files,
        "seconds": dict(run.log.seconds),
        "stages_run": list(run.log.run),
        "stages_cached": list(run.log.cached),
        "stages_skipped": [stage for stage in STAGES if stage not in run.log.seconds],
    }


def run_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warnings about a run's motion and what it is made of, each a text and a code."""
    return [
        *model_warnings(run),
        *_motion_warnings(run),
        *deflection_warnings(run),
        *stretching_warnings(run, TOO_LARGE),
        *loop_warnings(run),
        *periodic_warnings(run),
        *coupling_warnings(run),
        *_sampling_warnings(run),
        *contact_warnings(run),
        *gear_teeth_warnings(run),
    ]


def _state_figures(summary: dict[str, Any], budget: Budget | None) -> None:
    """Give the largest stresses and the tip's largest deflection their better values and intervals, or say why not."""
    rows = {} if budget is None else {row.name: row for row in budget.rows}
    figures = [
        (own, f"{body}, largest von Mises stress", "pa")
        for body, own in summary.get("worst_stress", {}).items()
        if isinstance(own, dict)
    ]
    if "peak_tip_deflection_m" in summary:
        figures.append((summary["tip"], "tip, largest deflection", "m"))
    for figure, quantity, unit in figures:
        row = rows.get(quantity)
        interval = None if row is None else row.interval
        figure[f"better_{unit}"] = None if row is None else row.better
        figure[f"interval_{unit}"] = interval and [*interval]
        figure.pop("why", None)
        if interval is None:
            figure["why"] = "no error budget states it" if row is None else row.why


def _left_out_modes(run: Pipeline) -> dict[str, list[int]]:
    """Return the numbers from 1 of the modes of each body that no run integrates: nothing excites them."""
    parts = [plan.excited.left_out if plan.excited else {} for plan in run.plans.values()]
    return {
        body: [k + 1 for k in modes if all(k in part.get(body, ()) for part in parts)]
        for body, modes in parts[0].items()
    }


def _worst_stress(run: Pipeline, body: str, time: float, node: int, value: float) -> dict[str, Any]:
    """Return the largest von Mises stress of a body, its time, and its place in the part's own coordinates."""
    place = run.bodies[run.frame_of(body)].origin + run.node_positions(body)[run.stress_of(body).nodes[node]]
    return {"value_pa": value, "time_s": time, "position_m": place.tolist()}


def _integrations(run: Pipeline) -> list[dict[str, Any]]:
    """Figures of each of the scene's runs: method, step, work, stability, differences from the first, and its end."""
    first = run.motion
    compared = run.stands_alone and first.trajectory.seconds > 0.0  # a clock may not tell how long a short march took
    limits = [plan.integrator.largest_step(plan.system) for plan in run.plans.values()]
    return [
        {
            "integrator": motion.trajectory.integrator,
            "step_s": motion.trajectory.step,
            "substeps": motion.trajectory.substeps,
            "forces": getattr(run.plans[label].integrator, "forces", None),
            "seconds": motion.trajectory.seconds,
            "spread": motion.trajectory.spread,
            "ratio_to_plain": motion.trajectory.seconds / first.trajectory.seconds if compared else None,
            "evaluations": motion.trajectory.evaluations,
            "fast_evaluations": motion.trajectory.fast_evaluations,
            "error": motion.trajectory.error and SAFETY * motion.trajectory.error,
            "growth": run.plans[label].growth,
            "part_over_plain": run.plans[label].over_plain,
            "largest_stable_step_s": limit if np.isfinite(limit) else None,
            "stability_margin": limit / motion.trajectory.step if np.isfinite(limit) else None,
            **motion.differences(first),
            "final": motion.final(),
        }
        for (label, motion), limit in zip(run.motions.items(), limits, strict=True)
    ]


def model_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warnings about what a run's motion, and answers of its linearised mechanism, are made of."""
    return [*mode_warnings(run), *_stiffness_warnings(run), *_division_warnings(run)]


def _stiffness_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warnings about bodies that the loads through them bring to buckling, or that should be stiffened and aren't."""
    found = []
    for name, change in run.stiffness_changes.items():
        if change.growth > 0.0 and not part_of(name):
            text = (
                f"{name}: the loads through it pass {change.buckling:.3g} times its buckling load at "
                f"t = {change.buckles_at:.4g} s; what grows from there is right only while it is small"
            )
            found.append({"code": "buckling", "body": name, "text": text})
    for name, spin in run.stiffening_loads.items():
        if not spin.stiffened and spin.change > run.scene.simulation.error:
            why = _why_not_stiffened(run.parts[name])
            text = (
                f"{name}: the loads through it can change its stiffness by up to {100 * spin.change:.2g} %, which is "
                f"left out: {why}"
            )
            found.append({"code": "stiffening-left-out", "body": name, "text": text})
    return found


def _why_not_stiffened(part: FlexiblePart) -> str:
    """Return why a body's stiffening is left out, and what would give it."""
    if part.can_be_stiffened:
        return "simulation.stiffening is off"
    return "it has but its file's" if part.is_reduced else "matrices.geometric_stiffness gives it"


def _division_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warnings about parts whose pieces vibrate, deflect or warp otherwise than the part in one piece."""
    unwarped = [
        {
            "code": "pieces",
            "body": name,
            "text": f"{name}: sections = 'warping' has fewer than six independent motions where pieces {cut.first + 1} "
            f"and {cut.second + 1} meet, and keeps none of them common there; a finer mesh across the cut has more, "
            "and sections = 'tractions' says that none are wanted",
        }
        for name, divided in run.division.divided.items()
        for cut in divided.unwarped_cuts
    ]
    return unwarped + [
        {
            "code": "pieces",
            "body": name,
            "text": f"{name}: the {what} of its {len(divided.pieces)} pieces together differ by up to "
            f"{100 * error:.2g} % from those of the part in one piece; a larger modes.count than "
            f"{run.scene.flexible[name].modes.count} helps where fast motions matter, sections = 'warping' "
            "where walls are thin, another number of pieces where a cut runs through a thick joint",
        }
        for name, divided in run.division.divided.items()
        for what, error in divided.errors.items()
        if error > {"lowest frequencies": PIECES_FREQUENCIES, "deflections": PIECES_DEFLECTIONS}[what]
    ]


def _sampling_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warn of sample times of controllers that make a closed loop unstable, or its exchange with an FMU coarse."""
    if not run.scene.sampled:
        return []
    from fmd.stages.sampling_check import find_coarse_exchanges, find_unstable_sampling, states_of_motion

    texts = [find_unstable_sampling(run, states_of_motion(run)), *find_coarse_exchanges(run)]
    return [{"code": "sample-time", "text": text} for text in texts if text]


def _motion_warnings(run: Pipeline) -> list[dict[str, str]]:
    """Warnings about results that can't be right, each a text and a code."""
    acts = any(not activity.quiet.all() for activity in run.mechanism.activities)
    duration = run.scene.simulation.duration
    idle = [
        {
            "code": "load-without-effect",
            "text": f"drive.{name} is 0 until the end of the simulation, t = {duration:g} s; check its times (the t of "
            "a formula is in seconds) and simulation.duration",
        }
        for name in find_idle_drives(run.scene)
    ]
    idle += [
        {
            "code": "table-jumps",
            "text": f"drive.{name} repeats a table that doesn't end as it begins: each time it jumps by "
            f"{100 * gap:.2g} % of its largest value",
        }
        for name, gap in find_jumping_tables(run.scene)
    ]
    output_step = run.scene.simulation.output_step
    for label, plan in run.plans.items():
        method = repeat_choice(plan, run.motions[label].trajectory).integrator
        within = method.step > output_step and not method.dense_output
        if within and method.step * plan.system.highest_frequency > 1.0:
            text = (
                f"{label}: outputs every {output_step:.4g} s lie within steps of {method.step:.4g} s, where fast "
                "vibrations aren't known: accelerations and forces there may be far off; a longer "
                "simulation.output_step, or a shorter step"
            )
            idle.append({"code": "outputs-within-steps", "text": text})
    return idle + [
        {
            "code": UNMOVED,
            "text": f"{motion.trajectory.integrator}: a load acts, but nothing moves; check its place and direction, "
            "and what the joints leave free",
        }
        for motion in run.motions.values()
        if acts and motion.trajectory.q.size and not np.ptp(motion.trajectory.q, axis=0).any()
    ]


def _budget_warnings(run: Pipeline, budget: Budget, seconds: float) -> list[dict[str, str]]:
    """Warnings about estimates that were left out, and about a wanted accuracy that the model itself doesn't reach."""
    warnings = []
    if budget.left_out:
        sources: dict[str, list[str]] = {}
        for source, _, why in (each.partition(": ") for each in budget.left_out):
            sources.setdefault(why, []).extend(source.split(", "))
        text = "the error budget isn't whole: " + "; ".join(
            f"{', '.join(dict.fromkeys(of))}: {why}" for why, of in sources.items()
        )
        if any(TIME_IS_SHORT in why for why in budget.left_out):
            allowed = seconds if math.isfinite(seconds) else budget.seconds
            text += f"; with --budget-seconds {math.ceil(MORE_TIME * max(allowed, 1.0))} more of it is estimated"
        warnings.append({"code": "budget-incomplete", "text": text})
    method, error = next(iter(run.plans.values())).integrator, run.scene.simulation.error
    if method.chooses_method and budget.integration is not None and budget.integration > SAFETY * error:
        text = (
            f"two marches by auto agreed within simulation.error, {error:g}; a third says {budget.integration:.1g}: "
            "both missed the same; a smaller simulation.error helps"
        )
        warnings.append({"code": "integration-error", "text": text})
    wanted = run.scene.accuracy
    causes = [each for each in budget.model if each.counted and wanted is not None and SAFETY * each.error > wanted]
    for each in causes:
        text = (
            f"the wanted accuracy is that of the equations as they are solved; the model itself is off by about "
            f"{100 * each.error:.2g} % in '{each.quantity}': {each.text}"
        )
        warnings.append({"code": "model-error", "text": text})
    return warnings


def _element_histories(run: Pipeline) -> dict[str, dict[str, Any]]:
    """Von Mises stress of each named element over each run."""
    names = [f"{body}.{element}" for body, part in run.wholes.items() for element in part.elements]
    return {name: run.element_stress(name) for name in names}


def _body(run: Pipeline, name: str) -> dict[str, Any]:
    """Figures of a flexible body: mass, frequencies in its frame, coupling, and the effect of its spin.

    Of a body in pieces they are the sum of the pieces' masses, the lowest or largest value of any piece, and the
    frequencies of the first.
    """
    pieces = [part.name for part in run.pieces_of(name)]
    bodies, spins = [run.bodies[own] for own in pieces], [run.stiffening_loads[own] for own in pieces]
    deformations = [run.deformations[own] for own in pieces if own in run.deformations]
    changes = [run.stiffness_changes[own] for own in pieces if own in run.stiffness_changes]
    critical = min(spin.critical_rate for spin in spins)
    figures: dict[str, Any] = {} if len(pieces) == 1 else {"pieces": len(pieces)}
    return figures | {
        "frequencies_in_frame_hz": bodies[0].frequencies_hz.tolist(),
        "coupling": max(body.coupling for body in bodies),
        "prescribed": run.parts[pieces[0]].joint.prescribed,
        "mass_kg": sum(body.integrals.mass for body in bodies),
        "largest_spin_rad_s": max(spin.largest_rate for spin in spins),
        "critical_spin_rad_s": critical if np.isfinite(critical) else None,
        "stiffened": any(spin.stiffened for spin in spins),
        "largest_rotation_rad": max((own.rotation for own in deformations), default=None),
        "largest_strain": max((own.strain for own in deformations), default=None),
        "stiffness_change": max((change.largest for change in changes), default=None),
        "buckling_load_factor": max((change.buckling for change in changes), default=None),
    }

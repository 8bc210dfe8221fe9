"""Scenes whose mechanisms differ in springs, rests and dampers of joints: what they share is found for all at once."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np

from fmd.core.errors import AccuracyError, InputError, StabilityError
from fmd.core.limits.memory import VALUES_AT_ONCE
from fmd.dynamics.compiled_system.shared import structure_of
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.fixed_step import FixedStepIntegrator
from fmd.stability.variants import JoinedPoints, VariantStart, differ_in_numbers, find_points_of_variants
from fmd.stages.found_together import known_marches, known_points
from fmd.stages.pipeline import Pipeline
from fmd.stages.plan import Plan


def share_growth(runs: Sequence[Pipeline]) -> None:
    """Find the growth of small vibrations by the methods of many scenes, for the stage "stability" of each to take.

    Those of one structure, with one method and step, are looked at together. What fails is left to each scene's own
    stage, which says why.
    """
    for number in range(max(len(run.scene.simulation.run) for run in runs)):
        alike: dict[Hashable, list[Pipeline]] = {}
        for run in runs:
            try:
                plan = run.drafts[number]
            except (IndexError, InputError, AccuracyError):
                continue
            method: Any = plan.integrator
            if not _starts_alike(method, plan.system):
                continue
            limit = method.largest_step(plan.system)
            if method.step < limit and (np.isfinite(limit) or method.may_grow(plan.system)):
                key = (structure_of(plan.system), method, run.scene.simulation.duration)
                alike.setdefault(key, []).append(run)
        for some in alike.values():
            if len(some) > 1:
                _share_growth_by_run(some, number)


def _starts_alike(method: Any, system: CompiledSystem) -> bool:
    """Tell whether a method takes states with numbers of their own: it has fixed steps, and its start is no more."""
    return isinstance(method, FixedStepIntegrator) and differ_in_numbers(system) and method.lag(system) is not None


def _share_growth_by_run(runs: Sequence[Pipeline], number: int) -> None:
    """Find the growth by the run of a number of scenes that have its structure, method and duration in common."""
    plans = [run.drafts[number] for run in runs]
    pairs = [*zip(runs, plans, strict=True)]
    known = [points for run, plan in pairs for points in known_points(run) if points.system is plan.system]
    if len(known) < len(runs):
        variants = [VariantStart(plan.system, run.mechanism, *run.start) for run, plan in pairs]
        try:
            known = find_points_of_variants(variants, runs[0].scene.simulation.duration)
        except StabilityError:  # which the stage of whose mechanism it is meets again
            return
        for run, points in zip(runs, known, strict=True):
            known_points(run).append(points)
    method: Any = plans[0].integrator
    JoinedPoints(known).find_growth(method)


def share_marches(runs: Sequence[Pipeline]) -> None:
    """March many scenes by the methods with fixed steps, for the stage "motion" of each to take.

    Those of one structure, with one method, step and output times, are marched by one call of a kernel. What fails is
    left to each scene's own stage.
    """
    alike: dict[Hashable, list[tuple[Pipeline, str, Plan]]] = {}
    for run in runs:
        try:
            plans = run.plans
        except (InputError, AccuracyError):
            continue
        simulation = run.scene.simulation
        for label, plan in plans.items():
            system, method = plan.marched[0], plan.integrator
            if _starts_alike(method, system):
                key = (structure_of(system), method, simulation.duration, simulation.output_step)
                alike.setdefault(key, []).append((run, label, plan))
    for some in alike.values():
        (run, _, plan), times = some[0], some[0][0].output_times
        system, method = plan.marched[0], plan.integrator
        size = len(some) * len(times) * (system.n_positions + system.n)
        if len(some) == 1 or size > VALUES_AT_ONCE or not isinstance(method, FixedStepIntegrator):
            continue
        states = [np.concatenate([q, v, own.compiled.numbers]) for own, q, v in (plan.marched for _, _, plan in some)]
        for (run, label, plan), march in zip(some, method.marches(system, np.array(states), times), strict=True):
            if march is not None:
                known_marches(run)[label] = plan.spread_out(march)

"""Scenes whose mechanisms differ in springs, rests and dampers of joints: what they share is found for all at once."""

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError, StabilityError
from fmd.core.limits.memory import FINE_VALUES_AT_ONCE, RIGID_MOTIONS_AT_ONCE, VALUES_AT_ONCE
from fmd.core.limits.stepping import NEARLY
from fmd.dynamics.compiled_system.shared import share_system, structure_of
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.transmitted_loads import transmitted_loads_of
from fmd.integrators.automatic import Automatic
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.fixed_step import FixedStepIntegrator
from fmd.integrators.march_pairs import Pairs, pairs_of
from fmd.integrators.protocol import Trajectory
from fmd.stability.variants import VariantStart, differ_in_numbers, find_growth_together, find_points_of_variants
from fmd.stages.found_together import FINE, keep_known_loads, known_marches, known_points
from fmd.stages.pipeline import Pipeline
from fmd.stages.plan import Plan, repeat_choice
from fmd.stages.runs import build_linear_mechanism
from fmd.stages.stiffening_check import RigidLoads, move_rigidly


def share_loads(runs: Sequence[Pipeline]) -> None:
    """Find the loads by the rigid motions of many scenes, for the stage "loads" of each to take.

    Those of one structure are found together, where neither loops nor force elements leave any open. What fails is left
    to each scene's own stage, which says why.
    """
    alike: dict[Hashable, list[tuple[Pipeline, Mechanism, Kinematics]]] = {}
    for run in runs:
        try:
            mechanism = build_linear_mechanism(run) if run.parts else None
            if mechanism is None or mechanism.closures or mechanism.elements:
                continue
            motion = move_rigidly(run.divided_scene, mechanism)
        except (InputError, AccuracyError):
            continue
        key = structure_of(share_system(motion.mechanism)), float(motion.times[-1])
        alike.setdefault(key, []).append((run, mechanism, motion))
    for some in alike.values():
        for first in range(0, len(some), RIGID_MOTIONS_AT_ONCE):
            own = some[first : first + RIGID_MOTIONS_AT_ONCE]
            loads = transmitted_loads_of([motion for *_, motion in own])
            for (run, mechanism, motion), found in zip(own, loads, strict=True):
                keep_known_loads(run, RigidLoads(mechanism, motion, found))


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
            fixed = isinstance(method, FixedStepIntegrator) and differ_in_numbers(plan.system)
            if fixed and method.step < method.largest_step(plan.system) < np.inf:
                key = (structure_of(plan.system), method, run.scene.simulation.duration)
                alike.setdefault(key, []).append(run)
        for some in alike.values():
            if len(some) > 1:
                _share_growth_by_run(some, number)


def _starts_alike(method: Any, system: CompiledSystem) -> bool:
    """Tell whether a method takes states with numbers of their own: it has fixed steps, and its start is no more."""
    return isinstance(method, FixedStepIntegrator) and differ_in_numbers(system) and method.lag(system) is not None


def _share_growth_by_run(runs: Sequence[Pipeline], number: int) -> None:
    """Find operating points of scenes of one structure, and the growth by their run of a number if it starts alike."""
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
    if _starts_alike(plans[0].integrator, plans[0].system):
        find_growth_together(known, plans[0].integrator)


def share_marches(runs: Sequence[Pipeline]) -> None:
    """March many scenes by the methods with fixed steps, for the stage "motion" of each to take.

    Those of one structure, with one method, step and output times, are marched by one call of a kernel. Those by
    'auto' have one choice in common. What fails is left to each scene's own stage.
    """
    alike: dict[Hashable, list[_Run]] = {}
    for run in runs:
        try:
            plans = run.plans
        except (InputError, AccuracyError):
            continue
        simulation = run.scene.simulation
        for label, plan in plans.items():
            system, method = plan.marched[0], plan.integrator
            if differ_in_numbers(system) if isinstance(method, Automatic) else _starts_alike(method, system):
                key = (structure_of(system), method, simulation.duration, simulation.output_step)
                alike.setdefault(key, []).append(_Run(run, label, plan))
    for some in alike.values():
        (run, _, plan), method = some[0], some[0].plan.integrator
        size = len(some) * len(run.output_times) * (plan.marched[0].n_positions + plan.marched[0].n)
        if len(some) == 1 or size > VALUES_AT_ONCE:
            continue
        if isinstance(method, Automatic):
            _share_choice(some, method)
        elif isinstance(method, FixedStepIntegrator):
            for own, march in zip(some, _march_together(some, method, run.output_times), strict=True):
                own.keep(march)


def share_fine_marches(runs: Sequence[Pipeline]) -> None:
    """March the first runs of many scenes again, in the same steps, for the stage "fine motion" of each to take.

    Those with something flexible at the tip that have one structure, method and step are marched by one call of a
    kernel, which samples at the times of all; each takes its own. What wouldn't fit in memory each marches by itself.
    """
    alike: dict[tuple[Hashable, Any], list[tuple[_Run, Array]]] = {}
    for run in runs:
        try:
            if not len(run.motion.tip_link.omega):
                continue
            times, outputs = run.fine_times
            plan = repeat_choice(next(iter(run.plans.values())), run.motion.trajectory)
        except (InputError, AccuracyError):
            continue
        system, method = plan.marched[0], plan.integrator
        if len(times) > len(outputs) and _starts_alike(method, system):
            alike.setdefault((structure_of(system), method), []).append((_Run(run, FINE, plan), times))
    for (_, method), some in alike.items():
        times, system = np.unique(np.concatenate([own for _, own in some])), some[0][0].plan.marched[0]
        size = len(some) * len(times) * (system.n_positions + system.n)
        if len(some) == 1 or size > FINE_VALUES_AT_ONCE:
            continue
        marches = _march_together([own for own, _ in some], method, times)
        for (own, asked), march in zip(some, marches, strict=True):
            at = np.searchsorted(times, asked)
            own.keep(march and replace(march, times=asked, q=march.q[at], v=march.v[at]))


class _Run(NamedTuple):
    """A run of a scene, with its label among the scene's and its plan."""

    run: Pipeline
    label: str
    plan: Plan

    def keep(self, march: Trajectory | None) -> None:
        """Keep a march of what is integrated for the stage "motion" to take, if there is one."""
        if march is not None:
            known_marches(self.run)[self.label] = self.plan.spread_out(march)


def _march_together(some: Sequence[_Run], method: FixedStepIntegrator, times: Array) -> list[Trajectory | None]:
    """March what is integrated of runs of one structure by a method to output times; those that diverge give None."""
    states = [np.concatenate([q, v, own.compiled.numbers]) for own, q, v in (each.plan.marched for each in some)]
    return method.marches(some[0].plan.marched[0], np.array(states), times)


def _share_choice(some: Sequence[_Run], auto: Automatic) -> None:
    """March runs of one structure by the method and the step that 'auto' takes for the one that vibrates fastest.

    Each has its error by two marches of its own. Those whose marches don't agree take shorter steps together, once, and
    make their own choice where that isn't enough.
    """
    fastest = max(some, key=lambda each: each.plan.marched[0].highest_frequency)
    try:
        march = fastest.plan.march(fastest.run.output_times)
    except AccuracyError:  # which its own stage meets again
        return
    known_marches(fastest.run)[fastest.label] = march
    if not isinstance(chosen := march.chosen, CentralDifference):
        return
    left = [(each, pairs_of(each.plan.marched[0], auto.error)) for each in some if each is not fastest]
    for method in (replace(chosen, step=NEARLY * chosen.step), chosen):
        left = _judge_together(left, auto, method)
    if left:
        _judge_together(left, auto, replace(chosen, step=chosen.step / max(own.more_steps() for _, own in left)))


def _judge_together(
    runs: Sequence[tuple[_Run, Pairs]], auto: Automatic, method: CentralDifference
) -> list[tuple[_Run, Pairs]]:
    """March runs, each with its marches before, and keep those that agree with these; return the others.

    Those that diverge aren't among them: they make their own choice.
    """
    left, marches = [], _march_together([own for own, _ in runs], method, runs[0][0].run.output_times)
    for (own, report), march in zip(runs, marches, strict=True):
        own.keep(found := march and auto.judge(march, method, own.plan.marched[0], report))
        if march and not found:
            left.append((own, report))
    return left

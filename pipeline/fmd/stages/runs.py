"""From a scene's runs to integrators, each with the mechanism that it marches, its split and its step."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, ConvergenceError, InertiaError, InputError, StabilityError
from fmd.core.limits.contact import CHOSEN_STEP
from fmd.core.limits.mechanism import NO_FORCE
from fmd.core.limits.stability import ALLOWED_GROWTH, LEAST_CYCLES, SURELY_STABLE, TRIED_PART, TRIED_TIMES
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.excited_modes import excited_part
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import Integrator, Trajectory
from fmd.integrators.side_by_side import time_by_turns
from fmd.recovery.deformation import Deformation, measure_deformation
from fmd.scene.run_table import SubCycledRun
from fmd.stability.limits import longest_safe_step
from fmd.stages.buckling import StiffnessChange, find_changes, require_unbuckled
from fmd.stages.contact_steps import leave_fastest_out, limit_contact_step, most_halvings, step_key, steps_settle
from fmd.stages.found_together import FINE, known_marches, known_points, take_known_loads
from fmd.stages.like_mechanisms import build_like
from fmd.stages.mechanism import find_start, place_joints
from fmd.stages.plan import Growth, Plan, repeat_choice
from fmd.stages.run_checks import (
    require_countable_steps,
    require_inertia,
    require_known_phases,
    require_resolved_loads,
    require_room,
)
from fmd.stages.run_times import with_compared_times
from fmd.stages.stage import forget
from fmd.stages.stiffening_check import (
    StiffeningLoads,
    check_stiffening_loads,
    find_rigid_loads,
    keep_inertia_of_pieces,
    rigid_spins,
)

if TYPE_CHECKING:
    from fmd.dynamics.mechanism import Mechanism
    from fmd.recovery.motion import Motion
    from fmd.reduction.body import FlexibleBody
    from fmd.scene.runs import Run
    from fmd.stability.operating_points import OperatingPoints
    from fmd.stages.pipeline import Pipeline

MACHINE_CODE = "machine code"
"""Name of the stage that compiles, or reads, all that marches call."""


def check_loads(run: Pipeline) -> Mapping[str, StiffeningLoads]:
    """Check the loads through each part and piece of a run; raises as `check_stiffening_loads`."""
    run.scene.simulation  # noqa: B018 - a scene of parts alone is refused before anything is reduced
    if not run.parts:
        return {}
    meshed = [name for name, part in run.parts.items() if part.can_be_stiffened or part.body.integrals.stiffening.size]
    found = take_known_loads(run) or find_rigid_loads(run.divided_scene, build_linear_mechanism(run))
    return check_stiffening_loads(run.divided_scene, _linear_bodies(run), meshed, found)


def build_linear_mechanism(run: Pipeline) -> Mechanism:
    """Build the mechanism of a run's bodies as they are reduced, none of them stiffened."""
    mechanism = build_like(run.built, run.divided_scene, _linear_bodies(run))
    if run.scene.gear_mesh:
        from fmd.stages.gear_teeth import couple_gears

        return couple_gears(run, mechanism)
    return mechanism


def _linear_bodies(run: Pipeline) -> dict[str, FlexibleBody]:
    return {name: part.body for name, part in run.parts.items()}


def stiffen_bodies(run: Pipeline) -> Mapping[str, FlexibleBody]:
    """Return the reduced bodies of a run, those stiffened whose loads count."""
    simulation, loads = run.scene.simulation, run.stiffening_loads
    linear = _linear_bodies(run)
    stiff = {name: part.stiffened for name, part in run.parts.items() if loads[name].stiffened}
    error = 0.0 if simulation.stiffening == "on" else simulation.error
    return linear | stiff | keep_inertia_of_pieces(linear, stiff, loads, error)


def find_stiffness_changes(run: Pipeline) -> Mapping[str, StiffnessChange]:
    """Return the changes of stiffness of a run's bodies; none where bodies were given in place of the scene's own."""
    return {} if run.has_other_bodies else find_changes(run.mechanism, run.stiffening_loads)


def draft_plans(built: Pipeline) -> tuple[Plan, ...]:
    """Make a scene's runs ready to be integrated, with steps whose stability isn't known yet.

    Raises
    ------
    InputError
        A motion has no inertia.
    """
    require_inertia(built.scene, built.system)
    given = _given_step(built)
    return tuple(_draft_plan(built, k, given) for k in range(len(built.scene.simulation.run)))


def measure_growths(built: Pipeline) -> tuple[Growth, ...]:
    """Measure the growth of small vibrations by the method of each run.

    Raises
    ------
    InputError
        A step is beyond its stability limit or steps over a load, or vibrations would grow visibly by the method.
    """
    simulation, growths = built.scene.simulation, []
    known = known_points(built)
    for run, plan in zip(simulation.run, built.drafts, strict=True):
        require_countable_steps(built.scene.file, plan.key, plan.integrator.step, simulation.duration)
        require_known_phases(built.scene.file, plan.key, plan.integrator, plan.system, simulation)
        require_resolved_loads(built.scene.file, plan.key, plan.integrator, plan.system)
        chosen = getattr(run, "forces", None) == "auto" and plan.integrator.substeps > 1
        growths.append((_choose_forces if chosen else _measure_growth)(built, plan, run, known))
    return tuple(growths)


def _choose_forces(built: Pipeline, plan: Plan, run: Run, known: list[OperatingPoints]) -> Growth:
    """Return the growth of a run with carried forces, if these are cheapest at the wanted error, else with its own.

    Their error is that of the first part of the motion, beside plain central differences, as if it went on growing.
    Vibrations may grow by them as much as the wanted error, or as by the tangents that would be taken else.
    """
    method: Any = plan.integrator
    carried, plain = replace(method, forces="carried"), CentralDifference(method.step)
    simulation, stable = built.scene.simulation, method.step < method.largest_step(plan.system)
    times = np.linspace(0.0, TRIED_PART * simulation.duration, TRIED_TIMES)
    enough = times[-1] >= LEAST_CYCLES * method.substeps * method.step
    if plan.system.takes_whole_cycles or not (carried.suits(plan.system) and stable and enough):
        return _measure_growth(built, plan, run, known)
    try:
        growth = _measure_growth(built, replace(plan, integrator=carried), run, known)
        exact, found = (replace(plan, integrator=each).march(times) for each in (plain, carried))
    except (InputError, StabilityError):
        return _measure_growth(built, plan, run, known)
    groups, _ = plan.system.groups
    error = max(_relative_difference(found.q[:, groups == k], exact.q[:, groups == k]) for k in np.unique(groups))
    fits = growth.step is None and error / TRIED_PART <= simulation.error
    if fits and growth.factor - 1.0 <= simulation.error:
        return replace(growth, carried=True)
    other = _measure_growth(built, plan, run, known)
    if fits and growth.factor <= other.factor:
        return replace(growth, carried=True)
    if not built.stands_alone:
        return other
    marches = {each.name: partial(replace(plan, integrator=each).march, times) for each in (plain, method)}
    timed = time_by_turns({name: march() for name, march in marches.items()}, marches)
    return replace(other, over_plain=timed[method.name].seconds / timed[plain.name].seconds)


def _relative_difference(found: Array, exact: Array) -> float:
    """Return the largest difference over the largest value, 0 where all are 0."""
    difference = float(np.abs(found - exact).max())
    return difference / float(np.abs(exact).max()) if difference else 0.0


def finish_plans(built: Pipeline) -> dict[str, Plan]:
    """Return a scene's runs with stable steps, each under a label of its integrator and ratio; raises as `growths`."""
    plans: dict[str, Plan] = {}
    for k, (plan, growth) in enumerate(zip(built.drafts, built.growths, strict=True)):
        method: Any = plan.integrator
        if growth.step is not None:
            method = replace(method, step=growth.step)
        if growth.carried:
            method = replace(method, forces="carried")
        label = built.scene.simulation.run[k].label(method.substeps)
        checked = replace(plan, integrator=method, growth=growth.factor, over_plain=growth.over_plain)
        alike = (each for each in plans.values() if each.mechanism is plan.mechanism and each.start is plan.start)
        plans[f"{label} ({k})" if label in plans else label] = _leave_out_modes(built, checked, next(alike, None))
    return plans


def plan_like(plan: Plan, variant: Pipeline) -> Plan:
    """Plan the first run of a scene's variant by the method and the step of a run whose growth is known.

    The step is a shorter one where the variant's highest frequency takes that.
    """
    first = plan_frozen(plan, variant)
    method: Any = plan.integrator
    limit = method.largest_step(first.system)
    return first if method.step < limit else replace(first, integrator=replace(method, step=SURELY_STABLE * limit))


def plan_frozen(plan: Plan, variant: Pipeline) -> Plan:
    """Plan the first run of a scene's variant by the method and the step of a run, whatever the variant's limit."""
    first = _draft_plan(variant, 0, _given_step(variant))
    like, own = plan.system.compiled, first.system.compiled
    alike = (first.mechanism.n, len(first.mechanism.links)) == (plan.mechanism.n, len(plan.mechanism.links))
    if alike and own.digest != like.digest:
        own.trace_like(like)  # may then have the run's code
    return _leave_out_modes(variant, replace(first, integrator=plan.integrator))


def _draft_plan(built: Pipeline, k: int, given: float | None) -> Plan:
    simulation = built.scene.simulation
    run = simulation.run[k]
    key = step_key(built.scene, k)
    if isinstance(run, SubCycledRun):
        return plan_sub_cycled(built, run, key, given)
    method = run.make(run.step or given or 0.0, simulation.error, simulation.duration)
    return Plan(key, method, built.mechanism, built.system, built.start)


def _leave_out_modes(built: Pipeline, plan: Plan, alike: Plan | None = None) -> Plan:
    """Leave the modes out of a run that nothing excites, unless all are to be kept; as in a plan of the same motion."""
    if alike is not None:
        return replace(plan, excited=alike.excited, excited_system=alike.excited_system)
    part = None
    if not built.keep_all:
        part = excited_part(plan.mechanism, plan.start[0], NO_FORCE * built.scene.simulation.error)
    if part is None:
        return plan
    return replace(plan, excited=part, excited_system=share_system(part.mechanism))


def _measure_growth(built: Pipeline, plan: Plan, run: Run, known: list[OperatingPoints]) -> Growth:
    """Measure the growth of small vibrations by a run's method; shorten its step for that if the scene gives none.

    The operating points of a system are the same for all of its runs; those ``known`` are taken, new ones added.
    """
    method: Any = plan.integrator  # a method with a limit has a step, and resumes
    limit, free = method.largest_step(plan.system), built.scene.simulation.step == "auto" and not run.step
    if plan.mechanism.contacts:
        apart = Growth()
        if plan.integrator.substeps > 1:
            mechanism = replace(plan.mechanism, contacts=())
            own = replace(plan, mechanism=mechanism, system=share_system(mechanism))
            apart = _measure_growth(built, own, run, known)
        return limit_contact_step(built, plan, run, free, apart)
    if not method.step < limit and not free:
        mend = (
            f"{method.name} would diverge; the largest stable step of this model is {limit:.4g} s "
            f"({method.describe_limit(plan.system)}{run.limit_remedy})"
        )
        raise InputError(built.scene.file, plan.key, f"{method.step:.6g} s", mend)
    if not (np.isfinite(limit) or method.may_grow(plan.system)):  # implicit, exact, or steered by its error
        return Growth()
    from fmd.stability.operating_points import find_operating_points

    duration = built.scene.simulation.duration
    points = next((own for own in known if own.system is plan.system), None)
    if points is None:
        try:
            if built.stands_alone:
                built.store.compute(MACHINE_CODE, plan.compile)
            points = find_operating_points(plan.system, built.mechanism, *built.start, duration)
        except StabilityError:  # of the mechanism itself: the march will tell
            return Growth()
        known.append(points)
    folds = points.e_folds(method) if method.step < limit else np.inf
    if folds > np.log(ALLOWED_GROWTH):
        # A remedy is found from the worst point, at an eighth of the cost; a step to march with counts them all.
        search = points if free or not method.step < limit else points.worst(method)
        longest = longest_safe_step(lambda step: search.e_folds(replace(method, step=step)), min(method.step, limit))
        if not (free and longest):
            mend = _describe_growth(method, folds, longest) + ("" if built.scene.contact else run.growth_remedy)
            raise InputError(built.scene.file, plan.key, f"{method.step:.6g} s", mend)
        return Growth(longest, float(np.exp(points.e_folds(replace(method, step=longest)))))
    return Growth(None, float(np.exp(folds)))


def _describe_growth(method: Integrator, folds: float, longest: float) -> str:
    ratio = f" {m}:1" if (m := method.substeps) > 1 else ""
    grows = "at once" if folds > 100 else f"by a factor of {np.exp(folds):.3g} over the scene"
    mend = f"a step of {longest:.3g} s keeps that below {ALLOWED_GROWTH:g}" if longest else "no step is short enough"
    return f"{method.name}{ratio} is unstable here: it makes small vibrations grow {grows}; {mend}"


def _given_step(built: Pipeline) -> float | None:
    """Return the scene's step; "auto" is plain central difference's for the required error, about the reference state.

    It is short enough for the loads, too, also where runs freeze them over a cycle of steps.
    """
    simulation = built.scene.simulation
    if simulation.step != "auto":
        return simulation.step
    from fmd.stability.splitting import longest_step

    longest = longest_step(*built.reference_matrices, simulation.error, simulation.duration)
    counts = [run.substeps for run in simulation.run if isinstance(run, SubCycledRun)]
    most = max((count for count in counts if isinstance(count, int)), default=1)
    return built.system.resolving_step(longest * most)[0] / most


def plan_sub_cycled(built: Pipeline, run: SubCycledRun, key: str, given: float | None) -> Plan:
    """Plan a sub-cycled run; each split of the coordinates has a mechanism with an order of its own."""
    simulation = built.scene.simulation
    step = run.step or given or 0.0
    if run.split == "joints":
        method = run.make(step, simulation.error, simulation.duration)
        return Plan(key, method, built.mechanism, built.system, built.start)
    from fmd.stability.splitting import choose_split, split_at

    whole, substeps = built.mechanism, run.substeps
    if run.split == "auto":
        spins = rigid_spins(whole, *place_joints(built.divided_scene, whole.rigid), simulation.duration)
        spin = max(float(np.sqrt(np.mean(np.sum(rates**2, axis=1)))) for rates in spins.values())
        choice = choose_split(built.system, simulation.error, simulation.duration, spin, step or None)
        frequency, substeps, step = choice.frequency_hz, choice.substeps, choice.step
        longest, _ = built.system.resolving_step(substeps * step)  # loads are frozen over a cycle
        substeps = max(1, int(longest / step * (1 + 1e-12)))
    else:
        frequency = run.split
    fast_joints, slow_modes = split_at(built.system, frequency)
    mechanism = replace(whole, fast_joints=fast_joints, slow_modes=slow_modes)
    system = share_system(mechanism)
    method = run.model_copy(update={"substeps": substeps}).make(step, simulation.error, simulation.duration)
    return Plan(key, method, mechanism, system, find_start(built.divided_scene, system))


def compile_plans(built: Pipeline) -> dict[str, Plan]:
    """Return a scene's runs, whose machine code is there, so that it counts for no run time."""
    for plan in built.plans.values() if built.stands_alone else ():
        plan.compile()
    return built.plans


def find_motions(run: Pipeline) -> dict[str, Motion]:
    """Return the motion by each run; where contact made or lost much energy by steps left open, with shorter ones.

    So it is where figures of contacts have to agree with half the step, until their change no longer falls. The errors
    are those of `Pipeline.motions`.
    """
    found: list[dict[str, Motion]] = []
    for _ in range(most_halvings(run)):
        with suppress(ConvergenceError):
            found = [*found[-2:], _find_whole_motions(run)]
            if steps_settle(run.scene, found):
                return found[-1]
        run.results["contact step"] = 0.5 * run.results.get("contact step", CHOSEN_STEP)
        forget(run, "stability")
    return _find_whole_motions(run)


def _find_whole_motions(run: Pipeline) -> dict[str, Motion]:
    """Return the motion by each run; one that lost its inertia is found anew with the whole energy of second order."""
    try:
        return _find_motions(run)
    except InertiaError:
        if run.whole_energy:
            raise
    run.whole_energy = True
    forget(run, "mechanism")
    known_marches(run).clear()
    return _find_motions(run)


def _find_motions(run: Pipeline) -> dict[str, Motion]:
    require_room(run.scene, run.mechanism)
    require_unbuckled(run.scene, run.stiffness_changes)
    plans = run.compiled_plans  # refuses a step before anything is timed
    trajectories = {label: _march(run, label, plan) for label, plan in plans.items()}
    if len(plans) > 1 and run.stands_alone:
        trajectories = with_compared_times(run, plans, trajectories)
    for label, plan in plans.items():
        plan.require_positive_mass(trajectories[label])
    return {label: run.motion_by(plan, trajectories[label]) for label, plan in plans.items()}


def _march(run: Pipeline, label: str, plan: Plan) -> Trajectory:
    """Integrate a run of the scene; where sampled controllers make the loop unstable, its failure says so."""
    if (known := known_marches(run).pop(label, None)) is not None:
        return known
    try:
        with run.store.monitor(label) as advance, run.while_timed():
            return plan.march(run.output_times, advance)
    except AccuracyError as error:
        if run.scene.sampled and not isinstance(error, InertiaError):
            from fmd.stages.sampling_check import find_unstable_sampling, state_of_start

            if cause := find_unstable_sampling(run, state_of_start(run)):
                raise AccuracyError(f"{error}; {cause}") from error
        if left := leave_fastest_out(run.scene) if isinstance(error, ConvergenceError) else "":
            raise ConvergenceError(f"{error}{left}, which stall it at any step where points slip and lift") from error
        raise


def march_finely(built: Pipeline) -> Motion:
    """Return the motion by the first run, in the same steps, at the output times and many more between them."""
    times, outputs = built.fine_times
    if len(times) == len(outputs):
        return built.motion
    plan = repeat_choice(next(iter(built.plans.values())), built.motion.trajectory)
    march = known_marches(built).pop(FINE) if FINE in known_marches(built) else plan.march(times)
    return built.motion_by(plan, march)


def measure_deformations(run: Pipeline) -> Mapping[str, Deformation]:
    """Return the rotations and strains of each part over the first run's motion."""
    return {
        name: measure_deformation(part.deformation_shapes, run.bodies[name], run.motion.modal(name))
        for name, part in run.parts.items()
    }

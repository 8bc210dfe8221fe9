"""From a scene's runs to integrators, each with the mechanism that it marches, its split and its step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InputError, StabilityError
from fmd.core.limits.mechanism import NO_FORCE
from fmd.core.limits.stability import ALLOWED_GROWTH, SURELY_STABLE
from fmd.dynamics.compiled_system.positive_mass import require_positive_over
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.excited_modes import Excited, excited_part
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import Integrator, Progress, Trajectory
from fmd.scene.run_table import SubCycledRun
from fmd.stability.safe_step import longest_safe_step
from fmd.stages.load_steps import (
    describe_fastest,
    require_countable_steps,
    require_known_phases,
    require_resolved_loads,
)
from fmd.stages.mass_check import require_inertia
from fmd.stages.mechanism import find_start, place_joints

if TYPE_CHECKING:
    from fmd.recovery.motion import Motion
    from fmd.reduction.body import FlexibleBody
    from fmd.scene.runs import Run
    from fmd.scene.scene import Scene
    from fmd.stability.operating_points import OperatingPoints
    from fmd.stages.stiffening_check import StiffnessChange
    from fmd.stages.store import StageStore

MACHINE_CODE = "machine code"
"""Name of the stage that compiles, or reads, all that marches call."""


class BuiltScene(Protocol):
    """A scene with its mechanism, as a `Pipeline` has it.

    Attributes
    ----------
    scene : Scene
        The scene.
    keep_all : bool
        Integrate modes that nothing can excite, too.
    store : StageStore
        Times what is compiled.
    results : dict of str to object
        Results of stages by their names.
    while_timed : callable
        Makes a context in which each run is timed.
    whole_energy : bool
        Displacements of second order count with their whole kinetic energy.
    """

    scene: Scene
    keep_all: bool
    store: StageStore
    results: dict[str, Any]
    while_timed: Callable[[], AbstractContextManager[None]]
    whole_energy: bool

    @property
    def divided_scene(self) -> Scene:
        """The scene with pieces as bodies of their own."""

    @property
    def bodies(self) -> Mapping[str, FlexibleBody]:
        """Reduced flexible bodies."""

    @property
    def mechanism(self) -> Mechanism:
        """Mechanism with the scene's own slow joints."""

    @property
    def system(self) -> CompiledSystem:
        """System that marches it."""

    @property
    def start(self) -> tuple[Array, Array]:
        """Positions and rates at the start."""

    @property
    def reference_matrices(self) -> tuple[Array, Array]:
        """Mass and stiffness of the undeformed mechanism."""

    @property
    def drafts(self) -> tuple[Plan, ...]:
        """Runs whose stability isn't known yet."""

    @property
    def growths(self) -> tuple[Growth, ...]:
        """Safe step of each run, and the growth of small vibrations by its method."""

    @property
    def compiled_plans(self) -> Mapping[str, Plan]:
        """Runs, ready to be integrated, whose machine code is there."""

    @property
    def stiffness_changes(self) -> Mapping[str, StiffnessChange]:
        """Change of each stiffened body's stiffness by the loads through it."""

    @property
    def output_times(self) -> Array:
        """Times of the results [s]."""

    def motion_by(self, plan: Plan, trajectory: Trajectory) -> Motion:
        """Return the motion that a trajectory describes."""


@dataclass(frozen=True)
class Plan:
    """A run of a scene, ready to be integrated: an integrator, a mechanism and a start.

    Attributes
    ----------
    key : str
        The scene's key of its step.
    mechanism : Mechanism
        With the run's own split into slow and fast coordinates.
    system : CompiledSystem
        The mechanism as it is marched, whose steps are limited.
    start : tuple of ndarray, shapes (n_positions,) and (n,)
        Positions and rates.
    excited : Excited, optional
        The part of the mechanism that is integrated, if some modes can be left at rest.
    excited_system : CompiledSystem, optional
        That part as it is marched.
    growth : float
        Factor by which an explicit method itself makes small vibrations grow over the scene.
    """

    key: str
    integrator: Integrator
    mechanism: Mechanism
    system: CompiledSystem
    start: tuple[Array, Array]
    excited: Excited | None = None
    excited_system: CompiledSystem | None = None
    growth: float = 1.0

    def require_positive_mass(self, trajectory: Trajectory) -> None:
        """Raise ``AccuracyError`` if the mass matrix isn't positive definite along a march of this plan."""
        require_positive_over(self.system, trajectory.times, trajectory.q)

    def compile(self) -> None:
        """Compile all functions that a march calls, or read them where they are kept."""
        self.march(np.zeros(1))

    def march(self, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate; coordinates of modes that stay at rest are 0. The end is that of what was integrated."""
        (q0, v0), part = self.start, self.excited
        if part is None or self.excited_system is None:
            return self._march(self.system, q0, v0, times, progress)
        march = self._march(self.excited_system, q0[part.positions], v0[part.rates], times, progress)
        q, v = np.tile(q0, (len(times), 1)), np.zeros((len(times), len(v0)))
        q[:, part.positions], v[:, part.rates] = march.q, march.v
        return replace(march, q=q, v=v)

    def _march(
        self, system: CompiledSystem, q0: Array, v0: Array, times: Array, progress: Progress | None
    ) -> Trajectory:
        """Integrate a system; an error says if a motion has lost its inertia, or which part is too fast to follow."""
        try:
            return self.integrator.march(system, q0, v0, times, progress)
        except StabilityError as failure:
            system.explain_failure(failure)
            duration = max(float(times[-1]), self.mechanism.horizon)
            raise StabilityError(
                f"{failure}{describe_fastest(system, duration)}", failure.time, failure.positions
            ) from failure


def repeat_choice(plan: Plan, trajectory: Trajectory) -> Plan:
    """Return a run's plan by the method and the step that an automatic choice ended with, which it made by marching."""
    return replace(plan, integrator=trajectory.chosen or plan.integrator)


@dataclass(frozen=True)
class Growth:
    """Step of a run that is safe to take, and the growth of small vibrations by the method itself.

    Attributes
    ----------
    step : float, optional
        Step in place of the plan's, which is too long [s].
    factor : float
        Factor by which small vibrations grow over the scene.
    """

    step: float | None = None
    factor: float = 1.0


def draft_plans(built: BuiltScene) -> tuple[Plan, ...]:
    """Make a scene's runs ready to be integrated, with steps whose stability isn't known yet.

    Raises
    ------
    InputError
        A motion has no inertia.
    """
    require_inertia(built.scene, built.system)
    given = _given_step(built)
    return tuple(_draft_plan(built, k, given) for k in range(len(built.scene.simulation.run)))


def measure_growths(built: BuiltScene) -> tuple[Growth, ...]:
    """Measure the growth of small vibrations by the method of each run.

    Raises
    ------
    InputError
        A step is beyond its stability limit or steps over a load, or vibrations would grow visibly by the method.
    """
    simulation, growths = built.scene.simulation, []
    known: list[OperatingPoints] = []
    for run, plan in zip(simulation.run, built.drafts, strict=True):
        require_countable_steps(built.scene.file, plan.key, plan.integrator.step, simulation.duration)
        require_known_phases(built.scene.file, plan.key, plan.integrator, plan.system, simulation)
        require_resolved_loads(built.scene.file, plan.key, plan.integrator, plan.system)
        growths.append(_measure_growth(built, plan, run, known))
    return tuple(growths)


def finish_plans(built: BuiltScene) -> dict[str, Plan]:
    """Return a scene's runs with stable steps, each under a label of its integrator and ratio; raises as `growths`."""
    plans: dict[str, Plan] = {}
    for k, (plan, growth) in enumerate(zip(built.drafts, built.growths, strict=True)):
        method: Any = plan.integrator
        if growth.step is not None:
            method = replace(method, step=growth.step)
        label = built.scene.simulation.run[k].label(method.substeps)
        checked = replace(plan, integrator=method, growth=growth.factor)
        plans[f"{label} ({k})" if label in plans else label] = _leave_out_modes(built, checked)
    return plans


def plan_like(plan: Plan, variant: BuiltScene) -> Plan:
    """Plan the first run of a scene's variant by the method and the step of a run whose growth is known.

    The step is a shorter one where the variant's highest frequency takes that.
    """
    first = _draft_plan(variant, 0, _given_step(variant))
    method: Any = plan.integrator
    limit = method.largest_step(first.system)
    if method.step >= limit:
        method = replace(method, step=SURELY_STABLE * limit)
    return _leave_out_modes(variant, replace(first, integrator=method))


def _draft_plan(built: BuiltScene, k: int, given: float | None) -> Plan:
    """Plan a run as the scene has it, whose stability isn't known yet."""
    simulation = built.scene.simulation
    run = simulation.run[k]
    key = f"simulation.run.{k}.step" if run.step else "simulation.step"
    if isinstance(run, SubCycledRun):
        return plan_sub_cycled(built, run, key, given)
    method = run.make(run.step or given or 0.0, simulation.error, simulation.duration)
    return Plan(key, method, built.mechanism, built.system, built.start)


def _leave_out_modes(built: BuiltScene, plan: Plan) -> Plan:
    """Leave the modes out of a run that nothing excites, unless all are to be kept."""
    part = None
    if not built.keep_all:
        part = excited_part(plan.mechanism, plan.start[0], NO_FORCE * built.scene.simulation.error)
    if part is None:
        return plan
    return replace(plan, excited=part, excited_system=share_system(part.mechanism))


def _measure_growth(built: BuiltScene, plan: Plan, run: Run, known: list[OperatingPoints]) -> Growth:
    """Measure the growth of small vibrations by a run's method; shorten its step for that if the scene gives none.

    The operating points of a system are the same for all of its runs; those ``known`` are taken, new ones added.
    """
    method: Any = plan.integrator  # a method with a limit has a step, and resumes
    limit, free = method.largest_step(plan.system), built.scene.simulation.step == "auto" and not run.step
    if not method.step < limit and not free:
        raise InputError(
            built.scene.file,
            plan.key,
            f"{method.step:.6g} s",
            f"{method.name} would diverge; the largest stable step of this model is {limit:.4g} s "
            f"({method.describe_limit(plan.system)}{run.limit_remedy})",
        )
    if not (np.isfinite(limit) or method.may_grow(plan.system)):  # implicit, exact, or steered by its error
        return Growth()
    from fmd.stability.operating_points import find_operating_points

    duration = built.scene.simulation.duration
    points = next((own for own in known if own.system is plan.system), None)
    if points is None:
        try:
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
            raise InputError(
                built.scene.file,
                plan.key,
                f"{method.step:.6g} s",
                _describe_growth(method, folds, longest) + run.growth_remedy,
            )
        return Growth(longest, float(np.exp(points.e_folds(replace(method, step=longest)))))
    return Growth(None, float(np.exp(folds)))


def _describe_growth(method: Integrator, folds: float, longest: float) -> str:
    ratio = f" {m}:1" if (m := method.substeps) > 1 else ""
    grows = "at once" if folds > 100 else f"by a factor of {np.exp(folds):.3g} over the scene"
    mend = f"a step of {longest:.3g} s keeps that below {ALLOWED_GROWTH:g}" if longest else "no step is short enough"
    return f"{method.name}{ratio} is unstable here: it makes small vibrations grow {grows}; {mend}"


def _given_step(built: BuiltScene) -> float | None:
    """Return the scene's step; "auto" is plain central difference's for the wanted error, about the reference state.

    It is short enough for the loads, too, also where runs hold them over a cycle of steps.
    """
    simulation = built.scene.simulation
    if simulation.step != "auto":
        return simulation.step
    from fmd.stability.splitting import longest_step

    longest = longest_step(*built.reference_matrices, simulation.error, simulation.duration)
    counts = [run.substeps for run in simulation.run if isinstance(run, SubCycledRun)]
    most = max((count for count in counts if isinstance(count, int)), default=1)
    return built.system.resolving_step(longest * most)[0] / most


def plan_sub_cycled(built: BuiltScene, run: SubCycledRun, key: str, given: float | None) -> Plan:
    """Plan a sub-cycled run; each split of the coordinates has a mechanism with an order of its own."""
    simulation = built.scene.simulation
    step = run.step or given or 0.0
    if run.split == "joints":
        method = run.make(step, simulation.error, simulation.duration)
        return Plan(key, method, built.mechanism, built.system, built.start)
    from fmd.stability.splitting import choose_split, split_at
    from fmd.stages.stiffening_check import rigid_spins

    whole, substeps = built.mechanism, run.substeps
    if run.split == "auto":
        spins = rigid_spins(whole, *place_joints(built.divided_scene, whole.rigid), simulation.duration)
        spin = max(float(np.sqrt(np.mean(np.sum(rates**2, axis=1)))) for rates in spins.values())
        choice = choose_split(built.system, simulation.error, simulation.duration, spin, step or None)
        frequency, substeps, step = choice.frequency_hz, choice.substeps, choice.step
        longest, _ = built.system.resolving_step(substeps * step)  # loads are held over a cycle
        substeps = max(1, int(longest / step * (1 + 1e-12)))
    else:
        frequency = run.split
    fast_joints, slow_modes = split_at(built.system, frequency)
    mechanism = replace(whole, fast_joints=fast_joints, slow_modes=slow_modes)
    system = share_system(mechanism)
    method = run.model_copy(update={"substeps": substeps}).make(step, simulation.error, simulation.duration)
    return Plan(key, method, mechanism, system, find_start(built.divided_scene, system))

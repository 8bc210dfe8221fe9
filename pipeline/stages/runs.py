"""From the scene's runs to integrators, each with the mechanism it marches: split and step chosen where asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import InputError, StabilityError
from pipeline.dynamics.excited_modes import Excited, excited_part
from pipeline.dynamics.system import System
from pipeline.integrators.protocol import Integrator, Progress, Trajectory
from pipeline.integrators.subcycling import Subcycling
from pipeline.stages.mechanism import Chain, chain_of

if TYPE_CHECKING:
    from pipeline.scene.runs import ReversibleSubCyclingRun, Run, SubCyclingRun
    from pipeline.scene.simulation import Simulation
    from pipeline.stages.pipeline import Pipeline

STABLE = 0.4  # of the largest stable step: what a neighbour of a run takes that doesn't stand the run's own
_NO_FORCE = 1e-3  # part of the wanted error: what a mode that is left out could have answered with


@dataclass(frozen=True)
class Plan:
    """One run: an integrator and what it marches from where.

    Attributes
    ----------
    key : str
        The scene's key of its step.
    chain : Chain, optional
        The mechanism with the run's own split, if the scene is a chain.
    excited : Excited, optional
        The part of the mechanism that is integrated, if some modes can be left at rest.
    growth : float
        Factor by which an explicit method itself makes small vibrations grow over the scene.
    """

    key: str
    integrator: Integrator
    system: System
    start: tuple[Array, Array]
    chain: Chain | None = None
    excited: Excited | None = None
    growth: float = 1.0

    def march(self, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate; coordinates of modes that stay at rest are 0. The end is that of what was integrated."""
        (q0, v0), part = self.start, self.excited
        if part is None:
            return self.integrator.march(self.system, q0, v0, times, progress)
        found = self.integrator.march(part.system, q0[part.positions], v0[part.rates], times, progress)
        q, v = np.tile(q0, (len(times), 1)), np.zeros((len(times), len(v0)))
        q[:, part.positions], v[:, part.rates] = found.q, found.v
        return replace(found, q=q, v=v)


def plans_of(pipeline: Pipeline) -> dict[str, Plan]:
    """Make the scene's runs ready; the label tells integrator and ratio.

    Raises
    ------
    InputError
        A step is beyond its stability limit, or vibrations would grow visibly by the method itself.
    """
    plans: dict[str, Plan] = {}
    given = _given_step(pipeline)
    for k, run in enumerate(pipeline.scene.simulation.run):
        plan = _plan(pipeline, k, given)
        label = str(run.integrator)
        if hasattr(run, "substeps"):
            label += f" {getattr(plan.integrator, 'substeps', 1)}:1"
        plans[f"{label} ({k})" if label in plans else label] = plan
    return plans


def plan_like(plan: Plan, neighbour: Pipeline) -> Plan:
    """A neighbouring scene's first run, by the method and the step of a run whose growth has been asked already.

    The step is a shorter one where the neighbour's highest frequency takes that.
    """
    found = _unasked(neighbour, 0, _given_step(neighbour))
    method: Any = plan.integrator
    limit = method.largest_step(found.system)
    if method.step >= limit:
        method = replace(method, step=STABLE * limit)
    return _without_rest(neighbour, replace(found, integrator=method))


def _plan(pipeline: Pipeline, k: int, given: float | None) -> Plan:
    simulation = pipeline.scene.simulation
    free = simulation.step == "auto" and not simulation.run[k].step
    return _without_rest(pipeline, _stable(pipeline, _unasked(pipeline, k, given), free))


def _unasked(pipeline: Pipeline, k: int, given: float | None) -> Plan:
    """A run as the scene has it, not asked yet whether it is stable."""
    simulation = pipeline.scene.simulation
    run = simulation.run[k]
    key = f"simulation.run.{k}.step" if run.step else "simulation.step"
    if run.integrator in ("sub-cycling", "reversible-sub-cycling"):
        return sub_cycled(pipeline, run, key, given)
    chain = None if pipeline.is_rotor else pipeline.chain
    return Plan(key, _method(run, simulation, given), pipeline.mechanism, pipeline.start, chain)


def _without_rest(pipeline: Pipeline, plan: Plan) -> Plan:
    """The same without the modes that nothing excites, unless all are to be kept."""
    if pipeline.keep_all:
        return plan
    wanted = _NO_FORCE * pipeline.scene.simulation.error
    return replace(plan, excited=excited_part(plan.system, plan.start[0], wanted))


def _stable(pipeline: Pipeline, plan: Plan, free: bool) -> Plan:
    """The same with its growth measured and, if its step is ``free``, with one that is short enough."""
    method: Any = plan.integrator  # a method with a limit has a step, and resumes
    limit = method.largest_step(plan.system)
    if not method.step < limit and not free:
        frequency = f"2/ω of its highest frequency, {1 / (np.pi * limit):.5g} Hz"
        if m := getattr(method, "substeps", 1) - 1:
            slow, fast = plan.system.highest_slow_frequency, plan.system.highest_fast_frequency
            if (m + 1) * slow > fast:
                frequency = f"2/(m ω) of its slow coordinates, {slow / (2 * np.pi):.5g} Hz"
        raise InputError(
            pipeline.scene.file,
            plan.key,
            f"{method.step:.6g} s",
            f"{method.name} would diverge; the largest stable step of this model is {limit:.4g} s ({frequency})",
        )
    if not np.isfinite(limit):  # implicit, exact for small motions, or steered by its error
        return plan
    from pipeline.stability.operating_points import find_operating_points
    from pipeline.stability.safe_step import ALLOWED_GROWTH, longest_safe_step

    duration, split = pipeline.scene.simulation.duration, plan.chain.tree if plan.chain else None
    try:
        points = find_operating_points(pipeline.mechanism, *pipeline.start, duration, split)
    except StabilityError:  # of the mechanism itself: the march will tell
        return plan
    folds = points.e_folds(method) if method.step < limit else np.inf
    if folds > np.log(ALLOWED_GROWTH):
        longest = longest_safe_step(lambda step: points.e_folds(replace(method, step=step)), min(method.step, limit))
        if not (free and longest):
            raise InputError(pipeline.scene.file, plan.key, f"{method.step:.6g} s", _told(method, folds, longest))
        plan = replace(plan, integrator=replace(method, step=longest))
        folds = points.e_folds(replace(method, step=longest))
    return replace(plan, growth=float(np.exp(folds)))


def _told(method: Integrator, folds: float, longest: float) -> str:
    from pipeline.stability.safe_step import ALLOWED_GROWTH

    ratio = f" {m}:1" if (m := getattr(method, "substeps", 1)) > 1 else ""
    grows = "at once" if folds > 100 else f"by a factor of {np.exp(folds):.3g} over the scene"
    mend = f"a step of {longest:.3g} s keeps that below {ALLOWED_GROWTH:g}" if longest else "no step is short enough"
    other = ", and reversible-sub-cycling takes longer ones" if method.name == "sub-cycling" else ""
    return f"{method.name}{ratio} is unstable here: it makes small vibrations grow {grows}; {mend}{other}"


def _method(run: Run, simulation: Simulation, given: float | None) -> Integrator:
    """Only what is used is loaded: each method brings kernels of its own."""
    step = run.step or given or 0.0
    match run.integrator:
        case "central-difference":
            from pipeline.integrators.central_difference import CentralDifference

            return CentralDifference(step)
        case "exponential":
            from pipeline.integrators.exponential import Exponential

            return Exponential(step)
        case "exponential-rosenbrock":
            from pipeline.integrators.rosenbrock import ExponentialRosenbrock

            return ExponentialRosenbrock(run.tolerance)
        case "generalized-alpha":
            from pipeline.integrators.generalized_alpha import GeneralizedAlpha

            return GeneralizedAlpha(step, run.rho)
        case "runge-kutta":
            from pipeline.integrators.runge_kutta import RungeKutta

            return RungeKutta(run.tolerance)
        case "auto":
            from pipeline.integrators.automatic import Automatic

            return Automatic(simulation.error, simulation.duration)
        case "Radau" | "LSODA":
            from pipeline.integrators.scipy_ivp import ScipyIvp

            return ScipyIvp(run.integrator, run.tolerance)
        case _:
            raise AssertionError(run)


def _two_rates(run: SubCyclingRun | ReversibleSubCyclingRun, step: float, substeps: int) -> Integrator:
    if run.integrator == "sub-cycling":
        return Subcycling(step, substeps)
    if substeps == 1:  # there both have the same limit, and nothing is held
        from pipeline.integrators.central_difference import CentralDifference

        return CentralDifference(step)
    from pipeline.integrators.reversible import ReversibleSubcycling

    return ReversibleSubcycling(step, substeps)


def _given_step(pipeline: Pipeline) -> float | None:
    """The scene's step; "auto" is plain central difference's for the wanted error, about the reference state."""
    simulation = pipeline.scene.simulation
    if simulation.step != "auto":
        return simulation.step
    from pipeline.stability.splitting import longest_step

    return longest_step(*pipeline.reference_matrices, simulation.error, simulation.duration)


def sub_cycled(pipeline: Pipeline, run: SubCyclingRun | ReversibleSubCyclingRun, key: str, given: float | None) -> Plan:
    """Split the coordinates as a run says; each split has a mechanism with its own order of coordinates."""
    simulation = pipeline.scene.simulation
    step = run.step or given or 0.0
    if run.split == "joints":
        assert run.substeps != "auto"  # the scene's own check
        chain = None if pipeline.is_rotor else pipeline.chain
        return Plan(key, _two_rates(run, step, run.substeps), pipeline.mechanism, pipeline.start, chain)
    from pipeline.stability.splitting import choose_split, split_at
    from pipeline.stages.stiffening_check import spins_of

    tree, substeps = pipeline.chain.tree, run.substeps
    if run.split == "auto":
        spins = spins_of(pipeline.chain, simulation.duration)
        spin = max(float(np.sqrt(np.mean(np.sum(rates**2, axis=1)))) for rates in spins.values())
        choice = choose_split(tree, simulation.error, simulation.duration, spin, step or None)
        frequency, substeps, step = choice.frequency_hz, choice.substeps, choice.step
    else:
        frequency = run.split
    assert substeps != "auto"
    chain = chain_of(pipeline.scene, pipeline.bodies, *split_at(tree, frequency))
    return Plan(key, _two_rates(run, step, substeps), chain.tree, (chain.q0, chain.v0), chain)

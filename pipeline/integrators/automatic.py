"""Automatic choice of a method for a wanted error, with steps refined until two marches agree."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.errors import AccuracyError, StabilityError
from pipeline.dynamics.system import System
from pipeline.integrators.adaptive import groups_of
from pipeline.integrators.central_difference import CentralDifference
from pipeline.integrators.exponential import PiecewiseExponential
from pipeline.integrators.generalized_alpha import GeneralizedAlpha
from pipeline.integrators.march_pairs import Pairs, compared_times
from pipeline.integrators.method_costs import (
    LEAP,
    STABLE,
    explicit_cost,
    explicit_pair_cost,
    exponential_cost,
    implicit_cost,
    leapfrog_cost,
    rosenbrock_cost,
)
from pipeline.integrators.protocol import Integrator, Progress, Trajectory
from pipeline.integrators.rosenbrock import ExponentialRosenbrock
from pipeline.integrators.runge_kutta import RungeKutta

_FIRST_STEPS = 128  # of the exponential method over the duration
_ODD = 13  # by which numbers of steps are more than doubled
_MOST_DOUBLINGS = 13
_DOUBLED = 8.0  # by which its error falls where it is worst, with twice as many steps
_DOUBLED_OFTEN = 16.0  # and where all is smooth
_MANY = 256  # breakpoints, as of a table, at each of which the exponential method would have to start anew
_FEW = 400  # stable steps of the Runge-Kutta method over the duration: not stiff
_MOST_EXPLICIT = 1e8  # leapfrog steps over the duration: beyond, no explicit method comes to an end
_FIRST_TOLERANCE = 0.3  # of an adaptive method, over the wanted error
_FINER: dict[type, float] = {
    RungeKutta: 0.01,
    ExponentialRosenbrock: 0.1,
}  # tolerance over the one before
_FINEST = 3e-14  # tolerance; the same one twice would agree with itself
_FALLS = 0.75  # power of the tolerance with which the error falls at least
_IMPLICIT_STEPS = 256  # of generalised-α over the duration, at first
_STEPS_IN_ACTION = 8  # of generalised-α in the shortest load
_TRIAL = 1 / 16  # of the duration
_WORTH_A_TRIAL = 1000.0  # steps of the Rosenbrock method
_FEWEST_EVALUATIONS = 3.0  # of generalised-α in a step
_PIECE = 16  # steps of it, over which they are counted
_SHARE = 1 / 6  # of the cost of two marches by central difference: what generalised-α may cost
_NEARLY = 1.25  # times as many steps, of a method that is exact enough where it is stable
_SHORTER = 1.5  # times as many steps, where stable ones of the reference state weren't
_OBSERVED_ORDER = 1.5  # of a method of second order with steps that are many times shorter than before
_COMPARED = 100  # output times at which two marches are compared, at least


@dataclass(frozen=True)
class Automatic:
    """Method that marches with finer and finer steps until the last two marches differ by less than ``error``.

    Where modes and joints don't couple through the mass matrix, that is the exponential method. Where few of the
    longest stable steps cover the duration, it is this or the Runge–Kutta method, by what two marches cost. Else
    generalised-α marches by shorter and shorter steps, as long as those that the error still asks for cost less than
    stable ones of central difference; then that method, as long as its steps cost less than the Runge–Kutta method's;
    then this one. Where stable steps are many, a trial over the first part of the motion may find the exponential
    Rosenbrock method cheaper than all of these. Costs are counted, not timed, so that the choice hardly depends on the
    machine.

    Parameters
    ----------
    error : float
        Wanted error, relative to the largest value of each kind of coordinate over the march; rates may have twice
        as much.
    duration : float
        Of the motion that the method is chosen for [s].
    """

    error: float
    duration: float

    name = "auto"
    step = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.error < 1.0:
            raise ValueError(f"error is {self.error}, expected 0 … 1")

    def order(self, system: System) -> int:
        """Return the order of the chosen method where it counts."""
        return 4

    def largest_step(self, system: System) -> float:
        """Return infinity: a march that diverges is refined."""
        return np.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 to the last of ``times``; run time and evaluations are those of all marches together.

        Raises
        ------
        AccuracyError
            The wanted error was not reached; the message has the last difference, or says why every march failed.
        """
        groups, n = groups_of(system), system.n_positions
        report = Pairs(self.error, groups[:n], groups[n:] - groups[:n].max(initial=-1) - 1)
        some = compared_times(times, _COMPARED)
        for method, gain in self._methods(system, q0, v0, times, report, progress):
            # The first march of a method is never the last: what it is compared at is enough.
            asked = some if report.before is None else times
            try:
                trajectory = method.march(system, q0, v0, asked, progress)
            except AccuracyError as error:  # it diverged, or an implicit step has no solution
                if isinstance(error, StabilityError):
                    getattr(system, "explain_failure", _explain_nothing)(error)
                report.add_failure(error)
                continue
            if report.agrees(trajectory, gain):
                name = f"{self.name} ({trajectory.integrator})"
                seconds, evaluations = report.seconds, report.evaluations
                return replace(trajectory, integrator=name, seconds=seconds, evaluations=evaluations, chosen=method)
        if report.failure and (report.failures > 1 or np.isinf(report.difference)):
            raise report.failure
        raise AccuracyError(
            f"{self.name}: the last two marches differ by {report.difference:.1e}, above {self.error:.0e}"
        )

    def _methods(
        self, system: System, q0: Array, v0: Array, times: Array, report: Pairs, progress: Progress | None
    ) -> Iterator[tuple[Integrator, float]]:
        """Yield methods, each finer than that before, with the factor by which its error is below their difference."""
        stable_steps = system.highest_frequency * self.duration / STABLE
        stiff, allowed = stable_steps > _FEW, np.inf
        if system.n_positions != system.n or len(system.breakpoints) > _MANY:
            allowed = 0.0  # the exponential method has no quaternions
        elif not stiff:
            allowed = explicit_pair_cost(system, self.duration)
        elif system.coupled:
            allowed = 0.0
        yield from self._exponential_methods(system, times, allowed, report)
        adaptive: type[RungeKutta | ExponentialRosenbrock] = RungeKutta
        if self.duration > _MOST_EXPLICIT * system.largest_step:  # by dampers
            adaptive = ExponentialRosenbrock
        elif stiff:
            leapfrog_steps = max(
                system.highest_frequency * self.duration / LEAP,
                _STEPS_IN_ACTION * self.duration / system.shortest_action,
            )
            leapfrog_steps = self.duration / system.resolving_step(self.duration / leapfrog_steps)[0]
            cost = 3 * leapfrog_steps * leapfrog_cost(system)  # of two marches, of so many steps and twice as many
            yield from self._implicit_methods(system, q0, v0, _SHARE * cost, report)
            if cost > _WORTH_A_TRIAL * rosenbrock_cost(system, 1.0):
                end = min(_TRIAL * self.duration, float(times[-1]))
                adaptive = self._choose_adaptive(system, q0, v0, cost, end, progress)
            if adaptive is RungeKutta:
                yield from self._leapfrog_methods(
                    system, leapfrog_steps, 2 * stable_steps * explicit_cost(system), report
                )
        report.start_anew()
        tolerance, gain = max(self.error * _FIRST_TOLERANCE, _FINEST), 1.0
        while report.failures < 2:  # else it isn't the tolerance
            yield adaptive(tolerance), gain
            if tolerance < 2 * _FINEST:
                return
            before, tolerance = tolerance, max(_FINER[adaptive] * tolerance, _FINEST)
            gain = math.pow(before / tolerance, _FALLS)

    def _exponential_methods(
        self, system: System, times: Array, allowed: float, report: Pairs
    ) -> Iterator[tuple[PiecewiseExponential, float]]:
        """Yield the exponential method with twice as many steps or more each time, while they cost what is allowed."""
        k, doublings = 0, 1
        cost = exponential_cost(system, _FIRST_STEPS, min(times.size, _COMPARED))  # of a march that is compared alone
        while k <= _MOST_DOUBLINGS and not report.failures:
            # Odd numbers, lest two marches agree that see a vibration at the same points of its periods.
            steps = _FIRST_STEPS * 2**k + (_ODD * (2 * k - 1) if k else 0)
            if not exponential_cost(system, max(steps, 2 * _FIRST_STEPS), times.size) + cost < allowed:
                return
            # What happens between two breakpoints takes finer steps too, lest two marches agree that miss it alike.
            yield PiecewiseExponential(self.duration / steps, 2 ** (k + 2)), _DOUBLED**doublings
            doublings = 1
            if np.isfinite(report.difference):
                doublings, cost = max(1, math.ceil(math.log(report.difference / self.error, _DOUBLED_OFTEN))), 0.0
            k += doublings

    def _implicit_methods(
        self, system: System, q0: Array, v0: Array, allowed: float, report: Pairs
    ) -> Iterator[tuple[GeneralizedAlpha, float]]:
        """Yield generalised-α with more and more steps, as long as these cost less than what is allowed.

        A piece of the motion tells how many evaluations a step takes, two marches how many steps the error asks for.
        """
        report.start_anew()
        steps = float(max(_IMPLICIT_STEPS, np.ceil(_STEPS_IN_ACTION * self.duration / system.shortest_action)))
        steps = self.duration / system.resolving_step(self.duration / steps)[0]
        gain, cost = 3.0, implicit_cost(system)
        if 3 * steps * _FEWEST_EVALUATIONS * cost > allowed:
            return
        try:
            piece = np.array([_PIECE * self.duration / steps])
            per_step = GeneralizedAlpha(self.duration / steps).march(system, q0, v0, piece).evaluations / _PIECE
        except AccuracyError:  # a step has no solution
            per_step = float(system.n)
        if 3 * steps * per_step * cost > allowed:
            return
        while steps * per_step * cost <= allowed:
            yield GeneralizedAlpha(self.duration / steps), gain
            if report.before is not None:
                per_step = report.before.evaluations * report.before.step / report.before.times[-1]
            more = report.more_steps()
            steps, gain = steps * more, _gain(more)

    def _leapfrog_methods(
        self, system: System, steps: float, allowed: float, report: Pairs
    ) -> Iterator[tuple[CentralDifference, float]]:
        """Yield central difference with more and more steps, as long as these cost less than what is allowed.

        Where it diverges, away from the reference state, shorter steps are tried once.
        """
        report.start_anew()
        gain, more = 1.0, _NEARLY
        while steps * leapfrog_cost(system) <= allowed:
            yield CentralDifference(self.duration / steps), gain
            if report.failures > 1:
                return
            if report.before is None:
                steps *= _SHORTER
                continue
            if np.isfinite(report.difference):
                more = report.more_steps()
            steps, gain = steps * more, _gain(more)

    def _choose_adaptive(
        self, system: System, q0: Array, v0: Array, explicit: float, end: float, progress: Progress | None
    ) -> type[RungeKutta | ExponentialRosenbrock]:
        """Choose between explicit methods by their cost and the Rosenbrock method by the steps it takes to ``end``."""
        method = ExponentialRosenbrock(self.error * _FIRST_TOLERANCE)
        try:
            # Its progress is that of a march to the end, which may be ended where that would take too long.
            watch = None if progress is None else lambda done: progress(end / self.duration * done)
            trial = method.march(system, q0, v0, np.array([end]), watch)
        except StabilityError:
            return RungeKutta
        step = max(trial.step, 1e-300)
        cheaper = 2 * self.duration / step * rosenbrock_cost(system, step) < explicit
        return ExponentialRosenbrock if cheaper else RungeKutta


def _gain(more: float) -> float:
    """Return how far the error of a method of second order is below its difference to a march of fewer steps.

    A march of far fewer steps doesn't resolve all vibrations, and says less than the order promises.
    """
    return min(math.pow(more, 2.0), max(4.0, math.pow(more, _OBSERVED_ORDER))) - 1.0


def _explain_nothing(failure: StabilityError) -> None:
    """Have nothing to say of why a march failed."""

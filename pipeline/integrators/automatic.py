"""Automatic choice of a method for a wanted error, with steps refined until two marches agree."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import AccuracyError, StabilityError
from pipeline.dynamics.system import System
from pipeline.integrators.adaptive import groups_of
from pipeline.integrators.central_difference import CentralDifference
from pipeline.integrators.exponential import PiecewiseExponential
from pipeline.integrators.generalized_alpha import GeneralizedAlpha
from pipeline.integrators.protocol import Integrator, Progress, Trajectory
from pipeline.integrators.rosenbrock import ExponentialRosenbrock
from pipeline.integrators.runge_kutta import RungeKutta

_FIRST_STEPS = 32  # of the exponential method over the duration
_MOST_REFINEMENTS, _MOST_DOUBLINGS = 16, 15
_MANY = 256  # breakpoints, as of a table, at each of which the exponential method would have to start anew
_STABLE = 5.5  # radians of the highest frequency in a step of the Runge-Kutta method
_FEW = 400  # such steps over the duration: not stiff
_SAFETY = 0.1  # tolerance of an adaptive method over the wanted error
_IMPLICIT_STEPS = 256  # of generalised-α over the duration, at first
_STEPS_IN_ACTION = 8  # of generalised-α in the shortest load
_OF_RATES = 0.5  # of their error counts: they hold more of the fastest vibrations, which matter less
_TRIAL = 1 / 16  # of the duration
_LEAP = 1.8  # radians of the highest frequency in a step of central difference, of the 2 that are stable
_MARGIN, _MOST_AT_ONCE = 1.2, 8.0  # on the steps that a difference asks for; times as many steps as before
_WORTH_A_TRIAL = 1000.0  # steps of the Rosenbrock method
_FEWEST_EVALUATIONS = 3.0  # of generalised-α in a step
_OVERHEAD = 3000.0  # operations of an iteration beside its evaluation
_PIECE = 16  # steps of it, over which they are counted
_SHARE = 1 / 6  # of the cost of two marches by central difference: what generalised-α may cost
_NEARLY = 1.25  # times as many steps, of a method that is exact enough where it is stable
_COST = 60.0  # operations of an evaluation for each coordinate, of a system that doesn't tell


@dataclass(frozen=True)
class Automatic:
    """Method that marches with finer and finer steps until the last two marches differ by less than ``error``.

    Where modes and joints don't couple through the mass matrix, that is the exponential method, and where few of the
    longest stable steps cover the duration, the Runge–Kutta method. Else generalised-α marches by shorter and shorter
    steps, as long as those that the error still asks for cost less than stable ones of central difference; then that
    method, as long as its steps cost less than the Runge–Kutta method's; then this one. Where stable steps are many, a
    trial over the first part of the motion may find the exponential Rosenbrock method cheaper than all of these. Costs
    are counted, not timed, so that the choice hardly depends on the machine.

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
        report = _Pairs(self.error, groups[:n], groups[n:] - groups[:n].max(initial=-1) - 1)
        for method, gain in self._methods(system, q0, v0, times[-1], report, progress):
            try:
                trajectory = method.march(system, q0, v0, times, progress)
            except AccuracyError as error:  # it diverged, or an implicit step has no solution
                report.before, report.failure = None, error
                report.failures += 1
                continue
            if report.agrees(trajectory, gain):
                name = f"{self.name} ({trajectory.integrator})"
                return replace(trajectory, integrator=name, seconds=report.seconds, evaluations=report.evaluations)
        if report.failure and (report.failures > 1 or np.isinf(report.difference)):
            raise report.failure
        raise AccuracyError(
            f"{self.name}: the last two marches differ by {report.difference:.1e}, above {self.error:.0e}"
        )

    def _methods(
        self, system: System, q0: Array, v0: Array, end: float, report: _Pairs, progress: Progress | None
    ) -> Iterator[tuple[Integrator, float]]:
        """Yield methods, each finer than that before, with the factor by which its error is below their difference."""
        if not system.coupled and len(system.breakpoints) <= _MANY:
            # What happens between two breakpoints takes finer steps too, lest two marches agree that miss it alike.
            k, doublings = 0, 1
            while k <= _MOST_DOUBLINGS:
                # order 3 where it is worst
                yield PiecewiseExponential(self.duration / (_FIRST_STEPS * 2**k), 2**k), 8.0**doublings
                doublings = 1
                if np.isfinite(report.difference):
                    doublings = max(1, math.ceil(math.log(report.difference / self.error, 8.0)))
                k += doublings
            return
        stable_steps = system.highest_frequency * self.duration / _STABLE
        adaptive: type[RungeKutta | ExponentialRosenbrock] = RungeKutta
        if stable_steps > _FEW:
            leapfrog_steps = max(
                system.highest_frequency * self.duration / _LEAP,
                _STEPS_IN_ACTION * self.duration / system.shortest_action,
            )
            cost = 3 * leapfrog_steps * _leapfrog_cost(system)  # of two marches, of so many steps and twice as many
            yield from self._implicit_methods(system, q0, v0, _SHARE * cost, report)
            if cost > _WORTH_A_TRIAL * _rosenbrock_cost(system, 1.0):
                adaptive = self._choose_adaptive(system, q0, v0, cost, min(_TRIAL * self.duration, end), progress)
            if adaptive is RungeKutta:
                allowed = 2 * stable_steps * _explicit_cost(system)
                yield from self._leapfrog_methods(system, leapfrog_steps, allowed, report)
        report.start_anew()
        for k in range(_MOST_REFINEMENTS):
            if report.failures > 1:  # it isn't the tolerance
                return
            yield adaptive(max(self.error * _SAFETY ** (2 * k), 3e-14)), _SAFETY**-1.5

    def _implicit_methods(
        self, system: System, q0: Array, v0: Array, allowed: float, report: _Pairs
    ) -> Iterator[tuple[GeneralizedAlpha, float]]:
        """Yield generalised-α with more and more steps, as long as these cost less than what is allowed.

        A piece of the motion tells how many evaluations a step takes, two marches how many steps the error asks for.
        """
        steps = float(max(_IMPLICIT_STEPS, np.ceil(_STEPS_IN_ACTION * self.duration / system.shortest_action)))
        gain, cost = 3.0, _implicit_cost(system)
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
            more = report.more_steps(self.error)
            steps, gain = steps * more, more**2 - 1.0

    def _leapfrog_methods(
        self, system: System, steps: float, allowed: float, report: _Pairs
    ) -> Iterator[tuple[CentralDifference, float]]:
        """Yield central difference with more and more steps, as long as these cost less than what is allowed."""
        report.start_anew()
        gain, more = 1.0, _NEARLY
        while steps * _leapfrog_cost(system) <= allowed:
            yield CentralDifference(self.duration / steps), gain
            if report.before is None:  # it diverged
                return
            if np.isfinite(report.difference):
                more = report.more_steps(self.error)
            steps, gain = steps * more, more**2 - 1.0

    def _choose_adaptive(
        self, system: System, q0: Array, v0: Array, explicit: float, end: float, progress: Progress | None
    ) -> type[RungeKutta | ExponentialRosenbrock]:
        """Choose between explicit methods by their cost and the Rosenbrock method by the steps it takes to ``end``."""
        method = ExponentialRosenbrock(self.error * _SAFETY)
        try:
            # Its progress is that of a march to the end, which may be ended where that would take too long.
            watch = None if progress is None else lambda done: progress(end / self.duration * done)
            trial = method.march(system, q0, v0, np.array([end]), watch)
        except StabilityError:
            return RungeKutta
        step = max(trial.step, 1e-300)
        cheaper = 2 * self.duration / step * _rosenbrock_cost(system, step) < explicit
        return ExponentialRosenbrock if cheaper else RungeKutta


def _evaluation_cost(system: System) -> float:
    """Operations of an evaluation of the accelerations."""
    return float(getattr(system, "evaluation_cost", _COST * system.n))


def _explicit_cost(system: System) -> float:
    """Cost of a step of the Runge–Kutta method: 12 evaluations, and sums of 12 slopes for each."""
    return 12 * (_evaluation_cost(system) + 12 * system.n)


def _leapfrog_cost(system: System) -> float:
    """Cost of a step of central difference."""
    return _evaluation_cost(system) + 6 * system.n


def _rosenbrock_cost(system: System, step: float) -> float:
    """Cost of a step [s] of the Rosenbrock method: as many evaluations as coordinates, and products of matrices."""
    n = system.n + system.n_positions
    doublings = max(0.0, np.log2(system.highest_frequency * step))
    return float(n * _evaluation_cost(system) + 2 * (14 + 15 * doublings) * n**3)


def _implicit_cost(system: System) -> float:
    """Cost of an evaluation of generalised-α, with a solution by a kept factor or its share of a new one."""
    return _evaluation_cost(system) + 4 * system.n**2 + _OVERHEAD


@dataclass
class _Pairs:
    """Marches so far, each compared with the one before.

    Attributes
    ----------
    before : Trajectory, optional
        The last march, None if the next one has nothing to be compared with.
    difference : float
        Error of the last march, from its difference to that before.
    failure : AccuracyError, optional
        Why the last march that failed did so.
    failures : int
        Number of marches that failed.
    """

    error: float
    groups: IntArray
    rate_groups: IntArray
    before: Trajectory | None = None
    difference: float = np.inf
    failure: AccuracyError | None = None
    failures: int = 0
    seconds: float = 0.0
    evaluations: int = 0

    def start_anew(self) -> None:
        """Begin with another method, whose marches aren't compared with those before."""
        self.before, self.failures, self.difference = None, 0, np.inf

    def more_steps(self, error: float) -> float:
        """Return how many times as many steps a method of second order should take next; 2 if nothing is known."""
        if not np.isfinite(self.difference):
            return 2.0
        return float(np.clip(_MARGIN * np.sqrt(self.difference / error), 1.5, _MOST_AT_ONCE))

    def agrees(self, trajectory: Trajectory, gain: float) -> bool:
        """Count a march, and return true if it differs from the one before by less than the error allows."""
        self.seconds += trajectory.seconds
        self.evaluations += trajectory.evaluations
        if self.before is not None:
            of_positions = largest_difference(self.before.q, trajectory.q, self.groups)
            # Where nothing moves, rates are round-off: what the positions are in the whole time counts at least.
            least = largest_values(trajectory.q, self.groups) / max(trajectory.times[-1], 1e-300)
            of_rates = largest_difference(self.before.v, trajectory.v, self.rate_groups, least)
            self.difference = max(of_positions, _OF_RATES * of_rates) / gain
        agrees = self.before is not None and self.difference < self.error
        self.before = trajectory
        return agrees


def largest_values(q: Array, groups: IntArray) -> Array:
    """Return the largest value of each group of coordinates over a motion (n_times, n)."""
    largest = np.zeros(int(groups.max(initial=-1)) + 1)
    np.maximum.at(largest, groups, np.nanmax(np.abs(q), axis=0, initial=0.0))
    return largest


def largest_difference(q: Array, other: Array, groups: IntArray, least: Array | None = None) -> float:
    """Return the largest difference of two motions (n_times, n), each coordinate's over its group's largest value.

    It is 0 where there are no coordinates, since all motions are prescribed.

    Parameters
    ----------
    least : ndarray, shape (n_groups,), optional
        What counts at least as a group's largest value.
    """
    if not groups.size:
        return 0.0
    largest = largest_values(other, groups)
    if least is not None and least.size:
        n = min(largest.size, least.size)
        largest[:n] = np.maximum(largest[:n], least[:n])
    apart = np.nanmax(np.abs(q - other), axis=0)
    return float((apart / np.maximum(largest[groups], 1e-300)).max())

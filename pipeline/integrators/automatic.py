"""Automatic choice of a method for a wanted error, with steps refined until two marches agree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import AccuracyError, StabilityError
from pipeline.dynamics.system import System
from pipeline.integrators.adaptive import groups_of
from pipeline.integrators.exponential import PiecewiseExponential
from pipeline.integrators.generalized_alpha import GeneralizedAlpha
from pipeline.integrators.protocol import Integrator, Progress, Trajectory
from pipeline.integrators.rosenbrock import ExponentialRosenbrock
from pipeline.integrators.runge_kutta import RungeKutta

_FIRST_STEPS = 32  # of the exponential method over the duration
_MOST_REFINEMENTS = 16
_MANY = 256  # breakpoints, as of a table, at each of which the exponential method would have to start anew
_STABLE = 5.5  # radians of the highest frequency in a step of the Runge-Kutta method
_FEW = 400  # such steps over the duration: not stiff
_SAFETY = 0.1  # tolerance of an adaptive method over the wanted error
_IMPLICIT_STEPS = 256  # of generalised-α over the duration, at first
_STEPS_IN_ACTION = 8  # of generalised-α in the shortest load
_TRIAL = 1 / 16  # of the duration
_EVALUATIONS = 4.0  # of generalised-α in a step, until a march has counted them
_COST = 60.0  # operations of an evaluation for each coordinate, of a system that doesn't tell


@dataclass(frozen=True)
class Automatic:
    """Method that marches with finer and finer steps until the last two marches differ by less than ``error``.

    Where modes and joints don't couple through the mass matrix, that is the exponential method, and where few of the
    longest stable steps cover the duration, the Runge–Kutta method. Else generalised-α marches by halved steps, as long
    as the steps that the error still asks for cost less than that method's stable ones; then the Runge–Kutta or the
    exponential Rosenbrock method, whichever a trial over the first part of the motion finds cheaper. Costs are counted,
    not timed, so that the choice is the same on every machine.

    Parameters
    ----------
    error : float
        Wanted error, relative to the largest value of each kind of coordinate over the march.
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
        report = _Pairs(self.error, groups_of(system)[: system.n_positions])
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
            for k in range(_MOST_REFINEMENTS):
                method = PiecewiseExponential(self.duration / (_FIRST_STEPS * 2**k), 2**k)
                yield method, 2.0**3  # order 3 where it is worst
            return
        stable_steps = system.highest_frequency * self.duration / _STABLE
        adaptive: type[RungeKutta | ExponentialRosenbrock] = RungeKutta
        if stable_steps > _FEW:
            yield from self._implicit_methods(system, stable_steps, report)
            adaptive = self._choose_adaptive(system, q0, v0, min(_TRIAL * self.duration, end), progress)
        report.before = None
        report.failures = 0
        for k in range(_MOST_REFINEMENTS):
            if report.failures > 1:  # it isn't the tolerance
                return
            yield adaptive(max(self.error * _SAFETY ** (1 + k), 3e-14)), 1 / _SAFETY

    def _implicit_methods(
        self, system: System, stable_steps: float, report: _Pairs
    ) -> Iterator[tuple[GeneralizedAlpha, float]]:
        """Yield generalised-α with halved steps while those still to come cost less than the explicit method."""
        explicit, evaluations = stable_steps * _explicit_cost(system), _EVALUATIONS
        steps = float(max(_IMPLICIT_STEPS, np.ceil(_STEPS_IN_ACTION * self.duration / system.shortest_action)))
        # Marches by halved steps cost twice the last one, and the explicit method takes two marches.
        while steps <= (allowed := explicit / (evaluations * _implicit_cost(system))):
            yield GeneralizedAlpha(self.duration / steps), 2.0**2 - 1.0
            if report.before is not None:
                evaluations = report.before.evaluations * report.before.step / report.before.times[-1]
            if np.isfinite(report.difference):
                # The error falls with the step's square.
                needed = steps * np.sqrt(report.difference / self.error)
                if needed > allowed:
                    return
            steps *= 2

    def _choose_adaptive(
        self, system: System, q0: Array, v0: Array, end: float, progress: Progress | None
    ) -> type[RungeKutta | ExponentialRosenbrock]:
        """Choose between the explicit method's stable steps and the Rosenbrock method's own until ``end`` [s]."""
        method = ExponentialRosenbrock(self.error * _SAFETY)
        try:
            # Its progress is that of a march to the end, which may be ended where that would take too long.
            watch = None if progress is None else lambda done: progress(end / self.duration * done)
            trial = method.march(system, q0, v0, np.array([end]), watch)
        except StabilityError:
            return RungeKutta
        n, step = system.n + system.n_positions, max(trial.step, 1e-300)
        doublings = max(0.0, np.log2(system.highest_frequency * step))
        products = 14 + 15 * doublings  # of matrices in a step
        cost = n * _evaluation_cost(system) + 2 * products * n**3
        cheaper = cost / step < system.highest_frequency / _STABLE * _explicit_cost(system)
        return ExponentialRosenbrock if cheaper else RungeKutta


def _evaluation_cost(system: System) -> float:
    """Operations of an evaluation of the accelerations."""
    return float(getattr(system, "evaluation_cost", _COST * system.n))


def _explicit_cost(system: System) -> float:
    """Cost of a step of the Runge–Kutta method: 12 evaluations, and sums of 12 slopes for each."""
    return 12 * (_evaluation_cost(system) + 12 * system.n)


def _implicit_cost(system: System) -> float:
    """Cost of an evaluation of generalised-α, with a solution by a kept factor or its share of a new one."""
    return _evaluation_cost(system) + 4 * system.n**2


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
    before: Trajectory | None = None
    difference: float = np.inf
    failure: AccuracyError | None = None
    failures: int = 0
    seconds: float = 0.0
    evaluations: int = 0

    def agrees(self, trajectory: Trajectory, gain: float) -> bool:
        """Count a march, and return true if it differs from the one before by less than the error allows."""
        self.seconds += trajectory.seconds
        self.evaluations += trajectory.evaluations
        if self.before is not None:
            self.difference = largest_difference(self.before.q, trajectory.q, self.groups) / gain
        agrees = self.before is not None and self.difference < self.error
        self.before = trajectory
        return agrees


def largest_difference(q: Array, other: Array, groups: IntArray) -> float:
    """Return the largest difference of two motions (n_times, n), each coordinate's over its group's largest value."""
    largest = np.zeros(int(groups.max()) + 1)
    np.maximum.at(largest, groups, np.nanmax(np.abs(other), axis=0))
    apart = np.nanmax(np.abs(q - other), axis=0)
    return float((apart / np.maximum(largest[groups], 1e-300)).max())

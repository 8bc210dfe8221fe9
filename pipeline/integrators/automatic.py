"""Automatic choice of a method for a wanted error, with steps refined until two marches agree."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import AccuracyError, StabilityError
from pipeline.dynamics.system import System
from pipeline.integrators.adaptive import groups_of
from pipeline.integrators.exponential import PiecewiseExponential
from pipeline.integrators.protocol import Integrator, Progress, Trajectory
from pipeline.integrators.rosenbrock import ExponentialRosenbrock
from pipeline.integrators.runge_kutta import RungeKutta

_FIRST_STEPS = 32  # over the duration
_MOST_REFINEMENTS = 16
_MANY = 256  # breakpoints, as of a table, at each of which the exponential method would have to start anew
# Radians of the highest frequency over the duration. Measured: 140 (rod-slider) for Runge-Kutta, 12,500 (arm) against.
_STIFF = 2000.0
_SAFETY = 0.1  # tolerance of an adaptive method over the wanted error


@dataclass(frozen=True)
class Automatic:
    """Method that marches with finer and finer steps until the last two marches differ by less than ``error``.

    By the measured run times over error (``benchmarks/``) the fastest are the exponential method where modes and joints
    don't couple through the mass matrix, else the exponential Rosenbrock method if the mechanism is stiff over the
    duration, and the Runge–Kutta method if it isn't.

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
            The wanted error was not reached; the message has the last difference.
        """
        groups = groups_of(system)[: system.n_positions]
        seconds, evaluations, difference = 0.0, 0, np.inf
        before: Trajectory | None = None
        for refinement in range(_MOST_REFINEMENTS):
            method, gain = self._method(system, refinement)
            try:
                trajectory = method.march(system, q0, v0, times, progress)
            except StabilityError:
                before = None
                continue
            seconds += trajectory.seconds
            evaluations += trajectory.evaluations
            if before is not None:
                difference = largest_difference(before.q, trajectory.q, groups) / gain
                if difference < self.error:
                    name = f"{self.name} ({trajectory.integrator})"
                    return replace(trajectory, integrator=name, seconds=seconds, evaluations=evaluations)
            before = trajectory
        raise AccuracyError(f"{self.name}: the last two marches differ by {difference:.1e}, above {self.error:.0e}")

    def _method(self, system: System, refinement: int) -> tuple[Integrator, float]:
        """Return a method, and the difference from the march before over the method's own error."""
        if system.coupled or len(system.breakpoints) > _MANY:
            tolerance = max(self.error * _SAFETY ** (1 + refinement), 3e-14)
            stiff = system.highest_frequency * self.duration > _STIFF
            return (ExponentialRosenbrock if stiff else RungeKutta)(tolerance), 1 / _SAFETY
        # What happens between two breakpoints takes finer steps too, lest two marches agree that miss it alike.
        method = PiecewiseExponential(self.duration / (_FIRST_STEPS * 2**refinement), 2**refinement)
        return method, 2.0**3  # order 3 where it is worst


def largest_difference(q: Array, other: Array, groups: IntArray) -> float:
    """Return the largest difference of two motions (n_times, n), each coordinate's over its group's largest value."""
    largest = np.zeros(int(groups.max()) + 1)
    np.maximum.at(largest, groups, np.nanmax(np.abs(other), axis=0))
    apart = np.nanmax(np.abs(q - other), axis=0)
    return float((apart / np.maximum(largest[groups], 1e-300)).max())

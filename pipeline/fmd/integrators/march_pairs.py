"""Marches of growing fineness, each compared with the one before."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.errors import OF_TOLERANCE
from fmd.core.limits.stepping import FEWEST_TIMES, MARGIN, MOST_TIMES, OF_RATES, STAYS, STILL_GROUP, THIRD_TOLERANCE
from fmd.dynamics.system import System
from fmd.integrators.protocol import Trajectory
from fmd.integrators.step_control import groups_of
from fmd.kernels.kernel import kernel


@dataclass(frozen=True)
class Gain:
    """Factor by which the error of a march is below its difference to a coarser one."""

    order: float  # power of the steps' length with which the error falls
    least: float  # least that is believed
    most: float  # most that is believed
    out_of_step: float = 0.0  # what is believed at least where the difference is hardly below that of coarser marches

    def of(self, coarse: Trajectory, fine: Trajectory) -> float:
        """Return the factor for two marches, by their mean steps."""
        return min(max(math.pow(coarse.step / fine.step, self.order) - 1.0, self.least), self.most)


@dataclass(frozen=True)
class Parting:
    """Where two marches differ most, and until when they agree."""

    is_rate: bool  # true if a rate differs most, false if a position does
    number: int  # number of that rate or position
    until: float  # last output time up to which all coordinates agree [s]


@dataclass
class Pairs:
    """Marches so far, each compared with the one before."""

    # Wanted error, relative to the largest value of each group of coordinates; rates may have twice as much
    error: float
    groups: IntArray  # (n_positions,): group of each position
    rate_groups: IntArray  # (n,): group of each rate
    before: Trajectory | None = None  # the last march; none if the next one has nothing to be compared with
    apart: float = np.inf  # difference of the last march to the one before
    stays: bool = False  # true if that is hardly below the difference of coarser marches
    difference: float = np.inf  # error of the last march that follows
    parting: Parting | None = None  # where that march parts from the one before, if they don't agree
    failure: AccuracyError | None = None  # why the last march that failed did so
    failures: int = 0  # number of marches of the present method that failed
    seconds: float = 0.0  # run time of all marches together by the clock [s]
    evaluations: int = 0  # evaluations of all marches together

    def start_anew(self) -> None:
        """Begin with another method, whose marches aren't compared with those before."""
        self._forget()
        self.failures, self.stays = 0, False

    def add_failure(self, failure: AccuracyError) -> None:
        """Count a march that failed."""
        self._forget()
        self.failure, self.failures = failure, self.failures + 1

    def _forget(self) -> None:
        self.before, self.difference, self.apart, self.parting = None, np.inf, np.inf, None

    def more_steps(self) -> float:
        """Return how many times as many steps a method of second order should take next; 2 if nothing is known."""
        if not np.isfinite(self.difference):
            return 2.0
        return float(np.clip(MARGIN * np.sqrt(self.difference / self.error), FEWEST_TIMES, MOST_TIMES))

    def agrees(self, trajectory: Trajectory, gain: Gain) -> bool:
        """Count a march, and return true if it differs from the one before by less than the error allows.

        The march before may have a part of the output times only, every second, say.
        """
        self.evaluations += trajectory.evaluations
        before, self.before = self.before, trajectory
        if before is None:
            return False
        apart_before, self.apart = self.apart, self._apart(before, trajectory)
        self.stays = self.apart > STAYS * apart_before
        believed = max(gain.of(before, trajectory), gain.out_of_step if self.stays else 0.0)
        self.difference = self.apart / believed
        agreed = self.difference < self.error
        self.parting = None if agreed else self._part(before, trajectory, believed * self.error)
        return agreed

    def holds_beside(self, third: Trajectory, last: Trajectory, tolerance: float) -> bool:
        """Take the last march's error from one of a finer tolerance, at its times; return true if it is allowed."""
        self.seconds, self.evaluations = self.seconds + third.seconds, self.evaluations + third.evaluations
        self.difference = max(self._apart(third, last) / (1.0 - THIRD_TOLERANCE), OF_TOLERANCE * tolerance)
        agreed = self.difference < self.error
        self.parting = None if agreed else self._part(third, last, (1.0 - THIRD_TOLERANCE) * self.error)
        return agreed

    def _part(self, before: Trajectory, after: Trajectory, allowed: float) -> Parting | None:
        """Return where a march parts from the one before by more than what is allowed."""
        at, end = np.searchsorted(after.times, before.times), max(float(after.times[-1]), 1e-300)
        parts = []
        of_positions, moved = _sizes_apart(before.q, after.q[at], self.groups, np.zeros(0))
        of_rates, _ = _sizes_apart(before.v, after.v[at], self.rate_groups, moved / end)
        for is_rate, apart in ((False, of_positions), (True, OF_RATES * of_rates)):
            if apart.size:
                beyond = np.flatnonzero((apart > allowed).any(axis=1))
                first = int(beyond[0]) if beyond.size else len(apart) - 1
                place = int(apart.max(axis=0).argmax())
                parts.append((float(apart.max()), Parting(is_rate, place, float(before.times[max(first - 1, 0)]))))
        if not parts:
            return None
        until = min(part.until for _, part in parts)
        return replace(max(parts, key=lambda each: each[0])[1], until=until)

    def _apart(self, before: Trajectory, after: Trajectory) -> float:
        end = max(float(after.times[-1]), 1e-300)
        at = np.searchsorted(after.times, before.times)
        of_positions, moved = _largest_difference(before.q, after.q, at, self.groups, np.zeros(0))
        # Where nothing moves, rates are round-off: what the positions are in the whole time counts at least.
        of_rates, _ = _largest_difference(before.v, after.v, at, self.rate_groups, moved / end)
        return max(of_positions, OF_RATES * of_rates)


def motion_difference(system: System, q: Array, v: Array, exact: Trajectory) -> float:
    """Return the difference of positions and rates (n_times, n) to a motion of a system, by the measure of `Pairs`."""
    motion = Trajectory("", 0.0, 1, exact.times, q, v, 0, 0, 0.0, exact.end)
    return pairs_of(system, 1.0)._apart(motion, exact)


def pairs_of(system: System, error: float) -> Pairs:
    """Return no marches of a system yet, for a wanted error."""
    groups, n = groups_of(system), system.n_positions
    return Pairs(error, groups[:n], groups[n:] - groups[:n].max(initial=-1) - 1)


def compared_times(times: Array, least: int) -> Array:
    """Return every k-th of the output times from the last one backwards, at least so many of them."""
    return times[:: -max(1, times.size // least)][::-1]


def _largest_difference(q: Array, other: Array, at: IntArray, groups: IntArray, least: Array) -> tuple[float, Array]:
    """Return the largest difference of two motions, each coordinate's over its group's largest value, and these.

    A group that hasn't moved has the size `STILL_GROUP`: its values are round-off, as where a coupler holds them at 0.
    The first, q (n_some, n), has the times of numbers ``at`` (n_some,) among those of the other (n_times, n). ``least``
    (n_groups,), or nothing, counts at least as a group's largest value.
    """
    largest = np.zeros(int(groups.max(initial=-1)) + 1)
    if not groups.size:  # all motions are prescribed
        return 0.0, largest
    return float(_compare(q, other, at, groups, least, largest)), largest


def _sizes_apart(q: Array, other: Array, groups: IntArray, least: Array) -> tuple[Array, Array]:
    """Return the differences of two motions over their groups' largest values, (n_times, n), and these values."""
    largest = np.zeros(int(groups.max(initial=-1)) + 1)
    np.maximum.at(largest, groups, np.abs(other).max(axis=0))
    largest[: len(least)] = np.maximum(largest[: len(least)], least[: len(largest)])
    return np.nan_to_num(np.abs(q - other), nan=np.inf) / np.maximum(largest, STILL_GROUP)[groups], largest


@kernel
def _compare(q: Array, other: Array, at: IntArray, groups: IntArray, least: Array, largest: Array) -> float:
    """Fill ``largest`` (n_groups,), and return the largest difference, infinite if a value is no number."""
    for k in range(other.shape[0]):
        for i in range(groups.size):
            size = abs(other[k, i])
            largest[groups[i]] = max(largest[groups[i]], size)
    for g in range(min(largest.size, least.size)):
        largest[g] = max(largest[g], least[g])
    worst = 0.0
    for k in range(at.size):
        for i in range(groups.size):
            apart = abs(q[k, i] - other[at[k], i]) / max(largest[groups[i]], STILL_GROUP)
            worst = max(worst, apart) if math.isfinite(apart) else math.inf
    return worst

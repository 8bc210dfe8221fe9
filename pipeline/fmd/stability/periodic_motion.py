"""Motions of driven mechanisms that repeat after a period, and their Floquet multipliers.

The start x is sought whose march over a period T ends in it, ``P(x) = x``, by Newton's method,
``(1 − Φ) δx = P(x) − x`` with the monodromy matrix Φ = ∂P/∂x (Nayfeh & Balachandran, Applied Nonlinear Dynamics, 1995,
section 5.2). Most disturbances die out within a period, so Φ is needed in few directions: those that a method of
conjugate residuals takes (Eisenstat, Elman & Schultz, SIAM J Numer Anal 20, 1983), each followed by a march from a
disturbed state, and kept for the next corrections.

Multipliers, the eigenvalues of Φ, are by which small disturbances grow over a period. Revolute joints may have gone
round; what a controller's state has added up doesn't count.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmd.core import newton
from fmd.core.arrays import Array, BoolArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits import stability as limits
from fmd.core.limits.newton import SHORTEST_NORM
from fmd.core.progress import check_for_interruption
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import Integrator, evaluate_projection, move_positions
from fmd.integrators.step_control import groups_of

State = tuple[Array, Array]
"""Positions (n_positions,) and rates (n,)."""


@dataclass(frozen=True)
class PeriodicMotion:
    """Start of a motion that repeats, and how it was found."""

    period: float  # [s]
    q: Array  # (n_positions,): positions at the start
    v: Array  # (n,): rates at the start
    gap: float  # what is left after a period, beside the largest value of each kind of coordinate
    marches: int  # periods that were marched to find it
    times: Array  # (n_times,): some times of the period [s]
    states: Array  # (n_times, n_positions + n): positions and rates then


def find_periodic_motion(
    system: Any, method: Integrator, start: State, period: float, closes: float, error: float
) -> PeriodicMotion:
    """Find the motion that repeats after a period [s], as the mechanism's loads and motions do, near a state.

    The method marches over the period with a relative ``error`` that differences of its marches have, well below
    ``closes``: gap and last correction, beside the largest value of each kind of coordinate.

    Raises
    ------
    AccuracyError
        There is none near the state, with the gap that was left.
    StabilityError
        A march fails.
    """
    search = _Search(system, method, period, error)
    tolerance = newton.Tolerance(limits.CORRECTIONS, absolute=closes)
    found = newton.solve(
        search.march(start),
        search.gap,
        search.correct,
        search.move,
        tolerance,
        # Where disturbances grow much within a period a small correction leaves a large gap: both count.
        size=lambda change: max(newton.largest(change), search.before),
        scale=lambda orbit: 1.0,
        accepts=search.accepts,
    )
    if not found.converged or found.residual > closes:
        raise AccuracyError(
            f"no motion of period {period:.6g} s near the start: after {found.corrections} corrections positions or "
            f"rates still differ by {found.residual:.2g} of their largest after a period; a start with rates near "
            "those of the motion helps, and damping, without which a vibration at a multiple of the drive's frequency "
            "grows without end"
        )
    orbit = found.state
    return PeriodicMotion(period, *orbit.start, found.residual, search.marches, orbit.times, orbit.states)


def find_multipliers(system: Any, method: Integrator, motion: PeriodicMotion, error: float) -> FloquetMultipliers:
    """Return a motion's Floquet multipliers, as far as differences of marches with this relative error tell them."""
    search, states = _Search(system, method, motion.period, error), motion.states
    q, v = np.split(states[-1], [len(motion.q)])
    orbit = _Orbit((motion.q, motion.v), motion.times, states, (q, v), search.scale_of(states))
    return FloquetMultipliers(search.multipliers(orbit), search.marches)


@dataclass(frozen=True)
class FloquetMultipliers:
    """Floquet multipliers of a motion that repeats."""

    # (k,): the largest first; those so small that round-off hides them are left out
    values: NDArray[np.complex128]
    marches: int  # periods that were marched to find them


@dataclass(frozen=True)
class _Orbit:
    """A march over a period: its start, some states on its way, the last one at its end, and scales, (2 n,)."""

    start: State
    times: Array
    states: Array
    end: State
    scale: Array


class _Search:
    """Newton's method for a mechanism; small motions (η, ζ) of positions and rates are over their scales, (2 n,)."""

    def __init__(self, system: Any, method: Integrator, period: float, error: float) -> None:
        self.system, self.method, self.period, self.error = system, method, period, error
        self.turning, self.counted = _turning_rates(system.mechanism)
        self.marches = 0
        self.known: list[tuple[Array, Array]] = []  # directions v, and Φ v
        self.before, self.stale = np.inf, False  # the last gap; if directions of an orbit before served
        self.scale = np.ones(2 * system.n)

    def march(self, start: State) -> _Orbit:
        """March over a period from a state."""
        times = np.linspace(0.0, self.period, limits.SAMPLES + 1)
        trajectory = self.method.march(self.system, *start, times, lambda done: check_for_interruption())
        self.marches += 1
        states = np.concatenate([trajectory.q, trajectory.v], axis=1)
        return _Orbit(start, times, states, (trajectory.q[-1], trajectory.v[-1]), self.scale_of(states))

    def scale_of(self, states: Array) -> Array:
        """Return the largest value of the group of each small motion, shape (2 n,)."""
        groups, at = groups_of(self.system), self.system.mechanism.position_of_rates
        largest = np.zeros(int(groups.max(initial=-1)) + 1)
        np.maximum.at(largest, groups, np.abs(states).max(axis=0))
        n_positions = self.system.n_positions
        positions = np.where(at >= 0, largest[groups[:n_positions][at]], 1.0)
        positions[self.turning] = 1.0  # an angle has its own scale, however many turns it has made
        rates = np.maximum(largest[groups[n_positions:]], positions / self.period)
        return np.asarray(np.maximum(np.concatenate([positions, rates]), SHORTEST_NORM))

    def gap(self, orbit: _Orbit) -> Array:
        """Return what is left of a march's end to its start, over its scale."""
        self.scale = orbit.scale
        return self._difference(orbit.start, orbit.end) / orbit.scale

    def _difference(self, one: State, other: State) -> Array:
        """Return the small motion (2 n,) from a state to another one; 0 where it doesn't count."""
        eta, at = np.zeros(self.system.n), self.system.mechanism.position_of_rates
        eta[at >= 0] = (other[0] - one[0])[at[at >= 0]]
        eta[self.turning] -= 2 * np.pi * np.rint(eta[self.turning] / (2 * np.pi))
        for rate, first in self.system.parameters.quaternions:
            (x, y, z, w), end = one[0][first : first + 4], other[0][first : first + 4]
            turn = np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z], [x, y, z, w]]) @ end
            eta[rate : rate + 3] = 2.0 * turn[:3] * np.copysign(1.0, turn[3])
        return np.where(self.counted, np.concatenate([eta, other[1] - one[1]]), 0.0)

    def correct(self, orbit: _Orbit, gap: Array) -> Array:
        """Return the small motion that Newton's method asks for, over its scale."""
        size = newton.largest(gap)
        if size > limits.KEPT_SLOPES * self.before:
            self.known = []
        self.before, self.stale = size, bool(self.known)
        while True:
            found, rest = self._solve(gap)
            for v, _ in 2 * self.known:  # the second turn takes the first one's round-off away
                rest = rest - (v @ rest) * v
            left = float(np.linalg.norm(rest))
            if left <= limits.FOLLOWED * np.linalg.norm(gap) or len(self.known) == np.count_nonzero(self.counted):
                return found
            self.known.append((rest / left, self._follow(orbit, rest / left, [np.sqrt(self.error), 0.0])))

    def _solve(self, gap: Array) -> tuple[Array, Array]:
        """Return the sum of known directions v that best solves ``(1 − Φ) x = gap``, and what is left of the gap."""
        if not self.known:
            return np.zeros(gap.size), gap
        V, W = (np.array(ways).T for ways in zip(*self.known, strict=True))
        shares = np.linalg.lstsq(V - W, gap)[0]
        return V @ shares, gap - (V - W) @ shares

    def _follow(self, orbit: _Orbit, w: Array, steps: list[float]) -> Array:
        """Return ``Φ w`` of a disturbance w by the difference of marches from two states; 0 is the orbit itself."""
        ends = [self.march(self._disturb(orbit, step * w)).end if step else orbit.end for step in steps]
        return self._difference(ends[1], ends[0]) / orbit.scale / (steps[0] - steps[1])

    def _disturb(self, orbit: _Orbit, change: Array) -> State:
        """Return the start of an orbit changed by a small motion, with loops closed."""
        n, whole = self.system.n, change * orbit.scale
        q, v = move_positions(self.system.parameters, orbit.start[0], whole[:n]), orbit.start[1] + whole[n:]
        evaluate_projection(self.system.parameters, 0.0, q, v)
        return q, v

    def move(self, orbit: _Orbit, change: Array) -> _Orbit:
        """March from the start of an orbit, changed."""
        return self.march(self._disturb(orbit, change))

    def accepts(self, trial: newton.Trial) -> bool:
        """Return true if a correction has made the gap smaller, or as small as marches tell.

        One that directions of an orbit before have led astray a little is no reason for shorter steps: new ones follow.
        """
        before, after = newton.largest(trial.before), newton.largest(trial.after)
        if self.stale and before <= after < limits.ASTRAY * before:
            self.known = []
            return True
        return after < max(before, self.error)

    def multipliers(self, orbit: _Orbit) -> NDArray[np.complex128]:
        """Return the multipliers of a motion, the largest first, as far as differences of marches tell them.

        Arnoldi's method, from a random disturbance on, until some of the largest are known, or all there are.
        """
        step = np.cbrt(self.error)
        v = np.where(self.counted, np.random.default_rng(0).standard_normal(len(orbit.scale)), 0.0)
        V, size = [v / np.linalg.norm(v)], np.count_nonzero(self.counted)
        H, known = np.zeros((len(v) + 1, len(v))), np.zeros(0, dtype=complex)
        for k in range(size):
            moved = self._follow(orbit, V[k], [step, -step])
            for _ in range(2):  # the second takes the first one's round-off away
                for j, known_one in enumerate(V):
                    share = float(known_one @ moved)
                    H[j, k] += share
                    moved = moved - share * known_one
            rest = float(np.linalg.norm(moved))
            values, ways = np.linalg.eig(H[: k + 1, : k + 1])
            errors = rest * np.abs(ways[-1])
            order = np.lexsort((-values.imag, -np.abs(values)))
            sure = (errors <= limits.SAME_MULTIPLIER) & (np.abs(values) > self.error / step)
            known = np.asarray(values[order][sure[order]], dtype=complex)
            if rest <= self.error / step or (
                k >= limits.SHOWN_MULTIPLIERS and sure[order[: limits.SHOWN_MULTIPLIERS]].all()
            ):
                break
            H[k + 1, k] = rest
            V.append(moved / rest)
        return known


def _turning_rates(mechanism: Mechanism) -> tuple[BoolArray, BoolArray]:
    """Return which rates turn joints that may have gone round, (n,), and which small motions count, (2 n,)."""
    turns, counts = np.zeros(mechanism.n, dtype=bool), np.ones(2 * mechanism.n, dtype=bool)
    for link, first in zip(mechanism.links, mechanism.layout.rate, strict=True):
        held = link.lead or link.spring or link.laws
        if link.n_rates and link.state is None and not held:
            turns[first + link.n_slides : first + link.n_scalars] = True
    for _, rate, _ in mechanism.states:
        counts[rate] = False
    return turns, counts

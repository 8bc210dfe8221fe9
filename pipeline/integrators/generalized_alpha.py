"""Generalised-α method of Chung & Hulbert, J Appl Mech 60 (1993), as by Arnold & Brüls, Multibody Syst Dyn 18 (2007).

The equations of motion hold at the end of each step; the auxiliary accelerations a follow
``(1 − α_m) a_{n+1} + α_m a_n = (1 − α_f) q̈_{n+1} + α_f q̈_n``. Positions move by
``h (v + h ((½ − β) a_n + β a_{n+1}))``, on a rotation in space along its own group (Brüls & Cardona, J Comput Nonlinear
Dyn 5, 2010). Newton's unknown is q̈_{n+1}; its tangent comes from differences of the accelerations and is kept while it
converges fast.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import AccuracyError
from pipeline.dynamics.jit.compiled import inner, kernel
from pipeline.dynamics.system import System, accelerations, advance
from pipeline.integrators.fixed_step import march_fixed_steps, runs_away
from pipeline.integrators.protocol import (
    Progress,
    State,
    Trajectory,
    march_from,
    require_step,
    start_state,
)

_TOLERANCE = 1e-10  # of Newton's corrections, relative to the largest acceleration
_OF_GUESS = 1e-5  # times the tolerance: the round-off of the acceleration that an iteration starts from
_ROUND_OFF = 1e-14  # of positions, relative to the largest, or to a radian or metre
_MOST_ITERATIONS = 12
_VANISHED = 1e-200  # an acceleration below which nothing is left to converge: damped motions underflow in the end


@dataclass(frozen=True)
class GeneralizedAlpha:
    """Generalised-α method with a constant step: implicit, of order 2.

    Parameters
    ----------
    step : float
        Time step [s].
    rho : float
        Spectral radius at infinite frequency, 0 (strongest damping of what the step can't resolve) … 1 (none).
    """

    step: float
    rho: float = 0.8

    name = "generalized-alpha"

    def __post_init__(self) -> None:
        require_step(self.step)
        if not 0.0 <= self.rho <= 1.0:
            raise ValueError(f"rho is {self.rho}, expected 0 … 1")

    @cached_property
    def weights(self) -> Array:
        """Weights α_m, α_f, β and γ that make the method of second order for this ρ∞, shape (4,)."""
        alpha_m = (2 * self.rho - 1) / (self.rho + 1)
        alpha_f = self.rho / (self.rho + 1)
        return np.array([alpha_m, alpha_f, 0.25 * (1 - alpha_m + alpha_f) ** 2, 0.5 - alpha_m + alpha_f])

    def order(self, system: System) -> int:
        """Return 2."""
        return 2

    def largest_step(self, system: System) -> float:
        """Return infinity: the method is stable for linear systems at any step."""
        return np.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 to the last of ``times``."""
        start = _two_accelerations(start_state(system, q0, v0, np.zeros(system.n)))
        return march_from(self, system, start, times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        AccuracyError
            Newton's iteration did not converge; the message has the time.
        """
        parameters, h, room = system.parameters, self.step, _newton_room(system)

        def run(state: State, n_steps: int, *samples: Any) -> int:
            march: tuple[Any, ...] = (h, state.step, n_steps, state.q, state.v, state.a)
            done = int(_march(parameters, self.weights, *room, state.memory, *march, *samples))
            if room[-1][1]:
                raise AccuracyError(
                    f"{self.name}: Newton's iteration did not converge at t = {(state.step + done) * h:.6g} s; "
                    "take a smaller step"
                )
            return done

        end, q, v, seconds = march_fixed_steps(run, start, h, 1, times, progress)
        return Trajectory(self.name, h, 1, times, q, v, int(room[-1][0]), 0, seconds, end)


def _two_accelerations(start: State) -> State:
    """Complete a state at time 0 by auxiliary and true accelerations, equal at first, and memory for `_newton_step`."""
    n = start.a.size
    return replace(start, a=np.concatenate([start.a, start.a]), memory=np.zeros(n * n + 2))


def _newton_room(system: System) -> tuple[Array, Array, Array]:
    """Return work arrays of the kernels: rates, positions, and counts of evaluations and of failures."""
    return np.zeros((6, system.n)), np.zeros((2, system.n_positions)), np.zeros(2)


@inner
def _factor(A: Array) -> None:
    """Factor a matrix into L and U in place, without pivoting: a tangent is the unit matrix and a step's change."""
    n = A.shape[0]
    for k in range(n):
        for i in range(k + 1, n):
            A[i, k] /= A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= A[i, k] * A[k, j]


@inner
def _solve(A: Array, x: Array) -> None:
    n = A.shape[0]
    for i in range(n):
        for j in range(i):
            x[i] -= A[i, j] * x[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= A[i, j] * x[j]
        x[i] /= A[i, i]


@inner
def _end_of_step(
    p: Any, weights: Array, end: float, h: float, q: Array, v: Array, a: Array, new: Array,
    q_new: Array, v_new: Array, mean: Array, found: Array,
) -> None:  # fmt: skip
    """Evaluate the accelerations at a step's end for trial ones ``new``; a holds the auxiliary and the true ones."""
    n = v.size
    alpha_m, alpha_f, beta, gamma = weights[0], weights[1], weights[2], weights[3]
    for i in range(n):
        ahead = ((1.0 - alpha_f) * new[i] + alpha_f * a[n + i] - alpha_m * a[i]) / (1.0 - alpha_m)
        mean[i] = v[i] + h * ((0.5 - beta) * a[i] + beta * ahead)
        v_new[i] = v[i] + h * ((1.0 - gamma) * a[i] + gamma * ahead)
    for i in range(q.size):
        q_new[i] = q[i]
    advance(p, q_new, mean, h, 0, n)
    accelerations(p, end, q_new, v_new, found)


@inner
def _newton_step(
    p: Any, weights: Array, work: Array, positions: Array, counts: Array, memory: Array,
    end: float, h: float, q: Array, v: Array, a: Array,
) -> bool:  # fmt: skip
    """Find the accelerations at a step's ``end`` [s] by Newton's method, into work[0].

    positions[0] and work[3] are the positions and rates there. ``memory`` keeps the factored tangent, 1 behind it
    while it is valid, and the largest acceleration so far.
    """
    n, new = v.size, work[0]
    alpha_m, alpha_f, beta = weights[0], weights[1], weights[2]
    for i in range(n):
        new[i] = a[n + i]
    for trial in range(2):  # a loop, since a call with True and one with False would be compiled each
        if _converges(p, weights, work, positions, counts, memory, end, h, q, v, a, trial == 0):
            return True
        # The last accelerations, held over a long step, carry a stiff coordinate far out to where no tangent is of use.
        for i in range(n):
            ahead = -(v[i] / h + (0.5 - beta) * a[i]) / beta  # so that positions stay
            new[i] = ((1.0 - alpha_m) * ahead + alpha_m * a[i] - alpha_f * a[n + i]) / (1.0 - alpha_f)
        memory[n * n] = 0.0
    return False


@inner
def _converges(
    p: Any, weights: Array, work: Array, positions: Array, counts: Array, memory: Array,
    end: float, h: float, q: Array, v: Array, a: Array, wary: bool,
) -> bool:  # fmt: skip
    """Iterate from the accelerations in work[0] until they converge; if ``wary``, only while corrections shrink.

    Forces that balance leave an acceleration with their own round-off: a correction that no longer shrinks, or shrinks
    to the last, is good enough if it is small beside the largest one so far, or moves positions by their round-off.
    """
    n = v.size
    new, found, shifted, v_new, mean, base = work[0], work[1], work[2], work[3], work[4], work[5]
    q_new, tangent = positions[0], memory[: n * n].reshape((n, n))
    largest_before, peak = 0.0, memory[n * n + 1]
    to_position = h * h * weights[2] * (1.0 - weights[1]) / (1.0 - weights[0])
    for iteration in range(_MOST_ITERATIONS):
        _end_of_step(p, weights, end, h, q, v, a, new, q_new, v_new, mean, found)
        counts[0] += 1
        size, largest, reached = _VANISHED, 0.0, 1.0
        if memory[n * n] == 0.0 or (iteration > 0 and iteration % 4 == 0):
            for i in range(n):
                base[i] = found[i]
                size = max(size, abs(found[i]), abs(new[i]), abs(a[i]), _OF_GUESS * abs(a[n + i]))
            for j in range(n):
                keep = new[j]
                nudge = 1e-6 * (abs(keep) + 1e-3 * max(size, peak))
                new[j] = keep + nudge
                _end_of_step(p, weights, end, h, q, v, a, new, q_new, v_new, mean, shifted)
                counts[0] += 1
                new[j] = keep
                for i in range(n):
                    tangent[i, j] = (1.0 if i == j else 0.0) - (shifted[i] - base[i]) / nudge
            _factor(tangent)
            memory[n * n] = 1.0
            for i in range(n):
                found[i] = base[i]
        size = _VANISHED
        for i in range(n):
            found[i] -= new[i]
        _solve(tangent, found)
        for i in range(n):
            new[i] += found[i]
            largest += abs(found[i])  # a sum: it keeps a NaN, which max would lose
            # Auxiliary ones too: their round-off is in what is found, and the guess's in new.
            size = max(size, abs(new[i]), abs(a[i]), _OF_GUESS * abs(a[n + i]))
        for i in range(q.size):
            reached = max(reached, abs(q_new[i]))
        slow = iteration > 0 and largest > 0.3 * largest_before
        good_enough = max(_TOLERANCE * peak, _ROUND_OFF * reached / to_position)
        last = iteration == _MOST_ITERATIONS - 1  # beneath round-off it may shrink by a steady factor for long
        if largest <= _TOLERANCE * size or ((slow or last) and largest <= good_enough):
            memory[n * n + 1] = max(peak, size)
            _end_of_step(p, weights, end, h, q, v, a, new, q_new, v_new, mean, found)
            counts[0] += 1
            return True
        if wary and iteration > 0 and largest > largest_before:
            return False
        if slow:
            memory[n * n] = 0.0  # too slow: a fresh tangent
        largest_before = largest
    return False


@inner
def _sample_step_at(
    p: Any, s: float, h: float, q: Array, v: Array, a: Array, new: Array, mean: Array, q_out: Array, v_out: Array
) -> None:
    """Interpolate the state at a time s after a step's begin: cubic in time, along the mean rates."""
    n = v.size
    x = s / h
    for i in range(n):
        v_out[i] = v[i] + s * (a[n + i] + 0.5 * x * (new[i] - a[n + i]))
        mean[i] = v[i] + s * (0.5 * a[n + i] + x * (new[i] - a[n + i]) / 6.0)
    for i in range(q.size):
        q_out[i] = q[i]
    advance(p, q_out, mean, s, 0, n)


@inner
def _accept_step(weights: Array, q: Array, v: Array, a: Array, new: Array, q_new: Array, v_new: Array) -> None:
    """Move the state to the end of a step."""
    n = v.size
    alpha_m, alpha_f = weights[0], weights[1]
    for i in range(n):
        a[i] = ((1.0 - alpha_f) * new[i] + alpha_f * a[n + i] - alpha_m * a[i]) / (1.0 - alpha_m)
        a[n + i] = new[i]
        v[i] = v_new[i]
    for i in range(q.size):
        q[i] = q_new[i]


@kernel
def _march(
    p: Any, weights: Array, work: Array, positions: Array, counts: Array, memory: Array,
    h: float, first: int, n_steps: int, q: Array, v: Array, a: Array,
    sample_step: IntArray, sample_offset: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
    for step in range(first, first + n_steps):
        if not _newton_step(p, weights, work, positions, counts, memory, step * h + h, h, q, v, a):
            counts[1] = 1.0
            return step - first
        while step == next_sample:
            k = cursor[0]
            _sample_step_at(p, sample_offset[k], h, q, v, a, work[0], work[2], sample_q[k], sample_v[k])
            cursor[0] += 1
            next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
        _accept_step(weights, q, v, a, work[0], positions[0], work[3])
        if runs_away(v):
            return step - first
    return n_steps

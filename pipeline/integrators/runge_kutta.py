"""Explicit Runge–Kutta method of order 8 by Dormand and Prince, compiled.

The tableau, the error estimate (of orders 5 and 3 together) and the dense output of order 7 are those of Hairer,
Nørsett & Wanner, Solving Ordinary Differential Equations I (1993), section II.10.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.compiled import inner, kernel
from pipeline.dynamics.system import System, accelerations, advance, velocities
from pipeline.integrators import dop853
from pipeline.integrators.adaptive import (
    SMALLEST,
    adaptive_start,
    groups_of,
    just_after,
    just_before,
    keep_largest,
    march_adaptive_steps,
    scaled_error,
    step_factor,
    step_within,
)
from pipeline.integrators.protocol import Progress, State, Trajectory, march_from, require_tolerance

_E3, _E5, _D = 16, 17, 18  # rows of the weights after those of the stages


class Tableau(NamedTuple):
    """Coefficients of the method: 12 stages, one at the step's end and three more for dense output.

    Attributes
    ----------
    C : ndarray, shape (16,)
        Times of the stages in a step.
    slope : ndarray of int, shape (22, 16)
        Numbers of the slopes that are summed for each stage, each of the two errors, and four coefficients of the
        dense output; filled up with 0.
    weight : ndarray, shape (22, 16)
        Their weights, and 0.
    length : ndarray of int, shape (22,)
        How many they are, rounded up to four.
    """

    C: Array
    slope: IntArray
    weight: Array
    length: IntArray


@cache
def tableau() -> Tableau:
    """Return the coefficients as arrays."""
    slope, weight, length = np.zeros((22, 16), dtype=np.int64), np.zeros((22, 16)), np.zeros(22, dtype=np.int64)
    for k, row in enumerate(dop853.ROWS):
        slope[k, : len(row)], weight[k, : len(row)], length[k] = [*row], [*row.values()], -(-len(row) // 4) * 4
    return Tableau(np.array(dop853.C), slope, weight, length)


@dataclass(frozen=True)
class RungeKutta:
    """Runge–Kutta method of order 8 that chooses its steps by a relative ``tolerance`` of each."""

    tolerance: float = 1e-9

    name = "runge-kutta"
    step = 0.0

    def __post_init__(self) -> None:
        require_tolerance(self.tolerance)

    def order(self, system: System) -> int:
        """Return 8."""
        return 8

    def largest_step(self, system: System) -> float:
        """Return infinity: the error keeps the step to stable ones."""
        return math.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the last of ``times`` is passed."""
        return march_from(self, system, adaptive_start(system, q0, v0), times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        StabilityError
            The step became too small.
        """
        p, groups, coefficients = system.parameters, groups_of(system), tableau()
        slopes, vectors = np.zeros((16, groups.size)), np.zeros((12, groups.size))
        trial, evaluations = np.zeros(start.memory.size), np.zeros(1)

        def run(state: State, clock: Array, stop: float, n_steps: int, *samples: Any) -> int:
            work = (state.q, state.v, state.a, groups, state.memory, slopes, vectors, trial, evaluations)
            return int(_march(p, coefficients, self.tolerance, clock, stop, n_steps, *work, *samples))

        return march_adaptive_steps(self.name, run, start, system.breakpoints, times, progress, evaluations)


@inner
def _add_slopes(c: Tableau, row: int, h: float, K: Array, out: Array) -> None:
    """Add a row's weighted sum of the slopes times h, four at a time, so that ``out`` is read and written less."""
    for first in range(0, c.length[row], 4):
        w0, w1 = h * c.weight[row, first], h * c.weight[row, first + 1]
        w2, w3 = h * c.weight[row, first + 2], h * c.weight[row, first + 3]
        K0, K1 = K[c.slope[row, first]], K[c.slope[row, first + 1]]
        K2, K3 = K[c.slope[row, first + 2]], K[c.slope[row, first + 3]]
        for i in range(out.size):
            out[i] += (w0 * K0[i] + w1 * K1[i]) + (w2 * K2[i] + w3 * K3[i])


@inner
def _stage(p: Any, c: Tableau, k: int, t: float, h: float, u: Array, n_positions: int, K: Array, U: Array) -> None:
    """Evaluate slope number k of a step, at ``t + C_k h``."""
    for i in range(u.size):
        U[i] = u[i]
    _add_slopes(c, k, h, K, U)
    velocities(p, U[:n_positions], U[n_positions:], K[k, :n_positions])
    accelerations(
        p, just_before(t + h) if c.C[k] == 1.0 else t + c.C[k] * h, U[:n_positions], U[n_positions:], K[k, n_positions:]
    )


@inner
def _error(c: Tableau, h: float, K: Array, groups: IntArray, largest: Array, error: Array) -> float:
    """Estimate the error of a step by those of orders 5 and 3 together: ``|e₅|² / √(|e₅|² + 0.01 |e₃|²)``."""
    for i in range(error.size):
        error[i] = 0.0
    _add_slopes(c, _E3, h, K, error)
    third = scaled_error(groups, largest, error)
    for i in range(error.size):
        error[i] = 0.0
    _add_slopes(c, _E5, h, K, error)
    fifth = scaled_error(groups, largest, error)
    size = math.sqrt(fifth * fifth + 0.01 * third * third)
    return fifth * fifth / size if size > 0.0 else size


@kernel
def _march(
    p: Any, c: Tableau, tolerance: float, clock: Array, stop: float, n_steps: int, q: Array, v: Array, a: Array,
    groups: IntArray, largest: Array, K: Array, x: Array, trial: Array, evaluations: Array,
    times: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n_positions, n = q.size, x.shape[1]
    u, U, new, error = x[0], x[1], x[2], x[3]
    smallest = SMALLEST * times[times.size - 1]
    for done in range(n_steps):
        if cursor[0] >= times.size or clock[0] >= stop:
            return done
        t = clock[0]
        for i in range(n_positions):
            u[i] = q[i]
        for i in range(n - n_positions):
            u[n_positions + i] = v[i]
        velocities(p, u[:n_positions], u[n_positions:], K[0, :n_positions])
        accelerations(p, just_after(t), u[:n_positions], u[n_positions:], K[0, n_positions:])
        evaluations[0] += 1
        h = step_within(clock[1], stop - t)
        planned, reached = h == clock[1], t
        while True:
            reached = stop if h == stop - t else t + h
            for k in range(1, 13):
                _stage(p, c, k, t, h, u, n_positions, K, new)  # the last one is at the step's end, and new with it
            evaluations[0] += 12
            for k in range(largest.size):
                trial[k] = largest[k]
            keep_largest(groups, trial, new)
            size = _error(c, h, K, groups, trial, error)
            factor = step_factor(size, tolerance, 8)
            if size <= tolerance:
                break
            h *= min(factor, 0.9)
            planned = True
            if not h > smallest:
                clock[1] = h
                return -done - 1
        if cursor[0] < times.size and times[cursor[0]] <= reached:
            for k in range(13, 16):
                _stage(p, c, k, t, h, u, n_positions, K, U)
            evaluations[0] += 3
            _prepare_samples(c, h, u, new, K, x)
            while cursor[0] < times.size and times[cursor[0]] <= reached:
                _sample((times[cursor[0]] - t) / h, u, x, U)
                for i in range(n):  # at the end the state itself, which the polynomial meets but for round-off
                    U[i] = U[i] if times[cursor[0]] < reached else new[i]
                for i in range(n_positions):
                    sample_q[cursor[0], i] = U[i]
                for i in range(n - n_positions):
                    sample_v[cursor[0], i] = U[n_positions + i]
                advance(p, sample_q[cursor[0]], sample_v[cursor[0]], 0.0, 0, n - n_positions)  # unit quaternions
                cursor[0] += 1
        for i in range(n_positions):
            q[i] = new[i]
        for i in range(n - n_positions):
            v[i] = new[n_positions + i]
        advance(p, q, v, 0.0, 0, n - n_positions)
        for i in range(n - n_positions):
            a[i] = K[12, n_positions + i]
        clock[0] = reached
        if planned:  # else a breakpoint cut the step short
            clock[1] = h * factor
        keep_largest(groups, largest, new)
    return n_steps


@inner
def _prepare_samples(c: Tableau, h: float, u: Array, new: Array, K: Array, x: Array) -> None:
    """Compute the coefficients of the dense output, into x[5 … 11]."""
    n = u.size
    for i in range(n):
        rise = new[i] - u[i]
        x[5, i] = rise
        x[6, i] = h * K[0, i] - rise
        x[7, i] = 2.0 * rise - h * (K[12, i] + K[0, i])
        for row in range(4):
            x[8 + row, i] = 0.0
    for row in range(4):
        _add_slopes(c, _D + row, h, K, x[8 + row])


@inner
def _sample(s: float, u: Array, x: Array, out: Array) -> None:
    """Evaluate the state at a part s of the step: ``u + s (f₁ + (1 − s)(f₂ + s (f₃ + …)))`` with seven coefficients."""
    for i in range(u.size):
        total = x[11, i] * s
        for row in range(10, 4, -1):
            total = (total + x[row, i]) * (1.0 - s if row % 2 == 0 else s)
        out[i] = u[i] + total

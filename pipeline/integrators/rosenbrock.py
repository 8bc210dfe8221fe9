"""Exponential Rosenbrock method exprb43: Hochbruck, Ostermann & Schweitzer, SIAM J Numer Anal 47 (2009).

``u' = F(t, u)`` for positions and rates together. In each step F is linearised anew, ``F = J u + v t + g``, the linear part
is solved exactly by ``φ_k(h J)`` and the rest g by two stages:

    U₂ = u + ½h φ₁(½hJ) F + (½h)² φ₂(½hJ) v          D₂ = g(U₂) − g(u)
    U₃ = u + h φ₁(hJ) (F + D₂) + h² φ₂(hJ) v          D₃ = g(U₃) − g(u)
    û  = u + h φ₁ F + h² φ₂ v + h φ₃ (16 D₂ − 2 D₃)    u₁ = û + h φ₄ (12 D₃ − 48 D₂)

u₁ is of order 4, û of order 3; their difference steers the step. Between, g is taken as ``a s² + b s³`` with
``a = 8 D₂ − D₃``, ``b = 2 D₃ − 8 D₂`` over s = 0 … 1, which gives the same u₁ at s = 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.checks import Array, IntArray
from pipeline.dynamics.compiled import kernel
from pipeline.dynamics.system import System, accelerations, advance, velocities
from pipeline.integrators.adaptive import (
    adaptive_state,
    groups_of,
    keep_largest,
    march_adaptively,
    scaled_error,
    step_factor,
)
from pipeline.integrators.protocol import Progress, State, Trajectory, start_state

_DEGREE = 10  # of φ₄'s Taylor polynomial: exact to round-off for a norm of …
_NORM = 0.5
_NUDGE = 1.5e-8  # of a coordinate, or of 1


@dataclass(frozen=True)
class ExponentialRosenbrock:
    """The adaptive method of order 4 with a relative ``tolerance`` of each step."""

    tolerance: float = 1e-6

    name = "exponential-rosenbrock"
    step = 0.0

    def __post_init__(self) -> None:
        if not 3e-14 <= self.tolerance < 1.0:
            raise ValueError(f"tolerance is {self.tolerance}, expected 3e-14 … 1")

    def order(self, system: System) -> int:
        """Order 4."""
        return 4

    def largest_step(self, system: System) -> float:
        """No limit: the step follows the error."""
        return math.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the last of ``times`` is passed."""
        start = start_state(system, q0, v0, np.zeros(system.n))
        groups = groups_of(system)
        largest = np.zeros(int(groups.max(initial=-1)) + 1)
        keep_largest(groups, largest, np.concatenate([start.q, start.v]))
        start = replace(adaptive_state(system, start), memory=largest)
        trajectory = self.resume(system, start, times, progress)
        return replace(trajectory, evaluations=trajectory.evaluations + 1)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        StabilityError
            The step became too small.
        """
        p, groups, n_all = system.parameters, groups_of(system), system.n_positions + system.n
        matrices, vectors = np.zeros((10, n_all, n_all)), np.zeros((14, n_all))
        evaluations = np.zeros(1)

        def run(state: State, clock: Array, stop: float, n_steps: int, *samples: Any) -> int:
            work = (state.q, state.v, state.a, groups, state.memory, matrices, vectors, evaluations)
            return int(_march(p, self.tolerance, clock, stop, n_steps, *work, *samples))

        end, q, v, seconds = march_adaptively(run, start, system.breakpoints, times, progress)
        n_steps = end.step - start.step
        mean = (end.time - start.time) / n_steps if n_steps else 0.0
        return Trajectory(self.name, mean, 1, times, q, v, int(evaluations[0]), 0, seconds, end)


@kernel
def _slope(p: Any, t: float, u: Array, n_positions: int, F: Array) -> None:
    """``F(t, u)``."""
    velocities(p, u[:n_positions], u[n_positions:], F[:n_positions])
    accelerations(p, t, u[:n_positions], u[n_positions:], F[n_positions:])


@kernel
def _linearise(
    p: Any, t: float, dt: float, u: Array, n_positions: int, F: Array, nudged: Array, J: Array, v: Array
) -> None:
    """Derivatives J of F by u and v by t, by differences."""
    n = u.size
    for j in range(n):
        keep = u[j]
        nudge = _NUDGE * max(1.0, abs(keep))
        u[j] = keep + nudge
        _slope(p, t, u, n_positions, nudged)
        nudge = u[j] - keep  # as it was stored
        u[j] = keep
        for i in range(n):
            J[i, j] = (nudged[i] - F[i]) / nudge
    _slope(p, t + dt, u, n_positions, nudged)
    for i in range(n):
        v[i] = (nudged[i] - F[i]) / dt


@kernel
def _multiply(A: Array, B: Array, C: Array) -> None:
    """``C = A B``."""
    n = A.shape[0]
    for i in range(n):
        row = C[i]
        for j in range(n):
            row[j] = 0.0
        for k in range(n):
            a = A[i, k]
            if a != 0.0:
                other = B[k]
                for j in range(n):
                    row[j] += a * other[j]


@kernel
def _phi_functions(J: Array, scale: Array, h: float, m: Array) -> None:
    """Fill m[0 … 4] with φ₀ … φ₄ of ``h S J S⁻¹`` and m[5], m[6] with φ₁, φ₂ of half of it; m[7 … 8] is room."""
    n = J.shape[0]
    A, new = m[7], m[8]
    norm = 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            A[i, j] = h * scale[i] * J[i, j] / scale[j]
            total += abs(A[i, j])
        norm = max(norm, total)
    doublings = 1
    while norm > _NORM * 2.0**doublings and doublings < 60:
        doublings += 1
    small = 0.5**doublings
    for i in range(n):
        for j in range(n):
            A[i, j] *= small
            m[4, i, j] = 0.0
    coefficient = 1.0  # 1/(degree + 4)!
    for k in range(1, _DEGREE + 5):
        coefficient /= k
    for k in range(_DEGREE, -1, -1):  # φ₄(A) = Σ A^k/(k + 4)!, by Horner
        if k < _DEGREE:
            _multiply(A, m[4], new)
            for i in range(n):
                for j in range(n):
                    m[4, i, j] = new[i, j]
            coefficient *= k + 5
        for i in range(n):
            m[4, i, i] += coefficient
    inverse = 6.0
    for k in range(3, -1, -1):  # φ_k = A φ_{k+1} + 1/k!
        _multiply(A, m[k + 1], m[k])
        for i in range(n):
            m[k, i, i] += 1.0 / inverse
        inverse /= max(k, 1)
    for doubling in range(doublings):
        if doubling == doublings - 1:
            for i in range(n):
                for j in range(n):
                    m[5, i, j], m[6, i, j] = m[1, i, j], m[2, i, j]
        # φ_k(2A) = 2^-k (φ₀ φ_k + Σ_j φ_j/(k − j)!), from the highest down: the lower ones are still needed
        for k in range(4, -1, -1):
            _multiply(m[0], m[k], new)
            for i in range(n):
                for j in range(n):
                    total, weight = new[i, j], 1.0
                    for lower in range(k, 0, -1):
                        total += weight * m[lower, i, j]
                        weight /= k - lower + 1
                    new[i, j] = total * 0.5**k
            for i in range(n):
                for j in range(n):
                    m[k, i, j] = new[i, j]


@kernel
def _add_product(factor: float, Phi: Array, scale: Array, x: Array, out: Array) -> None:
    """``out += factor S⁻¹ Φ S x``."""
    n = x.size
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += Phi[i, j] * scale[j] * x[j]
        out[i] += factor * total / scale[i]


@kernel
def _remainder(
    p: Any, t: float, dt: float, u: Array, start: Array, n_positions: int, F: Array, J: Array, v: Array, out: Array
) -> None:
    """``g(t + dt, u) − g(t, start)``, into out."""
    _slope(p, t + dt, u, n_positions, out)
    n = u.size
    for i in range(n):
        total = F[i] + dt * v[i]
        for j in range(n):
            total += J[i, j] * (u[j] - start[j])
        out[i] -= total


@kernel
def _march(
    p: Any, tolerance: float, clock: Array, stop: float, n_steps: int, q: Array, v_state: Array, a: Array,
    groups: IntArray, largest: Array, m: Array, x: Array, evaluations: Array,
    times: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n_positions, n = q.size, x.shape[1]
    u, F, v, U, D2, D3 = x[0], x[1], x[2], x[3], x[4], x[5]
    new, error, scale, A, B = x[6], x[7], x[8], x[9], x[10]
    J = m[9]
    last = times[times.size - 1]
    for done in range(n_steps):
        if cursor[0] >= times.size or clock[0] >= stop:
            return done
        t = clock[0]
        for i in range(n_positions):
            u[i] = q[i]
        for i in range(n - n_positions):
            u[n_positions + i], F[n_positions + i] = v_state[i], a[i]
        velocities(p, u[:n_positions], u[n_positions:], F[:n_positions])
        h = min(clock[1], stop - t)
        planned = h == clock[1]
        _linearise(p, t, 1e-4 * h, u, n_positions, F, new, J, v)
        evaluations[0] += n + 1
        while True:
            if not h > 1e-14 * max(abs(t), last):
                clock[1] = h
                return -done - 1
            for i in range(n):  # balances 1 and ω² into ω and ω
                column = 0.0
                for j in range(n_positions, n):
                    column = max(column, abs(J[j, i]))
                scale[i] = max(math.sqrt(column), 0.1 / h) if i < n_positions else 1.0
            _phi_functions(J, scale, h, m)
            for i in range(n):
                U[i] = u[i]
            _add_product(0.5 * h, m[5], scale, F, U)
            _add_product(0.25 * h * h, m[6], scale, v, U)
            _remainder(p, t, 0.5 * h, U, u, n_positions, F, J, v, D2)
            for i in range(n):
                U[i], error[i] = u[i], F[i] + D2[i]
            _add_product(h, m[1], scale, error, U)
            _add_product(h * h, m[2], scale, v, U)
            _remainder(p, t, h, U, u, n_positions, F, J, v, D3)
            evaluations[0] += 2
            for i in range(n):
                A[i], B[i] = 8.0 * D2[i] - D3[i], 2.0 * D3[i] - 8.0 * D2[i]
                new[i], error[i] = u[i], 0.0
            _add_product(h, m[1], scale, F, new)
            _add_product(h * h, m[2], scale, v, new)
            _add_product(2.0 * h, m[3], scale, A, new)
            _add_product(6.0 * h, m[4], scale, B, error)
            for i in range(n):
                new[i] += error[i]
            size = scaled_error(groups, largest, new, error)
            factor = step_factor(size, tolerance, 4)
            if size <= tolerance:
                break
            h *= min(factor, 0.9)
            planned = True
        while cursor[0] < times.size and times[cursor[0]] <= t + h:
            ahead = times[cursor[0]] - t
            s = ahead / h
            for i in range(n):
                U[i] = u[i] if s < 1.0 else new[i]
            if 0.0 < s < 1.0:
                _phi_functions(J, scale, ahead, m)
                _add_product(ahead, m[1], scale, F, U)
                _add_product(ahead * ahead, m[2], scale, v, U)
                _add_product(2.0 * ahead * s * s, m[3], scale, A, U)
                _add_product(6.0 * ahead * s * s * s, m[4], scale, B, U)
            for i in range(n_positions):
                sample_q[cursor[0], i] = U[i]
            for i in range(n - n_positions):
                sample_v[cursor[0], i] = U[n_positions + i]
            advance(p, sample_q[cursor[0]], sample_v[cursor[0]], 0.0, 0, n - n_positions)  # unit quaternions
            cursor[0] += 1
        for i in range(n_positions):
            q[i] = new[i]
        for i in range(n - n_positions):
            v_state[i] = new[n_positions + i]
        advance(p, q, v_state, 0.0, 0, n - n_positions)
        clock[0] = stop if h == stop - t else t + h
        accelerations(p, clock[0], q, v_state, a)
        evaluations[0] += 1
        if planned:  # else a breakpoint cut the step short
            clock[1] = h * factor
        keep_largest(groups, largest, new)
    return n_steps

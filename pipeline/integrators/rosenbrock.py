"""Exponential Rosenbrock method exprb43 of Hochbruck, Ostermann & Schweitzer, SIAM J Numer Anal 47 (2009).

``u' = F(t, u)`` for positions and rates together. Each step linearises F anew, ``F = J u + v t + g``: the linear part
is solved exactly by ``φ_k(h J)`` and the rest g by two stages:

    U₂ = u + ½h φ₁(½hJ) F + (½h)² φ₂(½hJ) v          D₂ = g(U₂) − g(u)
    U₃ = u + h φ₁(hJ) (F + D₂) + h² φ₂(hJ) v          D₃ = g(U₃) − g(u)
    û  = u + h φ₁ F + h² φ₂ v + h φ₃ (16 D₂ − 2 D₃)    u₁ = û + h φ₄ (12 D₃ − 48 D₂)

u₁ is of order 4, û of order 3; their difference steers the step. Between, g is taken as ``a s² + b s³`` with
``a = 8 D₂ − D₃``, ``b = 2 D₃ − 8 D₂`` over s = 0 … 1, which gives the same u₁ at s = 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.compiled import inner, kernel
from pipeline.dynamics.jit.products import multiply_square
from pipeline.dynamics.system import System, accelerations, advance, velocities
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

_NORMS = (0.25, 1.0, 1.8, 2.9)  # up to which φ₄'s Taylor polynomial of degree 8, 12, 16, 20 is exact to round-off
_INVERSES = tuple(1.0 / math.factorial(k) for k in range(26))
_LEVELS = 28  # of doublings at most
_NUDGE = 1.5e-8  # of a coordinate, or of 1
_ROUND_OFF = 1e-15  # of the largest rate and acceleration so far, and of what they change in a step


@dataclass(frozen=True)
class ExponentialRosenbrock:
    """Exponential Rosenbrock method of order 4 that chooses its steps by a relative ``tolerance`` of each."""

    tolerance: float = 1e-6

    name = "exponential-rosenbrock"
    step = 0.0

    def __post_init__(self) -> None:
        require_tolerance(self.tolerance)

    def order(self, system: System) -> int:
        """Return 4."""
        return 4

    def largest_step(self, system: System) -> float:
        """Return infinity: the step follows the error."""
        return math.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the last of ``times`` is passed."""
        start = adaptive_start(system, q0, v0, more=2)  # the largest of all rates and accelerations, for round-off
        return march_from(self, system, start, times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        StabilityError
            The step became too small.
        """
        p, groups, n_all = system.parameters, groups_of(system), system.n_positions + system.n
        levels, matrices = np.empty((_LEVELS, 5, n_all, n_all)), np.empty((7, n_all, n_all))
        vectors, sources, trial = np.zeros((11, n_all)), np.zeros((4, n_all)), np.zeros(start.memory.size)
        evaluations = np.zeros(1)

        def run(state: State, clock: Array, stop: float, n_steps: int, *samples: Any) -> int:
            room = (levels, matrices, vectors, sources, trial, evaluations)
            march = (clock, stop, n_steps, state.q, state.v, state.a, groups, state.memory)
            return int(_march(p, self.tolerance, *march, *room, *samples))

        return march_adaptive_steps(self.name, run, start, system.breakpoints, times, progress, evaluations)


@inner
def _slope(p: Any, t: float, u: Array, n_positions: int, F: Array) -> None:
    """Evaluate the time derivatives ``F(t, u)`` of positions and rates together, into F."""
    velocities(p, u[:n_positions], u[n_positions:], F[:n_positions])
    accelerations(p, t, u[:n_positions], u[n_positions:], F[n_positions:])


@inner
def _linearise(
    p: Any, t: float, dt: float, u: Array, n_positions: int, F: Array, nudged: Array, J: Array, v: Array, second: float
) -> None:
    """Differentiate F by u for J and by t for v, by finite differences.

    Entries that may be round-off alone are set to 0: a coordinate at rest would take them for errors of its own.
    """
    n = u.size
    for j in range(n):
        keep = u[j]
        u[j] = keep + _NUDGE * max(1.0, abs(keep))
        _slope(p, t, u, n_positions, nudged)
        nudge = u[j] - keep  # as it was stored
        u[j] = keep
        for i in range(n):
            change = nudged[i] - F[i]
            noise = _ROUND_OFF * second if i >= n_positions else 0.0
            J[i, j] = change / nudge if abs(change) > noise else 0.0
    _slope(p, t + dt, u, n_positions, nudged)
    for i in range(n):
        change = nudged[i] - F[i]
        v[i] = change / dt if abs(change) > _ROUND_OFF * second else 0.0


@inner
def _taylor_matrices(A: Array, tau: float, norm: float, phi: Array, m: Array) -> None:
    """Fill phi (5, n, n) with φ₀ … φ₄ of ``tau A``, of this norm; m (5, n, n) is room.

    φ₄ is a polynomial in blocks of four powers (Paterson & Stockmeyer, SIAM J Comput 2, 1973); the others follow from
    ``φ_k(z) = z φ_{k+1}(z) + 1/k!``.
    """
    n = A.shape[0]
    B, top, new = m[0], phi[4], m[4]
    for i in range(n):
        for j in range(n):
            B[i, j] = tau * A[i, j]
    for k in range(1, 4):
        multiply_square(B, m[k - 1], m[k])
    blocks = 2
    while blocks < 5 and norm > _NORMS[blocks - 2]:
        blocks += 1
    for i in range(n):
        for j in range(n):
            new[i, j] = _INVERSES[4 * blocks + 4] * m[3, i, j]
    for block in range(blocks - 1, -1, -1):
        c0, c1, c2, c3 = (
            _INVERSES[4 * block + 4],
            _INVERSES[4 * block + 5],
            _INVERSES[4 * block + 6],
            _INVERSES[4 * block + 7],
        )
        for i in range(n):
            for j in range(n):
                top[i, j] = new[i, j] + c1 * B[i, j] + c2 * m[1, i, j] + c3 * m[2, i, j]
            top[i, i] += c0
        if block:
            multiply_square(m[3], top, new)
    for k in range(3, -1, -1):
        multiply_square(B, phi[k + 1], phi[k])
        for i in range(n):
            phi[k, i, i] += _INVERSES[k]


@inner
def _double(phi: Array, out: Array) -> None:
    """Compute φ_k(2z) from φ_k(z): ``φ_k(2z) = 2^-k (φ₀ φ_k + Σ_j φ_j/(k − j)!)``."""
    n = phi.shape[1]
    for k in range(5):
        multiply_square(phi[0], phi[k], out[k])
    half, sixth = _INVERSES[2], _INVERSES[3]
    for i in range(n):  # a row of each at a time: sums of several terms are read and written once
        one, two, three, four = phi[1, i], phi[2, i], phi[3, i], phi[4, i]
        row = out[1, i]
        for j in range(n):
            row[j] = 0.5 * (row[j] + one[j])
        row = out[2, i]
        for j in range(n):
            row[j] = 0.25 * (row[j] + two[j] + one[j])
        row = out[3, i]
        for j in range(n):
            row[j] = 0.125 * (row[j] + three[j] + two[j] + half * one[j])
        row = out[4, i]
        for j in range(n):
            row[j] = 0.0625 * (row[j] + four[j] + three[j] + half * two[j] + sixth * one[j])


@inner
def _matrix_functions(A: Array, half: float, levels: Array, m: Array) -> int:
    """Fill levels[0 … top] with φ₀ … φ₄ of ``half A 2^(level − top)`` and return the top; -1 if they are too few."""
    n = A.shape[0]
    norm, all_rows = 0.0, 0.0
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += abs(A[i, j])
        norm = max(norm, half * total)
        all_rows += total  # a sum: it keeps a NaN, which max would lose
    top = 0
    while norm > _NORMS[3] and top < levels.shape[0]:
        norm *= 0.5
        top += 1
    if top == levels.shape[0] or not math.isfinite(all_rows):
        return -1
    _taylor_matrices(A, half * 0.5**top, norm, levels[0], m)
    for level in range(top):
        _double(levels[level], levels[level + 1])
    return top


@inner
def _flow(phi: Array, tau: float, w: Array, c: Array, out: Array) -> None:
    """Advance ``w' = A w + Σ_k c_k t^k/k!`` by a time tau exactly, and shift the source c (4, n) to begin there.

    ``∫ exp((tau − t) A) t^k/k! dt = tau^(k+1) φ_{k+1}(tau A)``.
    """
    n = w.size
    t1, t2, t3, t4 = tau, tau**2, tau**3, tau**4
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += phi[0, i, j] * w[j] + t1 * phi[1, i, j] * c[0, j] + t2 * phi[2, i, j] * c[1, j]
            total += t3 * phi[3, i, j] * c[2, j] + t4 * phi[4, i, j] * c[3, j]
        out[i] = total
    for i in range(n):
        w[i] = out[i]
        c[0, i] += tau * (c[1, i] + 0.5 * tau * (c[2, i] + tau / 3.0 * c[3, i]))
        c[1, i] += tau * (c[2, i] + 0.5 * tau * c[3, i])
        c[2, i] += tau * c[3, i]


@inner
def _taylor_flow(A: Array, tau: float, w: Array, c: Array, rate: Array, new: Array) -> None:
    """Advance w by a short time as `_flow` does, but by Taylor's series without matrices; c stays."""
    n = w.size
    for i in range(n):
        rate[i] = c[0, i]
        for j in range(n):
            rate[i] += A[i, j] * w[j]
    weight = tau
    for k in range(1, 30):
        for i in range(n):
            w[i] += weight * rate[i]
            new[i] = c[k, i] if k < 4 else 0.0
            for j in range(n):
                new[i] += A[i, j] * rate[j]
        for i in range(n):
            rate[i] = new[i]
        weight *= tau / (k + 1)


@inner
def _flow_to(
    A: Array, levels: Array, top: int, half: float, ahead: float, w: Array, c: Array, out: Array, room: Array
) -> None:
    """Advance w from 0 by any time below twice ``half``: by the levels' times, and the rest by Taylor's series."""
    for i in range(w.size):
        w[i] = 0.0
    tau, left = half, ahead
    for level in range(top, -1, -1):
        if left >= tau:
            _flow(levels[level], tau, w, c, out)
            left -= tau
        tau *= 0.5
    _taylor_flow(A, left, w, c, out, room)


@inner
def _flow_over(phi: Array, half: float, w: Array, c: Array, out: Array) -> None:
    """Advance w from 0 at the begin of a step to its end."""
    for i in range(w.size):
        w[i] = 0.0
    _flow(phi, half, w, c, out)
    _flow(phi, half, w, c, out)


@inner
def _set_source(c: Array, scale: Array, first: Array, v: Array, A: Array, B: Array, h: float) -> None:
    """Set the source of `_flow` to ``first + v t + A (t/h)² + B (t/h)³``, scaled."""
    for i in range(scale.size):
        c[0, i], c[1, i] = scale[i] * first[i], scale[i] * v[i]
        c[2, i], c[3, i] = 2.0 * scale[i] * A[i] / h**2, 6.0 * scale[i] * B[i] / h**3


@inner
def _remainder(
    p: Any, t: float, dt: float, u: Array, w: Array, scale: Array, n_positions: int, F: Array, J: Array, v: Array,
    U: Array, out: Array,
) -> None:  # fmt: skip
    """Evaluate ``g(t, u + w) − g(t − dt, u)`` into out for a scaled change w, and u + w into U."""
    n = u.size
    for i in range(n):
        U[i] = u[i] + w[i] / scale[i]
    _slope(p, t, U, n_positions, out)
    for i in range(n):
        total = F[i] + dt * v[i]
        for j in range(n):
            total += J[i, j] * w[j] / scale[j]
        out[i] -= total


@inner
def _balance(J: Array, n_positions: int, floor: float, scale: Array, A: Array) -> None:
    """Balance J by ``A = S J S⁻¹``, positions scaled so that an oscillator's 1 and ω² both become ω."""
    n = scale.size
    for i in range(n):
        column = 0.0
        for j in range(n_positions, n):
            column = max(column, abs(J[j, i]))
        scale[i] = max(math.sqrt(column), floor) if i < n_positions else 1.0
    for i in range(n):
        for j in range(n):
            A[i, j] = scale[i] * J[i, j] / scale[j]


@kernel
def _march(
    p: Any, tolerance: float, clock: Array, stop: float, n_steps: int, q: Array, v_state: Array, a: Array,
    groups: IntArray, largest: Array,
    levels: Array, m: Array, x: Array, c: Array, trial: Array, evaluations: Array,
    times: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n_positions, n = q.size, x.shape[1]
    u, F, v, U, D2, D3 = x[0], x[1], x[2], x[3], x[4], x[5]
    w, error, scale, room, none = x[6], x[7], x[8], x[9], x[10]
    J, A, top = m[5], m[6], 0
    smallest = SMALLEST * times[times.size - 1]
    for done in range(n_steps):
        if cursor[0] >= times.size or clock[0] >= stop:
            return done
        t = clock[0]
        for i in range(n_positions):
            u[i] = q[i]
        for i in range(n - n_positions):
            u[n_positions + i] = v_state[i]
        begin = just_after(t)
        _slope(p, begin, u, n_positions, F)
        change, second = largest[largest.size - 2], largest[largest.size - 1]
        for i in range(n_positions):
            change = max(change, abs(F[i]))
        for i in range(n_positions, n):
            a[i - n_positions] = F[i]
            second = max(second, abs(F[i]))
        h = step_within(clock[1], stop - t)
        planned, reached = h == clock[1], t
        _linearise(p, begin, 1e-4 * h, u, n_positions, F, U, J, v, second)
        _balance(J, n_positions, 0.1 / h, scale, A)
        evaluations[0] += n + 2
        while True:
            size, reached = math.nan, stop if h == stop - t else t + h
            top = _matrix_functions(A, 0.5 * h, levels, m)
            if top >= 0:
                phi = levels[top]
                for i in range(n):
                    w[i], none[i] = 0.0, 0.0
                _set_source(c, scale, F, v, none, none, h)
                _flow(phi, 0.5 * h, w, c, room)
                _remainder(p, t + 0.5 * h, 0.5 * h, u, w, scale, n_positions, F, J, v, U, D2)
                for i in range(n):
                    error[i] = F[i] + D2[i]
                _set_source(c, scale, error, v, none, none, h)
                _flow_over(phi, 0.5 * h, w, c, room)
                _remainder(p, just_before(reached), h, u, w, scale, n_positions, F, J, v, U, D3)
                evaluations[0] += 2
                for i in range(n):
                    D2[i], D3[i] = 8.0 * D2[i] - D3[i], 2.0 * D3[i] - 8.0 * D2[i]
                _set_source(c, scale, none, none, none, D3, h)
                _flow_over(phi, 0.5 * h, error, c, room)
                _set_source(c, scale, F, v, D2, D3, h)
                _flow_over(phi, 0.5 * h, w, c, room)
                for i in range(n):
                    U[i] = u[i] + w[i] / scale[i]
                    noise = _ROUND_OFF * h * ((change + h * second) if i < n_positions else second)
                    error[i] = max(abs(error[i]) / scale[i] - noise, 0.0) if math.isfinite(error[i]) else math.nan
                for k in range(largest.size):
                    trial[k] = largest[k]
                keep_largest(groups, trial, U)
                size = scaled_error(groups, trial, error)
            factor = step_factor(size, tolerance, 4)
            if size <= tolerance:
                break
            h *= min(factor, 0.9)
            planned = True
            if not h > smallest:
                clock[1] = h
                return -done - 1
        while cursor[0] < times.size and times[cursor[0]] <= reached:
            k, ahead = cursor[0], times[cursor[0]] - t
            if times[k] < reached:
                _set_source(c, scale, F, v, D2, D3, h)
                _flow_to(A, levels, top, 0.5 * h, ahead, w, c, room, none)
                for i in range(n):
                    w[i] = u[i] + w[i] / scale[i]
            else:
                for i in range(n):
                    w[i] = U[i]
            for i in range(n_positions):
                sample_q[k, i] = w[i]
            for i in range(n - n_positions):
                sample_v[k, i] = w[n_positions + i]
            advance(p, sample_q[k], sample_v[k], 0.0, 0, n - n_positions)  # unit quaternions
            cursor[0] += 1
        for i in range(n_positions):
            q[i] = U[i]
        for i in range(n - n_positions):
            v_state[i] = U[n_positions + i]
        advance(p, q, v_state, 0.0, 0, n - n_positions)
        clock[0] = reached
        if planned:  # else a breakpoint cut the step short
            clock[1] = h * factor
        keep_largest(groups, largest, U)
        largest[largest.size - 2], largest[largest.size - 1] = change, second
    return n_steps

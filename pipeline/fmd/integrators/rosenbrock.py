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
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.stepping import MOST_HALVED_STEPS, RATE_ROUND_OFF, ROSENBROCK_NUDGE, TICKS
from fmd.dynamics.system import System, accelerations, velocities
from fmd.integrators.adaptive import AdaptiveIntegrator
from fmd.integrators.adaptive_march import (
    AdaptiveMarch,
    begin_step,
    end_step,
    sample_step,
    set_trial,
    try_step,
)
from fmd.integrators.phi_functions import fill_phi_functions
from fmd.integrators.protocol import Integrator
from fmd.integrators.step_control import just_after, just_before, scaled_error
from fmd.kernels.arrays import clear
from fmd.kernels.kernel import inner
from fmd.kernels.table import Table, aligned


@dataclass(frozen=True)
class ExponentialRosenbrock(AdaptiveIntegrator):
    """Exponential Rosenbrock method of order 4 that chooses its steps by a relative ``tolerance`` of each."""

    tolerance: float = 1e-6
    most_steps: float = math.inf

    name = "exponential-rosenbrock"
    n_own = 2  # the largest of all rates and accelerations, for round-off

    def order(self, system: System) -> int:
        """Return 4."""
        return 4

    @classmethod
    def ladders(cls, explicit: Sequence[float], coarse: Sequence[float]) -> Iterator[Sequence[Integrator]]:
        """Yield the method with nine tolerances."""
        yield [cls(10.0**-k) for k in range(2, 11)]

    def room(self, system: System) -> _RosenbrockSteps:
        """Make room for a step of a system."""
        return make_room(system.n_positions + system.n)


@dataclass(frozen=True)
class _RosenbrockSteps(Table):
    """Room for a step of the method."""

    levels: Array  # (MOST_HALVED_STEPS, 5, n, n): φ₀ … φ₄ of A, for half of the step in the end, and half of that below
    matrices: Array  # (5, n, n): room for powers
    J: Array  # (n, n): derivatives of F, and the same balanced
    A: Array
    c: Array  # (4, n): source of the linear equation, by powers of the time
    marks: Array  # (2,): largest rate and acceleration of all coordinates so far, which round-off is relative to
    top: IntArray  # (1,): number of the level for half of the step
    F: Array  # (n,): time derivatives at the step's begin, and their derivative by time
    dt: Array
    D2: Array  # the remainder at the stages, and then its coefficients over the step
    D3: Array
    w: Array  # scaled change and error, and the scales
    error: Array
    scale: Array
    room: Array
    none: Array  # zeros


def make_room(n: int) -> _RosenbrockSteps:
    """Make room for a step with n positions and rates together."""
    levels, c, matrices = np.empty((MOST_HALVED_STEPS, 5, n, n)), np.zeros((4, n)), np.empty((5, n, n))
    J, A, marks, top = np.empty((n, n)), np.empty((n, n)), np.zeros(2), np.zeros(1, dtype=np.int64)
    return _RosenbrockSteps(levels, matrices, J, A, c, marks, top, *aligned(*9 * [n]))


@inner
def _slope(p: Any, t: float, u: Array, n_positions: int, F: Array) -> None:
    """Evaluate the time derivatives ``F(t, u)`` of positions and rates together, into F."""
    velocities(p, u[:n_positions], u[n_positions:], F[:n_positions])
    accelerations(p, t, u[:n_positions], u[n_positions:], F[n_positions:])


@inner
def _linearise(m: _RosenbrockSteps, p: Any, t: float, dt: float, u: Array, n_positions: int) -> None:
    """Differentiate F by u and by t, by finite differences.

    Entries that may be round-off alone are set to 0: a coordinate at rest would take them for errors of its own.
    """
    n, nudged, second = u.size, m.room, m.marks[1]
    for j in range(n):
        keep = u[j]
        u[j] = keep + ROSENBROCK_NUDGE * max(1.0, abs(keep))
        _slope(p, t, u, n_positions, nudged)
        nudge = u[j] - keep  # as it was stored
        u[j] = keep
        for i in range(n):
            change = nudged[i] - m.F[i]
            noise = RATE_ROUND_OFF * second if i >= n_positions else 0.0
            m.J[i, j] = change / nudge if abs(change) > noise else 0.0
    later = t + dt
    _slope(p, later, u, n_positions, nudged)
    for i in range(n):
        change = nudged[i] - m.F[i]
        m.dt[i] = change / (later - t) if abs(change) > RATE_ROUND_OFF * second else 0.0


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
    """Advance w by a short time as `_flow` does, but by Taylor's series without matrices; c stays.

    Its terms ``w⁽ᵏ⁾ tau^k/k!`` are small; the derivatives alone overflow where A is large.
    """
    n, weight = w.size, 1.0
    for i in range(n):
        rate[i] = c[0, i]
        for j in range(n):
            rate[i] += A[i, j] * w[j]
    for i in range(n):
        rate[i] *= tau
    for k in range(1, 30):
        weight *= tau / k
        for i in range(n):
            w[i] += rate[i]
            new[i] = weight * c[k, i] if k < 4 else 0.0
            for j in range(n):
                new[i] += A[i, j] * rate[j]
        for i in range(n):
            rate[i] = new[i] * (tau / (k + 1))


@inner
def _flow_to(m: _RosenbrockSteps, half: float, ahead: float) -> None:
    """Advance w from 0 by any time below twice ``half``: by the levels' times, and the rest by Taylor's series."""
    clear(m.w)
    tau, left = half, ahead
    for level in range(m.top[0], -1, -1):
        if left >= tau:
            _flow(m.levels[level], tau, m.w, m.c, m.room)
            left -= tau
        tau *= 0.5
    _taylor_flow(m.A, left, m.w, m.c, m.room, m.none)


@inner
def _flow_over(m: _RosenbrockSteps, phi: Array, half: float, w: Array) -> None:
    """Advance w from 0 at the begin of a step to its end."""
    clear(w)
    _flow(phi, half, w, m.c, m.room)
    _flow(phi, half, w, m.c, m.room)


@inner
def _set_source(m: _RosenbrockSteps, first: Array, v: Array, A: Array, B: Array, h: float) -> None:
    """Set the source of `_flow` to ``first + v t + A (t/h)² + B (t/h)³``, scaled."""
    c, scale = m.c, m.scale
    for i in range(scale.size):
        c[0, i], c[1, i] = scale[i] * first[i], scale[i] * v[i]
        c[2, i], c[3, i] = 2.0 * scale[i] * A[i] / h**2, 6.0 * scale[i] * B[i] / h**3


@inner
def _remainder(m: _RosenbrockSteps, p: Any, s: AdaptiveMarch, t: float, dt: float, out: Array) -> None:
    """Evaluate ``g(t, u + w) − g(t − dt, u)`` into out for the scaled change w; the system is solved once."""
    n = out.size
    for i in range(n):
        s.new[i] = s.begin[i] + m.w[i] / m.scale[i]
    _slope(p, t, s.new, s.q.size, out)
    s.evaluations[0] += 1
    for i in range(n):
        total = m.F[i] + dt * m.dt[i]
        for j in range(n):
            total += m.J[i, j] * m.w[j] / m.scale[j]
        out[i] -= total


@inner
def _balance(m: _RosenbrockSteps, n_positions: int, floor: float) -> None:
    """Balance J by ``A = S J S⁻¹``, positions scaled so that an oscillator's 1 and ω² both become ω."""
    n, scale = m.scale.size, m.scale
    for i in range(n):
        column = 0.0
        for j in range(n_positions, n):
            column = max(column, abs(m.J[j, i]))
        scale[i] = max(math.sqrt(column), floor) if i < n_positions else 1.0
    for i in range(n):
        for j in range(n):
            m.A[i, j] = scale[i] * m.J[i, j] / scale[j]


@begin_step.register(_RosenbrockSteps)
def _begin_step(m: _RosenbrockSteps, p: Any, s: AdaptiveMarch, t: float, h: float) -> None:
    """Linearise the equations of motion."""
    n, n_positions, start = s.begin.size, s.q.size, just_after(t)
    _slope(p, start, s.begin, n_positions, m.F)
    for k in range(2):
        m.marks[k] = s.largest[s.largest.size - 2 + k]
    for i in range(n):
        k = 0 if i < n_positions else 1
        m.marks[k] = max(m.marks[k], abs(m.F[i]))
    for k in range(s.balance.size):
        m.marks[1] = max(m.marks[1], s.balance[k])
    dt = max(1e-4 * h, TICKS * (np.nextafter(start, math.inf) - start))
    _linearise(m, p, start, dt, s.begin, n_positions)
    _balance(m, n_positions, 0.1 / h)
    s.evaluations[0] += n + 2


@try_step.register(_RosenbrockSteps)
def _try_step(m: _RosenbrockSteps, p: Any, s: AdaptiveMarch, t: float, h: float, reached: float) -> float:
    n, n_positions, change, second = s.begin.size, s.q.size, m.marks[0], m.marks[1]
    top = fill_phi_functions(m.A, 0.5 * h, m.levels, m.matrices)
    if top < 0:
        return math.nan
    m.top[0], phi = top, m.levels[top]
    for i in range(n):
        m.w[i], m.none[i] = 0.0, 0.0
    _set_source(m, m.F, m.dt, m.none, m.none, h)
    _flow(phi, 0.5 * h, m.w, m.c, m.room)
    _remainder(m, p, s, t + 0.5 * h, 0.5 * h, m.D2)
    for i in range(n):
        m.error[i] = m.F[i] + m.D2[i]
    _set_source(m, m.error, m.dt, m.none, m.none, h)
    _flow_over(m, phi, 0.5 * h, m.w)
    _remainder(m, p, s, just_before(reached), h, m.D3)
    for i in range(n):
        m.D2[i], m.D3[i] = 8.0 * m.D2[i] - m.D3[i], 2.0 * m.D3[i] - 8.0 * m.D2[i]
    _set_source(m, m.none, m.none, m.none, m.D3, h)
    _flow_over(m, phi, 0.5 * h, m.error)
    _set_source(m, m.F, m.dt, m.D2, m.D3, h)
    _flow_over(m, phi, 0.5 * h, m.w)
    for i in range(n):
        s.new[i] = s.begin[i] + m.w[i] / m.scale[i]
        noise = RATE_ROUND_OFF * h * ((change + h * second) if i < n_positions else second)
        error = abs(m.error[i]) / m.scale[i] - noise
        m.error[i] = max(error, 0.0) if math.isfinite(m.error[i]) else math.nan
    set_trial(s)
    return scaled_error(s.groups, s.trial, s.balance, m.error, n_positions, h)


@sample_step.register(_RosenbrockSteps)
def _sample_step(m: _RosenbrockSteps, p: Any, s: AdaptiveMarch, ahead: float, h: float) -> None:
    """Solve the linearised equations, with the remainder's polynomial, up to a time within the step."""
    _set_source(m, m.F, m.dt, m.D2, m.D3, h)
    _flow_to(m, 0.5 * h, ahead)
    for i in range(s.out.size):
        s.out[i] = s.begin[i] + m.w[i] / m.scale[i]


@end_step.register(_RosenbrockSteps)
def _end_step(m: _RosenbrockSteps, p: Any, s: AdaptiveMarch) -> None:
    for i in range(s.a.size):
        s.a[i] = m.F[s.q.size + i]
    for k in range(2):
        s.largest[s.largest.size - 2 + k] = m.marks[k]

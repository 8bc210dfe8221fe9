"""Reversible sub-cycling: a method with two step lengths that stays stable under inertial coupling.

With the slow coordinates L first, and ``D = M_LL⁻¹ M_LS`` frozen over a major cycle ``H = m h``, the sum
``y = q_L + D q_S`` feels no inertial coupling::

    M_LL ÿ = Q_L        S̄ q̈_S = Q_S − Dᵀ Q_L        S̄ = M_SS − M_SL D

The second row is the fast coordinates' with the slow ones free to react at once: nothing that oscillates fast is
frozen. What couples y and q_S is stiffness and damping alone, and that is treated reversibly: y drifts ½H and is frozen
at the cycle's middle, q_S takes m leapfrog steps h (½h drift, kick, ½h drift) with ``q_L = y − D q_S``, and y's rate
takes the impulse ``H a_y`` of the force at the mean of q_S at the cycle's two ends before y drifts on.

M̂ and Q̂ are solved once a cycle at its middle, predicted: y by its rate, q_S by half of its last change, and the
tangents of Q̂ carry the forces on within the cycle. With ``T = (−D, 1)`` they are needed along T alone, for the
predicted slow rates ``v_L + ½H a_y`` are those of the frozen y at the predicted fast rates::

    Q(q_S, v_S) = Q* − K T (q_S − q*_S) − C T (v_S − v*_S)

For constant M and K the map of the modes ω_i of (S̄, TᵀKT) has the characteristic equation, z = λ + 1/λ,

    det[(z − 2) M_LL/H² + K_LL − Σ w_i w_iᵀ (1 − c_i)/(2 ω_i²) (z + 2)/(z − 2 c_i)] = 0,   c_i = cos(2m asin(ω_i h/2))

whose pole terms grow with z; all its roots are in [−2, 2], and |λ| = 1, exactly if ``ω_max(S̄, TᵀKT) h < 2`` and
``ω_max(M_LL, K_LL) H < 2``, whatever the coupling. The order is 2.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.system import System, advance, freeze_middle, project, reacting_steps, slow_response
from fmd.integrators.fixed_step import (
    FixedMarch,
    FixedStepIntegrator,
    begin_cycle,
    end_cycle,
    runs_away,
    sample_within,
    take_steps,
)
from fmd.integrators.march_tables import Samples
from fmd.integrators.protocol import (
    State,
    Trajectory,
    require_ratio,
    start_state,
)
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.table import Table, aligned


@dataclass(frozen=True)
class ReversibleSubcycling(FixedStepIntegrator):
    """Reversible sub-cycling by a fast step [s] and a number of fast steps to a major cycle.

    A state's rates are at its own time; ``a`` holds the accelerations of y and q_S, ``memory`` the last change of q_S,
    (n,), and D, (n, n_slow).
    """

    step: float
    substeps: int = field()  # none by default

    name = "reversible-sub-cycling"
    start_evaluations = 2

    def __post_init__(self) -> None:
        require_ratio(self.step, self.substeps)

    def order(self, system: System) -> int:
        """Return 2."""
        return 2

    def largest_step(self, system: System) -> float:
        """Return the longest step that slow coordinates, and fast ones with the slow free to react, allow [s]."""
        return min(system.largest_reacting_step, system.largest_slow_step / self.substeps)

    def load_cycle(self, system: System) -> int:
        """Return the steps of a cycle, over which loads are frozen."""
        return self.substeps

    def fast_frequency(self, system: System) -> float:
        """Return the highest angular frequency of the fast coordinates with the slow ones free to react [rad/s]."""
        return system.highest_reacting_frequency if self.substeps > 1 else system.highest_frequency

    def start(self, system: System, q0: Array, v0: Array) -> State:
        """Return the state at time 0 with accelerations of y and q_S."""
        n, n_slow = system.n, system.n_slow
        start = start_state(system, q0, v0, np.zeros(n))
        D = np.zeros((n, n_slow))
        _freeze(system.parameters, 0.0, start.q, start.v, D, system.middle(self.substeps * self.step))
        start.a[:n_slow] += start.a @ D
        move = self.substeps * self.step * start.v
        return replace(start, memory=np.concatenate([move, D.ravel()]))

    def describe(self, times: Array, q: Array, v: Array, end: State, n_steps: int, seconds: float) -> Trajectory:
        """Return the trajectory of a march with so many fast steps."""
        m = self.substeps
        return Trajectory(self.name, self.step, m, times, q, v, n_steps // m, n_steps, seconds, end)

    def fixed_march(self, system: System) -> FixedMarch:
        """Return what a system is marched with."""
        h, m, n, n_slow = self.step, self.substeps, system.n, system.n_slow

        def make(state: State) -> _ReactingSteps:
            move, D = state.memory[:n], state.memory[n:].reshape(n, n_slow)
            room = aligned(system.n_positions, n, n, n)
            return _ReactingSteps(h, m, n_slow, state.q, state.v, state.a, move, D, *room)

        return FixedMarch(self.name, make, system, system.middle(m * h), h, m)


@kernel
def _freeze(p: Any, t: float, q: Array, v: Array, D: Array, middle: Any) -> None:
    freeze_middle(p, t, q, v, D, middle)


@dataclass(frozen=True)
class _ReactingSteps(Table):
    """State of a march; fast coordinates are scalars, number i at position ``i + q.size - v.size``."""

    h: float  # fast step [s]
    substeps: int
    n_slow: int
    q: Array
    v: Array
    a: Array
    move: Array  # (n,): change of the fast positions over the last cycle
    D: Array  # (n, n_slow): how the slow coordinates follow the fast ones, as `freeze_middle` gives it
    q_now: Array  # room: the middle's state or a sample's begin, and changes of the slow positions
    v_now: Array
    shift: Array
    before: Array  # (n,): rates of ``y = q_L + D q_S`` and fast positions at the cycle's begin


@begin_cycle.register(_ReactingSteps)
def _begin_cycle(m: _ReactingSteps, p: Any, middle: Any, first: int, sampled: bool) -> None:
    """Freeze the equations in the middle, predicted with the D of the last cycle, and y from here on."""
    n, n_slow, H, offset = m.v.size, m.n_slow, m.substeps * m.h, m.q.size - m.v.size
    for i in range(m.q.size):
        m.q_now[i] = m.q[i]
    for i in range(n_slow):
        m.shift[i] = 0.5 * H * m.v[i]
        m.v_now[i] = m.v[i] + 0.5 * H * m.a[i]
    for j in range(n_slow, n):
        m.before[j] = m.q[j + offset]
        m.q_now[j + offset] += 0.5 * m.move[j]
        m.v_now[j] = m.v[j]
        for i in range(n_slow):
            m.shift[i] += 0.5 * m.D[j, i] * (H * m.v[j] - m.move[j])
    advance(p, m.q_now, m.shift, 1.0, 0, n_slow)
    project(p, (first + 0.5 * m.substeps) * m.h, m.q_now, m.v_now)
    freeze_middle(p, (first + 0.5 * m.substeps) * m.h, m.q_now, m.v_now, m.D, middle)
    for i in range(n_slow):
        m.before[i] = m.v[i]
    for j in range(n_slow, n):
        for i in range(n_slow):
            m.before[i] += m.D[j, i] * m.v[j]
        m.q[j + offset] += 0.5 * m.h * m.v[j]


@take_steps.register(_ReactingSteps)
def _take_steps(m: _ReactingSteps, p: Any, middle: Any, first: int, done: int, count: int, sampled: bool) -> int:
    if sampled:
        offset = m.q.size - m.v.size
        for j in range(m.n_slow, m.v.size):
            m.v_now[j] = m.v[j]
            m.q_now[j + offset] = m.q[j + offset] - 0.5 * m.h * m.v[j] if done else m.before[j]
    reacting_steps(p, middle, first + done, m.h, count, m.q, m.v, m.a)
    return 0 if runs_away(m.v) else count


@sample_within.register(_ReactingSteps)
def _sample_within(m: _ReactingSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    """Evaluate the fast coordinates; the slow ones are known at the cycle's end."""
    offset = q.size - v.size
    for j in range(m.n_slow, v.size):  # Taylor's polynomial, which the next step continues
        v[j] = m.v_now[j] + s * m.a[j]
        q[j + offset] = m.q_now[j + offset] + s * (m.v_now[j] + 0.5 * s * m.a[j])


@end_cycle.register(_ReactingSteps)
def _end_cycle(m: _ReactingSteps, p: Any, middle: Any, first: int, samples: Samples, first_sample: int) -> None:
    """Take the slow step."""
    n, n_slow, H, offset = m.v.size, m.n_slow, m.substeps * m.h, m.q.size - m.v.size
    for j in range(n_slow, n):
        m.q[j + offset] -= 0.5 * m.h * m.v[j]
        m.move[j] = m.q[j + offset] - m.before[j]
        m.q_now[j], m.v_now[j] = m.before[j] + 0.5 * m.move[j], m.move[j] / H
    slow_response(p, middle, first, m.h, m.substeps, m.q_now, m.v_now, m.a)
    for k in range(first_sample, samples.cursor[0]):
        _sample_slow(m, p, (samples.step[k] - first) * m.h + samples.offset[k], samples.q[k], samples.v[k])
    for i in range(n_slow):
        m.shift[i] = H * (m.before[i] + 0.5 * H * m.a[i])
        m.v[i] = m.before[i] + H * m.a[i]
        for j in range(n_slow, n):
            m.shift[i] -= m.D[j, i] * m.move[j]
            m.v[i] -= m.D[j, i] * m.v[j]
    advance(p, m.q, m.shift, 1.0, 0, n_slow)
    project(p, (first + m.substeps) * m.h, m.q, m.v)


@inner
def _sample_slow(m: _ReactingSteps, p: Any, s: float, q: Array, v: Array) -> None:
    """Evaluate the slow coordinates a time s after the cycle's begin, where the fast ones are known."""
    n, n_slow, offset = v.size, m.n_slow, q.size - v.size
    for i in range(n_slow):
        m.shift[i] = s * (m.before[i] + 0.5 * s * m.a[i])
        v[i] = m.before[i] + s * m.a[i]
        for j in range(n_slow, n):
            m.shift[i] -= m.D[j, i] * (q[j + offset] - m.before[j])
            v[i] -= m.D[j, i] * v[j]
    for i in range(n_slow + offset):
        q[i] = m.q[i]
    advance(p, q, m.shift, 1.0, 0, n_slow)

"""Reversible sub-cycling: a method with two step lengths that stays stable under inertial coupling.

With the slow coordinates L first, and ``D = M_LL⁻¹ M_LS`` held over a major cycle ``H = m h``, the sum
``y = q_L + D q_S`` feels no inertial coupling::

    M_LL ÿ = Q_L        S̄ q̈_S = Q_S − Dᵀ Q_L        S̄ = M_SS − M_SL D

The second row is the fast coordinates' with the slow ones free to react at once: nothing that oscillates fast is held.
What couples y and q_S is stiffness and damping alone, and that is treated reversibly: y drifts ½H and is held at the
cycle's middle, q_S takes m leapfrog steps h (½h drift, kick, ½h drift) with ``q_L = y − D q_S``, and y's rate takes the
impulse ``H a_y`` of the force at the mean of q_S at the cycle's two ends before y drifts on.

M̂ and Q̂ are solved once a cycle at its middle, predicted: y by its rate, q_S by half of its last change, and the
tangents of Q̂ carry the forces on within the cycle. With ``T = (−D, 1)`` they are needed along T alone, for the
predicted slow rates ``v_L + ½H a_y`` are those of the held y at the predicted fast rates::

    Q(q_S, v_S) = Q* − K T (q_S − q*_S) − C T (v_S − v*_S)

For constant M and K the map of the modes ω_i of (S̄, TᵀKT) has the characteristic equation, z = λ + 1/λ,

    det[(z − 2) M_LL/H² + K_LL − Σ w_i w_iᵀ (1 − c_i)/(2 ω_i²) (z + 2)/(z − 2 c_i)] = 0,   c_i = cos(2m asin(ω_i h/2))

whose pole terms grow with z; all its roots are in [−2, 2], and |λ| = 1, exactly if ``ω_max(S̄, TᵀKT) h < 2`` and
``ω_max(M_LL, K_LL) H < 2``, whatever the coupling. The order is 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.compiled import aligned, kernel
from pipeline.dynamics.system import System, advance, hold_middle, reacting_steps, slow_response
from pipeline.integrators.fixed_step import march_fixed_steps, runs_away
from pipeline.integrators.protocol import (
    Progress,
    State,
    Trajectory,
    march_from,
    require_ratio,
    start_state,
)


@dataclass(frozen=True)
class ReversibleSubcycling:
    """Reversible sub-cycling by a fast step [s] and a number of fast steps to a major cycle.

    A state's rates are at its own time; ``a`` holds the accelerations of y and q_S, ``memory`` the last change of q_S,
    (n,), and D, (n, n_slow).
    """

    step: float
    substeps: int

    name = "reversible-sub-cycling"

    def __post_init__(self) -> None:
        require_ratio(self.step, self.substeps)

    def order(self, system: System) -> int:
        """Return 2."""
        return 2

    def largest_step(self, system: System) -> float:
        """Return the step at which slow coordinates, or fast ones with the slow free to react, reach ``2/ω`` [s]."""
        return min(2.0 / system.highest_reacting_frequency, 2.0 / (self.substeps * system.highest_slow_frequency))

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the major cycle that holds the last of ``times`` is complete."""
        n, n_slow = system.n, system.n_slow
        start = start_state(system, q0, v0, np.zeros(n))
        D = np.zeros((n, n_slow))
        _hold(system.parameters, 0.0, start.q, start.v, D, system.middle(self.substeps * self.step))
        start.a[:n_slow] += start.a @ D
        move = self.substeps * self.step * start.v
        start = replace(start, memory=np.concatenate([move, D.ravel()]))
        return march_from(self, system, start, times, progress, evaluations=2)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN."""
        parameters, middle, n, n_slow = (
            system.parameters,
            system.middle(self.substeps * self.step),
            system.n,
            system.n_slow,
        )
        h, m = self.step, self.substeps
        q_now, v_now, shift, before = aligned(system.n_positions, n, n, n)

        def run(state: State, n_steps: int, *samples: Any) -> int:
            move, D = state.memory[:n], state.memory[n:].reshape(n, n_slow)
            march = (n_slow, h, m, state.step, n_steps // m, state.q, state.v, state.a, move, D)
            return m * int(_march(parameters, middle, *march, q_now, v_now, shift, before, *samples))

        end, q, v, seconds = march_fixed_steps(run, start, h, m, times, progress)
        n_steps = end.step - start.step
        return Trajectory(self.name, h, m, times, q, v, n_steps // m, n_steps, seconds, end)


@kernel
def _hold(p: Any, t: float, q: Array, v: Array, D: Array, middle: Any) -> None:
    hold_middle(p, t, q, v, D, middle)


@kernel
def _march(
    p: Any, middle: Any, n_slow: int, h: float, m: int, first: int, n_cycles: int, q: Array, v: Array, a: Array,
    move: Array, D: Array, q_now: Array, v_now: Array, shift: Array, before: Array,
    sample_step: IntArray, sample_offset: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n, H = v.size, m * h
    offset = q.size - n  # fast coordinates are scalars: number i is position i + offset
    next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
    for cycle in range(n_cycles):
        start = first + cycle * m
        # The middle, predicted with the D of the last cycle.
        for i in range(q.size):
            q_now[i] = q[i]
        for i in range(n_slow):
            shift[i] = 0.5 * H * v[i]
            v_now[i] = v[i] + 0.5 * H * a[i]
        for j in range(n_slow, n):
            before[j] = q[j + offset]
            q_now[j + offset] += 0.5 * move[j]
            v_now[j] = v[j]
            for i in range(n_slow):
                shift[i] += 0.5 * D[j, i] * (H * v[j] - move[j])
        advance(p, q_now, shift, 1.0, 0, n_slow)
        hold_middle(p, (start + 0.5 * m) * h, q_now, v_now, D, middle)
        # The fast coordinates, with y held.
        for i in range(n_slow):
            before[i] = v[i]  # y's rate
        for j in range(n_slow, n):
            for i in range(n_slow):
                before[i] += D[j, i] * v[j]
            q[j + offset] += 0.5 * h * v[j]
        done, first_sample = 0, cursor[0]
        while done < m:
            count, until_sample = m - done, next_sample - start - done
            if until_sample == 0:
                count = 1
                for j in range(n_slow, n):
                    v_now[j] = v[j]
                    q_now[j + offset] = q[j + offset] - 0.5 * h * v[j] if done else before[j]
            elif 0 < until_sample < count:
                count = until_sample
            reacting_steps(p, middle, start + done, h, count, q, v, a)
            while start + done == next_sample:
                s = sample_offset[cursor[0]]
                for j in range(n_slow, n):  # Taylor's polynomial, which the next step continues
                    sample_v[cursor[0], j] = v_now[j] + s * a[j]
                    sample_q[cursor[0], j + offset] = q_now[j + offset] + s * (v_now[j] + 0.5 * s * a[j])
                cursor[0] += 1
                next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
            done += count
        # The slow ones.
        for j in range(n_slow, n):
            q[j + offset] -= 0.5 * h * v[j]
            move[j] = q[j + offset] - before[j]
            q_now[j], v_now[j] = before[j] + 0.5 * move[j], move[j] / H
        slow_response(p, middle, start, h, m, q_now, v_now, a)
        for k in range(first_sample, cursor[0]):
            s = (sample_step[k] - start) * h + sample_offset[k]
            for i in range(n_slow):
                shift[i] = s * (before[i] + 0.5 * s * a[i])
                sample_v[k, i] = before[i] + s * a[i]
                for j in range(n_slow, n):
                    shift[i] -= D[j, i] * (sample_q[k, j + offset] - before[j])
                    sample_v[k, i] -= D[j, i] * sample_v[k, j]
            for i in range(n_slow + offset):
                sample_q[k, i] = q[i]
            advance(p, sample_q[k], shift, 1.0, 0, n_slow)
        for i in range(n_slow):
            shift[i] = H * (before[i] + 0.5 * H * a[i])
            v[i] = before[i] + H * a[i]
            for j in range(n_slow, n):
                shift[i] -= D[j, i] * move[j]
                v[i] -= D[j, i] * v[j]
        advance(p, q, shift, 1.0, 0, n_slow)
        if runs_away(v):
            return cycle
    return n_cycles

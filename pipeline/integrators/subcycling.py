"""Sub-cycled central difference method of Miao, Zhu, Shi & Chen, Comput Mech 41 (2008), eqs. (8)–(11).

At the start of a major cycle of length ``H = m h`` both sets are solved together, ``M̂ a = Q̂``. The slow coordinates
then take one step H; the fast ones take m steps h, the first with that acceleration, the others with
``a_S = M_SS⁻¹ (Q_S − K_S q_S − M_SL a_L)``. Over the cycle M̂ and a_L are held (the "instantaneous structure"). A
mechanism holds the tangents of Q̂ by the fast coordinates and rates, and lets Q̂ change with its loads and with the slow
motion: a force held for a cycle would lag behind the mode that makes it and damp it at first order in H.

m = 1 is central difference, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.compiled import aligned, kernel
from pipeline.dynamics.system import System, accelerations, advance, fast_steps, hold_slow
from pipeline.integrators.central_difference import CentralDifference
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
class Subcycling:
    """Sub-cycling by a fast step [s] and a number of fast steps to a major cycle.

    Where slow and fast coordinates couple through the mass matrix, the slow acceleration held over the cycle makes
    the method weakly unstable; joint-conforming modes remove the coupling in the reference state.
    """

    step: float
    substeps: int

    name = "sub-cycling"

    def __post_init__(self) -> None:
        require_ratio(self.step, self.substeps)

    def order(self, system: System) -> int:
        """Return 2, or 1 if a cycle holds slow accelerations that couple with the fast coordinates."""
        return 1 if self.substeps > 1 and system.coupled else 2

    def largest_step(self, system: System) -> float:
        """Return the step at which fast or slow coordinates reach ``2/ω_max`` by their own steps [s]; all if m = 1."""
        if self.substeps == 1:
            return 2.0 / system.highest_frequency
        return min(2.0 / system.highest_fast_frequency, 2.0 / (self.substeps * system.highest_slow_frequency))

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the major cycle that holds the last of ``times`` is complete."""
        lag = np.full(system.n, 0.5 * self.step)
        lag[: system.n_slow] *= self.substeps
        return march_from(self, system, start_state(system, q0, v0, lag), times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN."""
        if self.substeps == 1:
            return replace(CentralDifference(self.step).resume(system, start, times, progress), integrator=self.name)
        parameters, frozen, n_slow, h, m = (
            system.parameters,
            system.frozen(self.step * self.substeps),
            system.n_slow,
            self.step,
            self.substeps,
        )
        q_now, v_now = aligned(system.n_positions, system.n)

        def run(state: State, n_steps: int, *samples: Any) -> int:
            march = (n_slow, h, m, state.step, n_steps // m, state.q, state.v, state.a)
            return m * int(_march(parameters, frozen, *march, q_now, v_now, *samples))

        end, q, v, seconds = march_fixed_steps(run, start, h, m, times, progress)
        n_steps = end.step - start.step
        return Trajectory(self.name, h, m, times, q, v, n_steps // m, n_steps - n_steps // m, seconds, end)


@kernel
def _march(
    p: Any, frozen: Any, n_slow: int, h: float, m: int, first: int, n_cycles: int, q: Array, v: Array, a: Array,
    q_now: Array, v_now: Array,
    sample_step: IntArray, sample_offset: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n, H = v.size, m * h
    offset = q.size - n  # fast coordinates are scalars: number i is position i + offset
    next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
    for cycle in range(n_cycles):
        start = first + cycle * m
        for i in range(n_slow):
            v_now[i] = v[i] + 0.5 * H * a[i]
        for i in range(n_slow, n):
            v_now[i] = v[i] + 0.5 * h * a[i]
        if start <= next_sample < start + m:
            for i in range(q.size):
                q_now[i] = q[i]
        accelerations(p, start * h, q, v_now, a)
        hold_slow(p, start * h, q, v_now, a, frozen)
        for i in range(n_slow):
            v[i] += H * a[i]
        advance(p, q, v, H, 0, n_slow)
        for i in range(n_slow, n):
            v[i] += h * a[i]
            q[i + offset] += h * v[i]
        done = 1
        while True:
            while start + done - 1 == next_sample:
                s = sample_offset[cursor[0]]
                s_slow, place = s + (done - 1) * h, sample_q[cursor[0]]
                for i in range(q.size):
                    place[i] = q_now[i]
                for i in range(n):  # Taylor's polynomial, which the next step continues
                    step, ahead = (H, s_slow) if i < n_slow else (h, s)
                    v_now[i] = v[i] - 0.5 * step * a[i] + 0.5 * ahead * a[i]
                    sample_v[cursor[0], i] = v_now[i] + 0.5 * ahead * a[i]
                advance(p, place, v_now, s_slow, 0, n_slow)
                advance(p, place, v_now, s, n_slow, n)
                cursor[0] += 1
                next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
            if done == m:
                break
            count, until_sample = m - done, next_sample - start - done
            if until_sample == 0:
                count = 1
                for i in range(n_slow, n):
                    q_now[i + offset] = q[i + offset]
            elif 0 < until_sample < count:
                count = until_sample
            fast_steps(p, frozen, start + done, h, count, q, v, a)
            done += count
        if runs_away(v):
            return cycle
    return n_cycles

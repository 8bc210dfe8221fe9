"""Sub-cycled central difference: Miao, Zhu, Shi & Chen, Comput Mech 41 (2008), eqs. (8)–(11).

At the start of a major cycle of length ``H = m h`` both sets are solved together, ``M̂ a = Q̂``. The slow coordinates
then take one step H; the fast ones take m steps h, the first with the acceleration just found, the others with
``a_S = M_SS⁻¹ (Q_S − K_S q_S − M_SL a_L)``. Over the cycle M̂ and a_L are held (the "instantaneous structure"). Of the
velocity-dependent terms the rotor holds the coefficients, θ̇² D and 2 θ̇ A, and lets them change at the rate known at
the start: a force held for a cycle would lag behind the mode that makes it and damp it at first order in H.

m = 1 is central difference, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.checks import Array, IntArray
from pipeline.dynamics.compiled import aligned, inner, kernel
from pipeline.dynamics.system import System, accelerations, advance, fast_steps, freeze
from pipeline.integrators.protocol import (
    Progress,
    State,
    Trajectory,
    march_from,
    march_in_chunks,
    require_ratio,
    runs_away,
    start_state,
)


@dataclass(frozen=True)
class Subcycling:
    """Sub-cycling with the fast step [s] and the number of fast steps to a major cycle.

    Where slow and fast coordinates couple through the mass matrix, the slow acceleration held over the cycle makes
    the method weakly unstable; joint-conforming modes remove the coupling in the reference state.
    """

    step: float
    substeps: int

    name = "sub-cycling"

    def __post_init__(self) -> None:
        require_ratio(self.step, self.substeps)

    def order(self, system: System) -> int:
        """Order 2; 1 if the cycle holds forces, or a slow acceleration that couples with the fast coordinates."""
        return 1 if self.substeps > 1 and (system.holds_forces or system.coupled) else 2

    def largest_step(self, system: System) -> float:
        """``2/ω_max`` of the fast and of the slow coordinates [s], each by its own step; of all if m = 1."""
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
        parameters, frozen, n_slow, h, m = (
            system.parameters,
            system.frozen(),
            system.n_slow,
            self.step,
            self.substeps,
        )
        sizes = (system.n_positions, system.n)
        room: list[Any] = aligned(*sizes, *2 * (*sizes, system.n), 1)

        def run(state: State, n_steps: int, *samples: Any) -> int:
            march = (n_slow, h, m, state.step, n_steps // m, state.q, state.v, state.a)
            return m * int(_march(parameters, frozen, *march, *room, *samples))

        end, q, v, seconds = march_in_chunks(run, start, h, m, times, progress)
        n_steps = end.step - start.step
        fast = n_steps - n_steps // m + int(room[-1][0])
        return Trajectory(self.name, h, m, times, q, v, n_steps // m, fast, seconds, end)


@kernel
def _march(
    p: Any, frozen: Any, n_slow: int, h: float, m: int, first: int, n_cycles: int, q: Array, v: Array, a: Array,
    q_now: Array, v_now: Array, first_q: Array, first_v: Array, first_a: Array,
    again_q: Array, again_v: Array, again_a: Array, again: Array,
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
        sampled = start <= next_sample < start + m
        if sampled:
            for i in range(q.size):
                q_now[i] = q[i]
        accelerations(p, start * h, q, v_now, a)
        freeze(p, start * h, q, v_now, a, frozen)
        for i in range(n_slow):
            v[i] += H * a[i]
        advance(p, q, v, H, 0, n_slow)
        for i in range(n_slow, n):
            v[i] += h * a[i]
            q[i + offset] += h * v[i]
        if sampled:
            _copy(q, v, a, first_q, first_v, first_a)
        if m > 1:
            fast_steps(p, frozen, start + 1, h, m - 1, q, v, a)
        while start <= next_sample < start + m:
            # What a sample needs is marched once more from the cycle's first step on: were the fast steps cut where it
            # lies instead, the motion itself would depend on it by round-off.
            s, k = sample_offset[cursor[0]], next_sample - start
            s_slow, place = s + k * h, sample_q[cursor[0]]
            _copy(first_q, first_v, first_a, again_q, again_v, again_a)
            for i in range(q.size):
                place[i] = q_now[i]
            again[0] += k
            taken = 0
            while taken < k:  # all but the last at once, which leaves the positions before it
                for i in range(n_slow, n):
                    place[i + offset] = again_q[i + offset]
                count = max(1, k - 1 - taken)
                _fast_again(p, frozen, start + 1 + taken, h, count, again_q, again_v, again_a)
                taken += count
            for i in range(n):  # Taylor's polynomial, which the next step continues
                step, ahead = (H, s_slow) if i < n_slow else (h, s)
                v_now[i] = again_v[i] - 0.5 * step * again_a[i] + 0.5 * ahead * again_a[i]
                sample_v[cursor[0], i] = v_now[i] + 0.5 * ahead * again_a[i]
            advance(p, place, v_now, s_slow, 0, n_slow)
            advance(p, place, v_now, s, n_slow, n)
            cursor[0] += 1
            next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
        if runs_away(v):
            return cycle
    return n_cycles


@inner
def _copy(q: Array, v: Array, a: Array, to_q: Array, to_v: Array, to_a: Array) -> None:
    for i in range(q.size):
        to_q[i] = q[i]
    for i in range(v.size):
        to_v[i], to_a[i] = v[i], a[i]


@inner
def _fast_again(p: Any, frozen: Any, first: int, h: float, count: int, q: Array, v: Array, a: Array) -> None:
    """Call `fast_steps` for samples: a function of its own, which is compiled once."""
    fast_steps(p, frozen, first, h, count, q, v, a)

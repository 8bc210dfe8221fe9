"""Central difference method in leapfrog form: ``v_{n+½} = v_{n−½} + h a_n``, ``q_{n+1} = q_n + h v_{n+½}``.

Velocity-dependent forces take ``v_n ≈ v_{n−½} + ½ h a_{n−1}``, which keeps the method explicit and of second order.
Stable for ω_max h < 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.compiled import aligned, kernel
from pipeline.dynamics.system import System, advance, leapfrog_step
from pipeline.integrators.fixed_step import march_fixed_steps, runs_away
from pipeline.integrators.protocol import (
    Progress,
    State,
    Trajectory,
    march_from,
    require_step,
    start_state,
)


@dataclass(frozen=True)
class CentralDifference:
    """Central difference method with a constant step [s]: explicit, of order 2."""

    step: float

    name = "central-difference"

    def __post_init__(self) -> None:
        require_step(self.step)

    def order(self, system: System) -> int:
        """Return 2."""
        return 2

    def largest_step(self, system: System) -> float:
        """Return ``2/ω_max`` of the coupled system [s]."""
        return 2.0 / system.highest_frequency

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 to the last of ``times``."""
        start = start_state(system, q0, v0, np.full(system.n, 0.5 * self.step))
        return march_from(self, system, start, times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN."""
        parameters, leapfrog, h = system.parameters, system.leapfrog(), self.step
        q_now, v_now = aligned(system.n_positions, system.n)

        def run(state: State, n_steps: int, *samples: Any) -> int:
            march = (parameters, leapfrog, h, state.step, n_steps, state.q, state.v, state.a)
            return int(_march(*march, q_now, v_now, *samples))

        end, q, v, seconds = march_fixed_steps(run, start, h, 1, times, progress)
        return Trajectory(self.name, h, 1, times, q, v, end.step - start.step, 0, seconds, end)


@kernel
def _march(
    p: Any, leapfrog: Any, h: float, first: int, n_steps: int, q: Array, v: Array, a: Array, q_now: Array, v_now: Array,
    sample_step: IntArray, sample_offset: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n = v.size
    next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
    for k in range(n_steps):
        sampled = first + k == next_sample
        if sampled:
            for i in range(q.size):
                q_now[i] = q[i]
        leapfrog_step(p, leapfrog, (first + k) * h, h, q, v, a)
        while first + k == next_sample:
            s = sample_offset[cursor[0]]
            for i in range(n):  # Taylor's polynomial, which the next step continues
                v_now[i] = v[i] - 0.5 * h * a[i] + 0.5 * s * a[i]
                sample_v[cursor[0], i] = v_now[i] + 0.5 * s * a[i]
            for i in range(q.size):
                sample_q[cursor[0], i] = q_now[i]
            advance(p, sample_q[cursor[0]], v_now, s, 0, n)
            cursor[0] += 1
            next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
        if runs_away(v):
            return k
    return n_steps

"""Sub-cycled central difference: Miao, Zhu, Shi & Chen, Comput Mech 41 (2008), eqs. (8)–(11).

At the start of a major cycle of length ``H = m h`` both sets are solved together, ``M̂ a = Q̂``. The slow coordinates
then take one step H; the fast ones take m steps h, the first with the acceleration just found, the others with
``a_S = M_SS⁻¹ (Q_S − K_S q_S − M_SL a_L)``. Over the cycle M̂, a_L and the coefficients of the velocity-dependent
terms are held (the "instantaneous structure"): it is the coefficients that are held, θ̇² D and 2 θ̇ A, and not the
forces, since a force held for a cycle lags behind the mode that makes it and damps it at first order in H.

m = 1 is central difference, bit for bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.checks import Array, IntArray
from pipeline.dynamics.compiled import kernel
from pipeline.dynamics.system import System, accelerations, fast_steps, freeze
from pipeline.integrators.protocol import Progress, State, Trajectory, march_in_chunks, runs_away, start_state


@dataclass(frozen=True)
class Subcycling:
    """Sub-cycling with the fast step [s] and the number of fast steps to a major cycle.

    The declared order holds where slow and fast coordinates don't couple through the mass matrix in the reference
    state (joint-conforming modes); otherwise the slow acceleration held over the cycle makes it of first order, and
    weakly unstable.
    """

    step: float
    substeps: int

    name = "sub-cycling"
    order = 2

    def __post_init__(self) -> None:
        if self.substeps < 1:
            raise ValueError(f"substeps is {self.substeps}, expected at least 1")

    def largest_step(self, system: System) -> float:
        """``2/ω_max`` of the fast coordinates [s], and of the coupled system if every step is a common one."""
        return 2.0 / (system.highest_frequency if self.substeps == 1 else system.highest_fast_frequency)

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the major cycle that holds the last of ``times`` is complete."""
        lag = np.full(system.n, 0.5 * self.step)
        lag[: system.n_slow] *= self.substeps
        return self.resume(system, start_state(system, q0, v0, lag), times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay empty."""
        parameters, frozen, n_slow, h, m = (
            system.parameters,
            system.frozen(),
            system.n_slow,
            self.step,
            self.substeps,
        )
        work = np.empty(system.n), np.empty(system.n)

        def run(state: State, n_steps: int, *samples: Any) -> int:
            march = (n_slow, h, m, state.step, n_steps // m, state.q, state.v, state.a)
            return m * int(_march(parameters, frozen, *march, *work, *samples))

        end, q, v, seconds = march_in_chunks(run, start, h, m, times, progress)
        n_steps = end.step - start.step
        return Trajectory(self.name, h, m, times, q, v, n_steps // m + 1, n_steps - n_steps // m, seconds, end)


@kernel
def _march(
    p: Any, frozen: Any, n_slow: int, h: float, m: int, first: int, n_cycles: int, q: Array, v: Array, a: Array,
    q_now: Array, v_now: Array,
    sample_step: IntArray, sample_offset: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n, H = q.size, m * h
    next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
    for cycle in range(n_cycles):
        start = first + cycle * m
        for i in range(n):
            v_now[i] = v[i] + 0.5 * (H if i < n_slow else h) * a[i]
            q_now[i] = q[i]
        accelerations(p, start * h, q, v_now, a)
        for i in range(n):
            v_now[i] = v[i] + 0.5 * (H if i < n_slow else h) * a[i]
        freeze(p, start * h, q, v_now, a, frozen)
        for i in range(n):
            step = H if i < n_slow else h
            v[i] += step * a[i]
            q[i] += step * v[i]
        done = 1
        while True:
            while start + done - 1 == next_sample:  # the fast coordinates have just left this step
                s = sample_offset[cursor[0]]
                for i in range(n):
                    if i == n_slow:
                        s = sample_offset[cursor[0]]
                    elif i == 0:
                        s = sample_offset[cursor[0]] + (done - 1) * h
                    sample_q[cursor[0], i] = q_now[i] + s * (v_now[i] + 0.5 * s * a[i])
                    sample_v[cursor[0], i] = v_now[i] + s * a[i]
                cursor[0] += 1
                next_sample = sample_step[cursor[0]] if cursor[0] < sample_step.size else -1
            if done == m:
                break
            ahead = next_sample - start - done
            sampled = ahead == 0
            if sampled:
                count = 1
                for i in range(n_slow, n):
                    q_now[i] = q[i]
            else:
                count = m - done if ahead < 0 else min(m - done, ahead)
            fast_steps(p, frozen, start + done, h, count, q, v, a)
            if sampled:
                for i in range(n_slow, n):
                    v_now[i] = v[i] - 0.5 * h * a[i]
            done += count
        if runs_away(v):
            return cycle
    return n_cycles

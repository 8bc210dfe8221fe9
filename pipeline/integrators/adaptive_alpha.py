"""Generalised-α with a step that follows the error.

The local error of a step is taken from the change of the acceleration over it, ``h² (β − 1/6)(a_{n+1} − a_n)``: what the
method's own positions miss of Taylor's third-order term (Zienkiewicz & Xie, Earthquake Eng Struct Dyn 20, 1991).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.checks import Array, IntArray
from pipeline.dynamics.compiled import kernel
from pipeline.dynamics.system import System
from pipeline.integrators.adaptive import (
    adaptive_state,
    groups_of,
    keep_largest,
    march_adaptively,
    scaled_error,
    step_factor,
)
from pipeline.integrators.generalized_alpha import (
    GeneralizedAlpha,
    accept_step,
    newton_room,
    newton_step,
    sample_step_at,
    two_accelerations,
)
from pipeline.integrators.protocol import Progress, State, Trajectory, start_state

# Changing the step costs a new tangent: a step that could be longer by less than this stays as it is.
_WORTH = 1.5


@dataclass(frozen=True)
class AdaptiveGeneralizedAlpha:
    """Generalised-α that chooses its steps.

    Parameters
    ----------
    tolerance : float
        Relative error of each step.
    rho : float
        Spectral radius at infinite frequency, 0 … 1.
    """

    tolerance: float = 1e-6
    rho: float = 0.8

    name = "generalized-alpha"
    step = 0.0

    def __post_init__(self) -> None:
        if not 3e-14 <= self.tolerance < 1.0:
            raise ValueError(f"tolerance is {self.tolerance}, expected 3e-14 … 1")
        GeneralizedAlpha(1.0, self.rho)  # checks rho

    @cached_property
    def weights(self) -> Array:
        """α_m, α_f, β and γ, shape (4,)."""
        return GeneralizedAlpha(1.0, self.rho).weights

    def order(self, system: System) -> int:
        """Order 2."""
        return 2

    def largest_step(self, system: System) -> float:
        """No limit: the step follows the error."""
        return math.inf

    def march(self, system: System, q0: Array, v0: Array, times: Array, progress: Progress | None = None) -> Trajectory:
        """Integrate from time 0 until the last of ``times`` is passed."""
        start = two_accelerations(adaptive_state(system, start_state(system, q0, v0, np.zeros(system.n))))
        groups = groups_of(system)[: system.n_positions]
        largest = np.zeros(int(groups.max(initial=-1)) + 1)
        keep_largest(groups, largest, start.q)
        start = replace(start, memory=np.concatenate([start.memory, largest]))
        trajectory = self.resume(system, start, times, progress)
        return replace(trajectory, evaluations=trajectory.evaluations + 1)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        StabilityError
            The step became too small.
        """
        p, groups, room = system.parameters, groups_of(system)[: system.n_positions], newton_room(system)
        error = np.zeros((2, system.n_positions))

        def run(state: State, clock: Array, stop: float, n_steps: int, *samples: Any) -> int:
            march = (self.tolerance, clock, stop, n_steps, state.q, state.v, state.a, groups, error)
            return int(_march(p, self.weights, *room, state.memory, *march, *samples))

        end, q, v, seconds = march_adaptively(run, start, system.breakpoints, times, progress)
        n_steps = end.step - start.step
        mean = (end.time - start.time) / n_steps if n_steps else 0.0
        return Trajectory(self.name, mean, 1, times, q, v, int(room[-1][0]), 0, seconds, end)


@kernel
def _march(
    p: Any, weights: Array, work: Array, positions: Array, counts: Array, memory: Array,
    tolerance: float, clock: Array, stop: float, n_steps: int, q: Array, v: Array, a: Array,
    groups: IntArray, error: Array,
    times: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n, new, shift = v.size, work[0], q.size - v.size
    largest = memory[n * n + 1 :]
    last = times[times.size - 1]
    for done in range(n_steps):
        if cursor[0] >= times.size or clock[0] >= stop:
            return done
        t = clock[0]
        h = min(clock[1], stop - t)
        planned = h == clock[1]
        while True:
            if not h > 1e-14 * max(abs(t), last):
                clock[1] = h
                return -done - 1
            factor = 0.25
            if newton_step(p, weights, work, positions, counts, memory, t, h, q, v, a):
                for i in range(q.size):  # a quaternion's components move by half the angle at most
                    error[0, i] = 0.0
                for i in range(n):
                    change = h * h * abs(weights[2] - 1.0 / 6.0) * abs(new[i] - a[n + i])
                    at = max(i + shift, 0)
                    error[0, at] = max(error[0, at], change)
                size = scaled_error(groups, largest, positions[0], error[0])
                factor = step_factor(size, tolerance, 3)
                if size <= tolerance:
                    break
            h *= min(factor, 0.9)
            planned = True
            memory[n * n] = 0.0
        while cursor[0] < times.size and times[cursor[0]] <= t + h:
            k = cursor[0]
            sample_step_at(p, times[k] - t, h, q, v, a, new, work[2], sample_q[k], sample_v[k])
            cursor[0] += 1
        accept_step(weights, q, v, a, new, positions[0], work[3])
        keep_largest(groups, largest, q)
        clock[0] = stop if h == stop - t else t + h
        if planned:
            clock[1] = h * factor if factor > _WORTH or factor < 1.0 else h
        if clock[1] != h:
            memory[n * n] = 0.0
    return n_steps

"""Generalised-α with a step that follows the error.

The local error of a step is taken from the change of the acceleration over it: what the method's own positions miss of
Taylor's third-order term, ``h² (β + ½ Δ − 1/6)(q̈_{n+1} − q̈_n)``, where the auxiliary acceleration is ``Δ = α_m − α_f``
of a step ahead of the true one (Zienkiewicz & Xie, Earthquake Eng Struct Dyn 20, 1991, for Newmark's method with
Δ = 0). A change of the step changes how far that is (Brüls & Arnold, J Comput Nonlinear Dyn 3, 2008).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.dynamics.jit.compiled import kernel
from pipeline.dynamics.system import System, accelerations
from pipeline.integrators.adaptive import (
    SMALLEST,
    adaptive_state,
    groups_of,
    just_after,
    just_before,
    keep_largest,
    march_adaptively,
    scaled_error,
    step_factor,
    step_within,
)
from pipeline.integrators.generalized_alpha import (
    TOLERANCE,
    GeneralizedAlpha,
    accept_step,
    newton_room,
    newton_step,
    sample_step_at,
    two_accelerations,
)
from pipeline.integrators.protocol import Progress, State, Trajectory, march_from, require_tolerance, start_state

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
        require_tolerance(self.tolerance)
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
        groups = groups_of(system)
        largest = np.zeros(int(groups.max(initial=-1)) + 1)
        keep_largest(groups[: system.n_positions], largest, start.q)
        start = replace(start, memory=np.concatenate([start.memory, largest, [start.next_step]]))
        return march_from(self, system, start, times, progress)

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        StabilityError
            The step became too small.
        """
        p, groups, room = system.parameters, groups_of(system), newton_room(system)
        n_positions = system.n_positions
        # A rate's error is that of the positions it moves, which are of the same group; those of the rates come after.
        like = groups[n_positions:] - groups[:n_positions].max(initial=-1) - 1
        if n_positions > system.n and getattr(system, "groups", None) is None:
            like[:] = 0
        error, trial = np.zeros(system.n), np.zeros(int(groups.max(initial=-1)) + 1)

        def run(state: State, clock: Array, stop: float, n_steps: int, *samples: Any) -> int:
            march: tuple[Any, ...] = (self.tolerance, clock, stop, n_steps, state.q, state.v, state.a)
            scales: tuple[Any, ...] = (groups[:n_positions], like, error, trial)
            return int(_march(p, self.weights, *room, state.memory, *march, *scales, *samples))

        return march_adaptively(self.name, run, start, system.breakpoints, times, progress, room[-1])


@kernel
def _march(
    p: Any, weights: Array, work: Array, positions: Array, counts: Array, memory: Array,
    tolerance: float, clock: Array, stop: float, n_steps: int, q: Array, v: Array, a: Array,
    groups: IntArray, like: IntArray, error: Array, trial: Array,
    times: Array, sample_q: Array, sample_v: Array, cursor: IntArray,
) -> int:  # fmt: skip
    n, new = v.size, work[0]
    largest, last = memory[n * n + 2 : memory.size - 1], memory.size - 1
    missing = abs(weights[2] + 0.5 * (weights[0] - weights[1]) - 1.0 / 6.0)
    smallest = SMALLEST * times[times.size - 1]
    for done in range(n_steps):
        if cursor[0] >= times.size or clock[0] >= stop:
            return done
        t = clock[0]
        h = step_within(clock[1], stop - t)
        planned, reached = h == clock[1], t
        while True:
            if h != memory[last]:
                for i in range(n):
                    a[i] = a[n + i] + (a[i] - a[n + i]) * (h / memory[last])
                memory[last], memory[n * n] = h, 0.0
            reached = stop if h == stop - t else t + h
            size = math.nan
            if newton_step(p, weights, work, positions, counts, memory, just_before(reached), h, q, v, a):
                acceleration = 0.0
                for i in range(n):
                    acceleration = max(acceleration, abs(new[i]))
                for i in range(n):
                    noise = TOLERANCE * acceleration
                    error[i] = h * h * max(missing * abs(new[i] - a[n + i]) - noise, 0.0)
                for k in range(largest.size):
                    trial[k] = largest[k]
                keep_largest(groups, trial, positions[0])
                size = scaled_error(like, trial, error)
            factor = step_factor(size, tolerance, 3)
            if size <= tolerance:
                break
            h *= min(factor, 0.9)
            planned = True
            if not h > smallest:
                clock[1] = h
                return -done - 1
        while cursor[0] < times.size and times[cursor[0]] <= reached:
            k = cursor[0]
            if times[k] < reached:
                sample_step_at(p, times[k] - t, h, q, v, a, new, work[2], sample_q[k], sample_v[k])
            else:
                for i in range(q.size):
                    sample_q[k, i] = positions[0, i]
                for i in range(n):
                    sample_v[k, i] = work[3, i]
            cursor[0] += 1
        accept_step(weights, q, v, a, new, positions[0], work[3])
        keep_largest(groups, largest, q)
        clock[0] = reached
        if reached == stop:  # accelerations may jump
            accelerations(p, just_after(stop), q, v, new)
            counts[0] += 1
            for i in range(n):
                a[i], a[n + i] = new[i], new[i]
        if planned:
            clock[1] = h * factor if factor > _WORTH or factor < 1.0 else h
    return n_steps

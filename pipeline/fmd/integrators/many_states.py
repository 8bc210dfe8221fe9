"""Slopes at many states by one call of a kernel, which may be those of systems that differ in numbers alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.system import System, accelerations, velocities
from fmd.kernels.kernel import kernel


def state_slopes(system: System, times: Array, states: Array) -> Array:
    """Return the time derivatives of positions and rates at many states, shape (n_states, n_positions + n).

    Behind positions and rates each state may have the numbers of a system of its own, see `numbers_in`; times in s.
    """
    parts = np.split(states, [system.n_positions, system.n_positions + system.n], axis=1)
    q, v, numbers = (np.ascontiguousarray(part) for part in parts)
    p, dq, a = system.parameters, np.zeros(q.shape), np.zeros(v.shape)
    own = numbers_in(p, numbers.shape[1])
    evaluate_states(p, own, np.ascontiguousarray(times, dtype=float), q, v, numbers, dq, a)
    return np.concatenate([dq, a], axis=1)


def numbers_in(p: Any, count: int) -> Array:
    """Return the place of a system's numbers in its parameters: springs, rests and dampers of joints.

    Systems of one structure differ in these alone. So one of them stands for all in kernels that take many states, each
    with the numbers of its own system behind it. Without numbers there is no place.
    """
    return p.inputs[p.inputs.size - count :] if count else np.zeros(0)


@kernel
def evaluate_states(p: Any, own: Array, times: Array, q: Array, v: Array, numbers: Array, dq: Array, a: Array) -> None:
    """Evaluate the time derivatives of a mechanism's positions and rates at many states, a row each.

    The numbers of a state are first put in their place ``own`` in the parameters.
    """
    for k in range(times.size):
        for i in range(own.size):
            own[i] = numbers[k, i]
        velocities(p, q[k], v[k], dq[k])
        accelerations(p, times[k], q[k], v[k], a[k])

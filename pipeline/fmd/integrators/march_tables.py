"""Tables of a march beside its method: output times, and states from which marches start one after the other."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.system import System, accelerations, velocities
from fmd.integrators.protocol import State
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.table import Table


@dataclass(frozen=True)
class Samples(Table):
    """Output times of a march, and the states there."""

    times: Array  # (n_times,) [s]
    step: IntArray  # (n_times,): number of the step that each time is in
    offset: Array  # (n_times,): time since that step's begin [s]
    q: Array  # (n_times, n_positions) and (n_times, n): positions and rates, NaN as long as they aren't known
    v: Array
    contacts: Array  # (n_times, n_values): values of contacts; none without contacts
    cursor: IntArray  # (1,): how many are known


@dataclass(frozen=True)
class Starts(Table):
    """States from which marches start, one after the other."""

    first: IntArray  # (n_marches,): number of the first step of each
    done: IntArray  # (n_marches,): how many steps each has taken before it ran away
    q: Array  # this and the next 3: the arrays of the state that the method's table writes into
    v: Array
    a: Array
    memory: Array
    numbers: Array  # (n_numbers,): the place of the system's numbers, if each march has its own
    # (n_marches, n_values + n_numbers): `State.values` of each, at its start and then at its end; behind them its
    # numbers
    values: Array
    # (n_marches, n_times, n_positions) and (n_marches, n_times, n): positions and rates of each at the output times, if
    # there are any
    sampled_q: Array
    sampled_v: Array


@cache
def no_starts() -> Starts:
    """Return the starts of a march that goes on from the state in its method's table."""
    nothing, none = np.zeros(0), np.zeros((0, 0, 0))
    first = np.zeros(0, dtype=np.int64)
    return Starts(first, first, nothing, nothing, nothing, nothing, nothing, np.zeros((0, 0)), none, none)


def make_starts(state: State, values: Array, first: IntArray, times: Array, p: Any) -> Starts:
    """Make the starts of marches from many `State.values`, which write into a state's arrays, with room for samples.

    Numbers behind the values are put in their place in a system's parameters.
    """
    found, done = np.array(values, order="C"), np.zeros(len(values), dtype=np.int64)
    q, v = (np.full((len(values), times.size, size), np.nan) for size in (state.q.size, state.v.size))
    numbers = numbers_in(p, found.shape[1] - state.values.size)
    return Starts(first, done, *state.arrays, numbers, found, q, v)


@inner
def take_values(x: Array, values: Array, first: int) -> int:
    """Copy an array from its place in a state's values, and return the place behind it."""
    for i in range(x.size):
        x[i] = values[first + i]
    return first + x.size


@inner
def keep_values(x: Array, values: Array, first: int) -> int:
    """Copy an array to its place in a state's values, and return the place behind it."""
    for i in range(x.size):
        values[first + i] = x[i]
    return first + x.size


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

"""Loop and step control of the methods whose step follows the error.

A coordinate's error counts relative to the largest value that its group, coordinates of like kind, has had so far.
The steps depend neither on the output times nor on how the march is cut into pieces; the last one may pass the last
output time, so that a march which starts from the end state continues bit for bit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import StabilityError
from pipeline.dynamics.jit.compiled import inner, kernel
from pipeline.dynamics.system import System
from pipeline.integrators.protocol import Progress, State, Trajectory, require_times, start_state

Run = Callable[[State, Array, float, int, Array, Array, Array, IntArray], int]

_FLOOR = 1e-12  # a group that has not moved yet
SMALLEST = 1e-12  # of the duration
_FIRST_CHUNK, _CHUNK = 4, 256  # steps: few where one takes long, so that progress is told in between
_CHUNK_SECONDS = 0.1
_SAFETY = 0.9


def groups_of(system: System) -> IntArray:
    """Return the group of each position and then of each rate; each coordinate is one if the system has no groups."""
    groups = getattr(system, "groups", None)
    positions, rates = (np.arange(system.n_positions), np.arange(system.n)) if groups is None else groups
    return np.concatenate([positions, rates + positions.max(initial=-1) + 1])


def adaptive_start(system: System, q0: Array, v0: Array, more: int = 0) -> State:
    """Return the state at time 0 of an adaptive method, its first step a tenth of the highest frequency's radian.

    The memory is the largest value of each group, and ``more`` numbers of the method's own.
    """
    start, groups = start_state(system, q0, v0, np.zeros(system.n)), groups_of(system)
    largest = np.zeros(int(groups.max(initial=-1)) + 1 + more)
    keep_largest(groups, largest, np.concatenate([start.q, start.v]))
    highest = system.highest_frequency if system.n else 1.0
    return replace(start, next_step=0.1 / highest if highest > 1e-3 else 1e-2, memory=largest)


def march_adaptive_steps(
    name: str,
    run: Run,
    start: State,
    breakpoints: tuple[float, ...],
    times: Array,
    progress: Progress | None,
    evaluations: Array,
) -> Trajectory:
    """Call a compiled march that chooses its steps until it has passed the last output time.

    Parameters
    ----------
    name : str
        Name of the method.
    run : callable
        ``run(state, clock, stop, n_steps, times, sample_q, sample_v, cursor) -> steps done``; it writes into the
        state's arrays and ``clock``, (2,), the time and the next step. A negative number of steps says that the next
        step would be too small.
    evaluations : ndarray
        Its first number is raised by ``run`` for each solution of the whole system.

    Raises
    ------
    StabilityError
        The step became too small, or the state is not finite; the message gives the time.
    """
    require_times(times)
    state = start.copy()
    q, v = np.full((times.size, start.q.size), np.nan), np.full((times.size, start.v.size), np.nan)
    cursor = np.array([np.searchsorted(times, state.time)])
    clock, end, seconds = np.array([state.time, state.next_step]), float(times[-1]), 0.0
    chunk = _FIRST_CHUNK
    while cursor[0] < times.size:
        stop = next((point for point in breakpoints if point > clock[0]), math.inf)
        tick = time.perf_counter()
        done = run(state, clock, stop, chunk, times, q, v, cursor)
        spent = time.perf_counter() - tick
        seconds += spent
        chunk = max(1, min(_CHUNK, 4 * chunk, int(chunk * _CHUNK_SECONDS / max(spent, 1e-9))))
        state = replace(state, step=state.step + abs(done), time=float(clock[0]), next_step=float(clock[1]))
        if done <= 0 or not (np.isfinite(state.q).all() and np.isfinite(state.v).all()):
            finite = all(np.isfinite(x).all() for x in (state.q, state.v, state.a))
            reason = f"its step fell to {clock[1]:.1e} s" if finite else "the accelerations are not finite"
            message = f"{name} stopped at t = {clock[0]:.6g} s: {reason}"
            raise StabilityError(message, float(clock[0]), state.q)
        if progress:
            progress(min(1.0, clock[0] / end) if end else 1.0)
    n_steps = state.step - start.step
    mean = (state.time - start.time) / n_steps if n_steps else 0.0
    return Trajectory(name, mean, 1, times, q, v, int(evaluations[0]), 0, seconds, state)


@inner
def just_after(t: float) -> float:
    """Return the time at which a step that begins at t evaluates loads: after a jump at t, not before it."""
    return float(np.nextafter(t, math.inf))


@inner
def just_before(t: float) -> float:
    """Return the time at which a step that ends at t evaluates loads: before a jump at t, not after it."""
    return float(np.nextafter(t, -math.inf))


@kernel
def step_within(h: float, left: float) -> float:
    """Return a step h, what is left to the next breakpoint, or half of that if a short rest would remain."""
    if h >= left * (1.0 - 1e-9):
        return left
    return 0.5 * left if h > 0.5 * left else h


@inner
def scaled_error(groups: IntArray, largest: Array, error: Array) -> float:
    """Return the largest error over its group's largest value; NaN if an error or a value isn't finite.

    Parameters
    ----------
    groups : ndarray, shape (n,)
        Group of each error.
    largest : ndarray, shape (n_groups,)
        Largest value of each group, the end of the trial step included.
    """
    worst = 0.0
    for i in range(groups.size):
        ratio = abs(error[i]) / max(largest[groups[i]], _FLOOR)
        if not (math.isfinite(error[i]) and math.isfinite(largest[groups[i]])):
            return math.nan
        worst = max(worst, ratio)
    return worst


@kernel
def keep_largest(groups: IntArray, largest: Array, new: Array) -> None:
    """Raise each group's largest value to that of a state; a NaN stays, so that it is noticed."""
    for i in range(groups.size):
        size = abs(new[i])
        if not size <= largest[groups[i]]:
            largest[groups[i]] = size


@inner
def step_factor(error: float, tolerance: float, order: int) -> float:
    """Return the factor that takes a step with an error of this order to the tolerance, within 0.2 … 4."""
    if error == 0.0:
        return 4.0
    if not math.isfinite(error):
        return 0.2
    wanted: float = _SAFETY * (tolerance / error) ** (1.0 / order)
    return min(4.0, max(0.2, wanted))

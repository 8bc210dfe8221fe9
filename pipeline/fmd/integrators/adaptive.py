"""Loop and step control of the methods whose step follows the error.

A coordinate's error counts relative to the largest value that its group, coordinates of like kind, has had so far.
No step misses a narrow feature of a force over the elongation.
The steps depend neither on the output times nor on how the march is cut into pieces; the last one may pass the last
output time, so that a march which starts from the end state continues bit for bit.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import StabilityError
from fmd.core.limits.stepping import (
    ADAPTIVE_WINDOW,
    CHUNK,
    CHUNK_SECONDS,
    CRAWL,
    FIRST_CHUNK,
    FORGIVEN,
    HARDLY_MOVING,
    LONG_SECONDS,
    MOST_ADAPTIVE_STEPS,
    SHORT_STEP,
    SHORTEST_STEP,
    SPARE_STEPS,
    STEP_SAFETY,
    STILL_GROUP,
    TIME_JITTER,
)
from fmd.dynamics.step_bounds import StepBounds, allowed_part, predicted_part, record_step_start, step_bounds_of
from fmd.dynamics.system import System, advance, project
from fmd.integrators.endless import StepsLeft
from fmd.integrators.protocol import Progress, State, Trajectory, require_times, start_state
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.table import Table, aligned

_JITTER = TIME_JITTER * np.finfo(float).eps


def groups_of(system: System) -> IntArray:
    """Return the group of each position and then of each rate; each coordinate is one if the system has no groups."""
    groups = getattr(system, "groups", None)
    positions, rates = (np.arange(system.n_positions), np.arange(system.n)) if groups is None else groups
    return np.concatenate((positions, rates + (positions.max() + 1))) if positions.size else rates


def kinds_of(system: System) -> tuple[IntArray, int]:
    """Return the kind of each group of `groups_of`, (n_groups,), and their number; 0 if none has two groups."""
    both = getattr(system, "groups", None)
    if both is None:
        return np.zeros(0, dtype=np.int64), 0
    in_positions, in_rates = (set(groups.tolist()) for groups in both)
    if all(len({group % 3 for group in used}) == len(used) for used in (in_positions, in_rates)):
        return np.zeros(0, dtype=np.int64), 0
    numbers = [range(max(used, default=-1) + 1) for used in (in_positions, in_rates)]
    return np.array([k % 3 for k in numbers[0]] + [3 + k % 3 for k in numbers[1]], dtype=np.int64), 6


def adaptive_start(system: System, q0: Array, v0: Array, more: int = 0) -> State:
    """Return the state at time 0 of an adaptive method, its first step a tenth of the highest frequency's radian.

    The memory is the largest value of each group, and ``more`` numbers of the method's own.
    """
    start, groups = start_state(system, q0, v0, np.zeros(system.n)), groups_of(system)
    largest = np.zeros(int(groups.max(initial=-1)) + 1 + more)
    keep_largest(groups, largest, np.concatenate([start.q, start.v]))
    highest = system.highest_frequency if system.n else 1.0
    return replace(start, next_step=0.1 / highest if highest > 1e-3 else 1e-2, memory=largest)


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
        ratio = abs(error[i]) / max(largest[groups[i]], STILL_GROUP)
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
def set_trial(s: AdaptiveMarch) -> None:
    """Set ``s.trial`` to the largest values with the trial step's end.

    A group that hardly moves counts for a small part of the largest of its kind: else a far link's first nanometres
    would have to be as exact, beside themselves, as the motion of those that drive it.
    """
    for k in range(s.largest.size):
        s.trial[k] = s.largest[k]
    keep_largest(s.groups, s.trial, s.new)
    for k in range(s.most.size):
        s.most[k] = 0.0
    for k in range(s.kinds.size):
        s.most[s.kinds[k]] = max(s.most[s.kinds[k]], s.trial[k])
    for k in range(s.kinds.size):
        s.trial[k] = max(s.trial[k], HARDLY_MOVING * s.most[s.kinds[k]])


@inner
def step_factor(error: float, tolerance: float, order: int) -> float:
    """Return the factor that takes a step with an error of this order to the tolerance, within 0.2 … 4."""
    if error == 0.0:
        return 4.0
    if not math.isfinite(error):
        return 0.2
    wanted: float = STEP_SAFETY * (tolerance / error) ** (1.0 / order)
    return min(4.0, max(0.2, wanted))


@dataclass(frozen=True)
class AdaptiveMarch(Table):
    """State of a march whose step follows the error, the step that is tried, and the output.

    Attributes
    ----------
    tolerance : float
        Of each step, relative to the largest value of a coordinate's group.
    order : int
        Of the step's error.
    longest : float
        Step [s] beyond which none grows, unless nothing moves.
    settles : bool
        True if states settle after each step: loops close, or quaternions become unit ones.
    q, v, a : ndarray
        Positions, rates and accelerations.
    clock : ndarray, shape (2,)
        Present time, and the step to try next [s].
    groups : ndarray of int, shape (n_positions + n,)
        Group of each position and rate.
    kinds, most : ndarray, shapes (n_groups,) and (n_kinds,)
        Kind of each group, and room for the largest value of each kind; empty where each kind has one group.
    largest, trial : ndarray
        Largest values of the groups so far, with numbers of the method's own behind, and with the trial step's end.
    begin, new, out : ndarray, shape (n_positions + n,)
        Positions and rates at a step's begin, at its end, and at an output time.
    times, sample_q, sample_v : ndarray
        Output times [s], and positions and rates there.
    cursor : ndarray of int, shape (1,)
        How many output times are passed.
    evaluations : ndarray, shape (1,)
        How often the whole system was solved.
    fresh : ndarray, shape (1,)
        1 where the accelerations ``a`` are not those of the present state: loads jump there, none are known yet, or
        the state has settled since.
    bounds : StepBounds
        Of a step by force laws with short pieces.
    spare : ndarray, shape (1,)
        How many more of the smallest steps may be taken before the next breakpoint although their error is too large:
        where a load's rate is infinite, it is always the same part of what has moved since rest.
    """

    tolerance: float
    order: int
    longest: float
    settles: bool
    q: Array
    v: Array
    a: Array
    clock: Array
    groups: IntArray
    kinds: IntArray
    most: Array
    largest: Array
    trial: Array
    begin: Array
    new: Array
    out: Array
    times: Array
    sample_q: Array
    sample_v: Array
    cursor: IntArray
    evaluations: Array
    fresh: Array
    spare: Array
    bounds: StepBounds


@singledispatch
def begin_step(m: Any, p: Any, s: AdaptiveMarch, t: float, h: float) -> None:
    """Prepare a step from ``s.begin`` at time t [s], of which h is the first trial."""
    raise NotImplementedError


@singledispatch
def try_step(m: Any, p: Any, s: AdaptiveMarch, t: float, h: float, reached: float) -> float:
    """Take a trial step into ``s.new``; return its error over the largest values, NaN if the step is no good."""
    raise NotImplementedError


@singledispatch
def prepare_samples(m: Any, p: Any, s: AdaptiveMarch, t: float, h: float) -> None:
    """Prepare what `sample_step` needs of an accepted step."""
    raise NotImplementedError


@singledispatch
def sample_step(m: Any, p: Any, s: AdaptiveMarch, ahead: float, h: float) -> None:
    """Evaluate positions and rates a time ``ahead`` [s] after the step's begin, into ``s.out``."""
    raise NotImplementedError


@singledispatch
def end_step(m: Any, p: Any, s: AdaptiveMarch) -> None:
    """Keep accelerations, and numbers of the method's own, of an accepted step."""
    raise NotImplementedError


@kernel
def _march(m: Any, p: Any, s: AdaptiveMarch, stop: float, n_steps: int) -> int:
    """Take steps until a breakpoint ``stop`` [s] or the last output time; return how many, less than 0 if one fails."""
    n_positions, n, clock, times, cursor = s.q.size, s.v.size, s.clock, s.times, s.cursor
    smallest, short = SHORTEST_STEP * times[times.size - 1], SHORT_STEP * times[times.size - 1]
    for done in range(n_steps):
        if cursor[0] >= times.size or clock[0] >= stop:
            return done
        t = clock[0]
        for i in range(n_positions):
            s.begin[i] = s.q[i]
        for i in range(n):
            s.begin[n_positions + i] = s.v[i]
        record_step_start(s.bounds, just_after(t), s.q, s.v)
        h = step_within(max(clock[1] * predicted_part(s.bounds, clock[1]), smallest), stop - t)
        planned, reached = h >= clock[1], t
        begin_step(m, p, s, t, h)
        while True:
            reached = stop if h == stop - t else t + h
            size = try_step(m, p, s, t, h, reached)
            factor = step_factor(size, s.tolerance, s.order)
            if size <= s.tolerance or (h < short and size * h <= _JITTER * t):
                part = allowed_part(s.bounds, just_before(reached), h, s.new[:n_positions], s.new[n_positions:])
                if part == 1.0 or h <= smallest:
                    if size > s.tolerance:
                        factor = max(factor, 1.0)  # shorter ones would be no better
                    break
                h = max(h * part, smallest)
                continue
            planned = True
            if h <= smallest:
                if not (s.spare[0] > 0.0 and size < FORGIVEN):
                    clock[1] = h
                    return -done - 1
                s.spare[0], factor = s.spare[0] - 1.0, 1.0
                break
            h = max(h * min(factor, 0.9), smallest)
        if cursor[0] < times.size and times[cursor[0]] <= reached:
            prepare_samples(m, p, s, t, h)
        while cursor[0] < times.size and times[cursor[0]] <= reached:
            k = cursor[0]
            if times[k] < reached:
                sample_step(m, p, s, times[k] - t, h)
            for i in range(n_positions + n):  # at the end the state itself, which a polynomial meets but for round-off
                s.out[i] = s.out[i] if times[k] < reached else s.new[i]
            _set_state(p, times[k], s.out, s.sample_q[k], s.sample_v[k])
            cursor[0] += 1
        _set_state(p, reached, s.new, s.q, s.v)
        clock[0] = reached
        if planned:  # else a breakpoint cut the step short
            clock[1] = min(h * factor, s.longest) if size > 0.0 else h * factor
        keep_largest(s.groups, s.largest, s.new)
        end_step(m, p, s)
        s.fresh[0] = 1.0 if s.settles else 0.0
    return n_steps


@inner
def _set_state(p: Any, t: float, both: Array, q: Array, v: Array) -> None:
    """Set positions, whose quaternions become unit ones, and rates; loops close."""
    for i in range(q.size):
        q[i] = both[i]
    for i in range(v.size):
        v[i] = both[q.size + i]
    advance(p, q, v, 0.0, 0, v.size)
    project(p, t, q, v)


def march_adaptive_steps(
    name: str,
    system: System,
    m: Table,
    tolerance: float,
    order: int,
    longest: float,
    start: State,
    times: Array,
    progress: Progress | None,
) -> Trajectory:
    """March by a method that chooses its steps until the last output time is passed.

    Parameters
    ----------
    name : str
        Name of the method.
    m : Table
        The method: its numbers and room to work in; `begin_step`, `try_step`, `prepare_samples`, `sample_step` and
        `end_step` are registered for it.
    tolerance, order, longest : float, int, float
        As in `AdaptiveMarch`.

    Raises
    ------
    StabilityError
        The step became too small, steps never come to an end, or the state is not finite; the message gives the time.
    AccuracyError
        Steps are short because a motion loses its inertia.
    """
    require_times(times)
    state, groups = start.copy(), groups_of(system)
    q, v = np.full((times.size, start.q.size), np.nan), np.full((times.size, start.v.size), np.nan)
    cursor, evaluations, fresh = np.array([np.searchsorted(times, state.time)]), np.zeros(1), np.zeros(1)
    first = int(cursor[0])
    clock, end, seconds = np.array([state.time, state.next_step]), float(times[-1]), 0.0
    begin, new, out, trial = aligned(*3 * [groups.size], state.memory.size)
    kinds, n_kinds = kinds_of(system)
    present = (state.q, state.v, state.a, clock, groups, kinds, np.zeros(n_kinds), state.memory)
    settles = bool(getattr(system, "settles", system.n_positions != system.n))
    output = (
        np.ascontiguousarray(times, dtype=float),
        q,
        v,
        cursor,
        evaluations,
        fresh,
        np.full(1, SPARE_STEPS),
        step_bounds_of(system),
    )
    march = AdaptiveMarch(tolerance, order, longest, settles, *present, trial, begin, new, out, *output)
    p, chunk = system.parameters, FIRST_CHUNK
    explain = getattr(system, "explain_failure", None)
    left = StepsLeft(name, end, MOST_ADAPTIVE_STEPS, ADAPTIVE_WINDOW, state.step, state.time)
    _march(m, p, march, math.inf, 0)  # compiles, or reads the kernel: not part of the run time
    while cursor[0] < times.size:
        stop = next((point for point in system.breakpoints if point > clock[0]), math.inf)
        if clock[0] in system.breakpoints:
            march.spare[0] = SPARE_STEPS
        fresh[0] = settles or clock[0] == 0.0 or clock[0] in system.breakpoints
        tick = time.perf_counter()
        done = int(_march(m, p, march, stop, chunk))
        spent = time.perf_counter() - tick
        seconds += spent
        chunk = max(1, min(CHUNK, int(chunk * CHUNK_SECONDS / max(spent, 1e-9))))
        state = replace(state, step=state.step + abs(done), time=float(clock[0]), next_step=float(clock[1]))
        if done <= 0 or not (np.isfinite(state.q).all() and np.isfinite(state.v).all()):
            finite = all(np.isfinite(x).all() for x in (state.q, state.v, state.a))
            reason = f"its step fell to {clock[1]:.1e} s" if finite else "the accelerations are not finite"
            message = f"{name} stopped at t = {clock[0]:.6g} s: {reason}"
            raise StabilityError(message, float(clock[0]), state.q)
        if spent > LONG_SECONDS and clock[1] * system.highest_frequency < CRAWL and explain is not None:
            explain(StabilityError(f"{name} takes steps of {clock[1]:.1e} s", float(clock[0]), state.q))
        left.require_end(state.step, state.time)
        if progress:
            progress(min(1.0, clock[0] / end) if end else 1.0)
    if not (np.isfinite(q[first:]).all() and np.isfinite(v[first:]).all()):
        raise StabilityError(f"{name}: what it finds between its steps isn't finite")
    n_steps = state.step - start.step
    mean = (state.time - start.time) / n_steps if n_steps else 0.0
    return Trajectory(name, mean, 1, times, q, v, int(evaluations[0]), 0, seconds, state)

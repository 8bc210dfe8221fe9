"""Loop and step control of the methods whose step follows the error.

A coordinate's error counts relative to the largest value that its group, coordinates of like kind, has had so far.
No step misses a narrow feature of a force over the elongation.
The steps depend neither on the output times nor on how the march is cut into pieces; the last one may pass the last
output time, so that a march which starts from the end state continues bit for bit.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.clock import read_clocks, seconds_since
from fmd.core.errors import StabilityError
from fmd.core.limits.contact import CHOSEN_STEP, LONGER_AFTER_CUT, MOST_CUTS
from fmd.core.limits.stepping import (
    ADAPTIVE_WINDOW,
    CHUNK,
    CHUNK_SECONDS,
    CRAWL,
    FIRST_CHUNK,
    FORGIVEN,
    LONG_SECONDS,
    MOST_ADAPTIVE_STEPS,
    SHORT_STEP,
    SHORTEST_STEP,
    SPARE_STEPS,
    TIME_JITTER,
)
from fmd.core.threads import one_thread
from fmd.dynamics.compiled_system.sampling import Sampling
from fmd.dynamics.step_bounds import allowed_part, predicted_part, record_step_start
from fmd.dynamics.system import System, is_pressed
from fmd.integrators.adaptive_march import (
    AdaptiveMarch,
    begin_step,
    end_step,
    prepare_samples,
    sample_step,
    set_state,
    try_step,
)
from fmd.integrators.endless import StepsLeft
from fmd.integrators.looks import (
    begin_contacts,
    begin_impulses,
    count_looks,
    look_at_contacts,
    note_sample,
    remember_end,
    time_of_change,
)
from fmd.integrators.protocol import (
    Progress,
    ResumableIntegrator,
    State,
    Trajectory,
    balanced_accelerations,
    require_times,
    require_tolerance,
    start_state,
)
from fmd.integrators.step_control import (
    balance_of_groups,
    groups_of,
    just_after,
    just_before,
    keep_largest,
    kinds_of,
    note_balance,
    raise_balance,
    step_factor,
    step_within,
)
from fmd.kernels.kernel import inlined, kernel
from fmd.kernels.table import Table, aligned

_JITTER = TIME_JITTER * np.finfo(float).eps


@inlined
def _sample_within(m: Any, p: Any, s: AdaptiveMarch, t: float, h: float, reached: float, n_looks: int) -> int:
    """Take the samples in a step, and return the number of the next look at contacts."""
    times, cursor, look = s.times, s.cursor, 1
    while cursor[0] < times.size and times[cursor[0]] <= reached:
        k = cursor[0]
        look = look_at_contacts(m, p, s, t, h, look, n_looks, times[k])
        if times[k] < reached:
            sample_step(m, p, s, times[k] - t, h)
        for i in range(s.out.size):  # at the end the state itself, which a polynomial meets but for round-off
            s.out[i] = s.out[i] if times[k] < reached else s.new[i]
        set_state(p, times[k], s.out, s.sample_q[k], s.sample_v[k])
        note_sample(p, s, k)
        cursor[0] += 1
    return look


@kernel
def march_steps(m: Any, p: Any, s: AdaptiveMarch, stop: float, n_steps: int) -> int:
    """Take steps until a breakpoint ``stop`` [s] or the last output time; return how many, less than 0 if one fails."""
    n_positions, n, clock, times, cursor = s.q.size, s.v.size, s.clock, s.times, s.cursor
    smallest, short = SHORTEST_STEP * times[times.size - 1], SHORT_STEP * times[times.size - 1]
    for done in range(n_steps):
        if cursor[0] >= times.size or clock[0] >= stop:
            return done
        t = clock[0]
        begin_impulses(s)
        for i in range(n_positions):
            s.begin[i] = s.q[i]
        for i in range(n):
            s.begin[n_positions + i] = s.v[i]
        record_step_start(s.bounds, just_after(t), s.q, s.v)
        if s.apart > 0.0:
            clock[1] = min(clock[1], s.longest)  # also where nothing moves yet
        h = step_within(max(clock[1] * predicted_part(s.bounds, clock[1]), smallest), stop - t)
        planned, reached = h >= clock[1], t
        begin_step(m, p, s, t, h)
        pressed, cuts = is_pressed(p, t, s.q, s.v), 0
        undone = s.pressed[1] > 0.0 and pressed == (s.pressed[0] > 0.0)  # round-off has, what the last step ended at
        s.pressed[0] = 1.0 if pressed else 0.0
        while True:
            reached = stop if h == stop - t else t + h
            size = try_step(m, p, s, t, h, reached)
            if not undone and cuts < MOST_CUTS and math.isfinite(size):
                change = time_of_change(m, p, s, t, h, pressed)
                if change < h:
                    h, planned, cuts = change, False, cuts + 1
                    continue
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
        if s.settles:
            note_balance(p, s.groups, n_positions, s.largest, s.balance)
        s.pressed[1] = cuts
        n_looks = count_looks(p, s, reached, h, pressed)
        if n_looks > 1 or (cursor[0] < times.size and times[cursor[0]] <= reached):
            prepare_samples(m, p, s, t, h)
        look = _sample_within(m, p, s, t, h, reached, n_looks)
        look_at_contacts(m, p, s, t, h, look, n_looks, reached)
        set_state(p, reached, s.new, s.q, s.v)
        remember_end(p, s, reached, h)
        clock[0] = reached
        if planned:  # else a breakpoint cut the step short
            clock[1] = min(h * factor, s.longest) if size > 0.0 else h * factor
        elif cuts > 0:
            clock[1] = min(clock[1], LONGER_AFTER_CUT * h)
        keep_largest(s.groups, s.largest, s.new)
        end_step(m, p, s)
        s.fresh[0] = 1.0 if s.settles or s.apart > 0.0 else 0.0
    return n_steps


def begin_sampling(system: Any, start: State) -> Sampling | None:
    """Return the sampled controllers of a system for a march from its begin; none if there are none.

    Raises
    ------
    ValueError
        The march goes on from another one, whose controllers' memory isn't in its state.
    """
    sampling: Sampling | None = system.sampling()
    if sampling is not None and start.time > 0.0:
        raise ValueError("a march with sampled controllers begins at time 0")
    return sampling


def begin_steps(system: System, p: Any, march: AdaptiveMarch, sampling: Sampling | None) -> float:
    """Prepare steps from the present time, at which controllers may sample; return where they end at the latest [s]."""
    now, breakpoints = float(march.clock[0]), system.breakpoints
    stop = next((point for point in breakpoints if point > now), math.inf)
    if now in breakpoints:
        march.spare[0] = SPARE_STEPS
    march.fresh[0] = march.settles or march.apart > 0.0 or now == 0.0 or now in breakpoints
    if sampling is None:
        return stop
    if now >= sampling.next:
        sampling.sample(now, march.q, march.v, p.inputs)
        march.fresh[0] = 1.0
    return min(stop, sampling.next)


def require_steps(name: str, march: AdaptiveMarch, done: int) -> None:
    """Raise ``StabilityError`` if a method of this name has taken no steps, or to a state that isn't finite."""
    if done > 0 and math.isfinite(march.q.sum() + march.v.sum()):
        return
    finite = all(np.isfinite(x).all() for x in (march.q, march.v, march.a))
    reason = f"its step fell to {march.clock[1]:.1e} s" if finite else "the accelerations are not finite"
    message = f"{name} stopped at t = {march.clock[0]:.6g} s: {reason}"
    raise StabilityError(message, float(march.clock[0]), march.q)


class AdaptiveIntegrator(ResumableIntegrator):
    """Base of the methods that choose their steps by a relative ``tolerance`` of each."""

    tolerance: float  # of each step, relative to the largest value of a coordinate's group
    most_steps: float = math.inf  # with more of them a march is ended; no number, unless another method takes over
    step = 0.0
    looks = CHOSEN_STEP  # of 2/ω with all points of contacts closed: how far apart these are looked at in a step
    n_own = 0  # length of what such a method remembers beside the largest values

    def __post_init__(self) -> None:
        require_tolerance(self.tolerance)

    def largest_step(self, system: System) -> float:
        """Return infinity: the step follows the error, which keeps it to stable ones."""
        return math.inf

    def longest_step(self, system: System) -> float:
        """Return the step beyond which none grows [s]."""
        return math.inf

    @abstractmethod
    def room(self, system: System) -> Table:
        """Return the method's table: its numbers and room to work in, for which the functions above are registered."""

    def start(self, system: System, q0: Array, v0: Array) -> State:
        """Return the state at time 0, the same for each tolerance; its first step is a tenth of the highest radian."""
        start, groups = start_state(self, system, q0, v0, np.zeros(system.n)), groups_of(system)
        held = np.zeros(int(groups.max(initial=-1)) + 1)
        largest = np.zeros(held.size + self.n_own)
        keep_largest(groups, largest, np.concatenate([start.q, start.v]))
        raise_balance(system.parameters, groups, start.q.size, largest, held)
        balanced = balance_of_groups(groups, start.q.size, balanced_accelerations(system, start))
        balance = np.maximum(balanced, held)
        highest = system.highest_frequency if system.n else 1.0
        return replace(start, next_step=0.1 / highest if highest > 1e-3 else 1e-2, memory=np.r_[balance, largest])

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN.

        Raises
        ------
        StabilityError
            The step became too small, steps never come to an end, or the state is not finite; the message gives the
            time.
        AccuracyError
            Steps are short because a motion loses its inertia.
        """
        require_times(times)
        state = start.copy()
        march, touching = self.begin(system, state, times), None
        clock, cursor, q, v = march.clock, march.cursor, march.sample_q, march.sample_v
        first, end, seconds = int(cursor[0]), float(times[-1]), 0.0
        m, p, chunk = self.room(system), system.parameters, FIRST_CHUNK
        sampling, unreported = begin_sampling(system, state), 0.0
        if system.n_contact_values:
            touching = p.contact
            own = march.balance.size + march.largest.size
            if state.memory.size > own:
                march.pressed[:] = state.memory[own : own + 2]
                touching.recall(state.memory[own + 2 :])
            begin_contacts(p, march)
            n_both, sizes = march.q.size + march.v.size, touching.unrounded_force * march.answers
            own_balance = balance_of_groups(march.groups[:n_both], march.q.size, sizes)
            march.balance[:] = np.maximum(march.balance, own_balance)
            march.new[march.q.size + march.v.size :] = touching.impulses
        left = StepsLeft(self.name, end, MOST_ADAPTIVE_STEPS, ADAPTIVE_WINDOW, state.step, state.time)
        march_steps(m, p, march, math.inf, 0)  # compiles, or reads the kernel: not part of the run time
        while cursor[0] < times.size:
            stop = begin_steps(system, p, march, sampling)
            tick = read_clocks()
            with nullcontext() if touching is None else one_thread():
                done = int(march_steps(m, p, march, stop, chunk))
            spent = seconds_since(tick)
            seconds, unreported = seconds + spent, unreported + spent
            chunk = max(1, min(CHUNK, int(chunk * CHUNK_SECONDS / max(spent, 1e-9))))
            state = replace(state, step=state.step + abs(done), time=float(clock[0]), next_step=float(clock[1]))
            if done < 0 and touching is not None and touching.lost:
                raise StabilityError(f"no forces of contact were found at t = {state.time:.6g} s: {touching.lost}")
            require_steps(self.name, march, done)
            if spent > LONG_SECONDS and clock[1] * system.highest_frequency < CRAWL:
                system.explain_failure(
                    StabilityError(f"{self.name} takes steps of {clock[1]:.1e} s", float(clock[0]), state.q)
                )
            left.require_end(state.step, state.time)
            if state.step - start.step > self.most_steps:
                raise StabilityError(f"{self.name} takes more than {self.most_steps:.3g} steps", state.time)
            if progress and (sampling is None or unreported > CHUNK_SECONDS or cursor[0] >= times.size):
                progress(min(1.0, clock[0] / end) if end else 1.0)
                unreported = 0.0
        if not (np.isfinite(q[first:]).all() and np.isfinite(v[first:]).all()):
            raise StabilityError(f"{self.name}: what it finds between its steps isn't finite")
        n_steps = state.step - start.step
        mean = (state.time - start.time) / n_steps if n_steps else 0.0
        held = None if sampling is None else sampling.record
        if touching is not None:
            state = replace(state, memory=np.r_[march.balance, march.largest, march.pressed, touching.memory])
        found = Trajectory(self.name, mean, 1, times, q, v, int(march.evaluations[0]), 0, seconds, state, held=held)
        return replace(found, contacts=march.contacts)

    def begin(self, system: System, state: State, times: Array) -> AdaptiveMarch:
        """Return a march from a state, into whose arrays it writes."""
        groups, (kinds, n_kinds) = groups_of(system), kinds_of(system)
        groups = np.concatenate([groups, np.full(3 * system.n_contacts, -1)])
        n_groups = int(groups.max(initial=-1)) + 1
        trial, begin, new, out = aligned(n_groups + self.n_own, *3 * [groups.size])
        return AdaptiveMarch(
            tolerance=self.tolerance,
            order=self.order(system),
            longest=self.longest_step(system),
            settles=system.settles,
            q=state.q,
            v=state.v,
            a=state.a,
            clock=np.array([state.time, state.next_step]),
            groups=groups,
            kinds=kinds,
            most=np.zeros(n_kinds),
            balance=state.memory[:n_groups],
            largest=state.memory[n_groups : 2 * n_groups + self.n_own],
            trial=trial,
            begin=begin,
            new=new,
            out=out,
            times=np.ascontiguousarray(times, dtype=float),
            sample_q=np.full((times.size, state.q.size), np.nan),
            sample_v=np.full((times.size, state.v.size), np.nan),
            cursor=np.array([np.searchsorted(times, state.time)]),
            evaluations=np.zeros(1),
            fresh=np.zeros(1),
            spare=np.full(1, SPARE_STEPS),
            bounds=system.step_bounds,
            apart=self.looks * system.shock_step,
            contacts=np.full((times.size, system.n_contact_values), np.nan),
            answers=system.answers_to_contact,
            pressed=np.zeros(2),
            q_within=np.zeros(state.q.size),
            v_within=np.zeros(state.v.size),
        )

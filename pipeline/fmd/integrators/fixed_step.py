"""Loop of the methods with a fixed step, and its test for divergence.

A method is a `Table` of its numbers and arrays, among them the state's ``q``, ``v`` and ``a``, for which
`begin_cycle`, `take_steps`, `sample_within` and `end_cycle` are registered. A cycle is as many steps as belong
together. Into how many calls of `take_steps` output times divide it changes no bit.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from functools import singledispatch
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.clock import read_clocks, seconds_since
from fmd.core.data_classes import dataclass
from fmd.core.errors import StabilityError
from fmd.core.limits.stepping import CYCLES_SECONDS, FIRST_CYCLES, MORE_CYCLES, RUNAWAY
from fmd.core.threads import one_thread
from fmd.dynamics.system import System, note_contacts, project
from fmd.integrators.march_tables import Samples, Starts, keep_values, make_starts, no_starts, state_slopes, take_values
from fmd.integrators.protocol import Progress, ResumableIntegrator, State, Trajectory, require_times
from fmd.integrators.work_bounds import ElongationLog, WorkCheck, note_elongations
from fmd.kernels.kernel import inlined, inner, kernel
from fmd.kernels.table import Table


class SingleSteps(Table):
    """Base of methods without sub-cycling, of which any number of steps is a cycle."""


@singledispatch
@inlined
def begin_cycle(m: Any, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    """Prepare the cycle that begins with step number ``first``; ``sampled`` tells if an output time is in it."""


@singledispatch
@inlined
def take_cycles(m: Any, p: Any, frozen: Any, first: int, count: int) -> int:
    """Take ``count`` cycles without samples from step number ``first`` on, and return how many are taken.

    Methods with a short way to it take all, or up to the one after which rates run away; the others none.
    """
    return 0


@singledispatch
def take_steps(m: Any, p: Any, frozen: Any, first: int, done: int, count: int, sampled: bool) -> int:
    """Take ``count`` steps of a cycle after ``done`` ones, and return how many before `runs_away`.

    ``sampled`` tells if output times are in the first.
    """
    raise NotImplementedError


@singledispatch
def sample_within(m: Any, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    """Evaluate the state a time s [s] after the begin of the last step, with ``done`` steps of its cycle before it."""
    raise NotImplementedError


@singledispatch
@inlined
def end_cycle(m: Any, p: Any, frozen: Any, first: int, samples: Samples, first_sample: int) -> None:
    """Complete a cycle, and its samples from number ``first_sample`` to the cursor."""


@inlined
def runs_away(v: Array) -> bool:
    """Return true if the rates are beyond bounds or not finite."""
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0  # which need not wait for each other
    whole = v.size - v.size % 4
    for i in range(0, whole, 4):
        first += abs(v[i])
        second += abs(v[i + 1])
        third += abs(v[i + 2])
        fourth += abs(v[i + 3])
    for i in range(whole, v.size):
        first += abs(v[i])
    return not (first + second) + (third + fourth) < RUNAWAY


@inner
def _march_cycles(
    m: Any, p: Any, frozen: Any, samples: Samples, log: ElongationLog, substeps: int, first: int, n_cycles: int
) -> int:
    """March some cycles from step number ``first`` on, and return how many steps are done before rates run away."""
    n_samples, cursor = samples.step.size, samples.cursor[0]
    next_sample = samples.step[cursor] if cursor < n_samples else -1
    cycle = 0
    while cycle < n_cycles:
        start, done, first_sample = first + cycle * substeps, 0, cursor
        free = n_cycles - cycle
        if next_sample >= 0:
            free = min(free, (next_sample - start) // substeps)
        if free > 0 and log.bounds.elongations == 0:
            taken = take_cycles(m, p, frozen, start, free)
            if taken > 0:
                if runs_away(m.v):
                    return (cycle + taken - 1) * substeps
                cycle += taken
                continue
        begin_cycle(m, p, frozen, start, start <= next_sample < start + substeps)
        while done < substeps:
            count, until_sample = substeps - done, next_sample - start - done
            if until_sample == 0:
                count = 1
            elif 0 < until_sample < count:
                count = until_sample
            taken = take_steps(m, p, frozen, start, done, count, until_sample == 0)
            if taken < count:
                return cycle * substeps + done + taken
            while start + done == next_sample:
                sample_within(m, p, done, samples.offset[cursor], samples.q[cursor], samples.v[cursor])
                if samples.contacts.shape[1] > 0:
                    t, values = samples.times[cursor], samples.contacts[cursor]
                    note_contacts(p, t, samples.q[cursor], samples.v[cursor], values)
                cursor += 1
                next_sample = samples.step[cursor] if cursor < n_samples else -1
            done += count
        samples.cursor[0] = cursor
        end_cycle(m, p, frozen, start, samples, first_sample)
        note_elongations(log, start + substeps, m.q, m.v)
        for k in range(first_sample, cursor):
            project(p, samples.times[k], samples.q[k], samples.v[k])
        cycle += 1
    return n_cycles * substeps


@kernel
def _march(
    m: Any,
    p: Any,
    frozen: Any,
    samples: Samples,
    log: ElongationLog,
    starts: Starts,
    substeps: int,
    first: int,
    n_cycles: int,
) -> int:
    """March some cycles from step number ``first`` on, or as many from each start whose steps done are noted there.

    Return how many steps are done before rates run away, of the last march. One kernel does both: compiling a second
    one for each method would take longer than most marches.
    """
    if starts.first.size == 0:
        return _march_cycles(m, p, frozen, samples, log, substeps, first, n_cycles)
    done = 0
    for k in range(starts.first.size):
        at = take_values(starts.q, starts.values[k], 0)
        at = take_values(starts.v, starts.values[k], at)
        at = take_values(starts.a, starts.values[k], at)
        at = take_values(starts.memory, starts.values[k], at)
        take_values(starts.numbers, starts.values[k], at)
        samples.cursor[0] = 0
        done = _march_cycles(m, p, frozen, samples, log, substeps, starts.first[k], n_cycles)
        starts.done[k] = done
        at = keep_values(starts.q, starts.values[k], 0)
        at = keep_values(starts.v, starts.values[k], at)
        at = keep_values(starts.a, starts.values[k], at)
        keep_values(starts.memory, starts.values[k], at)
        for j in range(samples.times.size):
            keep_values(samples.q[j], starts.sampled_q[k, j], 0)
            keep_values(samples.v[j], starts.sampled_v[k, j], 0)
    return done


def locate_samples(times: Array, step: float) -> tuple[IntArray, Array]:
    """Return the number of the step that each output time is in, and the time since that step's begin [s]."""
    number = np.floor(times / step * (1 + 1e-14) + 1e-9).astype(np.int64)
    offset = np.maximum(times - number * step, 0.0)
    offset[offset < 1e-9 * step] = 0.0
    return number, offset


def make_samples(state: State, times: Array, step: float) -> Samples:
    """Make room for the samples of a march from a state like this one, without contacts."""
    q, v = (np.full((times.size, size), np.nan) for size in (state.q.size, state.v.size))
    return Samples(times, *locate_samples(times, step), q, v, np.zeros((times.size, 0)), np.zeros(1, dtype=np.int64))


@dataclass(frozen=True)
class FixedMarch:
    """March of a system by a method with a fixed step."""

    name: str
    make: Callable[[State], Table]  # make the method's table for a state, into whose arrays it writes
    system: System
    frozen: Any  # Any: its storage for the method
    step: float  # fast step [s]
    substeps: int = 1  # fast steps to a major cycle, which is never divided
    origin: float = 0.0  # time of step number 0 [s]
    own_memory: int = 0  # entries of a state's memory that are the method's own; contacts' follow
    parameters: Any = None  # the system's, where the method's table has some of its arrays

    def run(
        self, start: State, times: Array, progress: Progress | None, contacts: Array | None = None
    ) -> tuple[State, Array, Array, float]:
        """March until the last output time is passed.

        The kernel is called for some steps at a time, so that progress shows and divergence is noticed early; neither
        that nor ``times`` changes the steps. ``contacts`` (n_times, n_values) are filled with values of contacts, which
        LAPACK finds with one thread: two take ten times as long.
        Returns the last state, positions and rates at the output times, and the run time of the compiled march [s].

        Raises
        ------
        StabilityError
            A rate is beyond bounds; the message gives the time and the coordinate that moves fastest then. Or steps
            missed much of what a force does over the elongation; the message has a step that works.
        """
        require_times(times)
        state, substeps = start.copy(), self.substeps
        sample_step, sample_offset = locate_samples(times, self.step)
        q, v = np.full((times.size, start.q.size), np.nan), np.full((times.size, start.v.size), np.nan)
        method, asked = self.make(state), np.ascontiguousarray(times, dtype=float)
        noted = np.zeros((times.size, 0)) if contacts is None else contacts
        cursor = np.array([np.searchsorted(sample_step, state.step)])
        samples = Samples(asked, sample_step, sample_offset, q, v, noted, cursor)
        last = -(-(int(sample_step[-1]) + 1 - state.step) // substeps) * substeps + state.step
        p = self.parameters or self.system.parameters
        check = WorkCheck(self.system, self.origin, self.step, substeps)
        touching = p.contact if self.system.n_contact_values else None
        if touching is not None and state.memory.size > self.own_memory:
            touching.recall(state.memory[self.own_memory :])
        check.begin(state.step, state.q, state.v)
        seconds, chunk, own = 0.0, substeps * FIRST_CYCLES, (method, p, self.frozen, samples, check.log, no_starts())
        _march(*own, substeps, state.step, 0)  # compiles, or reads the kernel
        while state.step < last:
            wanted = min(chunk, last - state.step, check.most_steps)
            cycle = wanted if isinstance(method, SingleSteps) and not check.follows_laws else substeps
            tick = read_clocks()
            with nullcontext() if touching is None else one_thread():
                done = int(_march(*own, cycle, state.step, wanted // cycle))
            spent = seconds_since(tick)
            seconds += spent
            state = replace(state, step=state.step + done, time=(state.step + done) * self.step)
            if touching is not None and touching.lost:
                raise StabilityError(f"no forces of contact were found at t = {state.time:.6g} s: {touching.lost}")
            if done < wanted or not np.isfinite(state.q).all():
                raise _divergence(state)
            check.add()
            share = min(MORE_CYCLES, CYCLES_SECONDS / max(spent, 1e-9))
            chunk = substeps * max(1, int(share * (wanted // substeps)))
            if progress:
                progress(state.step / last)
        check.require_little_missed(self.name)
        if touching is not None:
            memory = np.concatenate([state.memory[: self.own_memory], touching.memory])
            state = replace(state, memory=memory)
        return state, q, v, seconds


def _divergence(state: State) -> StabilityError:
    culprit = int(np.argmax(np.where(np.isfinite(state.v), np.abs(state.v), np.inf)))
    return StabilityError(
        f"the march diverged at t = {state.time:.6g} s, most in coordinate {culprit} "
        f"(rate {state.v[culprit]:.3g}); take a smaller step"
    )


class FixedStepIntegrator(ResumableIntegrator):
    """Base of explicit methods with a fixed step, which march many states with one set of tables."""

    @abstractmethod
    def fixed_march(self, system: System) -> FixedMarch:
        """Return what a system is marched with."""

    def resume(self, system: System, start: State, times: Array, progress: Progress | None = None) -> Trajectory:
        """Continue from a state that a march of this method has ended in; earlier output times stay NaN."""
        contacts = np.full((times.size, system.n_contact_values), np.nan)
        end, q, v, seconds = self.fixed_march(system).run(start, times, progress, contacts)
        return replace(self.describe(times, q, v, end, end.step - start.step, seconds), contacts=contacts)

    def lag(self, system: System) -> Array | None:
        """Return how long before a state's time its rates are (n,) [s]; None if its start takes more than that."""
        return None

    def starts(self, system: System, states: Array) -> Array:
        """Return the `State.values` at time 0 of many states, each of which may have numbers of its own behind it."""
        lag = self.lag(system)
        if lag is None:
            return super().starts(system, states)
        q, v, numbers = np.split(states, [system.n_positions, system.n_positions + system.n], axis=1)
        a = state_slopes(system, np.zeros(len(states)), states)[:, system.n_positions :]
        memory = self.start(system, q[0], v[0]).memory
        return np.concatenate([q, v - lag * a, a, np.tile(memory, (len(states), 1)), numbers], axis=1)

    def ends(self, system: System, start: State, values: Array, first: IntArray, n_cycles: int) -> Array:
        """Return the `State.values` in which marches end, as `ResumableIntegrator.ends` does, by one kernel call.

        Each march may be of a system of its own, whose numbers are behind its values, see `numbers_in`; but not where
        contacts, loops or force laws are followed.
        """
        march = self.fixed_march(system)
        check = WorkCheck(system, 0.0, march.step, march.substeps)
        remembers = check.follows_laws or system.has_loops or system.n_contact_values
        if remembers:  # what is each march's own
            return super().ends(system, start, values, first, n_cycles)
        found, _, _, done, _ = self.march_each(system, start, values, first, n_cycles, np.zeros(0))
        whole = (done == n_cycles * march.substeps) & np.isfinite(found).all(axis=1)
        if not whole.all():
            number = int(np.argmin(whole))
            at = (first[number] + done[number]) * march.step
            raise StabilityError(f"{self.name} diverges at t = {at:.6g} s; take a smaller step")
        return found

    def marches(self, system: System, states: Array, times: Array) -> list[Trajectory | None]:
        """March from many states of positions and rates at time 0 by one kernel call; those that diverge give None.

        States are (n_marches, n_positions + n + n_numbers): each may be of a system of its own, whose numbers are
        behind it, see `ends`. Output times are in s.
        """
        require_times(times)
        q0, v0, _ = np.split(states[0], [system.n_positions, system.n_positions + system.n])
        start, values, m = self.start(system, q0, v0), self.starts(system, states), self.substeps
        n_cycles = -(-(int(locate_samples(times, self.step)[0][-1]) + 1) // m)
        first, n_steps = np.zeros(len(states), dtype=np.int64), n_cycles * m
        ends, q, v, done, seconds = self.march_each(system, start, values, first, n_cycles, times)
        whole = (done == n_steps) & np.isfinite(ends).all(axis=1)
        at_end = replace(start, step=n_steps, time=n_steps * self.step)
        found = (
            self.describe(times, q[k], v[k], at_end.with_values(own[: start.values.size]), n_steps, seconds)
            for k, own in enumerate(ends)
        )
        return [
            replace(march, evaluations=march.evaluations + self.start_evaluations) if complete else None
            for march, complete in zip(found, whole, strict=True)
        ]

    @abstractmethod
    def describe(self, times: Array, q: Array, v: Array, end: State, n_steps: int, seconds: float) -> Trajectory:
        """Return the trajectory of a whole march with so many fast steps."""

    def march_each(
        self, system: System, start: State, values: Array, first: IntArray, n_cycles: int, times: Array
    ) -> tuple[Array, Array, Array, IntArray, float]:
        """March from each of many `State.values`, with what belongs to a start, and with output times if there are any.

        Returns values at the ends, positions and rates at the output times, the number of steps that each march took
        before it ran away, and run time of a march [s].
        """
        march, state, p = self.fixed_march(system), start.copy(), system.parameters
        samples, starts = make_samples(state, times, march.step), make_starts(state, values, first, times, p)
        method, log = march.make(state), WorkCheck(system, 0.0, march.step, march.substeps).log
        single = isinstance(method, SingleSteps)
        cycle, cycles = (n_cycles, 1) if single else (march.substeps, n_cycles)
        tick = read_clocks()
        _march(method, p, march.frozen, samples, log, starts, cycle, 0, cycles)
        seconds = seconds_since(tick) / len(values)
        return starts.values, starts.sampled_q, starts.sampled_v, starts.done, seconds

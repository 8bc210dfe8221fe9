"""Loop of the methods with a fixed step, and its test for divergence.

A method is a `Table` of its numbers and arrays, among them the state's ``q``, ``v`` and ``a``, for which
`begin_cycle`, `take_steps`, `sample_within` and `end_cycle` are registered. A cycle is as many steps as belong
together. Into how many calls of `take_steps` output times divide it changes no bit.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import StabilityError
from fmd.core.limits.stepping import CYCLES_SECONDS, FIRST_CYCLES, MORE_CYCLES, RUNAWAY
from fmd.dynamics.system import System, note_contacts, project
from fmd.integrators.protocol import Progress, ResumableIntegrator, State, require_times
from fmd.integrators.work_bounds import ElongationLog, WorkCheck, note_elongations
from fmd.kernels.kernel import inlined, kernel
from fmd.kernels.table import Table


@dataclass(frozen=True)
class Samples(Table):
    """Output times of a march, and the states there.

    Attributes
    ----------
    times : ndarray, shape (n_times,)
        [s]
    step : ndarray of int, shape (n_times,)
        Number of the step that each time is in.
    offset : ndarray, shape (n_times,)
        Time since that step's begin [s].
    q, v : ndarray, shapes (n_times, n_positions) and (n_times, n)
        Positions and rates, NaN as long as they aren't known.
    contacts : ndarray, shape (n_times, n_values)
        Values of contacts; none without contacts.
    cursor : ndarray of int, shape (1,)
        How many are known.
    """

    times: Array
    step: IntArray
    offset: Array
    q: Array
    v: Array
    contacts: Array
    cursor: IntArray


class SingleSteps(Table):
    """Base of methods without sub-cycling, of which any number of steps is a cycle."""


@singledispatch
def begin_cycle(m: Any, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    """Prepare the cycle that begins with step number ``first``; ``sampled`` tells if an output time is in it."""
    raise NotImplementedError


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
def end_cycle(m: Any, p: Any, frozen: Any, first: int, samples: Samples, first_sample: int) -> None:
    """Complete a cycle, and its samples from number ``first_sample`` to the cursor."""
    raise NotImplementedError


@begin_cycle.register(SingleSteps)
def _begin_nothing(m: Any, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    pass


@end_cycle.register(SingleSteps)
def _end_nothing(m: Any, p: Any, frozen: Any, first: int, samples: Samples, first_sample: int) -> None:
    pass


@inlined
def runs_away(v: Array) -> bool:
    """Return true if the rates are beyond bounds or not finite."""
    total = 0.0
    for i in range(v.size):
        total += abs(v[i])
    return not total < RUNAWAY


@kernel
def _march(
    m: Any, p: Any, frozen: Any, samples: Samples, log: ElongationLog, substeps: int, first: int, n_cycles: int
) -> int:
    """March some cycles from step number ``first`` on, and return how many steps are done before rates run away."""
    n_samples, cursor = samples.step.size, samples.cursor[0]
    next_sample = samples.step[cursor] if cursor < n_samples else -1
    for cycle in range(n_cycles):
        start, done, first_sample = first + cycle * substeps, 0, cursor
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
    return n_cycles * substeps


def locate_samples(times: Array, step: float) -> tuple[IntArray, Array]:
    """Return the number of the step that each output time is in, and the time since that step's begin [s]."""
    number = np.floor(times / step * (1 + 1e-14) + 1e-9).astype(np.int64)
    offset = np.maximum(times - number * step, 0.0)
    offset[offset < 1e-9 * step] = 0.0
    return number, offset


@dataclass(frozen=True)
class FixedMarch:
    """March of a system by a method with a fixed step.

    Attributes
    ----------
    name : str
        The method's.
    make : callable
        Make the method's table for a state, into whose arrays it writes.
    system : System
        What is marched.
    frozen : Any
        Its storage for the method.
    step : float
        Fast step [s].
    substeps : int
        Fast steps to a major cycle, which is never divided.
    origin : float
        Time of step number 0 [s].
    """

    name: str
    make: Callable[[State], Table]
    system: System
    frozen: Any
    step: float
    substeps: int = 1
    origin: float = 0.0

    def run(
        self, start: State, times: Array, progress: Progress | None, contacts: Array | None = None
    ) -> tuple[State, Array, Array, float]:
        """March until the last output time is passed.

        The kernel is called for some steps at a time, so that progress shows and divergence is noticed early; neither
        that nor ``times`` changes the steps. ``contacts`` (n_times, n_values) are filled with values of contacts.

        Returns
        -------
        tuple of State, ndarray, ndarray, float
            The last state, positions and rates at the output times, and the run time of the compiled march [s].

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
        p, check = self.system.parameters, WorkCheck(self.system, self.origin, self.step, substeps)
        touching = getattr(p, "contact", None)
        if touching is not None and state.memory.size:
            touching.recall(state.memory)
        check.begin(state.step, state.q, state.v)
        seconds, chunk = 0.0, substeps * FIRST_CYCLES
        _march(method, p, self.frozen, samples, check.log, substeps, state.step, 0)  # compiles, or reads the kernel
        while state.step < last:
            wanted = min(chunk, last - state.step, check.most_steps)
            cycle = wanted if isinstance(method, SingleSteps) and not check.follows_laws else substeps
            tick = time.perf_counter()
            done = int(_march(method, p, self.frozen, samples, check.log, cycle, state.step, wanted // cycle))
            spent = time.perf_counter() - tick
            seconds += spent
            state = replace(state, step=state.step + done, time=(state.step + done) * self.step)
            if done < wanted or not np.isfinite(state.q).all():
                raise _divergence(state)
            check.add()
            share = min(MORE_CYCLES, CYCLES_SECONDS / max(spent, 1e-9))
            chunk = substeps * max(1, int(share * (wanted // substeps)))
            if progress:
                progress(state.step / last)
        check.require_little_missed(self.name)
        state = state if touching is None else replace(state, memory=touching.memory)
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

    def ends(self, system: System, starts: Sequence[State], time: float) -> list[State]:
        """Return the states in which marches end that pass a time [s], from states that differ in values alone."""
        march = self.fixed_march(system)
        check = WorkCheck(system, 0.0, march.step, march.substeps)
        remembers = check.follows_laws or getattr(system, "has_loops", False) or hasattr(system, "n_contact_values")
        if remembers:  # what is each march's own
            return super().ends(system, starts, time)
        state, p, m = starts[0].copy(), system.parameters, march.substeps
        method, found = march.make(state), []
        (sample_step,), _ = locate_samples(np.array([time]), march.step)
        nothing, numbers = np.zeros(0), np.zeros(0, dtype=np.int64)
        q, v = np.zeros((0, state.q.size)), np.zeros((0, state.v.size))
        none = Samples(nothing, numbers, nothing, q, v, np.zeros((0, 0)), np.zeros(1, dtype=np.int64))
        for start in starts:
            for own, given in zip(state.arrays, start.arrays, strict=True):
                own[:] = given
            wanted = -(-(int(sample_step) + 1 - start.step) // m) * m
            done = int(_march(method, p, march.frozen, none, check.log, m, start.step, wanted // m))
            if done < wanted or not np.isfinite(state.q).all():
                at = (start.step + done) * march.step
                raise StabilityError(f"{self.name} diverges at t = {at:.6g} s; take a smaller step")
            found.append(replace(state.copy(), step=start.step + done, time=(start.step + done) * march.step))
        return found

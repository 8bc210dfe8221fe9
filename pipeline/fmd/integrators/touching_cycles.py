"""Sub-cycling of bodies that touch: all coordinates take the fast step while surfaces touch or may do so in the cycle.

A force of contact that is frozen over a cycle, or that acts on slow coordinates once in it, makes energy: kicks of
stiff forces have to be as close as their vibrations ask. So a cycle is one of sub-cycling only if gaps are wider than
bodies come in it; one at whose end surfaces press all the same is taken back. Between the two kinds of cycles the slow
rates, which are half a cycle before the state's time or half a step, move by the state's accelerations: these are the
half kicks of velocity Verlet, whose step may change at any state.
"""

from __future__ import annotations

from typing import Any

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.system import accelerations, is_pressed, may_touch
from fmd.integrators.central_difference import LeapfrogSteps
from fmd.integrators.fixed_step import begin_cycle, end_cycle, runs_away, sample_within, take_steps
from fmd.integrators.march_tables import Samples
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import inlined
from fmd.kernels.table import Table

TAKEN, SAMPLED, SINGLE = range(3)
"""Kinds of a cycle: taken as a whole, taken again to samples, and by single steps."""


@dataclass(frozen=True)
class TouchingCycles(Table):
    """State of a march whose cycles are of sub-cycling or of single steps; both kinds have the same arrays."""

    n_slow: int
    q: Array
    v: Array
    a: Array
    cycles: Any  # FrozenSteps or CarriedSteps: cycles of sub-cycling
    singles: LeapfrogSteps
    leapfrog: Any
    # (2,): 1 if the slow rates are half a step before the state's time, and how many cycles were of single steps
    memory: Array
    carried: Array  # (1,): how many cycles are known that carried forces go on from: none after single steps
    kind: IntArray  # (1,)
    q_begin: Array
    v_begin: Array
    a_begin: Array
    v_now: Array


@inlined
def _move_slow_rates(m: TouchingCycles, p: Any, t: float, single: float) -> None:
    """Evaluate the accelerations at a state, and set the slow rates half a step before it or half a cycle."""
    c, H = m.cycles, m.cycles.substeps * m.cycles.h
    accelerations(p, t, m.q, m.v_now, m.a)
    for i in range(m.n_slow):
        m.v[i] = m.v_now[i] - 0.5 * (c.h if single != 0.0 else H) * m.a[i]
    m.memory[0] = single


@begin_cycle.register(TouchingCycles)
def _begin_cycle(m: TouchingCycles, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    c, single, t = m.cycles, m.memory[0] != 0.0, first * m.cycles.h
    H = c.substeps * c.h
    for i in range(m.v.size):
        step = H if i < m.n_slow and not single else c.h
        m.v_now[i] = m.v[i] + 0.5 * step * m.a[i]
    if not may_touch(p, t, H, m.q, m.v_now):
        if single:
            _move_slow_rates(m, p, t, 0.0)
            m.carried[0] = 0.0
        _keep_begin(m)
        begin_cycle(c, p, frozen, first, False)
        take_steps(c, p, frozen, first, 0, c.substeps, False)
        m.kind[0] = TAKEN
        if runs_away(m.v):
            return
        pressed = is_pressed(p, t + H, m.q, m.v)
        if not pressed and not sampled:
            return
        _return_to_begin(m)
        if not pressed:
            m.kind[0] = SAMPLED
            begin_cycle(c, p, frozen, first, True)
            return
        single = False
    if not single:
        _move_slow_rates(m, p, t, 1.0)
    m.kind[0] = SINGLE
    m.memory[1] += 1.0


@inlined
def _keep_begin(m: TouchingCycles) -> None:
    copy(m.q, m.q_begin)
    for i in range(m.v.size):
        m.v_begin[i], m.a_begin[i] = m.v[i], m.a[i]


@inlined
def _return_to_begin(m: TouchingCycles) -> None:
    copy(m.q_begin, m.q)
    for i in range(m.v.size):
        m.v[i], m.a[i] = m.v_begin[i], m.a_begin[i]


@take_steps.register(TouchingCycles)
def _take_steps(m: TouchingCycles, p: Any, frozen: Any, first: int, done: int, count: int, sampled: bool) -> int:
    if m.kind[0] == SINGLE:
        return int(take_steps(m.singles, p, m.leapfrog, first, done, count, sampled))
    if m.kind[0] == SAMPLED:
        return int(take_steps(m.cycles, p, frozen, first, done, count, sampled))
    return 0 if done == 0 and runs_away(m.v) else count


@sample_within.register(TouchingCycles)
def _sample_within(m: TouchingCycles, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    if m.kind[0] == SINGLE:
        sample_within(m.singles, p, done, s, q, v)
    else:
        sample_within(m.cycles, p, done, s, q, v)


@end_cycle.register(TouchingCycles)
def _end_cycle(m: TouchingCycles, p: Any, frozen: Any, first: int, samples: Samples, first_sample: int) -> None:
    if m.kind[0] != SINGLE:
        end_cycle(m.cycles, p, frozen, first, samples, first_sample)

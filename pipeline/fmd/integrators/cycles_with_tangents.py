"""Major cycles of sub-cycling with eight tangents of the motion, whose slow coordinates stand between its fast ones."""

from dataclasses import dataclass
from typing import Any

from fmd.core.arrays import Array, IntArray
from fmd.dynamics.system import accelerations, advance, fast_steps, freeze_slow, project_onto_constraints
from fmd.integrators.fixed_step import begin_cycle, end_cycle, runs_away, sample_within, take_steps
from fmd.integrators.march_tables import Samples
from fmd.kernels.arrays import copy
from fmd.kernels.table import Table


@dataclass(frozen=True)
class CyclesWithTangents(Table):
    """State of a sub-cycled march with its tangents, and room for what its samples begin with."""

    h: float
    substeps: int
    place: IntArray  # (n,): position that each fast rate moves, -1 for slow ones
    q: Array
    v: Array
    a: Array
    q_now: Array
    v_now: Array


@begin_cycle.register(CyclesWithTangents)
def _begin_cycle(m: CyclesWithTangents, p: Any, frozen: Any, first: int, sampled: bool) -> None:
    """Evaluate all accelerations, freeze the fast equation, and take the slow step."""
    t, H = first * m.h, m.substeps * m.h
    for i in range(m.v.size):
        m.v_now[i] = m.v[i] + 0.5 * (H if m.place[i] < 0 else m.h) * m.a[i]
        frozen.behind[i] = m.v[i]
    for i in range(m.q.size if sampled else 0):
        m.q_now[i] = m.q[i]
    accelerations(p, t, m.q, m.v_now, m.a)
    freeze_slow(p, t, m.q, m.v_now, m.a, frozen)
    for i in range(m.v.size):
        m.v_now[i] = 0.0
        if m.place[i] < 0:
            m.v[i] += H * m.a[i]
            m.v_now[i] = m.v[i]
    advance(p, m.q, m.v_now, H, 0, m.v.size)


@take_steps.register(CyclesWithTangents)
def _take_steps(m: CyclesWithTangents, p: Any, frozen: Any, first: int, done: int, count: int, sampled: bool) -> int:
    for i in range(m.v.size if sampled else 0):
        if m.place[i] >= 0:
            m.q_now[m.place[i]] = m.q[m.place[i]]
    taken = 0
    if done == 0:  # with the accelerations of the cycle's begin
        for i in range(m.v.size):
            if m.place[i] >= 0:
                m.v[i] += m.h * m.a[i]
                m.q[m.place[i]] += m.h * m.v[i]
        taken = 1
    if count > taken:
        fast_steps(p, frozen, first + done + taken, m.h, count - taken, m.q, m.v, m.a)
    return 0 if runs_away(m.v) else count


@sample_within.register(CyclesWithTangents)
def _sample_within(m: CyclesWithTangents, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    s_slow, H = s + done * m.h, m.substeps * m.h
    copy(m.q_now, q)
    for i in range(v.size):  # Taylor's polynomial, which the next step continues
        step, ahead = (H, s_slow) if m.place[i] < 0 else (m.h, s)
        rate = m.v[i] - 0.5 * step * m.a[i] + 0.5 * ahead * m.a[i]
        v[i] = rate + 0.5 * ahead * m.a[i]
        m.v_now[i] = rate
        if m.place[i] >= 0:
            q[m.place[i]] += ahead * rate
            m.v_now[i] = 0.0
    advance(p, q, m.v_now, s_slow, 0, v.size)


@end_cycle.register(CyclesWithTangents)
def _end_cycle(m: CyclesWithTangents, p: Any, frozen: Any, first: int, samples: Samples, first_sample: int) -> None:
    project_onto_constraints(p, (first + m.substeps) * m.h, m.substeps * m.h, m.q, m.v, m.a)

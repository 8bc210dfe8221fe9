"""Reversible sub-cycling: constant forces at each fast step, all else once a major cycle, at its middle.

Modes, springs and dampers have constant forces ``K q + C v``. All that is left of the equations of motion, inertia,
loads and what else depends on the state, changes as the joints move. Over a major cycle ``H = m h`` it and the mass
matrix are frozen at the cycle's middle (q*, v*)::

    a = a* − M̂*⁻¹ (K (q − q*) + C (v − v*))        a* = M̂*⁻¹ Q̂(q*, v*)

and all coordinates take m leapfrog steps h of it (½h drift, kick, ½h drift). So one evaluation serves m steps, with the
accelerations M̂*⁻¹ of unit forces, whose articulated inertias are those of a*. Whatever couples by inertia does so at
each fast step: where M̂ is constant and forces are ``K q + C v``, the method is central difference with the fast step,
to round-off, and as stable. K and C may be any matrices, for what they leave out is frozen.

The middle's rates are predicted by a line through the mean rates v̄ of the last two cycles,
``v* = 2 v̄ − v̄⁻``, ``q* = q + ½ H v*``. The order is 2.
"""

from __future__ import annotations

from dataclasses import field, replace
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.code import DOUBLES_AT_ONCE, DOUBLES_IN_LINE
from fmd.dynamics.system import System, advance, find_responses, project
from fmd.dynamics.vibration import largest_leapfrog_step
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.fixed_step import (
    FixedMarch,
    FixedStepIntegrator,
    begin_cycle,
    end_cycle,
    runs_away,
    sample_within,
    take_steps,
)
from fmd.integrators.march_tables import Samples
from fmd.integrators.protocol import State, Trajectory, require_ratio, start_state
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import unrolled
from fmd.kernels.table import Table, aligned
from fmd.kernels.vectors import call_native, fill_vector, read_vector, write_vector


@dataclass(frozen=True)
class ReversibleSubcycling(FixedStepIntegrator):
    """Reversible sub-cycling by a fast step [s] and a number of fast steps to a major cycle.

    A state's rates are at its own time; ``memory``, (2 n,), holds the mean rates of the last two cycles, newest first.
    """

    step: float
    substeps: int = field()  # none by default

    name = "reversible-sub-cycling"

    def __post_init__(self) -> None:
        require_ratio(self.step, self.substeps)

    def order(self, system: System) -> int:
        """Return 2."""
        return 2

    def largest_step(self, system: System) -> float:
        """Return central difference's longest step, and the longest that end stops allow, which are frozen [s]."""
        return min(CentralDifference(self.step).largest_step(system), self._largest_by_stops(system))

    def _largest_by_stops(self, system: System) -> float:
        (M, K, C), (_, stiffest, most) = system.linear_matrices, system.stiffest_matrices
        if np.array_equal(K, stiffest) and np.array_equal(C, most):
            return np.inf
        return largest_leapfrog_step(M, stiffest - K, most - C) / self.substeps

    def describe_limit(self, system: Any) -> str:
        """Say what limits the step: end stops, or which frequency, and what dampers take of that."""
        plain = CentralDifference(self.step)
        if self._largest_by_stops(system) < plain.largest_step(system):
            return f"2/(m ω) of its end stops alone, whose forces are frozen over {self.substeps} steps"
        return plain.describe_limit(system)

    def load_cycle(self, system: System) -> int:
        """Return the steps of a cycle, over which loads are frozen."""
        return self.substeps

    def start(self, system: System, q0: Array, v0: Array) -> State:
        """Return the state at time 0, as if rates had been the same before."""
        return replace(start_state(self, system, q0, v0, np.zeros(system.n)), memory=np.tile(v0, 2))

    def history_size(self, state: State) -> int:
        """Return the number of the mean rates of two cycles."""
        return state.memory.size

    def describe(self, times: Array, q: Array, v: Array, end: State, n_steps: int, seconds: float) -> Trajectory:
        """Return the trajectory of a march with so many fast steps."""
        m = self.substeps
        return Trajectory(self.name, self.step, m, times, q, v, n_steps // m, 0, seconds, end)

    def fixed_march(self, system: System) -> FixedMarch:
        """Return what a system is marched with."""
        h, m, n, n_slow = self.step, self.substeps, system.n, system.n_slow
        lines = -(-n // DOUBLES_IN_LINE)
        _, K, C = (np.ascontiguousarray(A.T) for A in system.linear_matrices)
        damped = bool(C.any())

        def make(state: State) -> _FrozenSteps:
            matrices, whole = np.zeros((3, lines, n, DOUBLES_IN_LINE)), aligned(*6 * [lines * DOUBLES_IN_LINE])
            arrays = [np.array([h]), K, C, *state.arrays, *matrices, *whole, *aligned(system.n_positions, n, n, n, n)]
            return _FrozenSteps(h, m, n_slow, damped, *arrays)

        return FixedMarch(self.name, make, system, system.responses(), h, m)


@dataclass(frozen=True)
class _FrozenSteps(Table):
    """State of a march; fast coordinates are scalars, number i at position ``i + q.size - v.size``."""

    h: float  # fast step [s]
    substeps: int
    n_slow: int
    damped: bool  # C isn't zero
    clock: Array  # (1,): the fast step, too
    K: Array  # (n, n): forces of each position and rate, a row each
    C: Array
    q: Array
    v: Array
    a: Array
    memory: Array  # (2 n,)
    X: Array  # (n_blocks, n, 8): accelerations of unit forces, as `find_responses` has them
    A: Array  # the like: ``X K`` and ``X C``
    B: Array
    from_middle: Array  # (whole lines of 8,): coordinates from the cycle's middle
    rate: Array
    last: Array  # accelerations of the last fast step
    frozen: Array  # accelerations in the middle
    middle: Array  # rates there
    constant: Array  # ``frozen + B middle``
    q_now: Array  # (n_positions,) and (n,), room: the middle's state, and a sample's begin from the cycle's begin
    v_now: Array
    a_now: Array
    shift: Array
    begin: Array  # (n,): from_middle at the cycle's begin


@begin_cycle.register(_FrozenSteps)
def _begin_cycle(m: _FrozenSteps, p: Any, responses: Any, first: int, sampled: bool) -> None:
    """Freeze the equations in the middle."""
    n, H, offset = m.v.size, m.substeps * m.h, m.q.size - m.v.size
    copy(m.q, m.q_now)
    for i in range(n):
        m.v_now[i] = 2.0 * m.memory[i] - m.memory[n + i]
    advance(p, m.q_now, m.v_now, 0.5 * H, 0, n)
    for i in range(m.n_slow if offset else 0):  # of rotations in space, which have no differences
        m.begin[i] = -0.5 * H * m.v_now[i]
    project(p, (first + 0.5 * m.substeps) * m.h, m.q_now, m.v_now)
    find_responses(p, responses, (first + 0.5 * m.substeps) * m.h, m.q_now, m.v_now, m.a_now, m.X)
    for i in range(m.n_slow if offset else 0, n):  # loops move the middle, the slow coordinates too
        m.begin[i] = m.q[i + offset] - m.q_now[i + offset]
    for i in range(n):
        m.frozen[i], m.middle[i], m.rate[i], m.last[i] = m.a_now[i], m.v_now[i], m.v[i], m.a[i]
        m.from_middle[i] = m.begin[i] + 0.5 * m.h * m.v[i]
    if responses.middle:
        call_native(responses.middle, (m.K, m.C, m.X, m.frozen, m.middle, m.A, m.B, m.constant))
    else:
        _multiply(m, m.K, m.A)
        if m.damped:
            _multiply(m, m.C, m.B)
        _find_constant(m)


@take_steps.register(_FrozenSteps)
def _take_steps(m: _FrozenSteps, p: Any, responses: Any, first: int, done: int, count: int, sampled: bool) -> int:
    if sampled:
        for i in range(m.v.size):
            m.v_now[i] = m.rate[i]
            m.shift[i] = m.from_middle[i] - 0.5 * m.h * m.rate[i] - m.begin[i] if done else 0.0
    for _ in range(count):
        if responses.step:
            call_native(responses.step, (m.clock, m.A, m.B, m.constant, m.from_middle, m.rate, m.last))
        else:
            _step(m)
    return 0 if runs_away(m.rate) else count


@unrolled
def _multiply(m: _FrozenSteps, factor: Array, out: Array) -> None:
    """Set the columns of out to those of X times a matrix, of which ``factor[j]`` is a column."""
    n = m.v.size
    for block in range(m.X.shape[0]):
        for j in range(n):
            for part in range(0, DOUBLES_IN_LINE, DOUBLES_AT_ONCE):
                at, total = block * n * DOUBLES_IN_LINE + part, fill_vector(0.0, DOUBLES_AT_ONCE)
                for k in range(n):
                    if factor[j, k] != 0.0:
                        total = total + fill_vector(factor[j, k], DOUBLES_AT_ONCE) * read_vector(
                            m.X, at + DOUBLES_IN_LINE * k, DOUBLES_AT_ONCE
                        )
                write_vector(out, at + DOUBLES_IN_LINE * j, total)


@unrolled
def _find_constant(m: _FrozenSteps) -> None:
    n = m.v.size
    for i in range(0, m.rate.size, DOUBLES_AT_ONCE):
        at, total = (
            i // DOUBLES_IN_LINE * DOUBLES_IN_LINE * n + i % DOUBLES_IN_LINE,
            read_vector(m.frozen, i, DOUBLES_AT_ONCE),
        )
        for j in range(n if m.damped else 0):
            total = total + fill_vector(m.middle[j], DOUBLES_AT_ONCE) * read_vector(
                m.B, at + DOUBLES_IN_LINE * j, DOUBLES_AT_ONCE
            )
        write_vector(m.constant, i, total)


@unrolled
def _step(m: _FrozenSteps) -> None:
    """Take a leapfrog step."""
    n, h, half = m.v.size, fill_vector(m.h, DOUBLES_AT_ONCE), fill_vector(0.5 * m.h, DOUBLES_AT_ONCE)
    for i in range(0, m.rate.size, DOUBLES_AT_ONCE):  # for a moment the rates half a step later
        write_vector(
            m.rate, i, read_vector(m.rate, i, DOUBLES_AT_ONCE) + half * read_vector(m.last, i, DOUBLES_AT_ONCE)
        )
    for i in range(0, m.rate.size, DOUBLES_AT_ONCE):
        at = i // DOUBLES_IN_LINE * DOUBLES_IN_LINE * n + i % DOUBLES_IN_LINE
        elastic, damped = read_vector(m.constant, i, DOUBLES_AT_ONCE), fill_vector(0.0, DOUBLES_AT_ONCE)
        for j in range(n):
            elastic = elastic - fill_vector(m.from_middle[j], DOUBLES_AT_ONCE) * read_vector(
                m.A, at + DOUBLES_IN_LINE * j, DOUBLES_AT_ONCE
            )
        for j in range(n if m.damped else 0):
            damped = damped - fill_vector(m.rate[j], DOUBLES_AT_ONCE) * read_vector(
                m.B, at + DOUBLES_IN_LINE * j, DOUBLES_AT_ONCE
            )
        write_vector(m.frozen, i, elastic + damped)
    for i in range(0, m.rate.size, DOUBLES_AT_ONCE):
        a = read_vector(m.frozen, i, DOUBLES_AT_ONCE)
        rate = read_vector(m.rate, i, DOUBLES_AT_ONCE) - half * read_vector(m.last, i, DOUBLES_AT_ONCE) + h * a
        write_vector(m.last, i, a)
        write_vector(m.rate, i, rate)
        write_vector(m.from_middle, i, read_vector(m.from_middle, i, DOUBLES_AT_ONCE) + h * rate)


@sample_within.register(_FrozenSteps)
def _sample_within(m: _FrozenSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    copy(m.q, q)
    for i in range(v.size):  # Taylor's polynomial, which the next step continues
        v[i] = m.v_now[i] + s * m.last[i]
        m.a_now[i] = m.shift[i] + s * (m.v_now[i] + 0.5 * s * m.last[i])
    advance(p, q, m.a_now, 1.0, 0, v.size)


@end_cycle.register(_FrozenSteps)
def _end_cycle(m: _FrozenSteps, p: Any, responses: Any, first: int, samples: Samples, first_sample: int) -> None:
    """Move all coordinates, and remember their mean rates."""
    n, per_cycle = m.v.size, 1.0 / (m.substeps * m.h)
    for i in range(n):
        m.shift[i] = m.from_middle[i] - 0.5 * m.h * m.rate[i] - m.begin[i]
        m.memory[n + i], m.memory[i] = m.memory[i], m.shift[i] * per_cycle
        m.v[i], m.a[i] = m.rate[i], m.last[i]
    advance(p, m.q, m.shift, 1.0, 0, n)
    project(p, (first + m.substeps) * m.h, m.q, m.v)

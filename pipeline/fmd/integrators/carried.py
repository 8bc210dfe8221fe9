"""Sub-cycling by carried forces: one evaluation a major cycle, whatever the fast coordinates couple by.

At a cycle's begin the fast accelerations a are known, and with them the rest ``r = a + k q`` beside the diagonal
stiffness k of the reference state. Over the cycle r goes on from the cycles before: by a parabola through the last
three of them, by a line or as a constant where there are fewer, as after the start and after a load's breakpoints. The
coordinates are then oscillators by themselves, so that all m steps are a linear map of (q, v, a, r, r⁻, r⁻⁻) that never
changes. As a constant r is what the paper freezes (Miao et al. 2008, eq. 11), if mass and stiffness of the fast
coordinates are diagonal: an error of first order, and growth where gyroscopic forces act.

With ``z = h² k``, ``u_{j+1} = (2 − z) u_j − u_{j−1}``, S, R and P the sums of u, of S and of R, the way of m steps is
``d u_m + b S_m + g R_m + p P_m`` for an increment d, a first change b, and forces that change by g s + p s (s − 1)/2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.code import DOUBLES_AT_ONCE
from fmd.dynamics.system import System, accelerations, advance, cross_by_carried_forces
from fmd.integrators.fixed_step import begin_cycle, end_cycle, runs_away, sample_within, take_cycles, take_steps
from fmd.integrators.march_tables import Samples
from fmd.integrators.protocol import State
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import contracted, inlined
from fmd.kernels.table import Table, aligned, whole_lines
from fmd.kernels.vectors import read_vector, write_vector

DEGREES = {"frozen": 0, "carried": 2}
"""Largest degree of the polynomial by which forces go on, by the name of the scheme."""


@dataclass(frozen=True)
class CarriedSteps(Table):
    """State of a march by carried forces, what never changes in it, and the begin of a cycle with samples.

    Fast coordinates are scalars: number i is position ``i + q.size - v.size``.
    """

    h: float
    substeps: int
    n_slow: int
    degree: int
    breakpoints: Array  # (any,) [s]
    k: Array  # (n,): diagonal stiffness over mass
    maps: Array  # (3, 3, 5, n): by degree, of way, rate and last acceleration by v, a, r, r⁻ and r⁻⁻
    q: Array
    v: Array
    a: Array
    memory: Array  # (2 n + 1,): r of the last cycle and of the one before, and how many of them are known
    q_begin: Array
    v_begin: Array
    begin: Array  # (n,): accelerations at the begin
    r: Array
    q_now: Array
    v_now: Array
    a_now: Array


@dataclass(frozen=True)
class WholeCarriedSteps(CarriedSteps):
    """State of such a march whose cycles are one compiled function each, which takes the memory on, too."""

    whole_maps: Array  # (3, 17, any): by degree, the maps of `fmd.dynamics.compiler.carried_cycle`
    past: Array  # (2 n + 1,): memory at the begin of a cycle with samples


def whole_carried_steps(steps: CarriedSteps) -> WholeCarriedSteps:
    """Make the table of a march by whole cycles from that of its steps."""
    n, n_slow, H = steps.v.size, steps.n_slow, steps.substeps * steps.h
    (room,) = aligned(3 * 17 * whole_lines(n))
    fast, half, maps = np.arange(n) >= n_slow, np.full(n, 0.5 * steps.h), room.reshape(3, 17, -1)
    half[:n_slow] = 0.5 * H
    k = np.where(fast, steps.k, 0.0)
    by_v, by_a, by_r, by_r1, by_r2 = np.moveaxis(steps.maps, 2, 0)
    slow = np.array([[H, H * H], [1.0, H], [0.0, 1.0]])[:, :, None]  # way, rate and acceleration by rate and this
    parts = [np.where(fast, by_v, slow[:, 0]), by_r * k, by_r1 * fast, by_r2 * fast]
    maps[:, :15, :n] = np.stack([*parts, np.where(fast, by_a + by_r, slow[:, 1])], axis=2).reshape(3, 15, n)
    maps[:, 15, :n], maps[:, 16, :n] = k, half
    own: dict[str, Any] = {each.name: vars(steps)[each.name] for each in fields(steps)}
    return WholeCarriedSteps(**own, whole_maps=maps, past=np.zeros(2 * n + 1))


def carried_steps(system: System, h: float, m: int, degree: int, state: State) -> CarriedSteps:
    """Make the table of a march from a state, into whose arrays it writes."""
    n, (M, K, _) = system.n, system.linear_matrices
    k = np.ascontiguousarray(np.linalg.solve(M, K).diagonal())
    known = np.array(system.breakpoints, dtype=float)
    room = aligned(system.n_positions, n, n, n, system.n_positions, n, n)
    own = (state.q, state.v, state.a, state.memory)
    return CarriedSteps(h, m, system.n_slow, degree, known, k, _maps(k, h, m), *own, *room)


def _maps(k: Array, h: float, m: int) -> Array:
    """Return the maps of `CarriedSteps` for a constant, a line and a parabola, shape (3, 3, 5, n)."""
    z = h * h * k
    u = [-np.ones_like(z), np.zeros_like(z), np.ones_like(z)]  # from number −1 on
    while len(u) < m + 2:
        u.append((2.0 - z) * u[-1] - u[-2])
    U = np.array(u[1:])  # (m + 1, n)
    S = np.cumsum(U, axis=0)
    R = np.concatenate([np.zeros((1, z.size)), np.cumsum(S, axis=0)[:-1]])
    P = np.concatenate([np.zeros((1, z.size)), np.cumsum(R, axis=0)[:-1]])
    ways = np.array([[U[m], S[m], R[m], P[m]], [U[m] - U[m - 1], U[m], S[m - 1], R[m - 1]]])
    last = np.array([-z * U[m - 1], U[m] - U[m - 1], U[m - 1], S[m - 2]])
    by_steps = np.array([ways[0], ways[1], last])  # of d = h v, b = h² a, g, p
    made = np.zeros((3, 3, 5, z.size))
    units = (1.0, 1.0 / h, 1.0 / (h * h))
    for degree in range(3):
        for row in range(3):
            d, b, g, p = by_steps[row] * units[row]
            made[degree, row, 0], made[degree, row, 1] = d * h, b * h * h
            line, curve = h * h / m, h * h / m**2
            if degree == 1:
                made[degree, row, 2:4] = g * line, -g * line
            if degree == 2:  # r + (r − r⁻) s/m + (r − 2 r⁻ + r⁻⁻) s (s + m)/(2 m²), s² = s (s − 1) + s
                bend = curve * (g * (m + 1) / 2 + p)
                made[degree, row, 2] = g * line + bend
                made[degree, row, 3] = -g * line - 2.0 * bend
                made[degree, row, 4] = bend
    return made


def _along_fast(make: Callable[[int], Any]) -> Any:
    """Make a loop over the fast coordinates of a function of some of them, which is made for their number.

    They go as compiled accelerations read and write them: a processor waits before it reads a vector where single
    numbers have just been written.
    """
    some, one = make(DOUBLES_AT_ONCE), make(1)

    @inlined
    def go(m: CarriedSteps, maps: Array) -> None:
        i, n = m.n_slow, m.v.size
        while i + DOUBLES_AT_ONCE <= n:
            some(m, maps, i)
            i += DOUBLES_AT_ONCE
        while i < n:
            one(m, maps, i)
            i += 1

    return go


@_along_fast
def _go_half_a_step(width: int) -> Any:
    @contracted
    def go(m: CarriedSteps, maps: Array, i: int) -> None:
        write_vector(m.v_now, i, read_vector(m.v, i, width) + 0.5 * m.h * read_vector(m.a, i, width))

    return go


def _map_of(width: int) -> Any:
    """Make the sum of what some coordinates' rows of a map give."""

    @contracted
    def sum_rows(rows: Array, i: int, v: Array, a: Array, r: Array, r1: Array, r2: Array) -> Array:
        now = read_vector(rows[0], i, width) * v + read_vector(rows[1], i, width) * a
        now = now + read_vector(rows[2], i, width) * r
        return now + read_vector(rows[3], i, width) * r1 + read_vector(rows[4], i, width) * r2

    return sum_rows


@_along_fast
def _cross(width: int) -> Any:
    total = _map_of(width)

    @contracted
    def cross(m: CarriedSteps, maps: Array, i: int) -> None:
        n, place = m.v.size, i + m.q.size - m.v.size
        q, v, a = read_vector(m.q, place, width), read_vector(m.v, i, width), read_vector(m.begin, i, width)
        r1, r2 = read_vector(m.memory, i, width), read_vector(m.memory, n + i, width)
        r = a + read_vector(m.k, i, width) * q
        write_vector(m.q, place, q + total(maps[0], i, v, a, r, r1, r2))
        write_vector(m.v, i, total(maps[1], i, v, a, r, r1, r2))
        write_vector(m.a, i, total(maps[2], i, v, a, r, r1, r2))
        write_vector(m.r, i, r)

    return cross


@_along_fast
def _remember_forces(width: int) -> Any:
    @inlined
    def remember(m: CarriedSteps, maps: Array, i: int) -> None:
        write_vector(m.memory, m.v.size + i, read_vector(m.memory, i, width))
        write_vector(m.memory, i, read_vector(m.r, i, width))

    return remember


@begin_cycle.register(CarriedSteps)
def _begin_cycle(m: CarriedSteps, p: Any, nothing: Any, first: int, sampled: bool) -> None:
    """Evaluate all accelerations, and take the cycle."""
    n, H, t = m.v.size, m.substeps * m.h, first * m.h
    _forget_before_breakpoints(m, t)
    maps = m.maps[min(m.degree, int(m.memory[2 * n]))]
    for i in range(m.n_slow):
        m.v_now[i] = m.v[i] + 0.5 * H * m.a[i]
    _go_half_a_step(m, maps)
    accelerations(p, t, m.q, m.v_now, m.begin)
    if sampled:
        copy(m.q, m.q_begin)
        for i in range(n):
            m.v_begin[i] = m.v[i]
    _cross(m, maps)
    for i in range(m.n_slow):
        m.a[i] = m.begin[i]
        m.v[i] += H * m.a[i]
    advance(p, m.q, m.v, H, 0, m.n_slow)


@inlined
def _forget_before_breakpoints(m: CarriedSteps, t: float) -> None:
    """Let the cycle that begins at a time t [s] carry no forces over a breakpoint."""
    for k in range(m.breakpoints.size):
        if t - m.substeps * m.h < m.breakpoints[k] <= t:
            m.memory[2 * m.v.size] = 0.0


@take_cycles.register(CarriedSteps)
def _take_cycles(m: CarriedSteps, p: Any, nothing: Any, first: int, count: int) -> int:
    for cycle in range(count):
        begin_cycle(m, p, nothing, first + cycle * m.substeps, False)
        _remember(m)
        if runs_away(m.v):
            return cycle + 1
    return count


@take_steps.register(CarriedSteps)
def _take_steps(m: CarriedSteps, p: Any, nothing: Any, first: int, done: int, count: int, sampled: bool) -> int:
    if sampled:
        _follow(m, m.r, m.memory, done)
    return 0 if done == 0 and runs_away(m.v) else count


@inlined
def _follow(m: CarriedSteps, r: Array, before: Array, done: int) -> None:
    """Follow the coordinates from the cycle's begin to a step: positions before it, rates after it.

    The cycle's forces are r, those of the cycles before are as in memory.
    """
    n, h, steps, offset = m.v.size, m.h, m.substeps, m.q.size - m.v.size
    degree = min(m.degree, int(before[2 * n]))
    per_line, per_curve = (1.0 / steps if degree > 0 else 0.0), (0.5 / (steps * steps) if degree > 1 else 0.0)
    copy(m.q_begin, m.q_now)
    for i in range(m.n_slow):
        m.v_now[i], m.a_now[i] = m.v[i], m.a[i]
    for i in range(m.n_slow, n):
        line, curve = (r[i] - before[i]) * per_line, (r[i] - 2.0 * before[i] + before[n + i]) * per_curve
        x, rate, a = m.q_begin[i + offset], m.v_begin[i] + h * m.begin[i], m.begin[i]
        for step in range(1, done + 1):
            x += h * rate
            a = r[i] + step * line + step * (step + steps) * curve - m.k[i] * x
            rate += h * a
        m.q_now[i + offset], m.v_now[i], m.a_now[i] = x, rate, a


@sample_within.register(CarriedSteps)
def _sample_within(m: CarriedSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    H = m.substeps * m.h
    copy(m.q_now, q)
    for i in range(v.size):  # Taylor's polynomial, which the next step continues
        step, ahead = (H, s + done * m.h) if i < m.n_slow else (m.h, s)
        v[i] = m.v_now[i] - 0.5 * (step - ahead) * m.a_now[i]
    advance(p, q, v, s + done * m.h, 0, m.n_slow)
    advance(p, q, v, s, m.n_slow, v.size)
    for i in range(v.size):
        v[i] += 0.5 * (s + done * m.h if i < m.n_slow else s) * m.a_now[i]


@end_cycle.register(CarriedSteps)
def _end_cycle(m: CarriedSteps, p: Any, nothing: Any, first: int, samples: Samples, first_sample: int) -> None:
    _remember(m)


@inlined
def _remember(m: CarriedSteps) -> None:
    """Remember the forces of a cycle."""
    n = m.v.size
    _remember_forces(m, m.maps[0])
    m.memory[2 * n] = min(2.0, m.memory[2 * n] + 1.0)


@begin_cycle.register(WholeCarriedSteps)
def _begin_whole_cycle(m: WholeCarriedSteps, p: Any, carried: Any, first: int, sampled: bool) -> None:
    """Take the cycle."""
    if sampled:
        copy(m.q, m.q_begin)
        copy(m.v, m.v_begin)
        copy(m.memory, m.past)
    _cross_whole(m, p, carried, first)


@end_cycle.register(WholeCarriedSteps)
def _end_whole_cycle(
    m: WholeCarriedSteps, p: Any, carried: Any, first: int, samples: Samples, first_sample: int
) -> None:
    """Leave the memory as the cycle has made it."""


@take_steps.register(WholeCarriedSteps)
def _take_whole_steps(
    m: WholeCarriedSteps, p: Any, carried: Any, first: int, done: int, count: int, sampled: bool
) -> int:
    if sampled:
        _follow(m, m.memory, m.past, done)
    return 0 if done == 0 and runs_away(m.v) else count


@sample_within.register(WholeCarriedSteps)
def _sample_whole(m: WholeCarriedSteps, p: Any, done: int, s: float, q: Array, v: Array) -> None:
    for i in range(v.size):  # Taylor's polynomial, which the next step continues
        step, ahead = (m.substeps * m.h, s + done * m.h) if i < m.n_slow else (m.h, s)
        rate = m.v_now[i] - 0.5 * (step - ahead) * m.a_now[i]
        q[i] = m.q_now[i] + ahead * rate
        v[i] = rate + 0.5 * ahead * m.a_now[i]


@take_cycles.register(WholeCarriedSteps)
def _take_whole_cycles(m: WholeCarriedSteps, p: Any, carried: Any, first: int, count: int) -> int:
    for cycle in range(count):
        if _cross_whole(m, p, carried, first + cycle * m.substeps):
            return cycle + 1
    return count


@inlined
def _cross_whole(m: WholeCarriedSteps, p: Any, carried: Any, first: int) -> bool:
    """Take a cycle; true if the rates then run away."""
    t, n = first * m.h, m.v.size
    _forget_before_breakpoints(m, t)
    known = m.memory[2 * n]
    m.memory[2 * n] = min(2.0, known + 1.0)
    maps = m.whole_maps[min(m.degree, int(known))]
    return bool(cross_by_carried_forces(p, carried, t, maps, m.q, m.v, m.a, m.memory, m.begin))

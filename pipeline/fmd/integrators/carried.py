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

from dataclasses import dataclass
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.system import System, accelerations, advance
from fmd.integrators.fixed_step import begin_cycle, end_cycle, runs_away, sample_within, take_cycles, take_steps
from fmd.integrators.march_tables import Samples
from fmd.integrators.protocol import State
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import contracted, inlined
from fmd.kernels.table import Table, aligned
from fmd.kernels.vectors import fill_vector, read_vector, write_vector

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


@begin_cycle.register(CarriedSteps)
def _begin_cycle(m: CarriedSteps, p: Any, nothing: Any, first: int, sampled: bool) -> None:
    """Evaluate all accelerations, and take the cycle."""
    n, H, offset, t = m.v.size, m.substeps * m.h, m.q.size - m.v.size, first * m.h
    for i in range(m.n_slow):
        m.v_now[i] = m.v[i] + 0.5 * H * m.a[i]
    _go_half_a_step(m, n)
    accelerations(p, t, m.q, m.v_now, m.begin)
    for k in range(m.breakpoints.size):
        if t - H < m.breakpoints[k] <= t:
            m.memory[2 * n] = 0.0
    if sampled:
        copy(m.q, m.q_begin)
        for i in range(n):
            m.v_begin[i] = m.v[i]
    _cross(m, m.maps[min(m.degree, int(m.memory[2 * n]))], n, offset)
    for i in range(m.n_slow):
        m.a[i] = m.begin[i]
        m.v[i] += H * m.a[i]
    advance(p, m.q, m.v, H, 0, m.n_slow)


@take_cycles.register(CarriedSteps)
def _take_cycles(m: CarriedSteps, p: Any, nothing: Any, first: int, count: int) -> int:
    for cycle in range(count):
        begin_cycle(m, p, nothing, first + cycle * m.substeps, False)
        _remember(m)
        if runs_away(m.v):
            return cycle + 1
    return count


# Some entries at a time, by the widths in which compiled accelerations read and write them: a processor waits before it
# reads a vector where single numbers have just been written.


def _half_step(width: int) -> Any:
    """Make the rates half a step later of some fast coordinates, from one on."""

    @contracted
    def go(m: CarriedSteps, i: int) -> None:
        half = fill_vector(0.5 * m.h, width)
        write_vector(m.v_now, i, read_vector(m.v, i, width) + half * read_vector(m.a, i, width))

    return go


def _crossing(width: int) -> Any:
    """Make the way of some fast coordinates over a cycle, from one on."""

    @contracted
    def cross(m: CarriedSteps, maps: Array, n: int, offset: int, i: int) -> None:
        q, v, a = read_vector(m.q, i + offset, width), read_vector(m.v, i, width), read_vector(m.begin, i, width)
        r1, r2 = read_vector(m.memory, i, width), read_vector(m.memory, n + i, width)
        r = a + read_vector(m.k, i, width) * q
        way = read_vector(maps, i, width) * v + read_vector(maps, n + i, width) * a
        rate = read_vector(maps, 5 * n + i, width) * v + read_vector(maps, 6 * n + i, width) * a
        last = read_vector(maps, 10 * n + i, width) * v + read_vector(maps, 11 * n + i, width) * a
        way = way + read_vector(maps, 2 * n + i, width) * r + read_vector(maps, 3 * n + i, width) * r1
        rate = rate + read_vector(maps, 7 * n + i, width) * r + read_vector(maps, 8 * n + i, width) * r1
        last = last + read_vector(maps, 12 * n + i, width) * r + read_vector(maps, 13 * n + i, width) * r1
        write_vector(m.q, i + offset, q + (way + read_vector(maps, 4 * n + i, width) * r2))
        write_vector(m.v, i, rate + read_vector(maps, 9 * n + i, width) * r2)
        write_vector(m.a, i, last + read_vector(maps, 14 * n + i, width) * r2)
        write_vector(m.r, i, r)

    return cross


def _remembering(width: int) -> Any:
    """Make the memory of some fast coordinates' forces, from one on."""

    @inlined
    def remember(m: CarriedSteps, n: int, i: int) -> None:
        write_vector(m.memory, n + i, read_vector(m.memory, i, width))
        write_vector(m.memory, i, read_vector(m.r, i, width))

    return remember


_half_step_of_four, _half_step_of_two, _half_step_of_one = (_half_step(width) for width in (4, 2, 1))
_cross_four, _cross_two, _cross_one = (_crossing(width) for width in (4, 2, 1))
_remember_four, _remember_two, _remember_one = (_remembering(width) for width in (4, 2, 1))


@inlined
def _go_half_a_step(m: CarriedSteps, n: int) -> None:
    """Find the rates of the fast coordinates half a step later."""
    i = m.n_slow
    while i + 4 <= n:
        _half_step_of_four(m, i)
        i += 4
    if i + 2 <= n:
        _half_step_of_two(m, i)
        i += 2
    if i < n:
        _half_step_of_one(m, i)


@inlined
def _cross(m: CarriedSteps, maps: Array, n: int, offset: int) -> None:
    """Take the fast coordinates over a cycle."""
    i = m.n_slow
    while i + 4 <= n:
        _cross_four(m, maps, n, offset, i)
        i += 4
    if i + 2 <= n:
        _cross_two(m, maps, n, offset, i)
        i += 2
    if i < n:
        _cross_one(m, maps, n, offset, i)


@take_steps.register(CarriedSteps)
def _take_steps(m: CarriedSteps, p: Any, nothing: Any, first: int, done: int, count: int, sampled: bool) -> int:
    if sampled:
        _follow(m, done)
    return 0 if done == 0 and runs_away(m.v) else count


@inlined
def _follow(m: CarriedSteps, done: int) -> None:
    """Follow the coordinates from the cycle's begin to a step: positions before it, rates after it."""
    n, h, steps, offset = m.v.size, m.h, m.substeps, m.q.size - m.v.size
    degree = min(m.degree, int(m.memory[2 * n]))
    copy(m.q_begin, m.q_now)
    for i in range(m.n_slow):
        m.v_now[i], m.a_now[i] = m.v[i], m.a[i]
    for i in range(m.n_slow, n):
        line = (m.r[i] - m.memory[i]) / steps if degree > 0 else 0.0
        curve = (m.r[i] - 2.0 * m.memory[i] + m.memory[n + i]) / (2.0 * steps * steps) if degree > 1 else 0.0
        x, rate, a = m.q_begin[i + offset], m.v_begin[i] + h * m.begin[i], m.begin[i]
        for step in range(1, done + 1):
            x += h * rate
            a = m.r[i] + step * line + step * (step + steps) * curve - m.k[i] * x
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
    n, i = m.v.size, m.n_slow
    while i + 4 <= n:
        _remember_four(m, n, i)
        i += 4
    if i + 2 <= n:
        _remember_two(m, n, i)
        i += 2
    if i < n:
        _remember_one(m, n, i)
    m.memory[2 * n] = min(2.0, m.memory[2 * n] + 1.0)

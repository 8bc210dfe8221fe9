"""Solving for an open chain's accelerations, freezing them for sub-cycling, and moving its positions on."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.jit.compiled import addressed, inner, kernel, meaning
from pipeline.dynamics.jit.table import address_of, call
from pipeline.dynamics.links import FREE, SPHERICAL
from pipeline.dynamics.system import accelerations, advance, fast_steps, hold_slow, velocities
from pipeline.dynamics.tree.arrays import FrozenTree, TreeParameters
from pipeline.dynamics.tree.frames import move_through_joint, place_joint
from pipeline.dynamics.tree.kernels import add_body, add_point_load, mass_and_force


@inner
def factor(M: Array, first: int, n: int, L: Array) -> None:
    """``M = Lᵀ D L`` of the block from ``first`` to n - 1: L unit lower, D on its diagonal.

    Eliminated from the last coordinate back, a tree's mass matrix fills in nowhere (Featherstone 2008, section 6.3):
    modes of unit mass cost next to nothing.
    """
    for i in range(first, n):
        for j in range(first, i + 1):
            L[i, j] = M[i, j]
    for j in range(n - 1, first - 1, -1):
        pivot = L[j, j]
        if not pivot > 0.0:
            L[j, j] = math.nan  # no inertia: nothing that follows is a number, which the march reports
        for i in range(first, j):
            if L[j, i] != 0.0:
                part = L[j, i] / pivot
                for k in range(first, i + 1):
                    L[i, k] -= part * L[j, k]
        for i in range(first, j):
            L[j, i] /= pivot


@inner
def solve(L: Array, first: int, n: int, x: Array) -> None:
    """Solve with the factor's block from ``first`` to n - 1, in place."""
    for i in range(n - 1, first, -1):
        if x[i] != 0.0:
            for k in range(first, i):
                x[k] -= L[i, k] * x[i]
    for i in range(first, n):
        total = x[i] / L[i, i]
        for k in range(first, i):
            total -= L[i, k] * x[k]
        x[i] = total


@kernel
def solve_accelerations(p: TreeParameters, t: float, q: Array, v: Array, a: Array) -> None:
    """Form and solve ``M̂ a = Q̂``."""
    call(p.mass_and_force, (p, float(t), q, v))
    Q, L = p.Q, p.L
    for i in range(v.size):
        a[i] = Q[i]
    factor(p.M, 0, v.size, L)
    solve(L, 0, v.size, a)


@inner
def _hold(p: TreeParameters, t: float, q: Array, v: Array, a: Array, frozen: FrozenTree) -> None:
    M, Q, K, C, scalar_position, constant = p.M, p.Q, p.K, p.C, p.scalar_position, frozen.constant
    n, n_slow = v.size, frozen.n_slow
    factor(M, n_slow, n, frozen.L)
    frozen.single[0] = 0.0 if p.gripped else 1.0
    for i in range(n_slow, n):
        constant[i] = Q[i]
        for j in range(n_slow, n):
            constant[i] += K[i, j] * q[scalar_position[j]] + C[i, j] * v[j]
        for j in range(n_slow):
            constant[i] -= M[i, j] * a[j]
        for j in range(n_slow, i):
            if M[i, j] != 0.0:
                frozen.single[0] = 0.0


@addressed
def fast_march(frozen: FrozenTree, h: float, count: int, q: Array, v: Array, a: Array) -> None:
    """Take ``count`` leapfrog steps h with the fast coordinates' frozen equation."""
    constant, v_now, K, C, L = frozen.constant, frozen.v_now, frozen.K, frozen.C, frozen.L
    n, offset, n_slow = v.size, q.size - v.size, frozen.n_slow
    for _ in range(count):
        if frozen.single[0] != 0.0:  # each fast coordinate by itself
            for i in range(n_slow, n):
                v_now[i] = v[i] + 0.5 * h * a[i]
                a[i] = (constant[i] - K[i, i] * q[i + offset] - C[i, i] * v_now[i]) / L[i, i]
                v[i] += h * a[i]
                q[i + offset] += h * v[i]
            continue
        for i in range(n_slow, n):
            v_now[i] = v[i] + 0.5 * h * a[i]
        for i in range(n_slow, n):
            total = constant[i]
            for j in range(n_slow, n):
                total -= K[i, j] * q[j + offset] + C[i, j] * v_now[j]
            a[i] = total
        solve(L, n_slow, n, a)
        for i in range(n_slow, n):
            v[i] += h * a[i]
            q[i + offset] += h * v[i]


@inner
def _move(p: TreeParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    scalar_position, joint, rate, position = p.scalar_position, p.joint, p.rate, p.position
    for i in range(first, last):
        if scalar_position[i] >= 0:
            q[scalar_position[i]] += h * v[i]
    for b in range(joint.size):
        turn = rate[b] + (3 if joint[b] == FREE else 0)
        if joint[b] in (SPHERICAL, FREE) and first <= turn < last:
            _advance_quaternion(q, position[b] + (3 if joint[b] == FREE else 0), v, turn, h)


@inner
def _differentiate(p: TreeParameters, q: Array, v: Array, dq: Array) -> None:
    scalar_position, joint, rate, position = p.scalar_position, p.joint, p.rate, p.position
    for i in range(v.size):
        if scalar_position[i] >= 0:
            dq[scalar_position[i]] = v[i]
    for b in range(joint.size):
        if joint[b] in (SPHERICAL, FREE):
            skip = 3 if joint[b] == FREE else 0
            _quaternion_rate(q, position[b] + skip, v, rate[b] + skip, dq)


@inner
def _quaternion_rate(q: Array, at: int, v: Array, turn: int, dq: Array) -> None:
    """``½ e ∘ (ω, 0)`` for rates ω about the body's own axes."""
    wx, wy, wz = 0.5 * v[turn], 0.5 * v[turn + 1], 0.5 * v[turn + 2]
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    dq[at] = w * wx + y * wz - z * wy
    dq[at + 1] = w * wy - x * wz + z * wx
    dq[at + 2] = w * wz + x * wy - y * wx
    dq[at + 3] = -x * wx - y * wy - z * wz


@inner
def _advance_quaternion(q: Array, at: int, v: Array, turn: int, h: float) -> None:
    """Turn the unit quaternion at ``q[at]`` by h times the body's own rates; the only place where one changes."""
    wx, wy, wz = 0.5 * h * v[turn], 0.5 * h * v[turn + 1], 0.5 * h * v[turn + 2]
    size = math.sqrt(wx * wx + wy * wy + wz * wz)
    s, c = (math.sin(size) / size, math.cos(size)) if size > 1e-12 else (1.0, 1.0)
    wx, wy, wz = s * wx, s * wy, s * wz
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    e0 = w * wx + x * c + y * wz - z * wy
    e1 = w * wy - x * wz + y * c + z * wx
    e2 = w * wz + x * wy - y * wx + z * c
    e3 = w * c - x * wx - y * wy - z * wz
    norm = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    q[at], q[at + 1], q[at + 2], q[at + 3] = norm * e0, norm * e1, norm * e2, norm * e3


def with_kernels(p: TreeParameters) -> TreeParameters:
    """Give parameters with room the addresses of their kernels; compiles them, or reads them."""
    v = np.zeros(len(p.load))
    return replace(
        p,
        place_joint=address_of(place_joint, p, 0, v, v, p.R0),
        move_through_joint=address_of(move_through_joint, p, 0.0, 0, v, v, p.R0),
        add_body=address_of(add_body, p, 0, v, v),
        add_point_load=address_of(add_point_load, p, 0.0, 0, v) if len(p.at_body) else 0,
        mass_and_force=address_of(mass_and_force, p, 0.0, v, v),
        solve_accelerations=address_of(solve_accelerations, p, 0.0, v, v, v),
    )


def frozen_with_kernels(frozen: FrozenTree) -> FrozenTree:
    """Give storage of a major cycle the address of its kernel."""
    v = frozen.constant
    return replace(frozen, march=address_of(fast_march, frozen, 0.0, 0, v, v, v))


# What the integrators call is no more than a call: inlined into each of them, all this would compile over and over.


@meaning(accelerations, TreeParameters)
def _accelerations(p: TreeParameters, t: float, q: Array, v: Array, a: Array) -> None:
    call(p.solve_accelerations, (p, float(t), q, v, a))


@meaning(hold_slow, TreeParameters)
def _hold_slow(p: TreeParameters, t: float, q: Array, v: Array, a: Array, frozen: FrozenTree) -> None:
    _hold(p, t, q, v, a, frozen)


@meaning(fast_steps, TreeParameters)
def _fast_steps(
    p: TreeParameters, frozen: FrozenTree, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    call(frozen.march, (frozen, float(h), count, q, v, a))


@meaning(advance, TreeParameters)
def _advance(p: TreeParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    _move(p, q, v, h, first, last)


@meaning(velocities, TreeParameters)
def _velocities(p: TreeParameters, q: Array, v: Array, dq: Array) -> None:
    _differentiate(p, q, v, dq)

"""Solving for an open chain's accelerations, freezing them for sub-cycling, and moving its positions on."""

from __future__ import annotations

import math

from pipeline.checks import Array
from pipeline.dynamics.compiled import kernel, meaning
from pipeline.dynamics.system import accelerations, advance, fast_steps, freeze, velocities
from pipeline.dynamics.tree import FREE, SPHERICAL, FrozenTree, TreeParameters
from pipeline.dynamics.tree_kernels import mass_and_force


@kernel
def _factor(M: Array, first: int, L: Array) -> None:
    """Cholesky factor of the block of M from ``first`` on, into the same place of L."""
    for i in range(first, M.shape[0]):
        for j in range(first, i + 1):
            total = M[i, j]
            for k in range(first, j):
                total -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]


@kernel
def _solve(L: Array, first: int, x: Array) -> None:
    """Solve with the factor's block from ``first`` on, in place."""
    n = L.shape[0]
    for i in range(first, n):
        total = x[i]
        for k in range(first, i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]
    for i in range(n - 1, first - 1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]


@kernel
def _solve_all(p: TreeParameters, t: float, q: Array, v: Array, a: Array) -> None:
    mass_and_force(p, t, q, v)
    Q, L = p.Q, p.L
    for i in range(v.size):
        a[i] = Q[i]
    _factor(p.M, 0, L)
    _solve(L, 0, a)


@kernel
def _hold(p: TreeParameters, t: float, q: Array, v: Array, a: Array, frozen: FrozenTree) -> None:
    M, Q, L, K, C, scalar_position = p.M, p.Q, p.L, p.K, p.C, p.scalar_position
    constant, column = frozen.constant, frozen.column
    n = v.size
    n_slow = n - frozen.B.shape[0]
    _factor(M, n_slow, L)
    for i in range(n_slow, n):
        constant[i] = Q[i]
        for j in range(n_slow, n):
            constant[i] += K[i, j] * q[scalar_position[j]] + C[i, j] * v[j]
        for j in range(n_slow):
            constant[i] -= M[i, j] * a[j]
    _solve(L, n_slow, constant)
    _divide(L, n_slow, K, column, frozen.B)
    if p.damped:
        _divide(L, n_slow, C, column, frozen.D)


@kernel
def _divide(L: Array, first: int, A: Array, column: Array, out: Array) -> None:
    """Solve for the columns of A's block from ``first`` on, into out."""
    n = L.shape[0]
    for j in range(first, n):
        for i in range(first, n):
            column[i] = A[i, j]
        _solve(L, first, column)
        for i in range(first, n):
            out[i - first, j - first] = column[i]


@kernel
def _fast_march(
    p: TreeParameters, frozen: FrozenTree, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    constant, B, D, v_now = frozen.constant, frozen.B, frozen.D, frozen.column
    n, offset = v.size, q.size - v.size
    n_slow = n - B.shape[0]
    for _ in range(count):
        for i in range(n_slow, n):
            v_now[i] = v[i] + 0.5 * h * a[i]
        for i in range(n_slow, n):
            total = constant[i]
            for j in range(n_slow, n):
                total -= B[i - n_slow, j - n_slow] * q[j + offset]
            if p.damped:
                for j in range(n_slow, n):
                    total -= D[i - n_slow, j - n_slow] * v_now[j]
            a[i] = total
        for i in range(n_slow, n):
            v[i] += h * a[i]
            q[i + offset] += h * v[i]


@kernel
def _move(p: TreeParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    scalar_position, joint, rate, position = p.scalar_position, p.joint, p.rate, p.position
    for i in range(first, last):
        if scalar_position[i] >= 0:
            q[scalar_position[i]] += h * v[i]
    for b in range(joint.size):
        turn = rate[b] + (3 if joint[b] == FREE else 0)
        if joint[b] in (SPHERICAL, FREE) and first <= turn < last:
            _advance_quaternion(q, position[b] + (3 if joint[b] == FREE else 0), v, turn, h)


@kernel
def _differentiate(p: TreeParameters, q: Array, v: Array, dq: Array) -> None:
    scalar_position, joint, rate, position = p.scalar_position, p.joint, p.rate, p.position
    for i in range(v.size):
        if scalar_position[i] >= 0:
            dq[scalar_position[i]] = v[i]
    for b in range(joint.size):
        if joint[b] in (SPHERICAL, FREE):
            skip = 3 if joint[b] == FREE else 0
            _quaternion_rate(q, position[b] + skip, v, rate[b] + skip, dq)


@kernel
def _quaternion_rate(q: Array, at: int, v: Array, turn: int, dq: Array) -> None:
    """``½ e ∘ (ω, 0)`` for rates ω about the body's own axes."""
    wx, wy, wz = 0.5 * v[turn], 0.5 * v[turn + 1], 0.5 * v[turn + 2]
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    dq[at] = w * wx + y * wz - z * wy
    dq[at + 1] = w * wy - x * wz + z * wx
    dq[at + 2] = w * wz + x * wy - y * wx
    dq[at + 3] = -x * wx - y * wy - z * wz


@kernel
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


# What the integrators call is no more than a call: inlined into each of them, all this would compile over and over.


@meaning(accelerations, TreeParameters)
def _accelerations(p: TreeParameters, t: float, q: Array, v: Array, a: Array) -> None:
    _solve_all(p, t, q, v, a)


@meaning(freeze, TreeParameters)
def _freeze(p: TreeParameters, t: float, q: Array, v: Array, a: Array, frozen: FrozenTree) -> None:
    _hold(p, t, q, v, a, frozen)


@meaning(fast_steps, TreeParameters)
def _fast_steps(
    p: TreeParameters, frozen: FrozenTree, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    _fast_march(p, frozen, first, h, count, q, v, a)


@meaning(advance, TreeParameters)
def _advance(p: TreeParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    _move(p, q, v, h, first, last)


@meaning(velocities, TreeParameters)
def _velocities(p: TreeParameters, q: Array, v: Array, dq: Array) -> None:
    _differentiate(p, q, v, dq)

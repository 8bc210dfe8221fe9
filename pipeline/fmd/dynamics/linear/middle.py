"""Kernels of reversible sub-cycling for a linear system, whose major cycles are held at their middles."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.jit.compiled import meaning
from fmd.dynamics.linear.parameters import LinearParameters, MiddleLinear
from fmd.dynamics.system import hold_middle, reacting_steps, slow_response


def middle_of(M: Array, K: Array, C: Array, n_slow: int) -> MiddleLinear:
    """Return the constants of reversible sub-cycling for ``M q̈ + C q̇ + K q = 0``, and new work arrays."""
    n, L, S = len(M), slice(0, n_slow), slice(n_slow, None)
    D = np.linalg.solve(M[L, L], M[L, S])  # (n_slow, n_fast)
    T = np.concatenate([-D, np.eye(n - n_slow)])
    rows = np.concatenate([np.zeros((n_slow, n_slow)), D.T])
    W, V = np.linalg.inv(T.T @ M @ T), np.linalg.inv(M[L, L])
    arrays = (rows, W, V, T, K @ T, C @ T)
    return MiddleLinear(*(np.asfortranarray(a) for a in arrays), *np.zeros((5, n)))


@meaning(hold_middle, LinearParameters)
def _hold_middle(p: LinearParameters, t: float, q: Array, v: Array, D: Array, middle: MiddleLinear) -> None:
    K, C, Q = p.K, p.C, middle.Q
    for i in range(v.size):
        Q[i], middle.q[i], middle.v[i] = 0.0, q[i], v[i]
        for j in range(p.n_slow):
            D[i, j] = middle.D[i, j]
    for j in range(v.size):  # by columns, as the matrices lie in memory
        for i in range(v.size):
            Q[i] -= K[i, j] * q[j]
    for j in range(C.shape[1]):
        for i in range(v.size):
            Q[i] -= C[i, j] * v[j]


@meaning(reacting_steps, LinearParameters)
def _reacting_steps(
    p: LinearParameters, middle: MiddleLinear, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    W, T, K, C, Q, now, right, n_slow = (
        middle.W,
        middle.T,
        middle.K,
        middle.C,
        middle.Q,
        middle.now,
        middle.right,
        p.n_slow,
    )
    n, fast = v.size, a[n_slow:]
    for _ in range(count):
        for j in range(n_slow, n):
            now[j] = v[j] + 0.5 * h * a[j] - middle.v[j]
        for i in range(n):
            right[i] = Q[i]
        for j in range(n_slow, n):
            moved = q[j] - middle.q[j]
            for i in range(n):
                right[i] -= K[i, j - n_slow] * moved
        if p.C.shape[1]:
            for j in range(n_slow, n):
                for i in range(n):
                    right[i] -= C[i, j - n_slow] * now[j]
        for j in range(n_slow, n):  # below its first rows T is the unit matrix
            now[j] = right[j]
            for i in range(n_slow):
                now[j] += T[i, j - n_slow] * right[i]
            a[j] = 0.0
        for j in range(n_slow, n):
            for i in range(n - n_slow):
                fast[i] += W[i, j - n_slow] * now[j]
        for i in range(n_slow, n):
            v[i] += h * a[i]
            q[i] += h * v[i]


@meaning(slow_response, LinearParameters)
def _slow_response(
    p: LinearParameters, middle: MiddleLinear, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    V, K, C, Q, right, n_slow = middle.V, middle.K, middle.C, middle.Q, middle.right, p.n_slow
    for i in range(n_slow):
        right[i] = Q[i]
        for j in range(n_slow, v.size):
            right[i] -= K[i, j - n_slow] * (q[j] - middle.q[j]) + C[i, j - n_slow] * (v[j] - middle.v[j])
    for i in range(n_slow):
        a[i] = 0.0
        for j in range(n_slow):
            a[i] += V[i, j] * right[j]

"""An open chain over a major cycle that is frozen at its middle: what reversible sub-cycling needs of it."""

from __future__ import annotations

from pipeline.core.arrays import Array
from pipeline.dynamics.jit.compiled import inner, meaning
from pipeline.dynamics.jit.table import call
from pipeline.dynamics.system import hold_middle, reacting_steps, slow_response
from pipeline.dynamics.tree.arrays import MiddleTree, TreeParameters
from pipeline.dynamics.tree.solve import factor, fast_march, solve
from pipeline.dynamics.tree.tangents import velocity_tangents


@inner
def _hold(p: TreeParameters, t: float, q: Array, v: Array, D: Array, middle: MiddleTree) -> None:
    fast, M, L, Q, K, C, T = middle.fast, p.M, middle.L, middle.Q, middle.K, middle.C, middle.T
    n, n_slow, offset = v.size, fast.n_slow, q.size - v.size
    call(p.mass_and_force, (p, float(t), q, v))
    factor(M, 0, n_slow, L)
    for i in range(n):
        Q[i], middle.v[i] = p.Q[i], v[i]
    for j in range(n_slow, n):
        middle.q[j] = q[j + offset]
        for i in range(n_slow):
            D[j, i] = M[j, i]
        solve(L, 0, n_slow, D[j])
        for i in range(n):
            T[j, i] = -D[j, i] if i < n_slow else 0.0
        T[j, j] = 1.0
    for j in range(n_slow, n):
        for k in range(n_slow, j + 1):
            for i in range(n_slow):
                M[j, k] -= M[j, i] * D[k, i]
    factor(M, n_slow, n, fast.L)
    for i in range(n):
        for j in range(n_slow, n):
            K[j, i] = 0.0
            for k in range(n):
                K[j, i] += p.K[i, k] * T[j, k]
    velocity_tangents(p, t, q, v, T, n_slow, middle.carried, middle.room, C)
    _condense(D, n_slow, K, fast.K)
    _condense(D, n_slow, C, fast.C)
    fast.single[0] = 1.0
    for i in range(n_slow, n):
        total = Q[i]
        for k in range(n_slow):
            total -= D[i, k] * Q[k]
        for j in range(n_slow, n):
            total += fast.K[i, j] * middle.q[j] + fast.C[i, j] * v[j]
            if j != i and (fast.K[i, j] != 0.0 or fast.C[i, j] != 0.0 or fast.L[max(i, j), min(i, j)] != 0.0):
                fast.single[0] = 0.0
        fast.constant[i] = total


@inner
def _condense(D: Array, n_slow: int, A: Array, out: Array) -> None:
    """``out = Tᵀ Aᵀ``, fast rows of fast columns."""
    n = D.shape[0]
    for i in range(n_slow, n):
        for j in range(n_slow, n):
            total = A[j, i]
            for k in range(n_slow):
                total -= D[i, k] * A[j, k]
            out[i, j] = total


@inner
def _respond(middle: MiddleTree, q: Array, v: Array, a: Array) -> None:
    Q, K, C, q_middle, v_middle, n_slow = middle.Q, middle.K, middle.C, middle.q, middle.v, middle.fast.n_slow
    for i in range(n_slow):
        total = Q[i]
        for j in range(n_slow, v.size):
            total -= K[j, i] * (q[j] - q_middle[j]) + C[j, i] * (v[j] - v_middle[j])
        a[i] = total
    solve(middle.L, 0, n_slow, a)


@meaning(hold_middle, TreeParameters)
def _hold_middle(p: TreeParameters, t: float, q: Array, v: Array, D: Array, middle: MiddleTree) -> None:
    _hold(p, t, q, v, D, middle)


@meaning(reacting_steps, TreeParameters)
def _reacting_steps(
    p: TreeParameters, middle: MiddleTree, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    fast_march(middle.fast, h, count, q, v, a)


@meaning(slow_response, TreeParameters)
def _slow_response(
    p: TreeParameters, middle: MiddleTree, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    _respond(middle, q, v, a)

"""Reversible sub-cycling of a compiled mechanism: its equations at a major cycle's middle, the slow ones reacting.

With ``D = M_LL⁻¹ M_LS`` and ``T = (−D, 1)`` the fast equation is ``S̄ a_S = Tᵀ Q̂`` with ``S̄ = M_SS − M_SL D``, and Q̂
is carried on by its exact tangents along T.
"""

from __future__ import annotations

import math

from pipeline.core.arrays import Array
from pipeline.dynamics.compiled_system.held import step_all, step_single, take_tangents
from pipeline.dynamics.compiled_system.kernels import set_inputs
from pipeline.dynamics.compiled_system.parameters import CompiledParameters, MiddleCycle
from pipeline.dynamics.jit.compiled import inner, meaning
from pipeline.dynamics.jit.native import call_native
from pipeline.dynamics.system import accelerations, hold_middle, reacting_steps, slow_response, velocities

_LANES = 8


@inner
def _factor(A: Array) -> None:
    """Cholesky's factor of a symmetric matrix into its lower triangle; not a number where it isn't positive."""
    for j in range(A.shape[0]):
        for i in range(j, A.shape[0]):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
        A[j, j] = math.sqrt(A[j, j]) if A[j, j] > 0.0 else math.nan
        for i in range(j + 1, A.shape[0]):
            A[i, j] /= A[j, j]


@inner
def _solve(L: Array, x: Array, first: int) -> None:
    """Solve with Cholesky's factor for the entries from ``first`` on, in place."""
    n = L.shape[0]
    for i in range(n):
        for k in range(i):
            x[first + i] -= L[i, k] * x[first + k]
        x[first + i] /= L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[first + i] -= L[k, i] * x[first + k]
        x[first + i] /= L[i, i]


@inner
def _take_mass(p: CompiledParameters, middle: MiddleCycle, q: Array) -> None:
    """Fill the mass matrix column by column."""
    d, n = middle.held.directions, middle.M.shape[0]
    for first in range(0, n, _LANES):
        for j in range(first, min(first + _LANES, n)):
            d.da[j, j - first] = 1.0
        call_native(d.inertia, (p.inputs, q, d.da, d.dr))
        for j in range(first, min(first + _LANES, n)):
            d.da[j, j - first] = 0.0
            for i in range(n):
                middle.M[j, i] = d.dr[i, j - first]


@inner
def _eliminate(middle: MiddleCycle, D: Array) -> None:
    """Compute D, T and the factors of M_LL and S̄."""
    M, L, S, T, n_slow, n = middle.M, middle.L, middle.S, middle.T, middle.L.shape[0], middle.M.shape[0]
    for i in range(n_slow):
        for j in range(n_slow):
            L[i, j] = M[i, j]
    _factor(L)
    for j in range(n_slow, n):
        for i in range(n_slow):
            D[j, i] = M[j, i]
        _solve(L, D[j], 0)
        for i in range(n):
            T[j - n_slow, i] = -D[j, i] if i < n_slow else 0.0
        T[j - n_slow, j] = 1.0
    for j in range(n_slow, n):
        for i in range(n_slow, n):
            total = M[i, j]
            for k in range(n_slow):
                total -= M[j, k] * D[i, k]
            S[j - n_slow, i - n_slow] = total
    _factor(S)


@inner
def _take_tangents_along(p: CompiledParameters, middle: MiddleCycle, q: Array, v: Array) -> None:
    """Fill ``KT`` and ``CT``, the tangents of −Q̂ along the rows of T."""
    d, T, moved = middle.held.directions, middle.T, middle.held.moved
    n, n_fast = v.size, T.shape[0]
    n_columns = 2 * n_fast if middle.held.damped else n_fast
    for first in range(0, n_columns, _LANES):
        last = min(first + _LANES, n_columns)
        d.dq[:] = 0.0
        d.dv[:] = 0.0
        for column in range(first, last):
            if column < n_fast:
                velocities(p, q, T[column], moved)
                for i in range(q.size):
                    d.dq[i, column - first] = moved[i]
            else:
                for i in range(n):
                    d.dv[i, column - first] = T[column - n_fast, i]
        take_tangents(p, d, q, v)
        for column in range(first, last):
            out = middle.KT[column] if column < n_fast else middle.CT[column - n_fast]
            for i in range(n):
                out[i] = d.dr[i, column - first]


@inner
def _condense(middle: MiddleCycle, of_all: Array, out: Array) -> None:
    """``out = S̄⁻¹ Tᵀ x`` for the rows x of a matrix."""
    n_slow, n_fast, T = middle.L.shape[0], middle.T.shape[0], middle.T
    for j in range(n_fast):
        for i in range(n_fast):
            total = of_all[j, n_slow + i]
            for k in range(n_slow):
                total += T[i, k] * of_all[j, k]
            out[j, i] = total
        _solve(middle.S, out[j], 0)


@inner
def _hold_loose(p: CompiledParameters, q: Array, v: Array, middle: MiddleCycle) -> None:
    """Hold fast coordinates that couple neither with each other nor with the slow ones through the mass matrix."""
    held, a = middle.held, middle.a
    d, offset = held.directions, q.size - v.size
    for i in range(held.n_slow, v.size):
        d.dq[i + offset, 1], d.dv[i, 2] = 1.0, 1.0
    take_tangents(p, d, q, v)
    for i in range(held.n_slow, v.size):
        over = 1.0 / held.mass[i]
        k, c = over * d.dr[i, 1], over * d.dr[i, 2] if held.damped else 0.0
        held.k[i], held.c[i], held.slope[i] = k, c, 0.0
        held.constant[i] = a[i] + k * q[i + offset] + c * v[i]


@inner
def _hold_coupled(p: CompiledParameters, q: Array, v: Array, D: Array, middle: MiddleCycle) -> None:
    held, a, M, T, Q = middle.held, middle.a, middle.M, middle.T, middle.Q
    n, n_slow, offset = v.size, held.n_slow, q.size - v.size
    _take_mass(p, middle, q)
    _eliminate(middle, D)
    _take_tangents_along(p, middle, q, v)
    _condense(middle, middle.KT, held.K)
    if held.damped:
        _condense(middle, middle.CT, held.C)
    for i in range(n):
        Q[i] = 0.0
        for j in range(n):
            Q[i] += M[j, i] * a[j]
    for i in range(n_slow, n):
        total = Q[i]
        for k in range(n_slow):
            total += T[i - n_slow, k] * Q[k]
        held.constant[i], held.slope[i] = total, 0.0
    _solve(middle.S, held.constant, n_slow)
    for j in range(n - n_slow):
        for i in range(n - n_slow):
            held.constant[n_slow + i] += held.K[j, i] * q[n_slow + offset + j]
            if held.damped:
                held.constant[n_slow + i] += held.C[j, i] * v[n_slow + j]


@meaning(hold_middle, CompiledParameters)
def _hold_middle(p: CompiledParameters, t: float, q: Array, v: Array, D: Array, middle: MiddleCycle) -> None:
    middle.held.time[0] = t
    accelerations(p, t, q, v, middle.a)
    set_inputs(p, float(t))
    for i in range(q.size):
        middle.q[i] = q[i]
    for i in range(v.size):
        middle.v[i] = v[i]
    middle.fresh[0] = 1.0
    if middle.loose:
        _hold_loose(p, q, v, middle)
    else:
        _hold_coupled(p, q, v, D, middle)


@meaning(reacting_steps, CompiledParameters)
def _reacting_steps(
    p: CompiledParameters, middle: MiddleCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    if middle.loose:
        step_single(middle.held, first, h, count, middle.fresh[0] != 0.0, q, v, a)
    else:
        step_all(p, middle.held, first, h, count, q, v, a)
    middle.fresh[0] = 0.0


@meaning(slow_response, CompiledParameters)
def _slow_response(
    p: CompiledParameters, middle: MiddleCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    n_slow, n, offset = middle.held.n_slow, v.size, middle.q.size - v.size
    if middle.loose:  # D is zero: the slow equations by themselves
        for j in range(n_slow, n):
            middle.q[j + offset], middle.v[j] = q[j], v[j]
        accelerations(p, middle.held.time[0], middle.q, middle.v, middle.a)
        for i in range(n_slow):
            a[i] = middle.a[i]
        return
    for i in range(n_slow):
        total = middle.Q[i]
        for j in range(n_slow, n):
            total -= middle.KT[j - n_slow, i] * (q[j] - middle.q[j + offset])
            if middle.held.damped:
                total -= middle.CT[j - n_slow, i] * (v[j] - middle.v[j])
        a[i] = total
    _solve(middle.L, a, 0)

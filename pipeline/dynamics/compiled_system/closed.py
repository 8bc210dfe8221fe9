"""Accelerations, steps and projection of a compiled mechanism with loops.

The constraints are kept at the level of accelerations (index 1), and positions and rates are projected onto them after
each step, the shortest way by the mass matrix (Eich, SIAM J Numer Anal 30, 1993). ``S = J M̂⁻¹ Jᵀ`` is factored with
pivots, which leaves redundant constraints out: that is QR with column pivoting of ``L⁻¹ Jᵀ``, M̂ = L Lᵀ. Which ones they
are is decided at a step's begin, on the constraints, and kept for its stages.
"""

from __future__ import annotations

import math

from pipeline.core.arrays import Array
from pipeline.dynamics.compiled_system.kernels import set_inputs
from pipeline.dynamics.compiled_system.parameters import ClosedParameters, Leapfrog
from pipeline.dynamics.compiler.program import LANES
from pipeline.dynamics.jit.compiled import inner, meaning
from pipeline.dynamics.jit.native import call_native
from pipeline.dynamics.system import accelerations, advance, leapfrog_step, project

_DEPENDENT = 1e-8  # of the largest pivot, the square of the ratio of lengths
_NO_PIVOT = 1e-14  # beside what free bodies would do
_CLOSED = 1e-14  # gap that is round-off [m or rad]
_FAILED = 1e-8  # gap after the last correction
_CORRECTIONS = 8
_FAR = 1e-7  # gap from which on the constraints are linearised anew


@inner
def _spread(p: ClosedParameters, q: Array, first: int) -> None:
    """Compute X and S, from a block of unit multipliers on."""
    for block in range(first, p.units.shape[0]):
        call_native(p.multipliers, (p.inputs, q, p.units[block], p.x[block], p.s[block]))


@inner
def _factor(p: ClosedParameters) -> None:
    """Factor the scaled S in the order of its pivots: row i of the factor has entry k at ``S[i, order[k]]``."""
    n, S, order, fresh = p.S.shape[0], p.S, p.order, p.fresh[0] != 0.0
    for i in range(n):
        for j in range(n):
            S[i, j] = p.s[j // LANES, i, j % LANES] * p.scale[i] * p.scale[j]
    if fresh:
        p.rank[0] = n
        for k in range(n):
            order[k] = k
    top, p.fresh[0] = 0.0, 0.0
    for k in range(n):
        if fresh:
            best = k
            for i in range(k + 1, n):
                if S[order[i], order[i]] > S[order[best], order[best]]:
                    best = i
            order[k], order[best] = order[best], order[k]
            pivot = S[order[k], order[k]]
            top = max(top, pivot)
            if not pivot > max(_DEPENDENT * top, _NO_PIVOT):
                p.rank[0] = k
        if k >= p.rank[0]:
            return
        row = order[k]
        S[row, row] = math.sqrt(S[row, row])
        for i in range(k + 1, n):
            S[order[i], row] /= S[row, row]
        for i in range(k + 1, n):
            for j in range(k + 1, n):
                S[order[i], order[j]] -= S[order[i], row] * S[order[j], row]


@inner
def _push(p: ClosedParameters, w: Array) -> None:
    """Solve ``S λ = −w`` for the independent constraints, the others' λ being 0, and ``push = X λ``."""
    rank, S, order, y = p.rank[0], p.S, p.order, p.room
    for k in range(w.size):
        p.multiplier[k] = 0.0
    for k in range(rank):
        row = order[k]
        y[k] = -w[row] * p.scale[row]
        for j in range(k):
            y[k] -= S[row, order[j]] * y[j]
        y[k] /= S[row, row]
    for k in range(rank - 1, -1, -1):
        row = order[k]
        for i in range(k + 1, rank):
            y[k] -= S[order[i], row] * y[i]
        y[k] /= S[row, row]
    for k in range(rank):
        p.multiplier[order[k]] = y[k] * p.scale[order[k]]
    for i in range(p.push.size):
        p.push[i] = 0.0
    for k in range(rank):
        row = order[k]
        block, lane, size = row // LANES, row % LANES, p.multiplier[row]
        for i in range(p.push.size):
            p.push[i] += p.x[block, i, lane] * size


@meaning(accelerations, ClosedParameters)
def _accelerations(p: ClosedParameters, t: float, q: Array, v: Array, a: Array) -> None:
    set_inputs(p, float(t))
    call_native(p.closed, (p.inputs, q, v, p.units[0], a, p.w, p.x[0], p.s[0]))
    _spread(p, q, 1)
    _factor(p)
    _push(p, p.w)
    for i in range(a.size):
        a[i] += p.push[i]


@inner
def _widest(values: Array) -> float:
    """Return the largest value, NaN if one is."""
    widest = 0.0
    for k in range(values.size):
        if not abs(values[k]) <= widest:
            widest = abs(values[k])
    return widest


@meaning(project, ClosedParameters)
def _project(p: ClosedParameters, t: float, q: Array, v: Array) -> None:
    set_inputs(p, float(t))
    last = math.inf
    for k in range(_CORRECTIONS + 1):
        call_native(p.gaps, (p.inputs, q, v, p.g, p.rates))
        widest = _widest(p.g)
        if k == 0 or widest > _FAR:
            p.fresh[0] = 1.0
            _spread(p, q, 0)
            _factor(p)
        if widest <= _CLOSED or (widest <= _FAILED and widest > 0.3 * last):
            break
        if k == _CORRECTIONS or not widest < math.inf:
            v[0] = math.nan  # which ends the march
            break
        last = widest
        _push(p, p.g)
        advance(p, q, p.push, 1.0, 0, v.size)
    for _ in range(2):  # the second takes the first one's round-off away
        call_native(p.gaps, (p.inputs, q, v, p.g, p.rates))
        _push(p, p.rates)
        for i in range(v.size):
            v[i] += p.push[i]
    p.fresh[0] = 1.0


@meaning(leapfrog_step, ClosedParameters)
def _leapfrog_step(p: ClosedParameters, leapfrog: Leapfrog, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Take a leapfrog step whose constraint forces, along Jᵀ at its begin, close the gaps at its end.

    That is SHAKE (Ryckaert, Ciccotti & Berendsen, J Comput Phys 23, 1977).
    """
    for i in range(v.size):
        leapfrog.v_now[i] = v[i] + 0.5 * h * a[i]
    p.fresh[0] = 1.0
    accelerations(p, t, q, leapfrog.v_now, a)
    for i in range(v.size):
        v[i] += h * a[i]
    advance(p, q, v, h, 0, v.size)
    set_inputs(p, t + h)
    last = math.inf
    for _ in range(_CORRECTIONS):
        call_native(p.gaps, (p.inputs, q, v, p.g, p.rates))
        widest = _widest(p.g)
        if widest <= _CLOSED or (widest <= _FAILED and widest > 0.3 * last):
            return
        last = widest
        _push(p, p.g)
        advance(p, q, p.push, 1.0, 0, v.size)
        for i in range(v.size):
            v[i] += p.push[i] / h
            a[i] += p.push[i] / (h * h)
    v[0] = math.nan  # which ends the march

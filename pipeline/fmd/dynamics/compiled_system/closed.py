"""Accelerations, steps and projection of a compiled mechanism with loops.

The constraints are kept at the level of accelerations (index 1), and positions and rates are projected onto them after
each step, the shortest way by the mass matrix (Eich, SIAM J Numer Anal 30, 1993). ``S = J M̂⁻¹ Jᵀ`` is factored with
pivots, which leaves redundant constraints out: that is QR with column pivoting of ``L⁻¹ Jᵀ``, M̂ = L Lᵀ. Which ones they
are is decided at a step's begin, on the constraints, and kept for its stages.
"""

from __future__ import annotations

import math
from functools import singledispatch
from typing import Any

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.newton import NOT_PROJECTED, PROJECTED, PROJECTIONS, RELINEARISED
from fmd.core.limits.rank import DEPENDENT_PIVOT, NO_PIVOT
from fmd.core.limits.stepping import STILL_GROUP
from fmd.core.newton import settles
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import ClosedParameters, Multipliers
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import (
    accelerations,
    advance,
    choose_constraints_anew,
    note_held,
    project,
    project_onto_constraints,
)
from fmd.kernels.arrays import clear
from fmd.kernels.kernel import inlined, inner
from fmd.kernels.vectors import call_native

_settles = inlined(settles)


@inner
def _spread(p: ClosedParameters, q: Array, first: int) -> None:
    """Compute X and S, from a block of unit Lagrange multipliers on."""
    for block in range(first, p.units.shape[0]):
        call_native(p.multipliers, (p.inputs, q, p.units[block], p.whole.x[block], p.whole.s[block]))


@inner
def _factor(m: Multipliers) -> None:
    """Factor the scaled S in the order of its pivots: row i of the factor has entry k at ``S[i, order[k]]``."""
    n, S, order, fresh = m.S.shape[0], m.S, m.order, m.fresh[0] != 0.0
    for i in range(n):
        for j in range(n):
            S[i, j] = m.s[j // LANES, i, j % LANES] * m.scale[i] * m.scale[j]
    if fresh:
        m.rank[0] = n
        for k in range(n):
            order[k] = k
    top, m.fresh[0] = 0.0, 0.0
    for k in range(n):
        if fresh:
            best = k
            for i in range(k + 1, n):
                if S[order[i], order[i]] > S[order[best], order[best]]:
                    best = i
            order[k], order[best] = order[best], order[k]
            pivot = S[order[k], order[k]]
            top = max(top, pivot)
            if not pivot > max(DEPENDENT_PIVOT * top, NO_PIVOT):
                m.rank[0] = k
        if k >= m.rank[0]:
            return
        row = order[k]
        S[row, row] = math.sqrt(S[row, row])
        for i in range(k + 1, n):
            S[order[i], row] /= S[row, row]
        for i in range(k + 1, n):
            for j in range(k + 1, n):
                S[order[i], order[j]] -= S[order[i], row] * S[order[j], row]


@inner
def factor_constraints(p: ClosedParameters, q: Array) -> None:
    """Compute X and S at positions, and factor S with new pivots."""
    p.whole.fresh[0] = 1.0
    _spread(p, q, 0)
    _factor(p.whole)


@inner
def push(m: Multipliers, w: Array) -> None:
    """Solve ``S λ = −w`` for the independent constraints, the others' λ being 0, and ``push = X λ``."""
    rank, S, order, y = m.rank[0], m.S, m.order, m.room
    clear(m.multiplier)
    for k in range(rank):
        row = order[k]
        y[k] = -w[row] * m.scale[row]
        for j in range(k):
            y[k] -= S[row, order[j]] * y[j]
        y[k] /= S[row, row]
    for k in range(rank - 1, -1, -1):
        row = order[k]
        for i in range(k + 1, rank):
            y[k] -= S[order[i], row] * y[i]
        y[k] /= S[row, row]
    for k in range(rank):
        m.multiplier[order[k]] = y[k] * m.scale[order[k]]
        m.total[order[k]] += m.multiplier[order[k]]
    pull(m, m.multiplier, m.push)


@inner
def pull(m: Multipliers, multiplier: Array, out: Array) -> None:
    """Set ``out = X λ`` for multipliers λ of the independent constraints."""
    clear(out)
    for k in range(m.rank[0]):
        row = m.order[k]
        block, lane, size = row // LANES, row % LANES, multiplier[row]
        for i in range(out.size):
            out[i] += m.x[block, i, lane] * size


@accelerations.register(ClosedParameters)
def _accelerations(p: ClosedParameters, t: float, q: Array, v: Array, a: Array) -> None:
    set_inputs(p, float(t))
    call_native(p.closed, (p.inputs, q, v, p.units[0], a, p.w, p.whole.x[0], p.whole.s[0]))
    keep_closed(p, q, a)


@inner
def keep_closed(p: ClosedParameters, q: Array, a: Array) -> None:
    """Change the tree's accelerations so that the loops stay closed, once X, S and w of the first block are there."""
    _spread(p, q, 1)
    _factor(p.whole)
    push(p.whole, p.w)
    for i in range(a.size):
        a[i] += p.whole.push[i]


@inner
def _widest(values: Array) -> float:
    """Return the largest value, NaN if one is."""
    widest = 0.0
    for k in range(values.size):
        if not abs(values[k]) <= widest:
            widest = abs(values[k])
    return widest


@note_held.register(ClosedParameters)
def _note_held(p: ClosedParameters, groups: IntArray, largest: Array, held: Array) -> None:
    note_pushes(p.whole, groups, largest, held)


@inner
def note_pushes(m: Multipliers, groups: IntArray, largest: Array, held: Array) -> None:
    """Raise ``held`` to the sizes of ``push`` in groups that haven't moved.

    Those that move have no need of it, and pushes beside a singular position would let errors pass there.
    """
    for i in range(m.push.size):
        if groups[i] >= 0 and largest[groups[i]] <= STILL_GROUP:
            held[groups[i]] = max(held[groups[i]], abs(m.push[i]))


@project.register(ClosedParameters)
def _project(p: ClosedParameters, t: float, q: Array, v: Array) -> None:
    project_positions(p, t, q, v)
    project_rates(p, q, v)
    p.whole.fresh[0] = 1.0


@inner
def project_positions(p: ClosedParameters, t: float, q: Array, v: Array) -> None:
    """Bring positions at a time t [s] onto the constraints; a rate is NaN after where they don't come there."""
    set_inputs(p, float(t))
    last = math.inf
    for k in range(PROJECTIONS + 1):
        call_native(p.residuals, (p.inputs, q, v, p.g, p.rates))
        widest = _widest(p.g)
        if k == 0 or widest > RELINEARISED:
            factor_constraints(p, q)
            p.whole.anew[0] += 1 if k > 0 else 0
        if _settles(widest, last, PROJECTED, NOT_PROJECTED):
            break
        if k == PROJECTIONS or not widest < math.inf:
            v[0] = math.nan  # which ends the march
            break
        last = widest
        push(p.whole, p.g)
        advance(p, q, p.whole.push, 1.0, 0, v.size)


@inner
def project_rates(p: ClosedParameters, q: Array, v: Array) -> None:
    """Bring rates onto the constraints after `project_positions`, with its factors."""
    for _ in range(2):  # the second takes the first one's round-off away
        call_native(p.residuals, (p.inputs, q, v, p.g, p.rates))
        push(p.whole, p.rates)
        for i in range(v.size):
            v[i] += p.whole.push[i]


@choose_constraints_anew.register(ClosedParameters)
def _choose_constraints_anew(p: ClosedParameters) -> None:
    p.whole.fresh[0] = 1.0


@project_onto_constraints.register(ClosedParameters)
def _project_onto_constraints(p: ClosedParameters, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    set_inputs(p, float(t))
    last, anew = math.inf, False
    for k in range(2 * PROJECTIONS):
        call_native(p.residuals, (p.inputs, q, v, p.g, p.rates))
        widest = _widest(p.g)
        if _settles(widest, last, PROJECTED, NOT_PROJECTED):
            return
        if not anew and (k == PROJECTIONS or widest > last):  # at a singular position, or in a long step
            anew = True
            factor_constraints(p, q)
            p.whole.anew[0] += 1
        last = widest
        push(p.whole, p.g)
        advance(p, q, p.whole.push, 1.0, 0, v.size)
        for i in range(v.size):
            v[i] += p.whole.push[i] / h
            a[i] += p.whole.push[i] / (h * h)
    v[0] = math.nan  # which ends the march


@singledispatch
@inlined
def begin_reaction(p: Any, inertia: int, solve_slow: int, q: Array, n_slow: int) -> None:
    """Prepare `close_reaction` at positions of the last accelerations, with addresses of functions."""


@singledispatch
@inlined
def close_reaction(p: Any, x: Array, first: int, count: int, n_slow: int) -> None:
    """Let the slow coordinates' answers x (n, 8) to ``count`` fast ones from ``first`` on keep the constraints, too.

    x is ``M_LL⁻¹ M_LS``, and D with ``M_LL D + J_Lᵀ μ = M_LS``, ``J_L D = J_S`` after.
    """


@singledispatch
@inlined
def close_response(p: Any, f: Array, x: Array) -> None:
    """Let accelerations x = M̂⁻¹ f, (n, 8), answer forces as the constraints allow."""


@begin_reaction.register(ClosedParameters)
def _begin_reaction(p: ClosedParameters, inertia: int, solve_slow: int, q: Array, n_slow: int) -> None:
    J, slow, n_rows = p.J, p.slow, p.w.size
    for block in range(J.shape[0]):
        call_native(inertia, (p.inputs, q, p.whole.x[block], J[block]))
        call_native(solve_slow, (p.inputs, q, J[block], slow.x[block]))
    for k in range(n_rows):
        for j in range(n_rows):
            total = 0.0
            for i in range(n_slow):
                total += J[k // LANES, i, k % LANES] * slow.x[j // LANES, i, j % LANES]
            slow.s[j // LANES, k, j % LANES] = total
    slow.fresh[0] = 1.0
    _factor(slow)


@close_reaction.register(ClosedParameters)
def _close_reaction(p: ClosedParameters, x: Array, first: int, count: int, n_slow: int) -> None:
    J, n_rows = p.J, p.w.size
    for lane in range(count):
        for k in range(n_rows):
            p.w[k] = -J[k // LANES, first + lane, k % LANES]
            for i in range(n_slow):
                p.w[k] += J[k // LANES, i, k % LANES] * x[i, lane]
        push(p.slow, p.w)
        for i in range(n_slow):
            x[i, lane] += p.slow.push[i]


@close_response.register(ClosedParameters)
def _close_response(p: ClosedParameters, f: Array, x: Array) -> None:
    X, n_rows = p.whole.x, p.w.size
    for lane in range(LANES):
        for k in range(n_rows):
            p.w[k] = 0.0
            for i in range(f.shape[0]):
                p.w[k] += X[k // LANES, i, k % LANES] * f[i, lane]
        push(p.whole, p.w)
        for i in range(f.shape[0]):
            x[i, lane] += p.whole.push[i]

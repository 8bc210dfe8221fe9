"""Steps and projections of a mechanism with loops, with eight tangents of its motion.

Multipliers λ of the constraints push the mechanism by ``X λ``, ``X = M̂⁻¹ Jᵀ``. So how accelerations change has two
parts: at fixed multipliers, by the graph, and ``X δλ``. The second keeps the tangents on the constraints: what leaves
the residual 0 is found by the factors of the motion itself, which are those of a step's begin, and corrected until
round-off is left.
"""

from __future__ import annotations

import math

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.newton import PROJECTIONS, STALLED
from fmd.core.limits.round_off import ENLARGED
from fmd.dynamics.compiled_system.closed import note_pushes, project_positions, project_rates, pull, push
from fmd.dynamics.compiled_system.parameters import ClosedParameters, CompiledParameters, Leapfrog
from fmd.dynamics.compiled_system.tangent_kernels import (
    TangentParameters,
    change_pushes,
    pulled,
    set_time,
    take_state,
)
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import (
    accelerations,
    advance,
    leapfrog_step,
    note_held,
    project,
    project_onto_constraints,
    remember_found,
)
from fmd.kernels.arrays import clear, copy
from fmd.kernels.kernel import inner
from fmd.kernels.vectors import call_native


class LinearisedAnewError(AccuracyError):
    """A projection linearised the constraints more than once: derivatives take its multipliers for those of one."""


def require_one_linearisation(p: CompiledParameters | TangentParameters, refinement: str) -> None:
    """Raise `LinearisedAnewError` where a march has linearised constraints anew within a projection, with a mend."""
    own = p.own if isinstance(p, ClosedTangentParameters) else p
    if isinstance(own, ClosedParameters) and own.whole.anew[0] > 0:
        count = int(own.whole.anew[0])
        raise LinearisedAnewError(f"loops were linearised anew within {count} projections; {refinement}")


@dataclass(frozen=True)
class ClosedTangentParameters(TangentParameters):
    """Parameters of a mechanism with n_rows constraints of loops and of eight tangents of its motion."""

    own: ClosedParameters  # the mechanism's
    n_positions: int  # the motion's own positions
    residuals: int  # addresses of the compiled functions
    closing: int
    other: Array  # (n_rows,): that have changed rates
    none: Array  # (n_rows,): zeros
    w: Array  # (n_rows,), room to work in
    dg: Array  # (n_rows, 8): tangents of the residuals, or of their accelerations
    drates: Array  # (n_rows, 8): and of their rates
    q_now: Array  # positions with tangents, at a step's begin
    q_ahead: Array  # (n_positions,): the motion's own at its end, before they are projected
    moved: Array  # and room for these
    v_now: Array  # rates with tangents
    rates: Array
    a_free: Array  # accelerations with tangents, at fixed multipliers or without any, and with some
    a_pulled: Array


@inner
def advance_tangents(p: ClosedTangentParameters, q: Array, own: Array, h: float) -> None:
    """Move the tangents of positions by h times ``rates`` about the motion's ``own`` positions; q's own stay."""
    copy(q, p.moved)
    copy(own[: p.n_positions], q[: p.n_positions])
    advance(p, q, p.rates, h, 0, p.rates.size)
    copy(p.moved[: p.n_positions], q[: p.n_positions])


@inner
def _change_by(p: ClosedTangentParameters, d: Array, lane: int) -> None:
    """Set ``own.whole.push = X δλ`` so that one lane of d (n_rows, 8) becomes 0."""
    for k in range(p.w.size):
        p.w[k] = d[k, lane]
    push(p.own.whole, p.w)


@accelerations.register(ClosedTangentParameters)
def _accelerations(p: ClosedTangentParameters, t: float, q: Array, v: Array, a: Array) -> None:
    set_time(p, float(t))
    whole = p.own.whole
    accelerations(p.own, t, q[: p.n_positions], v[: p.n], a[: p.n])
    copy(whole.multiplier, p.multiplier)
    change_pushes(p, q, v)
    pulled(p, q, v, p.multiplier, a, a)
    copy(a, p.a_free)
    along = (p.directions, q[p.n_position_lines :], v[p.n_lines :], a[p.n_lines :])
    call_native(p.closing, (p.inputs, q, v, a, along[0], along[1], along[2], along[3], p.dg))
    m = p.variants
    for k in range(m.closing.size if m.any != 0 else 0):
        if m.closing[k] != 0:
            take_state(m, k, q, v, a)
            call_native(m.closing[k], (m.inputs[k], m.q, m.v, m.a, m.g))
            for row in range(m.g.size):
                p.dg[row, k // 4] += m.weights[k] * m.g[row]
    for lane in range(LANES):
        _change_by(p, p.dg, lane)
        for i in range(p.n):
            a[p.n_lines + LANES * i + lane] += whole.push[i]


@leapfrog_step.register(ClosedTangentParameters)
def _leapfrog_step(
    p: ClosedTangentParameters, leapfrog: Leapfrog, t: float, h: float, q: Array, v: Array, a: Array
) -> None:
    copy(q, p.q_now)
    for i in range(v.size):
        leapfrog.v_now[i] = v[i] + 0.5 * h * a[i]
    p.own.whole.fresh[0] = 1.0
    if p.quaternions.shape[0] != 0:
        _leap_and_turn(p, leapfrog.v_now, t, h, q, v, a)
    else:
        _leap(p, leapfrog.v_now, t, h, q, v, a)
    set_time(p, float(t + h))
    close_positions(p, q, v)
    add_move(p, h, v, a)
    remember_found(p, t)


@inner
def add_move(p: ClosedTangentParameters, h: float, v: Array, a: Array) -> None:
    """Add what tangents of positions have moved by in a step h, ``rates``, to those of rates and accelerations."""
    for i in range(p.n_lines, v.size):
        v[i] += p.rates[i] / h
        a[i] += p.rates[i] / (h * h)


@inner
def _leap(p: ClosedTangentParameters, v_now: Array, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Take a step with the motion alone, then with its tangents at the multipliers that have closed it."""
    n = p.n
    accelerations(p.own, t, q[: p.n_positions], v_now[:n], a[:n])
    copy(p.own.whole.multiplier, p.multiplier)
    for i in range(n):
        v[i] += h * a[i]
        p.rates[i] = v[i]
    advance(p.own, q, v, h, 0, n)
    _project_motion(p, t, h, q, v, a)
    change_pushes(p, p.q_now, v_now)
    pulled(p, p.q_now, v_now, p.multiplier, a, p.a_pulled)
    for i in range(p.n_lines, v.size):
        a[i] = p.a_pulled[i]
        v[i] += h * a[i]
        p.rates[i] = v[i]
    advance_tangents(p, q, p.q_now, h)


@inner
def _leap_and_turn(p: ClosedTangentParameters, v_now: Array, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Take a step and its projection one after the other, since rotations in space don't add up."""
    accelerations(p, t, q, v_now, a)
    for i in range(v.size):
        v[i] += h * a[i]
        p.rates[i] = v[i]
    advance(p, q, v, h, 0, v.size)
    copy(q[: p.n_positions], p.q_ahead)
    _project_motion(p, t, h, q, v, a)
    pulled(p, p.q_now, v_now, p.multiplier, a, p.a_pulled)
    for i in range(p.n):
        p.rates[i] = v[i] - p.rates[i]
    for i in range(p.n_lines, v.size):
        p.rates[i] = h * (p.a_pulled[i] - p.a_free[i])
        v[i] += p.rates[i]
        a[i] += p.rates[i] / h
    advance_tangents(p, q, p.q_ahead, h)


@inner
def _project_motion(p: ClosedTangentParameters, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Project the motion's own step, and add the multipliers that have done it to those of its accelerations."""
    whole = p.own.whole
    clear(whole.total)
    project_onto_constraints(p.own, t + h, h, q[: p.n_positions], v[: p.n], a[: p.n])
    for k in range(whole.total.size):
        p.multiplier[k] += whole.total[k] / (h * h)
    set_time(p, float(t))


@inner
def close_positions(p: ClosedTangentParameters, q: Array, v: Array) -> None:
    """Bring the tangents of positions onto the constraints; ``rates`` has how far they have moved."""
    last = math.inf
    clear(p.rates)
    copy(q, p.moved)
    for _ in range(2 * PROJECTIONS):
        last = _find_push(p, q, v, p.dg, last)
        if last == 0.0:
            break
        for i in range(p.n_lines, v.size):
            p.rates[i] += p.a_free[i]
        advance(p, q, p.a_free, 1.0, 0, v.size)
    copy(p.moved[: p.n_positions], q[: p.n_positions])


@inner
def _close_rates(p: ClosedTangentParameters, q: Array, v: Array) -> None:
    """Bring the tangents of rates onto the constraints."""
    last = math.inf
    for _ in range(2 * PROJECTIONS):
        last = _find_push(p, q, v, p.drates, last)
        if last == 0.0:
            break
        for i in range(p.n_lines, v.size):
            v[i] += p.a_free[i]


@inner
def _find_push(p: ClosedTangentParameters, q: Array, v: Array, wanted: Array, last: float) -> float:
    """Find the pushes of tangents, ``a_free``, that make some of their changes 0; return the largest of these.

    It is 0 where no push is wanted: these no longer shrink as Newton's method does.
    """
    widest = _find_changes(p, q, v, wanted)
    if widest == 0.0 or not widest < STALLED * last:
        return 0.0
    clear(p.a_free[: p.n])
    for lane in range(LANES):
        _change_by(p, wanted, lane)
        for i in range(p.n):
            p.a_free[p.n_lines + LANES * i + lane] = p.own.whole.push[i]
    return widest


@inner
def _find_changes(p: ClosedTangentParameters, q: Array, v: Array, wanted: Array) -> float:
    """Evaluate the tangents of residuals and rates; return the largest of those that are to become 0."""
    along = (p.directions, q[p.n_position_lines :], v[p.n_lines :])
    call_native(p.residuals, (p.inputs, q, v, along[0], along[1], along[2], p.dg, p.drates))
    m = p.variants
    for k in range(m.residuals.size if m.any != 0 else 0):
        if m.residuals[k] != 0:
            take_state(m, k, q, v, v)
            call_native(m.residuals[k], (m.inputs[k], m.q, m.v, m.g, m.rates))
            for row in range(m.g.size):
                p.dg[row, k // 4] += m.weights[k] * m.g[row]
                p.drates[row, k // 4] += m.weights[k] * m.rates[row]
    widest = 0.0
    for k in range(wanted.shape[0]):
        for lane in range(LANES):
            widest = max(widest, abs(wanted[k, lane]))
    return widest


@note_held.register(ClosedTangentParameters)
def _note_held(p: ClosedTangentParameters, groups: IntArray, largest: Array, held: Array) -> None:
    pull(p.own.whole, p.multiplier, p.own.whole.push)  # the last one was that of a tangent
    note_pushes(p.own.whole, groups, largest, held)


@project.register(ClosedTangentParameters)
def _project(p: ClosedTangentParameters, t: float, q: Array, v: Array) -> None:
    n, first, whole = p.n, p.n_lines, p.own.whole
    set_time(p, float(t))
    copy(q, p.q_now)
    copy(v, p.v_now)
    clear(whole.total)
    project_positions(p.own, t, q[: p.n_positions], v[:n])
    copy(whole.total, p.multiplier)
    clear(whole.total)
    project_rates(p.own, q[: p.n_positions], v[:n])
    copy(whole.total, p.other)
    move_by(p, p.multiplier)
    advance_tangents(p, q, p.q_now, 1.0)
    move_by(p, p.other)
    for i in range(first, v.size):
        v[i] += p.rates[i]
    close_positions(p, q, v)
    _close_rates(p, q, v)
    whole.fresh[0] = 1.0


@inner
def move_by(p: ClosedTangentParameters, multiplier: Array) -> None:
    """Set ``rates`` to ``X λ`` and its tangents at fixed λ, at the state before a projection.

    Beside accelerations these are so small that round-off of variants would drown them.
    """
    pull(p.own.whole, multiplier, p.rates[: p.n])
    for k in range(p.w.size):
        p.w[k] = ENLARGED * multiplier[k]
    _pull_anew(p, p.none, p.a_free)
    _pull_anew(p, p.w, p.a_pulled)
    for i in range(p.n_lines, p.rates.size):
        p.rates[i] = (p.a_pulled[i] - p.a_free[i]) / ENLARGED


@inner
def _pull_anew(p: ClosedTangentParameters, multiplier: Array, a: Array) -> None:
    """Evaluate accelerations by multipliers, then their tangents: variants of the mechanism ask for the first."""
    pulled(p, p.q_now, p.v_now, multiplier, a, a)
    if p.variants.any != 0:
        pulled(p, p.q_now, p.v_now, multiplier, a, a)

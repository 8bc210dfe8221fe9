"""Sub-cycling of a mechanism with loops, with eight tangents of its motion: those of `closed_cycle`.

What answers to fast positions x and rates u solves ``M̂ z + Jᵀ μ = b``, ``J z = 0`` at the cycle's begin. Slow
coordinates follow by ``z = T x``, of which the fast rows are x and the slow rows of b are 0. Fast accelerations answer
by those of ``y = R f`` to the slope f of −Q̂ along T x and T u. At fixed z and μ each changes by the second derivative
of the residual, which the factors that have found z solve for. Each fast step has its own x and u.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.stepping import SHARE_AHEAD
from fmd.dynamics.compiled_system.closed import push
from fmd.dynamics.compiled_system.closed_tangents import (
    ClosedTangentParameters,
    add_move,
    advance_tangents,
    close_positions,
    move_by,
)
from fmd.dynamics.compiled_system.cycle_tangents import CycleTangents, go_ahead
from fmd.dynamics.compiled_system.parameters import Multipliers
from fmd.dynamics.compiled_system.tangent_kernels import set_time, take_state
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import (
    accelerations,
    advance,
    freeze_slow,
    project_onto_constraints,
    velocities,
)
from fmd.kernels.arrays import clear, copy
from fmd.kernels.kernel import inner
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class ClosedCycleTangents(CycleTangents):
    """The fast equation of a motion in loops over a major cycle, and how it changes with each of eight tangents."""

    still: Array  # (n_rows,): zeros
    at_rest: Array  # (n_rows, 8): tangents of the residuals' rates at rest
    z: Array  # (n,): all rates by fast ones
    of_z: Array  # (n, 8): tangents
    moved_z: Array  # (n_positions,): how positions move then, and tangents
    of_moved: Array  # (n_positions, 8)
    along_f: Array  # (n_rows,): multipliers
    w: Array  # (n_rows,)
    rate: Array  # rates with tangents: of the slow motion, and all of z
    none_q: Array  # (n_positions,): zeros
    none: Array  # (n,)
    dw: Array  # (n_positions, 8), zeros
    du: Array  # (n, 8), zeros
    a_later: Array  # accelerations with tangents where the slow motion is followed to


@freeze_slow.register(ClosedTangentParameters)
def _freeze_slow(p: ClosedTangentParameters, t: float, q: Array, v: Array, a: Array, c: ClosedCycleTangents) -> None:
    n, n_slow, own = p.n, c.frozen.n_slow, p.own
    freeze_slow(own, t, q[: p.n_positions], v[:n], a[:n], c.cycle)
    copy(q, c.q)
    copy(v, c.v)
    copy(a, c.a)
    go_ahead(p, t, c)
    own.whole.fresh[0] = 0.0  # factors of the begin, in the same order
    accelerations(own, t, q[: p.n_positions], v[:n], c.a_ahead)
    set_time(p, float(t))
    _find_rates(p, c, q, c.none, c.du, c.at_rest)
    _follow_slow_motion(p, c, q, v, a)
    for row in range(c.share.size):
        _find_column(p, c, q, v, row)
    ahead = c.cycle.ahead[0]
    set_time(p, t + ahead)
    accelerations(p, t + ahead, p.q_now, p.v_now, c.a_later)
    own.whole.fresh[0] = 1.0  # for the next cycle
    for row in range(c.share.size):
        for i in range(n_slow, n):
            for lane in range(LANES):
                at = p.n_lines + LANES * i + lane
                c.columns[row, i, lane] += (row + 1) * c.h * (c.a_later[at] - a[at]) / ahead


@inner
def _follow_slow_motion(p: ClosedTangentParameters, c: ClosedCycleTangents, q: Array, v: Array, a: Array) -> None:
    """Find the state a little later, with the slow motion that leaves fast coordinates where they are."""
    ahead = c.cycle.ahead[0]
    copy(q, p.q_now)
    copy(v, p.v_now)
    clear(c.rate)
    _add_slow(p, c, q, v, v, 1.0, c.rate)
    _add_slow(p, c, q, v, a, ahead, p.v_now)
    advance(p, p.q_now, c.rate, ahead, 0, c.rate.size)


@inner
def _add_slow(
    p: ClosedTangentParameters, c: ClosedCycleTangents, q: Array, v: Array, x: Array, share: float, out: Array
) -> None:
    """Add the slow part of ``x − T x_S`` times a share, with its tangents."""
    n_slow, D = c.frozen.n_slow, c.cycle.D
    _follow(p, c, q, v, x)
    for i in range(n_slow):
        at = p.n_lines + LANES * i
        out[i] += share * (x[i] - c.z[i])
        for lane in range(LANES):
            total = x[at + lane] - c.of_z[i, lane]
            for j in range(n_slow, p.n):
                total += D[j, i] * x[p.n_lines + LANES * j + lane]
            out[at + lane] += share * total


@inner
def _follow(p: ClosedTangentParameters, c: ClosedCycleTangents, q: Array, v: Array, x: Array) -> None:
    """Find ``z = T x`` by fast rates x, and its tangents ``of_z`` at fixed x."""
    n, n_slow, slow = p.n, c.frozen.n_slow, p.own.slow
    for i in range(n):
        for lane in range(LANES):
            c.x[i, lane] = 0.0
        c.x[i, 0] = x[i] if i >= n_slow else 0.0
    call_native(c.cycle.middle.inertia, (p.inputs, q, c.x, c.f))
    call_native(c.cycle.middle.solve_slow, (p.inputs, q, c.f, c.x))
    for i in range(n):
        c.z[i] = x[i] if i >= n_slow else -c.x[i, 0]
    _turn_back(p, c.z, c.w)
    push(slow, c.w)
    for i in range(n_slow):
        c.z[i] += slow.push[i]
    copy(slow.multiplier, c.along_f)
    _change(p, c, q, v, c.none_q, c.none, c.dw, c.du)
    call_native(c.cycle.middle.solve_slow, (p.inputs, q, c.f, c.x))
    for i in range(n):
        for lane in range(LANES):
            c.of_z[i, lane] = 0.0 if i >= n_slow else -c.x[i, lane]
    _close(p, c, q, slow, n_slow)


@inner
def _turn_back(p: ClosedTangentParameters, z: Array, w: Array) -> None:
    """Set ``w = J z``."""
    J = p.own.J
    for k in range(w.size):
        w[k] = 0.0
        for i in range(p.n):
            w[k] += J[k // LANES, i, k % LANES] * z[i]


@inner
def _change(
    p: ClosedTangentParameters,
    c: ClosedCycleTangents,
    q: Array,
    v: Array,
    along_q: Array,
    along_v: Array,
    dalong_q: Array,
    dalong_v: Array,
) -> None:
    """Fill f with what ``M̂ z − Jᵀ along_f`` and the slope of −Q̂ along a direction change by, z and along_f fixed."""
    rest, m = c.cycle.middle.rest, p.variants
    dq, dv = q[p.n_position_lines :], v[p.n_lines :]
    along = (
        p.inputs,
        q,
        v,
        rest,
        c.still,
        along_q,
        along_v,
        c.z,
        c.along_f,
        p.directions,
        dq,
        dv,
        dalong_q,
        dalong_v,
        c.f,
    )
    call_native(c.slopes, along)
    for k in range(m.residual.size if m.any != 0 else 0):
        if m.residual[k] == 0:
            continue
        take_state(m, k, q, v, rest)
        for i in range(m.q.size):
            c.lanes_q[i, 0] = m.signs_q[k, i] * along_q[i]
        for i in range(p.n):
            c.lanes_v[i, 0], c.lanes_a[i, 0] = m.signs_v[k, i] * along_v[i], m.signs_v[k, i] * c.z[i]
        lanes = (c.lanes_inputs, c.lanes_q, c.lanes_v, c.lanes_a)
        call_native(c.beside[k], (m.inputs[k], m.q, m.v, m.a, lanes[0], lanes[1], lanes[2], lanes[3], c.x))
        for i in range(p.n):
            c.f[i, k // 4] += m.weights[k] * m.signs_v[k, i] * c.x[i, 0]
        call_native(m.residual[k], (m.inputs[k], m.q, m.v, c.along_f, m.a, m.r))
        for i in range(p.n):  # less forces by the multipliers
            c.f[i, k // 4] += m.weights[k] * m.signs_v[k, i] * m.r[i]
        call_native(m.residual[k], (m.inputs[k], m.q, m.v, c.still, m.a, m.r))
        for i in range(p.n):
            c.f[i, k // 4] -= m.weights[k] * m.signs_v[k, i] * m.r[i]


@inner
def _find_rates(p: ClosedTangentParameters, c: ClosedCycleTangents, q: Array, z: Array, dv: Array, out: Array) -> None:
    """Fill tangents (n_rows, 8) of the residuals' rates by rates z with tangents dv (n, 8)."""
    m, dq = p.variants, q[p.n_position_lines :]
    call_native(p.residuals, (p.inputs, q, z, p.directions, dq, dv, p.dg, out))
    for k in range(m.residuals.size if m.any != 0 else 0):
        if m.residuals[k] != 0:
            take_state(m, k, q, z, z)
            call_native(m.residuals[k], (m.inputs[k], m.q, m.v, m.g, m.rates))
            for row in range(m.g.size):
                out[row, k // 4] += m.weights[k] * m.rates[row]


@inner
def _close(p: ClosedTangentParameters, c: ClosedCycleTangents, q: Array, factors: Multipliers, count: int) -> None:
    """Let the first ``count`` tangents ``of_z`` keep ``J z = 0``."""
    _find_rates(p, c, q, c.z, c.of_z, p.drates)
    for lane in range(LANES):
        for k in range(c.w.size):
            c.w[k] = p.drates[k, lane] - c.at_rest[k, lane]
        push(factors, c.w)
        for i in range(count):
            c.of_z[i, lane] += factors.push[i]


@inner
def _find_column(p: ClosedTangentParameters, c: ClosedCycleTangents, q: Array, v: Array, row: int) -> None:
    """Find what the fast positions and rates of a step change fast accelerations by, in all tangents."""
    n, n_slow, n_positions, whole = p.n, c.frozen.n_slow, p.n_positions, p.own.whole
    offset = n_positions - n
    for i in range(n_slow, n):
        c.middle[i] = c.along_q[row, i + offset]
    _follow(p, c, q, v, c.middle)
    copy(c.z, c.rate)
    for i in range(n):
        for lane in range(LANES):
            c.rate[p.n_lines + LANES * i + lane] = c.of_z[i, lane]
    velocities(p, q, c.rate, c.moved)
    for i in range(n_positions):
        c.moved_z[i] = c.moved[i]
        for lane in range(LANES):
            c.dq[i, lane] = c.moved[p.n_position_lines + LANES * i + lane]
    _follow(p, c, q, v, c.along_v[row])
    for i in range(n):
        c.rate[i] = c.z[i]
        for lane in range(LANES):
            c.dv[i, lane] = c.of_z[i, lane]
    _answer(p, c, q, v)
    copy(c.rate, c.middle)  # z is the answer from here on
    _change(p, c, q, v, c.moved_z, c.middle, c.dq, c.dv)
    call_native(c.cycle.middle.solve, (p.inputs, q, c.f, c.x))
    for i in range(n):
        c.z[i] = -c.z[i]
        for lane in range(LANES):
            c.of_z[i, lane] = c.x[i, lane]
    _close(p, c, q, whole, n)
    for i in range(n_slow, n):
        for lane in range(LANES):
            c.columns[row, i, lane] = -c.of_z[i, lane]


@inner
def _answer(p: ClosedTangentParameters, c: ClosedCycleTangents, q: Array, v: Array) -> None:
    """Set z to ``−R f`` and ``along_f`` to less its multipliers; f is the slope along ``moved_z`` and ``rate``."""
    frozen, whole = c.frozen, p.own.whole
    for i in range(p.n_positions):
        for lane in range(LANES):
            c.of_moved[i, lane] = 0.0
        c.of_moved[i, 0] = c.moved_z[i]
    for i in range(p.n):
        for lane in range(LANES):
            c.of_z[i, lane] = 0.0
        c.of_z[i, 0] = c.rate[i]
    call_native(frozen.stiffness, (p.inputs, q, v, c.cycle.middle.rest, c.of_moved, c.f))
    if frozen.damped:
        call_native(frozen.damping, (p.inputs, q, v, c.of_z, c.x))
        for i in range(p.n):
            c.f[i, 0] += c.x[i, 0]
    call_native(c.cycle.middle.solve, (p.inputs, q, c.f, c.x))
    for k in range(c.w.size):
        c.w[k] = 0.0
        for i in range(p.n):
            c.w[k] += whole.x[k // LANES, i, k % LANES] * c.f[i, 0]
    push(whole, c.w)
    for i in range(p.n):
        c.z[i] = -(c.x[i, 0] + whole.push[i])
    for k in range(c.w.size):
        c.along_f[k] = -whole.multiplier[k]


@project_onto_constraints.register(ClosedTangentParameters)
def _project_onto_constraints(p: ClosedTangentParameters, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Project a cycle's end by forces along Jᵀ of the state a little after its begin, ``q_now`` and ``v_now``."""
    n, whole = p.n, p.own.whole
    clear(whole.total)
    copy(q[: p.n_positions], p.q_ahead)
    project_onto_constraints(p.own, t, h, q[: p.n_positions], v[:n], a[:n])
    copy(whole.total, p.multiplier)
    set_time(p, t - h + SHARE_AHEAD * h)
    move_by(p, p.multiplier)
    advance_tangents(p, q, p.q_ahead, 1.0)
    set_time(p, float(t))
    add_move(p, h, v, a)
    close_positions(p, q, v)
    add_move(p, h, v, a)

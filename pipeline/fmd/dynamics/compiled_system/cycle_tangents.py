"""Sub-cycling of a compiled mechanism with eight tangents of its motion: those of the fast equation of a major cycle.

A fast step solves ``M_SS (a_S − a_S⁰) = −r'_S[d]``: r' is the residual's slope at the cycle's begin along how far the
state has gone from there, d, with the slow coordinates as their rates and accelerations take them. So

    δa_S = δa_S⁰ − M_SS⁻¹ (r''_S[d, δ] + r'_S[δd])

with d joined by ``a_S − a_S⁰``, r'' along it and along the tangent δ of the cycle's begin. Where fast coordinates don't
couple, r'' is linear in few directions that all steps share; else each fast step has its own. The rest of ``r'_S[δd]``
is the motion's own frozen equation.
"""

from __future__ import annotations

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiled_system.parameters import ClosedCycle, CompiledParameters, FrozenCycle
from fmd.dynamics.compiled_system.tangent_kernels import TangentParameters, set_time, take_state
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import fast_steps, freeze_slow, velocities
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import inner
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class CycleTangents(Table):
    """The fast equation of a motion over a major cycle, and how it changes with each of eight tangents.

    Rows of a direction are all fast positions, the slow motion, each input that drives fast coordinates, and all fast
    rates, if they are damped; or, where fast coordinates couple, the fast steps after the first.
    """

    own: CompiledParameters  # the motion's own
    cycle: FrozenCycle | ClosedCycle  # what it steps by
    frozen: FrozenCycle  # its equation
    h: float
    slopes: int  # addresses of the compiled functions: second derivatives, and first ones of variants or 0
    beside: IntArray  # (32,)
    share: Array  # (n_rows,): of the slow motion in each direction [s]
    along_inputs: Array  # (n_rows, n_inputs)
    along_q: Array  # (n_rows, n_positions)
    along_v: Array  # (n_rows, n)
    along_a: Array
    columns: Array  # (n_rows, n, 8): what they change fast accelerations by
    dq: Array  # (n_positions, 8): tangents of the slow motion
    dv: Array  # (n, 8)
    moved: Array  # how positions change, with tangents
    behind: Array  # rates half a step before the cycle, with tangents
    q: Array  # and the state at its begin
    v: Array
    a: Array
    inputs: Array  # (n_inputs,)
    directions: Array  # (n_inputs, 8)
    q_ahead: Array  # (n_positions,): the motion's own at a fast step
    v_ahead: Array  # (n,)
    a_ahead: Array
    middle: Array  # rates half a step later, with tangents
    lanes_inputs: Array  # (n_inputs, 8): eight directions for a variant
    lanes_q: Array
    lanes_v: Array
    lanes_a: Array
    f: Array  # (n, 8), room to work in
    x: Array


@freeze_slow.register(TangentParameters)
def _freeze_slow(p: TangentParameters, t: float, q: Array, v: Array, a: Array, c: CycleTangents) -> None:
    freeze_slow(c.own, t, q[: c.along_q.shape[1]], v[: p.n], a[: p.n], c.cycle)
    copy(q, c.q)
    copy(v, c.v)
    copy(a, c.a)
    copy(p.inputs, c.inputs)
    for i in range(c.inputs.size):
        for lane in range(LANES):
            c.directions[i, lane] = p.directions[i, lane]
    velocities(p, q, v, c.moved)
    if c.frozen.single:
        _take_shares(c)
    else:
        go_ahead(p, t, c)
    _follow_slow_motion(p, c)
    for row in range(c.share.size):
        for i in range(p.n):
            for lane in range(LANES):
                c.columns[row, i, lane] = 0.0
    if p.variants.any != 0:
        _add_variants(p, q, v, a, c)
    for row in range(c.share.size):
        _find_column(p, q, v, a, c, row)


@inner
def _take_shares(c: CycleTangents) -> None:
    """Let directions have their shares of fast accelerations that don't couple: masses may change with a number."""
    frozen, last = c.frozen, c.share.size - 1
    for i in range(frozen.n_slow, frozen.k.size):
        c.along_a[0, i], c.along_a[1, i] = -frozen.k[i], frozen.slope[i]
        for k in range(frozen.driven.size):
            c.along_a[2 + k, i] = frozen.lever[k, i]
        if frozen.damped:
            c.along_a[last, i] = -frozen.c[i]


@inner
def go_ahead(p: TangentParameters, t: float, c: CycleTangents) -> None:
    """Take the motion's own fast steps, and keep how far each has gone."""
    n, n_slow, h, q, v, a = p.n, c.frozen.n_slow, c.h, c.q_ahead, c.v_ahead, c.a_ahead
    offset = q.size - n
    copy(c.q, q)
    copy(c.behind, v)
    copy(c.a, a)
    first = int(t / h + 0.5)
    for row in range(c.share.size):
        if row == 0:
            for i in range(n_slow, n):
                v[i] += h * a[i]
                q[i + offset] += h * v[i]
        for i in range(n_slow, n):
            c.along_q[row, i + offset] = q[i + offset] - c.q[i + offset]
            c.along_v[row, i] = v[i] + 0.5 * h * a[i] - c.v[i]
        fast_steps(c.own, c.cycle, first + row + 1, h, 1, q, v, a)
        for i in range(n_slow, n):
            c.along_a[row, i] = a[i] - c.a[i]
        set_time(p, (first + row + 1) * h)
        for k in range(c.frozen.driven.size):
            j = c.frozen.driven[k]
            c.along_inputs[row, j] = p.inputs[j] - c.inputs[j]
    set_time(p, t)


@inner
def _follow_slow_motion(p: TangentParameters, c: CycleTangents) -> None:
    """Let directions have their shares of the slow motion."""
    n_slow = c.frozen.n_slow
    for row in range(c.share.size):
        for i in range(n_slow + c.along_q.shape[1] - p.n):
            c.along_q[row, i] = c.share[row] * c.moved[i]
        for i in range(n_slow):
            c.along_v[row, i] = c.share[row] * c.a[i]


@inner
def _add_variants(p: TangentParameters, q: Array, v: Array, a: Array, c: CycleTangents) -> None:
    """Add to columns what the residual's slopes differ by between variants of the mechanism, eight at a time."""
    m = p.variants
    for k in range(m.residual.size):
        for first in range(0, c.share.size if m.residual[k] != 0 else 0, LANES):
            count = min(LANES, c.share.size - first)
            take_state(m, k, q, v, a)
            for lane in range(count):
                row = first + lane
                for i in range(c.inputs.size):
                    c.lanes_inputs[i, lane] = c.along_inputs[row, i]
                for i in range(m.q.size):
                    c.lanes_q[i, lane] = m.signs_q[k, i] * c.along_q[row, i]
                for i in range(p.n):
                    c.lanes_v[i, lane] = m.signs_v[k, i] * c.along_v[row, i]
                    c.lanes_a[i, lane] = m.signs_v[k, i] * c.along_a[row, i]
            along = (c.lanes_inputs, c.lanes_q, c.lanes_v, c.lanes_a)
            call_native(c.beside[k], (m.inputs[k], m.q, m.v, m.a, along[0], along[1], along[2], along[3], c.f))
            for lane in range(count):
                for i in range(p.n):
                    c.columns[first + lane, i, k // 4] += m.weights[k] * m.signs_v[k, i] * c.f[i, lane]


@inner
def _find_column(p: TangentParameters, q: Array, v: Array, a: Array, c: CycleTangents, row: int) -> None:
    """Complete what a direction changes the fast accelerations by, in all tangents."""
    n_slow, share, frozen = c.frozen.n_slow, c.share[row], c.frozen
    for i in range(n_slow + c.along_q.shape[1] - p.n):
        for lane in range(LANES):
            c.dq[i, lane] = share * c.moved[p.n_position_lines + LANES * i + lane]
    for i in range(n_slow):
        for lane in range(LANES):
            c.dv[i, lane] = share * a[p.n_lines + LANES * i + lane]
    inputs, along_q, along_v, along_a = c.along_inputs[row], c.along_q[row], c.along_v[row], c.along_a[row]
    dq, dv, da = q[p.n_position_lines :], v[p.n_lines :], a[p.n_lines :]
    along = (p.inputs, q, v, a, inputs, along_q, along_v, along_a, p.directions, dq, dv, da, c.dq, c.dv, c.f)
    call_native(c.slopes, along)
    for i in range(n_slow, p.n):
        for lane in range(LANES):
            c.f[i, lane] += c.columns[row, i, lane]
    if frozen.single:
        for i in range(n_slow, p.n):
            for lane in range(LANES):
                c.columns[row, i, lane] = -frozen.inverse_mass[i] * c.f[i, lane]
        return
    call_native(frozen.solve_fast, (p.inputs, q, c.f, c.x))
    for i in range(n_slow, p.n):
        for lane in range(LANES):
            c.columns[row, i, lane] = -c.x[i, lane]


@fast_steps.register(TangentParameters)
def _fast_steps(
    p: TangentParameters, c: CycleTangents, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    n_positions = c.along_q.shape[1]
    for step in range(count):
        t = (first + step) * h
        for i in range(v.size):
            c.middle[i] = v[i] + 0.5 * h * a[i]
        copy(q, c.q_ahead)
        fast_steps(c.own, c.cycle, first + step, h, 1, q[:n_positions], v[: p.n], a[: p.n])
        if c.frozen.driven.size:
            set_time(p, t)
        if c.frozen.single:
            _change_alone(p, c, t - c.frozen.time[0], q, a)
        else:
            _change_together(p, c, int((t - c.frozen.time[0]) / h + 0.5) - 1, q, a)
        for i in range(c.frozen.n_slow, p.n):
            at, to = p.n_lines + LANES * i, p.n_position_lines + LANES * (i + n_positions - p.n)
            for lane in range(LANES):
                v[at + lane] += h * a[at + lane]
                q[to + lane] += h * v[at + lane]


@inner
def _change_alone(p: TangentParameters, c: CycleTangents, tau: float, q: Array, a: Array) -> None:
    """Find tangents of fast accelerations that don't couple, at a time τ after the cycle's begin."""
    frozen, offset, last = c.frozen, c.along_q.shape[1] - p.n, c.share.size - 1
    for i in range(frozen.n_slow, p.n):
        at, to = p.n_lines + LANES * i, p.n_position_lines + LANES * (i + offset)
        x, u = c.q_ahead[i + offset] - c.q[i + offset], c.middle[i] - c.v[i]
        for lane in range(LANES):
            total = c.a[at + lane] + c.columns[0, i, lane] * x + c.columns[1, i, lane] * tau
            total -= frozen.k[i] * (q[to + lane] - c.q[to + lane])
            if frozen.damped:
                total += c.columns[last, i, lane] * u - frozen.c[i] * (c.middle[at + lane] - c.v[at + lane])
            for k in range(frozen.driven.size):
                j = frozen.driven[k]
                total += c.columns[2 + k, i, lane] * (p.inputs[j] - c.inputs[j])
                total += frozen.lever[k, i] * (p.directions[j, lane] - c.directions[j, lane])
            a[at + lane] = total


@inner
def _change_together(p: TangentParameters, c: CycleTangents, row: int, q: Array, a: Array) -> None:
    """Find tangents of fast accelerations that couple, at a fast step."""
    frozen, offset, n_slow, n = c.frozen, c.along_q.shape[1] - p.n, c.frozen.n_slow, p.n
    for i in range(n_slow, n):
        at = p.n_lines + LANES * i
        for lane in range(LANES):
            total = c.a[at + lane] + c.columns[row, i, lane]
            for k in range(frozen.driven.size):
                j = frozen.driven[k]
                total += frozen.lever[k, i] * (p.directions[j, lane] - c.directions[j, lane])
            a[at + lane] = total
    for j in range(n_slow, n):
        of, to = p.n_lines + LANES * j, p.n_position_lines + LANES * (j + offset)
        for i in range(n_slow, n):
            at = p.n_lines + LANES * i
            for lane in range(LANES):
                a[at + lane] -= frozen.K[j - n_slow, i - n_slow] * (q[to + lane] - c.q[to + lane])
            if frozen.damped:
                for lane in range(LANES):
                    a[at + lane] -= frozen.C[j - n_slow, i - n_slow] * (c.middle[of + lane] - c.v[of + lane])

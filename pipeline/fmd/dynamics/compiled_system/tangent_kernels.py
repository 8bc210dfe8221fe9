"""Accelerations of a mechanism with eight tangents of its motion, and how positions and theirs follow the rates."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.round_off import NO_TURN, SMALL_TURN
from fmd.dynamics.compiled_system.kernels import quaternion_rate, take_leap
from fmd.dynamics.compiled_system.parameters import Leapfrog
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import accelerations, advance, leapfrog_step, project_onto_constraints, velocities
from fmd.kernels.kernel import inlined, inner
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class MechanismVariants(Table):
    """Mechanisms beside one, whose weighted residuals are the derivative of its own, four to each tangent.

    Their modal coordinates may have other signs.
    """

    any: int  # 1 if there are some
    residual: IntArray  # (32,): addresses of the compiled functions, 0 where there is none
    residuals: IntArray  # (32,): and of those for loops
    closing: IntArray
    signals: IntArray  # (32,): 0 without signals
    weights: Array  # (32,)
    inputs: Array  # (32, n_inputs)
    signs_q: Array  # (32, n_positions)
    signs_v: Array  # (32, n)
    q: Array  # room for a state, and for what functions fill
    v: Array
    a: Array
    r: Array
    g: Array  # (n_rows,)
    rates: Array


@dataclass(frozen=True)
class TangentParameters(Table):
    """A mechanism's accelerations and their tangents by their address, its signals and how these change."""

    accelerations: int  # addresses of the compiled functions: with tangents, and alone
    alone: int
    signals: int
    n: int  # the motion's own rates
    n_lines: int  # as many and zeros, before the tangents
    n_position_lines: int
    inputs: Array  # (3 n_signals + n_numbers,)
    directions: Array  # (3 n_signals + n_numbers, 8): their tangents
    beside: IntArray  # (8, 4): addresses of signals beside the mechanism's own
    weights: Array  # (8, 4): of these in each tangent
    room: Array  # (3 n_signals + n_numbers,)
    n_inputs: int  # 3 n_signals
    clock: Array  # (2,): the time that the inputs are of, and one for which others are evaluated [s]
    position: IntArray  # (n,): position that each rate moves, -1 for a rotation in space
    quaternions: IntArray  # (n_rotations, 2): first rate and first position of each rotation in space
    multiplier: Array  # (n_rows,): that act, or that have moved positions
    dr: Array  # (n, 8): what the residual changes by where more than inputs change
    variants: MechanismVariants


@inner
def copy(x: Array, out: Array) -> None:
    """Fill an array with the first values of another."""
    for i in range(out.size):
        out[i] = x[i]


@accelerations.register(TangentParameters)
def _accelerations(p: TangentParameters, t: float, q: Array, v: Array, a: Array) -> None:
    set_time(p, float(t))
    if p.variants.any != 0:
        call_native(p.alone, (p.inputs, q, v, a))
    pulled(p, q, v, p.multiplier, a, a)


@inlined
def pulled(p: TangentParameters, q: Array, v: Array, multiplier: Array, known: Array, a: Array) -> None:
    """Evaluate accelerations by some multipliers, and their tangents at fixed ones; variants take known ones."""
    dq, dv, da = q[p.n_position_lines :], v[p.n_lines :], a[p.n_lines :]
    if p.variants.any != 0:
        _change_residual(p, q, v, multiplier, known)
        call_native(p.accelerations, (p.inputs, q, v, multiplier, p.directions, dq, dv, p.dr, a, da))
    else:
        call_native(p.accelerations, (p.inputs, q, v, multiplier, p.directions, dq, dv, a, da))


@inlined
def take_state(m: MechanismVariants, k: int, q: Array, v: Array, a: Array) -> None:
    """Take a state for a variant, with its signs."""
    for i in range(m.q.size):
        m.q[i] = m.signs_q[k, i] * q[i]
    for i in range(m.v.size):
        m.v[i], m.a[i] = m.signs_v[k, i] * v[i], m.signs_v[k, i] * a[i]


@inlined
def _change_residual(p: TangentParameters, q: Array, v: Array, multiplier: Array, a: Array) -> None:
    m = p.variants
    for i in range(p.n):
        for lane in range(LANES):
            p.dr[i, lane] = 0.0
    for k in range(m.residual.size):
        if m.residual[k] != 0:
            take_state(m, k, q, v, a)
            call_native(m.residual[k], (m.inputs[k], m.q, m.v, multiplier, m.a, m.r))
            for i in range(p.n):
                p.dr[i, k // 4] += m.weights[k] * m.signs_v[k, i] * m.r[i]


@inlined
def set_time(p: TangentParameters, t: float) -> None:
    """Evaluate the signals at a time t [s], and how they change, unless they are there from the last call."""
    if p.signals != 0 and p.clock[0] != t:
        _set_inputs(p, t)


@inlined
def _set_inputs(p: TangentParameters, t: float) -> None:
    p.clock[0], p.clock[1] = t, t
    call_native(p.signals, (p.clock[1:], p.inputs))
    for lane in range(LANES):
        for i in range(p.n_inputs if p.weights[lane, 0] != 0.0 else 0):
            p.directions[i, lane] = 0.0
        for k in range(4):
            if p.weights[lane, k] != 0.0:
                call_native(p.beside[lane, k], (p.clock[1:], p.room))
                for i in range(p.n_inputs):
                    p.directions[i, lane] += p.weights[lane, k] * p.room[i]
    for k in range(p.variants.signals.size):
        if p.variants.signals[k] != 0:
            call_native(p.variants.signals[k], (p.clock[1:], p.variants.inputs[k]))


@leapfrog_step.register(TangentParameters)
def _leapfrog_step(p: TangentParameters, leapfrog: Leapfrog, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    take_leap(p, leapfrog, t, h, q, v, a)


@project_onto_constraints.register(TangentParameters)
def _close_nothing(p: TangentParameters, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    pass


@advance.register(TangentParameters)
def _advance(p: TangentParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    """Move all coordinates: nothing marches a part of them alone."""
    if p.quaternions.shape[0] == 0:
        for i in range(v.size):
            q[i] += h * v[i]
        return
    for i in range(p.n):
        if p.position[i] >= 0:
            q[p.position[i]] += h * v[i]
            to, at = p.n_position_lines + LANES * p.position[i], p.n_lines + LANES * i
            for lane in range(LANES):
                q[to + lane] += h * v[at + lane]
    for k in range(p.quaternions.shape[0]):
        _advance_quaternion(p, q, p.quaternions[k, 1], v, p.quaternions[k, 0], h)


@velocities.register(TangentParameters)
def _velocities(p: TangentParameters, q: Array, v: Array, dq: Array) -> None:
    if p.quaternions.shape[0] == 0:
        for i in range(v.size):
            dq[i] = v[i]
        return
    for i in range(p.n):
        if p.position[i] >= 0:
            dq[p.position[i]] = v[i]
            to, at = p.n_position_lines + LANES * p.position[i], p.n_lines + LANES * i
            for lane in range(LANES):
                dq[to + lane] = v[at + lane]
    for k in range(p.quaternions.shape[0]):
        at, turn = p.quaternions[k, 1], p.quaternions[k, 0]
        quaternion_rate(q, at, v, turn, dq)
        for lane in range(LANES):
            _quaternion_rate_along(p, q, at, v, turn, dq, lane)


@inlined
def _quaternion_rate_along(p: TangentParameters, q: Array, at: int, v: Array, turn: int, dq: Array, lane: int) -> None:
    """``½ (δe ∘ (ω, 0) + e ∘ (δω, 0))``."""
    to, of = p.n_position_lines + LANES * at + lane, p.n_lines + LANES * turn + lane
    wx, wy, wz = 0.5 * v[turn], 0.5 * v[turn + 1], 0.5 * v[turn + 2]
    ux, uy, uz = 0.5 * v[of], 0.5 * v[of + LANES], 0.5 * v[of + 2 * LANES]
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    dx, dy, dz, dw = q[to], q[to + LANES], q[to + 2 * LANES], q[to + 3 * LANES]
    dq[to] = dw * wx + dy * wz - dz * wy + w * ux + y * uz - z * uy
    dq[to + LANES] = dw * wy - dx * wz + dz * wx + w * uy - x * uz + z * ux
    dq[to + 2 * LANES] = dw * wz + dx * wy - dy * wx + w * uz + x * uy - y * ux
    dq[to + 3 * LANES] = -dx * wx - dy * wy - dz * wz - x * ux - y * uy - z * uz


@inlined
def _advance_quaternion(p: TangentParameters, q: Array, at: int, v: Array, turn: int, h: float) -> None:
    """Turn the unit quaternion at ``q[at]`` by h times the body's own rates, and its tangents with it."""
    wx, wy, wz = 0.5 * h * v[turn], 0.5 * h * v[turn + 1], 0.5 * h * v[turn + 2]
    size = math.sqrt(wx * wx + wy * wy + wz * wz)
    s, c = (math.sin(size) / size, math.cos(size)) if size > NO_TURN else (1.0, 1.0)
    # Of s, by half the size squared.
    bend = (c - s) / (size * size) if size > SMALL_TURN else -1.0 / 3.0 + size * size / 30.0
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    e0 = s * (w * wx + y * wz - z * wy) + x * c
    e1 = s * (w * wy - x * wz + z * wx) + y * c
    e2 = s * (w * wz + x * wy - y * wx) + z * c
    e3 = w * c - s * (x * wx + y * wy + z * wz)
    norm = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    e0, e1, e2, e3 = norm * e0, norm * e1, norm * e2, norm * e3
    for lane in range(LANES):
        to, of = p.n_position_lines + LANES * at + lane, p.n_lines + LANES * turn + lane
        ux, uy, uz = 0.5 * h * v[of], 0.5 * h * v[of + LANES], 0.5 * h * v[of + 2 * LANES]
        along = wx * ux + wy * uy + wz * uz
        tx, ty, tz, tc = s * ux + bend * along * wx, s * uy + bend * along * wy, s * uz + bend * along * wz, -s * along
        dx, dy, dz, dw = q[to], q[to + LANES], q[to + 2 * LANES], q[to + 3 * LANES]
        d0 = w * tx + y * tz - z * ty + x * tc + s * (dw * wx + dy * wz - dz * wy) + dx * c
        d1 = w * ty - x * tz + z * tx + y * tc + s * (dw * wy - dx * wz + dz * wx) + dy * c
        d2 = w * tz + x * ty - y * tx + z * tc + s * (dw * wz + dx * wy - dy * wx) + dz * c
        d3 = w * tc - x * tx - y * ty - z * tz - s * (dx * wx + dy * wy + dz * wz) + dw * c
        d0, d1, d2, d3 = norm * d0, norm * d1, norm * d2, norm * d3
        out = e0 * d0 + e1 * d1 + e2 * d2 + e3 * d3
        q[to], q[to + LANES] = d0 - out * e0, d1 - out * e1
        q[to + 2 * LANES], q[to + 3 * LANES] = d2 - out * e2, d3 - out * e3
    q[at], q[at + 1], q[at + 2], q[at + 3] = e0, e1, e2, e3

"""Accelerations of a mechanism with eight tangents of its motion, and how positions and theirs follow the rates."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiled_system.kernels import take_leap
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.compiler.turns import Turns
from fmd.dynamics.system import accelerations, advance, leapfrog_step, velocities
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import inlined
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
    turns: Turns
    multiplier: Array  # (n_rows,): that act, or that have moved positions
    dr: Array  # (n, 8): what the residual changes by where more than inputs change
    variants: MechanismVariants


@accelerations.register(TangentParameters)
def _accelerations(p: TangentParameters, t: float, q: Array, v: Array, a: Array) -> None:
    set_time(p, float(t))
    if p.variants.any != 0:
        call_native(p.alone, (p.inputs, q, v, a))
    pulled(p, q, v, p.multiplier, a, a)


@singledispatch
@inlined
def change_pushes(p: Any, q: Array, v: Array) -> None:
    """Find how what contacts push by changes along tangents of the state whose forces were found last."""


@singledispatch
def pulled(p: Any, q: Array, v: Array, multiplier: Array, known: Array, a: Array) -> None:
    """Evaluate accelerations by some multipliers, and their tangents at fixed ones; variants take known ones."""
    raise NotImplementedError


@singledispatch
def variant_residual(p: Any, k: int, multiplier: Array) -> None:
    """Evaluate the residual of a variant at its state."""
    raise NotImplementedError


@pulled.register(TangentParameters)
@inlined
def _pulled(p: TangentParameters, q: Array, v: Array, multiplier: Array, known: Array, a: Array) -> None:
    dq, dv, da = q[p.n_position_lines :], v[p.n_lines :], a[p.n_lines :]
    if p.variants.any != 0:
        change_residual(p, q, v, multiplier, known)
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


@variant_residual.register(TangentParameters)
@inlined
def _residual(p: TangentParameters, k: int, multiplier: Array) -> None:
    m = p.variants
    call_native(m.residual[k], (m.inputs[k], m.q, m.v, multiplier, m.a, m.r))


@inlined
def change_residual(p: TangentParameters, q: Array, v: Array, multiplier: Array, a: Array) -> None:
    """Find by what residuals change with variants at accelerations a."""
    m = p.variants
    for i in range(p.n):
        for lane in range(LANES):
            p.dr[i, lane] = 0.0
    for k in range(m.residual.size):
        if m.residual[k] != 0:
            take_state(m, k, q, v, a)
            variant_residual(p, k, multiplier)
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


leapfrog_step.register(TangentParameters, take_leap)


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
        turn, at = p.quaternions[k, 0], p.quaternions[k, 1]
        of, to = p.n_lines + LANES * turn, p.n_position_lines + LANES * at
        p.turns.step[0] = h
        call_native(p.turns.turn_tangents, (p.turns.step, q[at:], v[turn:], q[to:], v[of:], q[at:], q[to:]))


@velocities.register(TangentParameters)
def _velocities(p: TangentParameters, q: Array, v: Array, dq: Array) -> None:
    if p.quaternions.shape[0] == 0:
        copy(v, dq)
        return
    for i in range(p.n):
        if p.position[i] >= 0:
            dq[p.position[i]] = v[i]
            to, at = p.n_position_lines + LANES * p.position[i], p.n_lines + LANES * i
            for lane in range(LANES):
                dq[to + lane] = v[at + lane]
    for k in range(p.quaternions.shape[0]):
        turn, at = p.quaternions[k, 0], p.quaternions[k, 1]
        of, to = p.n_lines + LANES * turn, p.n_position_lines + LANES * at
        along = (p.turns.step, q[at:], v[turn:], q[to:], v[of:], dq[at:], dq[to:])
        call_native(p.turns.rate_tangents, along)

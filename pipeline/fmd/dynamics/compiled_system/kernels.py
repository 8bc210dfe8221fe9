"""Accelerations of a compiled mechanism, and how its positions follow the rates."""

from __future__ import annotations

import math
from typing import Any

from fmd.core.arrays import Array
from fmd.core.limits.round_off import NO_TURN
from fmd.dynamics.compiled_system.parameters import CompiledParameters, Leapfrog, TreeParameters
from fmd.dynamics.system import accelerations, advance, leapfrog_step, project, project_onto_constraints, velocities
from fmd.kernels.kernel import inlined
from fmd.kernels.vectors import call_native


@inlined
def set_inputs(p: CompiledParameters, t: float) -> None:
    """Evaluate the signals at a time t [s], unless they are there from the last call."""
    if p.signals != 0 and p.clock[0] != t:
        inputs_at(p, t, p.inputs)
        p.clock[0] = t


@inlined
def inputs_at(p: CompiledParameters, t: float, inputs: Array) -> None:
    """Evaluate the signals at a time t [s]: value, rate and acceleration of each."""
    p.clock[1] = t
    call_native(p.signals, (p.clock[1:], inputs))


@accelerations.register(TreeParameters)
def _accelerations(p: TreeParameters, t: float, q: Array, v: Array, a: Array) -> None:
    set_inputs(p, float(t))
    call_native(p.accelerations, (p.inputs, q, v, a))


@project.register(TreeParameters)
def _project(p: TreeParameters, t: float, q: Array, v: Array) -> None:
    pass


@project_onto_constraints.register(TreeParameters)
def _close_nothing(p: TreeParameters, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    pass


@leapfrog_step.register(TreeParameters)
def _leapfrog_step(p: TreeParameters, leapfrog: Leapfrog, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    if leapfrog.leap:
        set_inputs(p, float(t))
        leapfrog.step[0] = h
        call_native(leapfrog.leap, (p.inputs, leapfrog.step, q, v, a))
        return
    take_leap(p, leapfrog, t, h, q, v, a)


@inlined
def take_leap(p: Any, leapfrog: Leapfrog, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Take a leapfrog step of any mechanism by its accelerations."""
    for i in range(v.size):
        leapfrog.v_now[i] = v[i] + 0.5 * h * a[i]
    accelerations(p, t, q, leapfrog.v_now, a)
    for i in range(v.size):
        v[i] += h * a[i]
    advance(p, q, v, h, 0, v.size)


@advance.register(CompiledParameters)
def _advance(p: CompiledParameters, q: Array, v: Array, h: float, first: int, last: int) -> None:
    if p.quaternions.shape[0] == 0:
        for i in range(first, last):
            q[i] += h * v[i]
        return
    for i in range(first, last):
        if p.position[i] >= 0:
            q[p.position[i]] += h * v[i]
    for k in range(p.quaternions.shape[0]):
        if first <= p.quaternions[k, 0] < last:
            _advance_quaternion(q, p.quaternions[k, 1], v, p.quaternions[k, 0], h)


@velocities.register(CompiledParameters)
def _velocities(p: CompiledParameters, q: Array, v: Array, dq: Array) -> None:
    if p.quaternions.shape[0] == 0:
        for i in range(v.size):
            dq[i] = v[i]
        return
    for i in range(v.size):
        if p.position[i] >= 0:
            dq[p.position[i]] = v[i]
    for k in range(p.quaternions.shape[0]):
        quaternion_rate(q, p.quaternions[k, 1], v, p.quaternions[k, 0], dq)


@inlined
def quaternion_rate(q: Array, at: int, v: Array, turn: int, dq: Array) -> None:
    """``½ e ∘ (ω, 0)`` for rates ω about the body's own axes."""
    wx, wy, wz = 0.5 * v[turn], 0.5 * v[turn + 1], 0.5 * v[turn + 2]
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    dq[at] = w * wx + y * wz - z * wy
    dq[at + 1] = w * wy - x * wz + z * wx
    dq[at + 2] = w * wz + x * wy - y * wx
    dq[at + 3] = -x * wx - y * wy - z * wz


@inlined
def _advance_quaternion(q: Array, at: int, v: Array, turn: int, h: float) -> None:
    """Turn the unit quaternion at ``q[at]`` by h times the body's own rates; the only place where one changes."""
    wx, wy, wz = 0.5 * h * v[turn], 0.5 * h * v[turn + 1], 0.5 * h * v[turn + 2]
    size = math.sqrt(wx * wx + wy * wy + wz * wz)
    s, c = (math.sin(size) / size, math.cos(size)) if size > NO_TURN else (1.0, 1.0)
    wx, wy, wz = s * wx, s * wy, s * wz
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    e0 = w * wx + x * c + y * wz - z * wy
    e1 = w * wy - x * wz + y * c + z * wx
    e2 = w * wz + x * wy - y * wx + z * c
    e3 = w * c - x * wx - y * wy - z * wz
    norm = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    q[at], q[at + 1], q[at + 2], q[at + 3] = norm * e0, norm * e1, norm * e2, norm * e3

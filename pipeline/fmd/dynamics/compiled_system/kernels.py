"""Accelerations of a compiled mechanism, and how its positions follow the rates."""

from __future__ import annotations

from typing import Any

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.parameters import CompiledParameters, Leapfrog, TreeParameters
from fmd.dynamics.system import (
    accelerations,
    advance,
    choose_constraints_anew,
    leapfrog_step,
    project_onto_constraints,
    remember_found,
    velocities,
)
from fmd.kernels.arrays import copy
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


@leapfrog_step.register(TreeParameters)
def _leapfrog_step(p: TreeParameters, leapfrog: Leapfrog, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    if leapfrog.leap:
        set_inputs(p, float(t))
        leapfrog.step[0] = h
        call_native(leapfrog.leap, (p.inputs, leapfrog.step, q, v, a))
        return
    take_leap(p, leapfrog, t, h, q, v, a)


@leapfrog_step.register(CompiledParameters)
@inlined
def take_leap(p: Any, leapfrog: Leapfrog, t: float, h: float, q: Array, v: Array, a: Array) -> None:
    """Take a leapfrog step of any mechanism by its accelerations."""
    for i in range(v.size):
        leapfrog.v_now[i] = v[i] + 0.5 * h * a[i]
    choose_constraints_anew(p)
    accelerations(p, t, q, leapfrog.v_now, a)
    remember_found(p, t)
    for i in range(v.size):
        v[i] += h * a[i]
    advance(p, q, v, h, 0, v.size)
    project_onto_constraints(p, t + h, h, q, v, a)


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
        turn, at = p.quaternions[k, 0], p.quaternions[k, 1]
        if first <= turn < last:
            p.turns.step[0] = h
            call_native(p.turns.turn, (p.turns.step, q[at:], v[turn:], q[at:]))


@velocities.register(CompiledParameters)
def _velocities(p: CompiledParameters, q: Array, v: Array, dq: Array) -> None:
    if p.quaternions.shape[0] == 0:
        copy(v, dq)
        return
    for i in range(v.size):
        if p.position[i] >= 0:
            dq[p.position[i]] = v[i]
    for k in range(p.quaternions.shape[0]):
        turn, at = p.quaternions[k, 0], p.quaternions[k, 1]
        call_native(p.turns.rate, (p.turns.step, q[at:], v[turn:], dq[at:]))

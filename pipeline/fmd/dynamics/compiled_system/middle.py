"""Reversible sub-cycling of a compiled mechanism: its equations at a major cycle's middle, the slow ones reacting.

With ``D = M_LL⁻¹ M_LS`` and ``T = (−D, 1)`` the fast equation is ``S̄ a_S = Tᵀ Q̂`` with ``S̄ = M_SS − M_SL D``, and Q̂
is carried on by its exact tangents along T. Its solution is the fast part of ``M̂⁻¹ Q̂``, so no matrix is factored:
compiled functions solve for eight columns at once.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.closed import begin_reaction, close_reaction, close_response
from fmd.dynamics.compiled_system.frozen import (
    complete_constant,
    freeze_single,
    keep_columns,
    step_all,
    step_single,
)
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import CompiledParameters, MiddleCycle
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import accelerations, freeze_middle, reacting_steps, slow_response, velocities
from fmd.kernels.kernel import inlined
from fmd.kernels.vectors import call_native


@inlined
def _find_reaction(p: CompiledParameters, q: Array, block: int, D: Array, middle: MiddleCycle) -> None:
    """Compute D and how all coordinates follow a block of fast ones."""
    frozen, along = middle.frozen, middle.along_rates[block]
    first, n, n_slow = frozen.n_slow + LANES * block, along.shape[0], frozen.n_slow
    count = min(LANES, n - first)
    call_native(middle.inertia, (p.inputs, q, frozen.unit_rates[block], frozen.f))
    call_native(middle.solve_slow, (p.inputs, q, frozen.f, frozen.x))
    close_reaction(p, frozen.x, first, count, n_slow)
    for i in range(n_slow):
        for lane in range(LANES):
            along[i, lane] = -frozen.x[i, lane]
    for lane in range(count):
        for i in range(n_slow):
            D[first + lane, i] = frozen.x[i, lane]
    for lane in range(count if p.quaternions.shape[0] else 0):
        for i in range(n):
            middle.row[i] = along[i, lane]
        velocities(p, q, middle.row, frozen.moved)
        for i in range(q.size):
            middle.along_positions[block, i, lane] = frozen.moved[i]


@inlined
def _keep_response(
    p: CompiledParameters, q: Array, block: int, D: Array, middle: MiddleCycle, on_fast: Array, on_slow: Array
) -> None:
    """Keep what a block of columns of −Q̂, in ``frozen.f``, does to the fast accelerations and to that of y.

    With ``x = M̂⁻¹ f`` the latter is ``M_LL⁻¹ f_L = x_L + D x_S``.
    """
    frozen = middle.frozen
    n_fast, n_slow, first, f, x = on_fast.shape[0], frozen.n_slow, LANES * block, frozen.f, frozen.x
    call_native(middle.solve, (p.inputs, q, f, x))
    close_response(p, f, x)
    keep_columns(x, block, n_slow, on_fast)
    for i in range(n_slow):
        for lane in range(LANES):
            f[i, lane] = x[i, lane]
        for k in range(n_slow, n_slow + n_fast):
            for lane in range(LANES):
                f[i, lane] += D[k, i] * x[k, lane]
        for lane in range(min(LANES, n_fast - first)):
            on_slow[first + lane, i] = f[i, lane]


@inlined
def freeze_reacting(p: CompiledParameters, q: Array, v: Array, D: Array, middle: MiddleCycle, a: Array) -> None:
    """Freeze the fast equation at a state with accelerations a, the slow coordinates reacting to the fast ones."""
    frozen, n_slow = middle.frozen, middle.frozen.n_slow
    plain = p.quaternions.shape[0] == 0  # positions follow as rates do
    begin_reaction(p, middle.inertia, middle.solve_slow, q, n_slow)
    for block in range(middle.along_rates.shape[0]):
        _find_reaction(p, q, block, D, middle)
    for block in range(middle.along_rates.shape[0]):
        rates = middle.along_rates[block]
        positions = rates if plain else middle.along_positions[block]
        call_native(frozen.stiffness, (p.inputs, q, v, middle.rest, positions, frozen.f))
        _keep_response(p, q, block, D, middle, frozen.K, middle.Ky)
        if frozen.damped:
            call_native(frozen.damping, (p.inputs, q, v, rates, frozen.f))
            _keep_response(p, q, block, D, middle, frozen.C, middle.Cy)
    _complete(q, v, D, middle, a)


@inlined
def _freeze_together(p: CompiledParameters, q: Array, v: Array, D: Array, middle: MiddleCycle) -> None:
    """Do what `freeze_reacting` does, and find the accelerations, by one function for each eight fast coordinates."""
    frozen, found, a, n_slow = middle.frozen, middle.found, middle.a, middle.frozen.n_slow
    n_fast = v.size - n_slow
    for block in range(frozen.unit_rates.shape[0]):
        units = frozen.unit_rates[block]
        if frozen.damped:
            filled = (a, found[0], found[1], found[2], found[3], found[4])
            call_native(middle.react, (p.inputs, q, v, units, *filled))
            keep_columns(found[3], block, n_slow, frozen.C)
        else:
            call_native(middle.react, (p.inputs, q, v, units, a, found[0], found[1], found[2]))
        keep_columns(found[1], block, n_slow, frozen.K)
        first = LANES * block
        for lane in range(min(LANES, n_fast - first)):
            for i in range(n_slow):
                D[n_slow + first + lane, i] = found[0, i, lane]
                middle.Ky[first + lane, i] = found[2, i, lane]
                if frozen.damped:
                    middle.Cy[first + lane, i] = found[4, i, lane]
    _complete(q, v, D, middle, a)


@inlined
def _complete(q: Array, v: Array, D: Array, middle: MiddleCycle, a: Array) -> None:
    """Complete the fast equation and the acceleration of y with accelerations a."""
    n_slow = middle.frozen.n_slow
    for i in range(n_slow):
        middle.y[i] = a[i]
        for j in range(n_slow, v.size):
            middle.y[i] += D[j, i] * a[j]
    for i in range(n_slow, v.size):
        middle.frozen.slope[i] = 0.0
    complete_constant(middle.frozen, q, v, a)


@freeze_middle.register(CompiledParameters)
def _freeze_middle(p: CompiledParameters, t: float, q: Array, v: Array, D: Array, middle: MiddleCycle) -> None:
    middle.frozen.time[0] = t
    set_inputs(p, float(t))
    if not middle.react:
        accelerations(p, t, q, v, middle.a)
    for i in range(q.size):
        middle.q[i] = q[i]
    for i in range(v.size):
        middle.v[i] = v[i]
    if middle.loose:
        freeze_single(p, q, v, middle.a, middle.frozen)
        for i in range(middle.frozen.n_slow, v.size):
            middle.frozen.slope[i] = 0.0
    elif middle.react:
        _freeze_together(p, q, v, D, middle)
    else:
        freeze_reacting(p, q, v, D, middle, middle.a)


@reacting_steps.register(CompiledParameters)
def _reacting_steps(
    p: CompiledParameters, middle: MiddleCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    if middle.loose:
        step_single(p, middle.frozen, first, h, count, q, v, a)
    else:
        step_all(p, middle.frozen, first, h, count, q, v, a)


@slow_response.register(CompiledParameters)
def _slow_response(
    p: CompiledParameters, middle: MiddleCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    n_slow, n, offset = middle.frozen.n_slow, v.size, middle.q.size - v.size
    if middle.loose:  # D is zero: the slow equations by themselves
        for j in range(n_slow, n):
            middle.q[j + offset], middle.v[j] = q[j], v[j]
        accelerations(p, middle.frozen.time[0], middle.q, middle.v, middle.a)
        for i in range(n_slow):
            a[i] = middle.a[i]
        return
    for i in range(n_slow):
        total = middle.y[i]
        for j in range(n_slow, n):
            total -= middle.Ky[j - n_slow, i] * (q[j] - middle.q[j + offset])
            if middle.frozen.damped:
                total -= middle.Cy[j - n_slow, i] * (v[j] - middle.v[j])
        a[i] = total

"""Reversible sub-cycling of a compiled mechanism: its equations at a major cycle's middle, the slow ones reacting.

With ``D = M_LL⁻¹ M_LS`` and ``T = (−D, 1)`` the fast equation is ``S̄ a_S = Tᵀ Q̂`` with ``S̄ = M_SS − M_SL D``, and Q̂
is carried on by its exact tangents along T. Its solution is the fast part of ``M̂⁻¹ Q̂``, so no matrix is factored:
compiled functions solve for eight columns at once.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.closed import begin_reaction, close_reaction, close_response
from fmd.dynamics.compiled_system.held import (
    complete_constant,
    hold_single,
    keep_columns,
    step_all,
    step_single,
)
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import CompiledParameters, MiddleCycle
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.jit.compiled import inlined, meaning
from fmd.dynamics.jit.native import call_native
from fmd.dynamics.system import accelerations, hold_middle, reacting_steps, slow_response, velocities


@inlined
def _find_reaction(p: CompiledParameters, q: Array, block: int, D: Array, middle: MiddleCycle) -> None:
    """Compute D and how all coordinates follow a block of fast ones."""
    held, along = middle.held, middle.along_rates[block]
    first, n, n_slow = held.n_slow + LANES * block, along.shape[0], held.n_slow
    count = min(LANES, n - first)
    call_native(middle.inertia, (p.inputs, q, held.unit_rates[block], held.f))
    call_native(middle.solve_slow, (p.inputs, q, held.f, held.x))
    close_reaction(p, held.x, first, count, n_slow)
    for i in range(n_slow):
        for lane in range(LANES):
            along[i, lane] = -held.x[i, lane]
    for lane in range(count):
        for i in range(n_slow):
            D[first + lane, i] = held.x[i, lane]
    for lane in range(count if p.quaternions.shape[0] else 0):
        for i in range(n):
            middle.row[i] = along[i, lane]
        velocities(p, q, middle.row, held.moved)
        for i in range(q.size):
            middle.along_positions[block, i, lane] = held.moved[i]


@inlined
def _keep_response(
    p: CompiledParameters, q: Array, block: int, D: Array, middle: MiddleCycle, on_fast: Array, on_slow: Array
) -> None:
    """Keep what a block of columns of −Q̂, in ``held.f``, does to the fast accelerations and to that of y.

    With ``x = M̂⁻¹ f`` the latter is ``M_LL⁻¹ f_L = x_L + D x_S``.
    """
    held = middle.held
    n_fast, n_slow, first, f, x = on_fast.shape[0], held.n_slow, LANES * block, held.f, held.x
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
def hold_reacting(p: CompiledParameters, q: Array, v: Array, D: Array, middle: MiddleCycle, a: Array) -> None:
    """Hold the fast equation at a state with accelerations a, the slow coordinates reacting to the fast ones."""
    held, n_slow = middle.held, middle.held.n_slow
    plain = p.quaternions.shape[0] == 0  # positions follow as rates do
    begin_reaction(p, middle.inertia, middle.solve_slow, q, n_slow)
    for block in range(middle.along_rates.shape[0]):
        _find_reaction(p, q, block, D, middle)
    for block in range(middle.along_rates.shape[0]):
        rates = middle.along_rates[block]
        positions = rates if plain else middle.along_positions[block]
        call_native(held.stiffness, (p.inputs, q, v, middle.rest, positions, held.f))
        _keep_response(p, q, block, D, middle, held.K, middle.Ky)
        if held.damped:
            call_native(held.damping, (p.inputs, q, v, rates, held.f))
            _keep_response(p, q, block, D, middle, held.C, middle.Cy)
    _complete(q, v, D, middle, a)


@inlined
def _hold_together(p: CompiledParameters, q: Array, v: Array, D: Array, middle: MiddleCycle) -> None:
    """Do what `hold_reacting` does, and find the accelerations, by one function for each eight fast coordinates."""
    held, found, a, n_slow = middle.held, middle.found, middle.a, middle.held.n_slow
    n_fast = v.size - n_slow
    for block in range(held.unit_rates.shape[0]):
        units = held.unit_rates[block]
        if held.damped:
            filled = (a, found[0], found[1], found[2], found[3], found[4])
            call_native(middle.react, (p.inputs, q, v, units, *filled))
            keep_columns(found[3], block, n_slow, held.C)
        else:
            call_native(middle.react, (p.inputs, q, v, units, a, found[0], found[1], found[2]))
        keep_columns(found[1], block, n_slow, held.K)
        first = LANES * block
        for lane in range(min(LANES, n_fast - first)):
            for i in range(n_slow):
                D[n_slow + first + lane, i] = found[0, i, lane]
                middle.Ky[first + lane, i] = found[2, i, lane]
                if held.damped:
                    middle.Cy[first + lane, i] = found[4, i, lane]
    _complete(q, v, D, middle, a)


@inlined
def _complete(q: Array, v: Array, D: Array, middle: MiddleCycle, a: Array) -> None:
    """Complete the fast equation and the acceleration of y with accelerations a."""
    n_slow = middle.held.n_slow
    for i in range(n_slow):
        middle.y[i] = a[i]
        for j in range(n_slow, v.size):
            middle.y[i] += D[j, i] * a[j]
    for i in range(n_slow, v.size):
        middle.held.slope[i] = 0.0
    complete_constant(middle.held, q, v, a)


@meaning(hold_middle, CompiledParameters)
def _hold_middle(p: CompiledParameters, t: float, q: Array, v: Array, D: Array, middle: MiddleCycle) -> None:
    middle.held.time[0] = t
    set_inputs(p, float(t))
    if not middle.react:
        accelerations(p, t, q, v, middle.a)
    for i in range(q.size):
        middle.q[i] = q[i]
    for i in range(v.size):
        middle.v[i] = v[i]
    middle.fresh[0] = 1.0
    if middle.loose:
        hold_single(p, q, v, middle.a, middle.held)
        for i in range(middle.held.n_slow, v.size):
            middle.held.slope[i] = 0.0
    elif middle.react:
        _hold_together(p, q, v, D, middle)
    else:
        hold_reacting(p, q, v, D, middle, middle.a)


@meaning(reacting_steps, CompiledParameters)
def _reacting_steps(
    p: CompiledParameters, middle: MiddleCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    if middle.loose:
        step_single(middle.held, first, h, count, middle.fresh[0] != 0.0, q, v, a)
    else:
        step_all(p, middle.held, first, h, count, q, v, a)
    middle.fresh[0] = 0.0


@meaning(slow_response, CompiledParameters)
def _slow_response(
    p: CompiledParameters, middle: MiddleCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    n_slow, n, offset = middle.held.n_slow, v.size, middle.q.size - v.size
    if middle.loose:  # D is zero: the slow equations by themselves
        for j in range(n_slow, n):
            middle.q[j + offset], middle.v[j] = q[j], v[j]
        accelerations(p, middle.held.time[0], middle.q, middle.v, middle.a)
        for i in range(n_slow):
            a[i] = middle.a[i]
        return
    for i in range(n_slow):
        total = middle.y[i]
        for j in range(n_slow, n):
            total -= middle.Ky[j - n_slow, i] * (q[j] - middle.q[j + offset])
            if middle.held.damped:
                total -= middle.Cy[j - n_slow, i] * (v[j] - middle.v[j])
        a[i] = total

"""Sub-cycling of a compiled mechanism: the fast coordinates' equation, linearised at the start of a major cycle.

With the residual ``r = M̂ a − Q̂`` of the equations of motion and the slow accelerations held, the fast rows change by
``M_SS δa_S = −(∂r_S/∂q_S δq_S + ∂r_S/∂v_S δv_S + ∂r_S/∂u δu + r'_S τ)``: u are the loads, evaluated at each fast step,
and r' is the change with what the slow coordinates do. The derivatives are exact, so that the equation held over the
cycle lacks terms of τ² alone.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.kernels import inputs_at, set_inputs
from fmd.dynamics.compiled_system.parameters import CompiledParameters, HeldCycle, TreeParameters
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.jit.compiled import contracted, inlined, meaning
from fmd.dynamics.jit.native import call_native
from fmd.dynamics.jit.oscillators import step_damped, step_undamped
from fmd.dynamics.system import fast_steps, hold_slow, velocities


@inlined
def hold_single(p: CompiledParameters, q: Array, v: Array, a: Array, held: HeldCycle) -> None:
    """Hold fast coordinates that don't couple, at accelerations a."""
    n, offset = v.size, q.size - v.size
    moved = v
    if p.quaternions.shape[0]:
        velocities(p, q, v, held.moved)
        moved = held.moved
    call_native(
        held.hold_single,
        (p.inputs, q, v, a, moved, held.drift, held.by_inputs, held.by_positions, held.by_rates),
    )
    for i in range(held.n_slow, n):
        over = held.inverse_mass[i]
        k, c = over * held.by_positions[i], over * held.by_rates[i] if held.damped else 0.0
        held.k[i], held.c[i] = k, c
        held.constant[i] = a[i] + k * q[i + offset] + c * v[i]
        held.slope[i] = -over * held.drift[i]
    for j in range(held.driven.size):
        for i in range(held.n_slow, n):
            held.lever[j, i] = -held.by_inputs[held.driven[j], i] * held.inverse_mass[i]


@inlined
def _hold_drift(p: CompiledParameters, q: Array, v: Array, a: Array, held: HeldCycle) -> None:
    """Hold how the slow coordinates' motion and the inputs change the fast accelerations."""
    n, n_slow, n_columns = v.size, held.n_slow, 1 + held.driven.size
    velocities(p, q, v, held.moved)
    call_native(held.find_drift, (p.inputs, q, v, a, held.moved, held.drift, held.by_inputs))
    for first in range(0, n_columns, LANES):
        count = min(LANES, n_columns - first)
        for lane in range(count):
            column = held.by_inputs[held.driven[first + lane - 1]] if first + lane else held.drift
            for i in range(n_slow, n):
                held.f[i, lane] = column[i]
        call_native(held.solve_fast, (p.inputs, q, held.f, held.x))
        for lane in range(count):
            column = held.lever[first + lane - 1] if first + lane else held.slope
            for i in range(n_slow, n):
                column[i] = -held.x[i, lane]


@inlined
def keep_columns(x: Array, block: int, n_slow: int, out: Array) -> None:
    """Keep a block of eight columns, of the fast rows, as rows of a matrix (n_fast, n_fast)."""
    n_fast, first = out.shape[0], LANES * block
    for lane in range(min(LANES, n_fast - first)):
        for i in range(n_fast):
            out[first + lane, i] = x[n_slow + i, lane]


@inlined
def complete_constant(held: HeldCycle, q: Array, v: Array, a: Array) -> None:
    """Choose the constant of the held equation so that it gives the fast accelerations at a state."""
    n_slow, offset, n_fast = held.n_slow, q.size - v.size, v.size - held.n_slow
    for i in range(n_slow, v.size):
        held.constant[i] = a[i]
    for j in range(n_fast):
        x, u = q[n_slow + offset + j], v[n_slow + j]
        for i in range(n_fast):
            held.constant[n_slow + i] += held.K[j, i] * x
        if held.damped:
            for i in range(n_fast):
                held.constant[n_slow + i] += held.C[j, i] * u


@inlined
def _hold_coupled(p: CompiledParameters, q: Array, v: Array, a: Array, held: HeldCycle) -> None:
    _hold_drift(p, q, v, a, held)
    for block in range(held.unit_rates.shape[0]):
        call_native(held.stiffness, (p.inputs, q, v, a, held.unit_positions[block], held.f))
        call_native(held.solve_fast, (p.inputs, q, held.f, held.x))
        keep_columns(held.x, block, held.n_slow, held.K)
        if held.damped:
            call_native(held.damping, (p.inputs, q, v, held.unit_rates[block], held.f))
            call_native(held.solve_fast, (p.inputs, q, held.f, held.x))
            keep_columns(held.x, block, held.n_slow, held.C)
    complete_constant(held, q, v, a)


@inlined
def set_active(p: CompiledParameters, t: float, held: HeldCycle) -> None:
    """Find whether any input changes in the cycle from t [s] on, and keep those of its start in ``before``."""
    held.active[0] = 0.0
    if held.driven.size == 0:
        return
    inputs_at(p, t + held.cycle[0], held.now)
    for k in range(p.inputs.size // 3):
        held.before[3 * k] = p.inputs[3 * k]
        for i in range(1, 3):
            held.before[3 * k + i] = p.inputs[3 * k + i]
            if p.inputs[3 * k + i] != 0.0 or held.now[3 * k + i] != 0.0:
                held.active[0] = 1.0
        if p.inputs[3 * k] != held.now[3 * k]:
            held.active[0] = 1.0
    for k in range(held.breakpoints.size):  # a short load may begin and end within the cycle
        if t < held.breakpoints[k] < t + held.cycle[0]:
            held.active[0] = 1.0


@meaning(hold_slow, TreeParameters)
def _hold_slow(p: TreeParameters, t: float, q: Array, v: Array, a: Array, frozen: HeldCycle) -> None:
    set_inputs(p, float(t))
    set_active(p, float(t), frozen)
    frozen.time[0] = t
    if frozen.single:
        hold_single(p, q, v, a, frozen)
    else:
        _hold_coupled(p, q, v, a, frozen)


@inlined
def add_loads(p: CompiledParameters, held: HeldCycle, t: float, a: Array) -> None:
    """Add to a how the loads at a time t [s] accelerate the fast coordinates beyond those at the cycle's start."""
    inputs_at(p, t, held.now)
    for k in range(held.driven.size):
        change = held.now[held.driven[k]] - held.before[held.driven[k]]
        for i in range(held.n_slow, a.size):
            a[i] += change * held.lever[k, i]


@inlined
def step_driven(
    p: CompiledParameters, held: HeldCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    """Take leapfrog steps with uncoupled coordinates under varying loads, from time ``first · h``.

    Loads are evaluated for some steps ahead, through which each coordinate then goes by itself.
    """
    changes, done = held.changes, 0
    while done < count:
        ahead = min(changes.shape[0], count - done)
        for step in range(ahead):
            inputs_at(p, (first + done + step) * h, held.now)
            for k in range(held.driven.size):
                changes[step, k] = held.now[held.driven[k]] - held.before[held.driven[k]]
        for i in range(held.n_slow, v.size):
            _step_one(held, first + done, h, ahead, i, q, v, a)
        done += ahead


@contracted
def _step_one(held: HeldCycle, first: int, h: float, count: int, i: int, q: Array, v: Array, a: Array) -> None:
    """Take leapfrog steps with one coordinate under the loads of ``changes``, from time ``first · h``."""
    place, start = i + q.size - v.size, held.time[0]
    constant, slope, k, c = held.constant[i], held.slope[i], held.k[i], held.c[i]
    x, rate, acceleration = q[place], v[i], a[i]
    for step in range(count):
        load = constant + ((first + step) * h - start) * slope  # not a sum, whose round-off depends on its first term
        for j in range(held.driven.size):
            load += held.changes[step, j] * held.lever[j, i]
        if held.damped:
            load -= c * (rate + 0.5 * h * acceleration)
        acceleration = load - k * x
        rate += h * acceleration
        x += h * rate
    q[place], v[i], a[i] = x, rate, acceleration


@inlined
def step_single(held: HeldCycle, first: int, h: float, count: int, begins: bool, q: Array, v: Array, a: Array) -> None:
    """Take leapfrog steps with uncoupled coordinates from time ``first · h``; ``begins`` tells a cycle's first call."""
    start, constant, slope, k = held.time[0], held.constant, held.slope, held.k
    if held.damped:
        step_damped(held.n_slow, constant, slope, k, held.c, q, v, a, first, start, h, count)
    else:
        d, rising = held.d, held.rising
        step_undamped(held.n_slow, constant, slope, k, q, v, a, d, rising, first, start, h, count, begins)


@inlined
def step_all(
    p: CompiledParameters, held: HeldCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    """Take leapfrog steps with coordinates that couple, from time ``first · h``."""
    held.clock[1] = h
    for step in range(count):
        t = (first + step) * h  # not a sum, whose round-off would depend on how a cycle is divided
        held.clock[0] = t - held.time[0]
        if held.active[0] != 0.0:
            for i in range(held.n_slow, v.size):
                held.load[i] = 0.0
            add_loads(p, held, t, held.load)
        if held.unrolled:
            _step_unrolled(held, q, v, a)
        else:
            _step_looped(held, q, v, a)
    for i in range(held.n_slow, v.size):
        held.load[i] = 0.0


@inlined
def _step_unrolled(held: HeldCycle, q: Array, v: Array, a: Array) -> None:
    if held.damped:
        call_native(held.unrolled, (held.clock, held.constant, held.slope, held.load, held.K, held.C, q, v, a))
    else:
        call_native(held.unrolled, (held.clock, held.constant, held.slope, held.load, held.K, q, v, a))


@inlined
def _step_looped(held: HeldCycle, q: Array, v: Array, a: Array) -> None:
    K, C, v_now = held.K, held.C, held.v_now
    n, offset, n_slow, tau, h = v.size, q.size - v.size, held.n_slow, held.clock[0], held.clock[1]
    for i in range(n_slow, n):
        v_now[i] = v[i] + 0.5 * h * a[i]
        a[i] = held.constant[i] + tau * held.slope[i] + held.load[i]
    for j in range(n - n_slow):
        x = q[n_slow + offset + j]
        for i in range(n - n_slow):
            a[n_slow + i] -= K[j, i] * x
    if held.damped:
        for j in range(n - n_slow):
            x = v_now[n_slow + j]
            for i in range(n - n_slow):
                a[n_slow + i] -= C[j, i] * x
    for i in range(n_slow, n):
        v[i] += h * a[i]
        q[i + offset] += h * v[i]


@meaning(fast_steps, TreeParameters)
def _fast_steps(
    p: TreeParameters, frozen: HeldCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    if not frozen.single:
        step_all(p, frozen, first, h, count, q, v, a)
    elif frozen.active[0] != 0.0:
        step_driven(p, frozen, first, h, count, q, v, a)
    else:
        step_single(frozen, first, h, count, (first - 1) * h == frozen.time[0], q, v, a)

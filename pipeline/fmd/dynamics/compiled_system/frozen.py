"""Sub-cycling of a compiled mechanism: the fast coordinates' equation, linearised at the start of a major cycle.

With the residual ``r = M̂ a − Q̂`` of the equations of motion and the slow accelerations frozen, the fast rows change by
``M_SS δa_S = −(∂r_S/∂q_S δq_S + ∂r_S/∂v_S δv_S + ∂r_S/∂u δu + r'_S τ)``: u are the loads, evaluated at each fast step,
and r' is the change with what the slow coordinates do. The derivatives are exact, so that the equation frozen over the
cycle lacks terms of τ² alone.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.kernels import inputs_at, set_inputs
from fmd.dynamics.compiled_system.parameters import CompiledParameters, FrozenCycle, TreeParameters
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import fast_steps, freeze_slow, velocities
from fmd.kernels.kernel import contracted, inlined
from fmd.kernels.vectors import call_native


@inlined
def freeze_single(p: CompiledParameters, q: Array, v: Array, a: Array, frozen: FrozenCycle) -> None:
    """Freeze fast coordinates that don't couple, at accelerations a."""
    n, offset = v.size, q.size - v.size
    moved = v
    if p.quaternions.shape[0]:
        velocities(p, q, v, frozen.moved)
        moved = frozen.moved
    call_native(
        frozen.freeze_single,
        (p.inputs, q, v, a, moved, frozen.drift, frozen.by_inputs, frozen.by_positions, frozen.by_rates),
    )
    for i in range(frozen.n_slow, n):
        over = frozen.inverse_mass[i]
        k, c = over * frozen.by_positions[i], over * frozen.by_rates[i] if frozen.damped else 0.0
        frozen.k[i], frozen.c[i] = k, c
        frozen.constant[i] = a[i] + k * q[i + offset] + c * v[i]
        frozen.slope[i] = -over * frozen.drift[i]
    for j in range(frozen.driven.size):
        for i in range(frozen.n_slow, n):
            frozen.lever[j, i] = -frozen.by_inputs[frozen.driven[j], i] * frozen.inverse_mass[i]


@inlined
def _freeze_drift(p: CompiledParameters, q: Array, v: Array, a: Array, frozen: FrozenCycle) -> None:
    """Freeze how the slow coordinates' motion and the inputs change the fast accelerations."""
    n, n_slow, n_columns = v.size, frozen.n_slow, 1 + frozen.driven.size
    velocities(p, q, v, frozen.moved)
    call_native(frozen.find_drift, (p.inputs, q, v, a, frozen.moved, frozen.drift, frozen.by_inputs))
    for first in range(0, n_columns, LANES):
        count = min(LANES, n_columns - first)
        for lane in range(count):
            column = frozen.by_inputs[frozen.driven[first + lane - 1]] if first + lane else frozen.drift
            for i in range(n_slow, n):
                frozen.f[i, lane] = column[i]
        call_native(frozen.solve_fast, (p.inputs, q, frozen.f, frozen.x))
        for lane in range(count):
            column = frozen.lever[first + lane - 1] if first + lane else frozen.slope
            for i in range(n_slow, n):
                column[i] = -frozen.x[i, lane]


@inlined
def keep_columns(x: Array, block: int, n_slow: int, out: Array) -> None:
    """Keep a block of eight columns, of the fast rows, as rows of a matrix (n_fast, n_fast)."""
    n_fast, first = out.shape[0], LANES * block
    for lane in range(min(LANES, n_fast - first)):
        for i in range(n_fast):
            out[first + lane, i] = x[n_slow + i, lane]


@inlined
def complete_constant(frozen: FrozenCycle, q: Array, v: Array, a: Array) -> None:
    """Choose the constant of the frozen equation so that it gives the fast accelerations at a state."""
    n_slow, offset, n_fast = frozen.n_slow, q.size - v.size, v.size - frozen.n_slow
    for i in range(n_slow, v.size):
        frozen.constant[i] = a[i]
    for j in range(n_fast):
        x, u = q[n_slow + offset + j], v[n_slow + j]
        for i in range(n_fast):
            frozen.constant[n_slow + i] += frozen.K[j, i] * x
        if frozen.damped:
            for i in range(n_fast):
                frozen.constant[n_slow + i] += frozen.C[j, i] * u


@inlined
def _freeze_coupled(p: CompiledParameters, q: Array, v: Array, a: Array, frozen: FrozenCycle) -> None:
    _freeze_drift(p, q, v, a, frozen)
    for block in range(frozen.unit_rates.shape[0]):
        call_native(frozen.stiffness, (p.inputs, q, v, a, frozen.unit_positions[block], frozen.f))
        call_native(frozen.solve_fast, (p.inputs, q, frozen.f, frozen.x))
        keep_columns(frozen.x, block, frozen.n_slow, frozen.K)
        if frozen.damped:
            call_native(frozen.damping, (p.inputs, q, v, frozen.unit_rates[block], frozen.f))
            call_native(frozen.solve_fast, (p.inputs, q, frozen.f, frozen.x))
            keep_columns(frozen.x, block, frozen.n_slow, frozen.C)
    complete_constant(frozen, q, v, a)


@inlined
def set_active(p: CompiledParameters, t: float, frozen: FrozenCycle) -> None:
    """Find whether any input changes in the cycle from t [s] on, and keep those of its start in ``before``."""
    frozen.active[0] = 0.0
    if frozen.driven.size == 0:
        return
    inputs_at(p, t + frozen.cycle[0], frozen.now)
    for k in range(frozen.before.size // 3):
        frozen.before[3 * k] = p.inputs[3 * k]
        for i in range(1, 3):
            frozen.before[3 * k + i] = p.inputs[3 * k + i]
            if p.inputs[3 * k + i] != 0.0 or frozen.now[3 * k + i] != 0.0:
                frozen.active[0] = 1.0
        if p.inputs[3 * k] != frozen.now[3 * k]:
            frozen.active[0] = 1.0
    for k in range(frozen.breakpoints.size):  # a short load may begin and end within the cycle
        if t < frozen.breakpoints[k] < t + frozen.cycle[0]:
            frozen.active[0] = 1.0


@freeze_slow.register(TreeParameters)
def _freeze_slow(p: TreeParameters, t: float, q: Array, v: Array, a: Array, frozen: FrozenCycle) -> None:
    set_inputs(p, float(t))
    set_active(p, float(t), frozen)
    frozen.time[0] = t
    if frozen.single:
        freeze_single(p, q, v, a, frozen)
    else:
        _freeze_coupled(p, q, v, a, frozen)


@inlined
def add_loads(p: CompiledParameters, frozen: FrozenCycle, t: float, a: Array) -> None:
    """Add to a how the loads at a time t [s] accelerate the fast coordinates beyond those at the cycle's start."""
    inputs_at(p, t, frozen.now)
    for k in range(frozen.driven.size):
        change = frozen.now[frozen.driven[k]] - frozen.before[frozen.driven[k]]
        for i in range(frozen.n_slow, a.size):
            a[i] += change * frozen.lever[k, i]


@inlined
def step_single(
    p: CompiledParameters, frozen: FrozenCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    """Take leapfrog steps with uncoupled coordinates, from time ``first · h``.

    Loads are evaluated for some steps ahead, through which each coordinate then goes by itself.
    """
    changes, done = frozen.changes, 0
    n_driven = frozen.driven.size if frozen.active[0] != 0.0 else 0
    while done < count:
        ahead = min(changes.shape[0], count - done)
        for step in range(ahead if n_driven else 0):
            inputs_at(p, (first + done + step) * h, frozen.now)
            for k in range(n_driven):
                changes[step, k] = frozen.now[frozen.driven[k]] - frozen.before[frozen.driven[k]]
        for i in range(frozen.n_slow, v.size):
            _step_one(frozen, first + done, h, ahead, n_driven, i, q, v, a)
        done += ahead


@contracted
def _step_one(
    frozen: FrozenCycle, first: int, h: float, count: int, n_driven: int, i: int, q: Array, v: Array, a: Array
) -> None:
    """Take leapfrog steps with one coordinate under some loads of ``changes``, from time ``first · h``."""
    place, start = i + q.size - v.size, frozen.time[0]
    constant, slope, k, c = frozen.constant[i], frozen.slope[i], frozen.k[i], frozen.c[i]
    x, rate, acceleration = q[place], v[i], a[i]
    for step in range(count):
        load = constant + ((first + step) * h - start) * slope  # not a sum, whose round-off depends on its first term
        for j in range(n_driven):
            load += frozen.changes[step, j] * frozen.lever[j, i]
        if frozen.damped:
            load -= c * (rate + 0.5 * h * acceleration)
        acceleration = load - k * x
        rate += h * acceleration
        x += h * rate
    q[place], v[i], a[i] = x, rate, acceleration


@inlined
def step_all(
    p: CompiledParameters, frozen: FrozenCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    """Take leapfrog steps with coordinates that couple, from time ``first · h``."""
    frozen.clock[1] = h
    for step in range(count):
        t = (first + step) * h  # not a sum, whose round-off would depend on how a cycle is divided
        frozen.clock[0] = t - frozen.time[0]
        if frozen.active[0] != 0.0:
            for i in range(frozen.n_slow, v.size):
                frozen.load[i] = 0.0
            add_loads(p, frozen, t, frozen.load)
        if frozen.unrolled:
            _step_unrolled(frozen, q, v, a)
        else:
            _step_looped(frozen, q, v, a)
    for i in range(frozen.n_slow, v.size):
        frozen.load[i] = 0.0


@inlined
def _step_unrolled(frozen: FrozenCycle, q: Array, v: Array, a: Array) -> None:
    if frozen.damped:
        call_native(
            frozen.unrolled, (frozen.clock, frozen.constant, frozen.slope, frozen.load, frozen.K, frozen.C, q, v, a)
        )
    else:
        call_native(frozen.unrolled, (frozen.clock, frozen.constant, frozen.slope, frozen.load, frozen.K, q, v, a))


@inlined
def _step_looped(frozen: FrozenCycle, q: Array, v: Array, a: Array) -> None:
    K, C, v_now = frozen.K, frozen.C, frozen.v_now
    n, offset, n_slow, tau, h = v.size, q.size - v.size, frozen.n_slow, frozen.clock[0], frozen.clock[1]
    for i in range(n_slow, n):
        v_now[i] = v[i] + 0.5 * h * a[i]
        a[i] = frozen.constant[i] + tau * frozen.slope[i] + frozen.load[i]
    for j in range(n - n_slow):
        x = q[n_slow + offset + j]
        for i in range(n - n_slow):
            a[n_slow + i] -= K[j, i] * x
    if frozen.damped:
        for j in range(n - n_slow):
            x = v_now[n_slow + j]
            for i in range(n - n_slow):
                a[n_slow + i] -= C[j, i] * x
    for i in range(n_slow, n):
        v[i] += h * a[i]
        q[i + offset] += h * v[i]


@fast_steps.register(TreeParameters)
def _fast_steps(
    p: TreeParameters, frozen: FrozenCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    if frozen.single:
        step_single(p, frozen, first, h, count, q, v, a)
    else:
        step_all(p, frozen, first, h, count, q, v, a)

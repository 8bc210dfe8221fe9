"""Sub-cycling of a compiled mechanism: the fast coordinates' equation, linearised at the start of a major cycle.

With the residual ``r = M̂ a − Q̂`` of the equations of motion and the slow accelerations held, the fast rows change by
``M_SS δa_S = −(∂r_S/∂q_S δq_S + ∂r_S/∂v_S δv_S + ∂r_S/∂u δu + r'_S τ)``: u are the loads, evaluated at each fast step,
and r' is the change with what the slow coordinates do. The derivatives are exact, so that the equation held over the
cycle lacks terms of τ² alone.
"""

from __future__ import annotations

from pipeline.core.arrays import Array
from pipeline.dynamics.compiled_system.kernels import inputs_at, set_inputs
from pipeline.dynamics.compiled_system.parameters import CompiledParameters, Directions, HeldCycle
from pipeline.dynamics.jit.compiled import inner, meaning
from pipeline.dynamics.jit.native import call_native
from pipeline.dynamics.system import fast_steps, hold_slow, velocities

_LANES = 8


@inner
def take_tangents(p: CompiledParameters, d: Directions, q: Array, v: Array) -> None:
    """Fill ``d.dr`` with the residual's derivatives along the directions at a state, and at the accelerations d.a."""
    call_native(d.tangents, (p.inputs, q, v, d.a, d.dinputs, d.dq, d.dv, d.da, d.dr))


@inner
def _set_drift(d: Directions, q: Array, v: Array, a: Array, n_rates: int, moved: Array) -> None:
    """Let lane 0 follow the first rates, and their positions, as they change by themselves."""
    for i in range(n_rates):
        d.dv[i, 0] = a[i]
    for i in range(n_rates + q.size - v.size):
        d.dq[i, 0] = moved[i]


@inner
def _hold_single(p: CompiledParameters, q: Array, v: Array, a: Array, held: HeldCycle) -> None:
    """Hold fast coordinates that don't couple: lane 0 is the motion, 1 and 2 are all fast positions and rates."""
    d, n, offset, n_slow, n_inputs = held.directions, v.size, q.size - v.size, held.n_slow, held.driven.size
    velocities(p, q, v, held.moved)
    _set_drift(d, q, v, a, n, held.moved)
    for i in range(n_slow, n):
        d.dq[i + offset, 1], d.dv[i, 2] = 1.0, 1.0
    for k in range(min(n_inputs, _LANES - 3)):
        d.dinputs[held.driven[k], 3 + k] = 1.0
    take_tangents(p, d, q, v)
    for i in range(n_slow, n):
        over = 1.0 / held.mass[i]
        k, c = over * d.dr[i, 1], over * d.dr[i, 2] if held.damped else 0.0
        held.k[i], held.c[i] = k, c
        held.constant[i] = a[i] + k * q[i + offset] + c * v[i]
        held.slope[i] = k * v[i] + c * a[i] - over * d.dr[i, 0]
        for j in range(min(n_inputs, _LANES - 3)):
            held.lever[j, i] = -over * d.dr[i, 3 + j]
    if n_inputs > _LANES - 3:
        _hold_columns(p, q, v, held, 1 + 2 * (n - n_slow))


@inner
def _set_column(held: HeldCycle, column: int, lane: int, offset: int, n_fast: int) -> None:
    """Let a lane be the direction of a column's fast position, fast rate or input; column 0 is another."""
    d, j = held.directions, column - 1
    if 0 <= j < n_fast:
        d.dq[held.n_slow + offset + j, lane] = 1.0
    elif n_fast <= j < 2 * n_fast:
        d.dv[held.n_slow + j - n_fast, lane] = 1.0
    elif j >= 2 * n_fast:
        d.dinputs[held.driven[j - 2 * n_fast], lane] = 1.0


@inner
def _keep_column(held: HeldCycle, column: int, lane: int, offset: int, n_fast: int, q: Array, v: Array) -> None:
    """Keep what a column's direction does to the fast accelerations."""
    n_slow, j = held.n_slow, column - 1
    for i in range(n_fast):
        x = held.x[n_slow + i, lane]
        if column == 0:
            held.slope[n_slow + i] = -x
        elif j < n_fast:
            held.K[j, i] = x
            held.constant[n_slow + i] += x * q[n_slow + offset + j]
        elif j < 2 * n_fast:
            held.C[j - n_fast, i] = x
            held.constant[n_slow + i] += x * v[n_slow + j - n_fast]
        else:
            held.lever[j - 2 * n_fast, n_slow + i] = -x


@inner
def _hold_columns(p: CompiledParameters, q: Array, v: Array, held: HeldCycle, first_column: int) -> None:
    """Hold the fast coordinates' equation from a column on.

    Column 0 is what the slow coordinates do; then come the fast positions, the fast rates, and the inputs.
    """
    d, n, offset, n_slow = held.directions, v.size, q.size - v.size, held.n_slow
    n_fast = n - n_slow
    n_columns = 1 + 2 * n_fast + held.driven.size
    first = first_column
    while first < n_columns:
        last = min(first + _LANES, n_columns)
        if not held.damped and 1 + n_fast < last and first < 1 + 2 * n_fast:
            last = 1 + n_fast  # no column of the rates
        d.dinputs[:] = 0.0
        d.dq[:] = 0.0
        d.dv[:] = 0.0
        if first == 0:
            velocities(p, q, v, held.moved)
            _set_drift(d, q, v, d.a, n_slow, held.moved)
        for column in range(first, last):
            _set_column(held, column, column - first, offset, n_fast)
        take_tangents(p, d, q, v)
        if held.solve_fast:
            for i in range(n):
                for lane in range(_LANES):
                    held.f[i, lane] = d.dr[i, lane]
            call_native(held.solve_fast, (p.inputs, q, held.f, held.x))
        else:
            for i in range(n_slow, n):
                for lane in range(_LANES):
                    held.x[i, lane] = d.dr[i, lane] / held.mass[i]
        for column in range(first, last):
            _keep_column(held, column, column - first, offset, n_fast, q, v)
        first = last
        if not held.damped and first == 1 + n_fast:
            first = 1 + 2 * n_fast


@inner
def set_active(p: CompiledParameters, t: float, held: HeldCycle) -> None:
    """Find whether any input changes in the cycle from t [s] on, and keep those of its start in ``before``."""
    held.active[0] = 0.0
    if held.driven.size == 0:
        return
    inputs_at(p, t + held.cycle, held.now)
    for k in range(p.inputs.size // 3):
        held.before[3 * k] = p.inputs[3 * k]
        for i in range(1, 3):
            held.before[3 * k + i] = p.inputs[3 * k + i]
            if p.inputs[3 * k + i] != 0.0 or held.now[3 * k + i] != 0.0:
                held.active[0] = 1.0
        if p.inputs[3 * k] != held.now[3 * k]:
            held.active[0] = 1.0
    for k in range(held.breakpoints.size):  # a short load may begin and end within the cycle
        if t < held.breakpoints[k] < t + held.cycle:
            held.active[0] = 1.0


@meaning(hold_slow, CompiledParameters)
def _hold_slow(p: CompiledParameters, t: float, q: Array, v: Array, a: Array, frozen: HeldCycle) -> None:
    set_inputs(p, float(t))
    set_active(p, float(t), frozen)
    frozen.time[0] = t
    for i in range(v.size):
        frozen.directions.a[i] = a[i]
    if frozen.single:
        _hold_single(p, q, v, a, frozen)
        return
    for i in range(frozen.n_slow, v.size):
        frozen.constant[i] = a[i]
    _hold_columns(p, q, v, frozen, 0)


@inner
def add_loads(p: CompiledParameters, held: HeldCycle, t: float, a: Array) -> None:
    """Add to a how the loads at a time t [s] accelerate the fast coordinates beyond those at the cycle's start."""
    inputs_at(p, t, held.now)
    for k in range(held.driven.size):
        change = held.now[held.driven[k]] - held.before[held.driven[k]]
        for i in range(held.n_slow, a.size):
            a[i] += change * held.lever[k, i]


@inner
def step_driven(
    p: CompiledParameters, held: HeldCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    """Take leapfrog steps with uncoupled coordinates under varying loads, from time ``first · h``."""
    constant, slope, k, c, v_now, offset = held.constant, held.slope, held.k, held.c, held.v_now, q.size - v.size
    for step in range(count):
        t = (first + step) * h  # not a sum, whose round-off would depend on how a cycle is divided
        tau = t - held.time[0]
        for i in range(held.n_slow, v.size):
            v_now[i] = v[i] + 0.5 * h * a[i]
            a[i] = constant[i] + tau * slope[i] - k[i] * q[i + offset] - c[i] * v_now[i]
        add_loads(p, held, t, a)
        for i in range(held.n_slow, v.size):
            v[i] += h * a[i]
            q[i + offset] += h * v[i]


@inner
def step_single(held: HeldCycle, first: int, h: float, count: int, begins: bool, q: Array, v: Array, a: Array) -> None:
    """Take leapfrog steps coordinate by coordinate, from time ``first · h``; ``begins`` tells a cycle's first call.

    Undamped ones go in increments d = h v: the processor works on several at once, and each waits for two operations a
    step instead of four. A later call goes on with increments as they are, not by way of v.
    """
    constant, slope, k, c, offset = held.constant, held.slope, held.k, held.c, q.size - v.size
    square, over, start = h * h, 1.0 / h, held.time[0]
    since, until = first * h - start, (first + count - 1) * h - start
    for i in range(held.n_slow, v.size):
        x, ki, rise = q[i + offset], square * k[i], h * slope[i]
        if held.damped:
            rate, acceleration = v[i], a[i]
            for step in range(count):
                middle = rate + 0.5 * h * acceleration
                tau = (first + step) * h - start
                acceleration = constant[i] + tau * slope[i] - k[i] * x - c[i] * middle
                rate += h * acceleration
                x += h * rate
            a[i], v[i], q[i + offset] = acceleration, rate, x
            continue
        more = square * rise
        d, load = h * v[i], square * (constant[i] + since * slope[i])
        if not begins:
            d, load = held.d[i], held.load[i]
        for _ in range(count - 1):
            d = (d + load) - ki * x
            x += d
            load += more
        a[i] = constant[i] + until * slope[i] - k[i] * x
        d = (d + load) - ki * x
        v[i], q[i + offset] = over * d, x + d
        held.d[i], held.load[i] = d, load + more


@inner
def step_all(
    p: CompiledParameters, held: HeldCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    """Take leapfrog steps with coordinates that couple, from time ``first · h``."""
    constant, slope, K, C, v_now = held.constant, held.slope, held.K, held.C, held.v_now
    n, offset, n_slow = v.size, q.size - v.size, held.n_slow
    for step in range(count):
        t = (first + step) * h  # not a sum, whose round-off would depend on how a cycle is divided
        tau = t - held.time[0]
        for i in range(n_slow, n):
            v_now[i] = v[i] + 0.5 * h * a[i]
            a[i] = constant[i] + tau * slope[i]
        if held.active[0] != 0.0:
            add_loads(p, held, t, a)
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


@meaning(fast_steps, CompiledParameters)
def _fast_steps(
    p: CompiledParameters, frozen: HeldCycle, first: int, h: float, count: int, q: Array, v: Array, a: Array
) -> None:
    if not frozen.single:
        step_all(p, frozen, first, h, count, q, v, a)
    elif frozen.active[0] != 0.0:
        step_driven(p, frozen, first, h, count, q, v, a)
    else:
        step_single(frozen, first, h, count, (first - 1) * h == frozen.time[0], q, v, a)

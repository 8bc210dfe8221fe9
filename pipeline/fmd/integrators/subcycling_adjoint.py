"""Adjoint of a sub-cycled march of a mechanism without loops, cycle by cycle.

A fast step j solves ``M_SS (a_S − a_S⁰) + r'_S[d] = 0``: the residual's slope at the cycle's begin, along how far the
state has gone from there. With ``D = (d, a_S − a_S⁰)`` and its accelerations' weights ``x = M_SS⁻¹ ā`` it is taken
back by the derivatives of ``x · r'_S[D]``: by D, of which the steps before it, the slow motion and the loads are parts,
and by the state at the cycle's begin. By numbers that change the equations follow ``x · r'_S[D]`` of mechanisms beside.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiled_system.adjoint_kernels import (
    StepsBack,
    advance_back,
    keep_evaluation,
    pull_back,
    velocities_back,
)
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import CompiledParameters, FrozenCycle
from fmd.dynamics.compiled_system.tangent_kernels import MechanismVariants, take_state
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import accelerations, advance, fast_steps, freeze_slow, velocities
from fmd.integrators.adjoint import (
    NotTakenBackError,
    Sums,
    WeightedMarch,
    WeightedOutput,
    has_next,
    make_room,
    sections_back,
    take_back,
)
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import State
from fmd.integrators.subcycling import Subcycling
from fmd.kernels.arrays import clear, copy
from fmd.kernels.kernel import inlined, inner, kernel
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class _Cycles(Table):
    """Fast steps of a section's cycles, weights of the march's output, and derivatives by a cycle's begin."""

    slopes: int  # address of the compiled function
    frozen: FrozenCycle
    n_slow: int
    n_varying: int  # inputs that signals are
    lag: Array  # (n,): how long before a state's time its rates are [s]
    q: Array  # (n_kept, m, n_positions): positions at fast steps
    v: Array  # (n_kept, m, n): rates and accelerations there
    a: Array
    x: Array  # (n_kept, m, n): weights of slopes, 0 at a cycle's begin
    along_inputs: Array  # (n_kept, m, n_inputs): directions of these
    along_q: Array
    along_v: Array
    along_a: Array
    output: WeightedOutput
    dq: Array  # (n_positions,): derivatives by a cycle's begin, of what follows from it but for its accelerations
    dv: Array  # (n,)
    da: Array  # (n,): by its accelerations
    inputs: Array  # (n_inputs,): inputs there, and derivatives by them
    of_start: Array
    moving: Array  # (n_positions,): how positions change there, and derivatives by it
    of_moving: Array
    later: Array  # (n_positions,): derivatives by positions at a fast step, of output in it
    of_inputs: Array  # of a slope by its arguments
    of_q: Array
    of_v: Array
    of_a: Array
    by_along_inputs: Array
    by_along_q: Array
    by_along_v: Array
    by_along_a: Array
    room_q: Array  # room for positions and rates
    room_v: Array
    rate: Array
    f: Array  # (n, 8)
    y: Array


@dataclass(frozen=True)
class _Lanes(Table):
    """Eight directions of a mechanism's slopes."""

    clock: Array  # (2,): time [s]
    inputs: Array  # (n_inputs, 8)
    q: Array  # (n_positions, 8)
    v: Array  # (n, 8)
    a: Array


@kernel
def _take_cycles(
    p: CompiledParameters, s: StepsBack, c: _Cycles, q: Array, v: Array, a: Array, first: int, n: int
) -> None:
    """Take some cycles, and keep them."""
    m, offset = c.q.shape[1], q.size - v.size
    H = m * s.h
    for k in range(n):
        start = (first + k) * m
        copy(q, s.q[k])
        for i in range(v.size):
            s.v[k, i] = v[i] + c.lag[i] * a[i]
        accelerations(p, start * s.h, q, s.v[k], a)
        freeze_slow(p, start * s.h, q, s.v[k], a, c.frozen)
        copy(a, s.a[k])
        for i in range(v.size):
            v[i] += (H if i < c.n_slow else s.h) * a[i]
            s.ahead[k, i] = v[i] if i < c.n_slow else 0.0
        copy(q, c.q[k, 0])
        copy(s.v[k], c.v[k, 0])
        copy(a, c.a[k, 0])
        advance(p, q, v, H, 0, c.n_slow)
        for i in range(c.n_slow, v.size):
            q[i + offset] += s.h * v[i]
        for j in range(1, m):
            copy(q, c.q[k, j])
            for i in range(v.size):
                c.v[k, j, i] = v[i] + 0.5 * s.h * a[i]
            fast_steps(p, c.frozen, start + j, s.h, 1, q, v, a)
            copy(a, c.a[k, j])


@kernel
def _take_cycles_back(p: CompiledParameters, s: StepsBack, c: _Cycles, first: int, count: int) -> None:
    """Take the kept cycles back."""
    m, offset = c.q.shape[1], s.dq.size - s.dv.size
    for back in range(count):
        k = count - 1 - back
        _begin_back(p, s, c, first + k, k)
        for later in range(m):
            j = m - 1 - later
            clear(c.later)
            while has_next(c.output, (first + k) * m + j):
                c.output.left[0] -= 1
                _add_output(p, s, c, c.output.left[0], k, j)
            for i in range(c.n_slow, s.dv.size):
                s.dv[i] += s.h * s.dq[i + offset]
                s.da[i] += s.h * s.dv[i]
                # accelerations of a fast step are those of the cycle's begin and what they change by
                c.da[i] += s.da[i]
            if j > 0:
                _react_back(p, s, c, k, j, ((first + k) * m + j) * s.h)
            for i in range(c.n_slow, s.dv.size):
                s.dq[i + offset] += c.later[i + offset]
        _end_back(p, s, c, (first + k) * m * s.h, k)


@inlined
def _begin_back(p: CompiledParameters, s: StepsBack, c: _Cycles, number: int, k: int) -> None:
    set_inputs(p, number * c.q.shape[1] * s.h)
    copy(p.inputs, c.inputs)
    velocities(p, s.q[k], s.v[k], c.moving)
    clear(c.dq)
    clear(c.dv)
    clear(c.da)
    clear(c.of_start)
    clear(c.of_moving)


@inner
def _add_output(p: CompiledParameters, s: StepsBack, c: _Cycles, number: int, k: int, j: int) -> None:
    """Add what an output has of its fast step, and of its cycle: Taylor's polynomials."""
    H, ahead, offset = c.q.shape[1] * s.h, c.output.offset[number], s.dq.size - s.dv.size
    since = ahead + j * s.h
    for i in range(s.dq.size):
        c.room_q[i] = c.output.by_q[number, i] if i < c.n_slow + offset else 0.0
    for i in range(s.dv.size):
        c.room_v[i] = 0.0
        c.rate[i] = s.ahead[k, i] - 0.5 * (H - since) * s.a[k, i] if i < c.n_slow else 0.0
    advance_back(p, s.q[k], c.rate, since, c.room_q, c.room_v)
    for i in range(c.n_slow + offset):
        c.dq[i] += c.room_q[i]
    for i in range(s.dv.size):
        along, step, past = c.room_v[i], H, since
        if i >= c.n_slow:
            along, step, past = ahead * c.output.by_q[number, i + offset], s.h, ahead
            c.later[i + offset] += c.output.by_q[number, i + offset]
        along += c.output.by_v[number, i]
        s.dv[i] += along
        s.da[i] += 0.5 * (past - step) * along + 0.5 * past * c.output.by_v[number, i]


@inner
def _react_back(p: CompiledParameters, s: StepsBack, c: _Cycles, k: int, j: int, t: float) -> None:
    """Take a fast step's accelerations back, with the weights ``da``; that leaves those of the step before."""
    n_slow, offset, tau = c.n_slow, s.dq.size - s.dv.size, j * s.h
    _weigh(s, c, s.q[k], c.x[k, j])
    for i in range(s.dq.size):
        c.along_q[k, j, i] = tau * c.moving[i] if i < n_slow + offset else c.q[k, j, i] - c.q[k, 0, i]
    for i in range(s.dv.size):
        c.along_v[k, j, i] = tau * s.a[k, i] if i < n_slow else c.v[k, j, i] - c.v[k, 0, i]
        c.along_a[k, j, i] = 0.0 if i < n_slow else c.a[k, j, i] - c.a[k, 0, i]
    set_inputs(p, t)
    for i in range(c.n_varying):
        c.along_inputs[k, j, i] = p.inputs[i] - c.inputs[i]
    d = (c.along_inputs[k, j], c.along_q[k, j], c.along_v[k, j], c.along_a[k, j], c.x[k, j])
    by, along = (c.of_inputs, c.of_q, c.of_v, c.of_a), (c.by_along_inputs, c.by_along_q, c.by_along_v, c.by_along_a)
    state = (c.inputs, s.q[k], s.v[k], s.a[k], d[0], d[1], d[2], d[3], d[4])
    call_native(c.slopes, (*state, by[0], by[1], by[2], by[3], along[0], along[1], along[2], along[3]))
    for i in range(s.dq.size):
        c.dq[i] -= c.of_q[i]
        if i < n_slow + offset:
            c.of_moving[i] -= tau * c.by_along_q[i]
        else:
            c.dq[i] += c.by_along_q[i]
            s.dq[i] -= c.by_along_q[i]
    for i in range(s.dv.size):
        c.dv[i] -= c.of_v[i]
        c.da[i] -= c.of_a[i]
        if i < n_slow:
            c.da[i] -= tau * c.by_along_v[i]
        else:
            c.dv[i] += c.by_along_v[i]
            s.dv[i] -= c.by_along_v[i]
            s.da[i] = -0.5 * s.h * c.by_along_v[i]
    for i in range(c.inputs.size):
        c.of_start[i] -= c.of_inputs[i]
        s.of_inputs[i] = 0.0
    for i in range(c.n_varying):
        c.of_start[i] += c.by_along_inputs[i]
        s.of_inputs[i] = -c.by_along_inputs[i]
    if c.n_varying > 0:
        keep_evaluation(s, t, s.q[k], s.v[k])


@inlined
def _weigh(s: StepsBack, c: _Cycles, q: Array, x: Array) -> None:
    """Solve ``M_SS x = ā`` at the cycle's begin."""
    frozen = c.frozen
    if frozen.single:
        for i in range(c.n_slow, x.size):
            x[i] = frozen.inverse_mass[i] * s.da[i]
        return
    for i in range(c.n_slow, x.size):
        c.f[i, 0] = s.da[i]
    call_native(frozen.solve_fast, (c.inputs, q, c.f, c.y))
    for i in range(c.n_slow, x.size):
        x[i] = c.y[i, 0]


@inlined
def _end_back(p: CompiledParameters, s: StepsBack, c: _Cycles, t: float, k: int) -> None:
    """Take the slow step and the accelerations of a cycle's begin back."""
    H, offset = c.q.shape[1] * s.h, s.dq.size - s.dv.size
    for i in range(s.dq.size):
        c.room_q[i] = s.dq[i] if i < c.n_slow + offset else 0.0
    clear(c.room_v)
    advance_back(p, s.q[k], s.ahead[k], H, c.room_q, c.room_v)
    for i in range(c.n_slow + offset):
        s.dq[i] = c.room_q[i]
    for i in range(c.n_slow):
        s.dv[i] += c.room_v[i]
        c.da[i] += H * s.dv[i] + s.da[i]
    velocities_back(p, s.q[k], s.v[k], c.of_moving, c.dq, c.dv)
    pull_back(p, s, t, s.q[k], s.v[k], s.a[k], s.none, c.da)
    for i in range(c.of_start.size):
        s.known.inputs[s.known.count[0] - 1, i] += c.of_start[i]
    for i in range(s.dq.size):
        s.dq[i] += s.of_q[i] + c.dq[i]
    for i in range(s.dv.size):
        s.dv[i] += s.of_v[i] + c.dv[i]
        s.da[i] = c.lag[i] * (s.of_v[i] + c.dv[i])


@kernel
def _take_start_back(p: CompiledParameters, s: StepsBack, c: _Cycles, q: Array, v: Array, a: Array) -> None:
    """Go back to time 0 from rates before it."""
    for i in range(s.dv.size):
        s.da[i] -= c.lag[i] * s.dv[i]
    pull_back(p, s, 0.0, q, v, a, s.none, s.da)
    for i in range(s.dq.size):
        s.dq[i] += s.of_q[i]
    for i in range(s.dv.size):
        s.dv[i] += s.of_v[i]


@kernel
def _sum_slopes(
    m: MechanismVariants, beside: IntArray, s: StepsBack, c: _Cycles, first: int, count: int, sums: Array, lanes: _Lanes
) -> None:
    """Add what the sum changes by along numbers that change the slopes of fast steps, eight steps at a time."""
    steps = c.q.shape[1]
    for k in range(count):
        lanes.clock[0] = (first + k) * steps * s.h
        for e in range(beside.size):
            if beside[e] == 0:
                continue
            take_state(m, e, s.q[k], s.v[k], s.a[k])
            if m.signals[e] != 0:
                call_native(m.signals[e], (lanes.clock, m.inputs[e]))
            for begin in range(1, steps, LANES):
                width = min(LANES, steps - begin)
                for lane in range(width):
                    j = begin + lane
                    for i in range(lanes.inputs.shape[0]):
                        lanes.inputs[i, lane] = c.along_inputs[k, j, i]
                    for i in range(m.q.size):
                        lanes.q[i, lane] = m.signs_q[e, i] * c.along_q[k, j, i]
                    for i in range(m.v.size):
                        lanes.v[i, lane] = m.signs_v[e, i] * c.along_v[k, j, i]
                        lanes.a[i, lane] = m.signs_v[e, i] * c.along_a[k, j, i]
                call_native(beside[e], (m.inputs[e], m.q, m.v, m.a, lanes.inputs, lanes.q, lanes.v, lanes.a, c.f))
                for lane in range(width):
                    for i in range(c.n_slow, m.v.size):
                        sums[e // 4] -= m.weights[e] * m.signs_v[e, i] * c.f[i, lane] * c.x[k, begin + lane, i]


@take_back.register(Subcycling)
def _take_march_back(method: Subcycling, march: WeightedMarch, sums: Sums) -> tuple[Array, Array, float]:
    if method.substeps == 1:
        return take_back(CentralDifference(method.step), march, sums)
    if march.system.has_loops:
        raise NotTakenBackError(f"{method.name} of loops")
    system, h, m, p = march.system, method.step, method.substeps, march.parameters
    output = march.locate_output(h)
    n_cycles = int(output.step[-1]) // m + 1
    kept = min(n_cycles, march.count_kept_steps(8 * m))
    s, state = make_room(system, h, kept, max(2, kept * m)), method.start(system, march.q0, march.v0)
    c = _make_cycles(method, march, output, kept)
    lanes = _Lanes(np.zeros(2), *(np.zeros((size, LANES)) for size in _sizes(march)))

    def keep(state: State, first: int, count: int) -> None:
        _take_cycles(p, s, c, state.q, state.v, state.a, first, count)

    for first, count in sections_back(n_cycles, kept, state, keep):
        _take_cycles_back(p, s, c, first, count)
        sums.take(s.known)
        for table, addresses, found in sums.beside("tangents"):
            _sum_slopes(table, addresses, s, c, first, count, found, lanes)
    start = [np.array(x, dtype=float) for x in (march.q0, march.v0, method.start(system, march.q0, march.v0).a)]
    _take_start_back(p, s, c, *start)
    sums.take(s.known)
    return s.dq, s.dv, 0.0


def _sizes(march: WeightedMarch) -> tuple[int, int, int, int]:
    """Return how many inputs, positions, rates and accelerations there are."""
    system = march.system
    return march.parameters.inputs.size, system.n_positions, system.n, system.n


def _make_cycles(method: Subcycling, march: WeightedMarch, output: WeightedOutput, kept: int) -> _Cycles:
    system, m = march.system, method.substeps
    frozen = system.frozen(m * method.step)
    assert isinstance(frozen, FrozenCycle)
    sizes = dict(zip(("inputs", "q", "v", "a"), _sizes(march), strict=True))
    room: dict[str, Any] = {f"along_{name}": np.zeros((kept, m, size)) for name, size in sizes.items()}
    room |= {name: np.zeros((kept, m, sizes[name])) for name in ("q", "v", "a")}
    room |= {f"of_{name}": np.zeros(size) for name, size in sizes.items()}
    room |= {f"by_along_{name}": np.zeros(size) for name, size in sizes.items()}
    room |= {name: np.zeros(sizes["inputs"]) for name in ("inputs", "of_start")}
    room |= {name: np.zeros(sizes["q"]) for name in ("dq", "moving", "of_moving", "later", "room_q")}
    room |= {name: np.zeros(sizes["v"]) for name in ("dv", "da", "room_v", "rate")}
    return _Cycles(
        slopes=system.compiled.address("slope_adjoint"),
        frozen=frozen,
        n_slow=system.n_slow,
        n_varying=3 * len(system.compiled.signals),
        lag=method.lag(system),
        x=np.zeros((kept, m, system.n)),
        output=output,
        f=np.zeros((system.n, LANES)),
        y=np.zeros((system.n, LANES)),
        **room,
    )

"""Adjoint of a march by central difference: how a weighted sum of its output changes with all that the march takes.

Steps are taken back from the last one, each by the transpose of its own derivative (Griewank & Walther, *Evaluating
Derivatives*, SIAM, 2008, chapters 3 and 12). With ``a = f(t, q, v + ½ h a₋)``, ``v₊ = v + h a``, ``q₊ = q + h v₊`` and
the sum's derivatives q̄, v̄, ā by a step's end, those by its begin are

    v̄ ← v̄ + h q̄,   ā ← ā + h v̄,   (q̂, v̂) = ā ∂f/∂(q, v),   q̄ ← q̄ + q̂,   v̄ ← v̄ + v̂,   ā₋ = ½ h v̂

Where a quaternion turns, the transpose of that turn stands for the first of these.
The motion is marched anew in sections, from states that are kept at their begins, so that memory holds one section.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import MOST_STEPS_KEPT
from fmd.core.limits.round_off import NO_TURN, SMALL_TURN
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import CompiledParameters
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction
from fmd.dynamics.compiler.signal_code import load_signals
from fmd.dynamics.system import accelerations, advance
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.fixed_step import locate_samples
from fmd.integrators.protocol import State
from fmd.kernels.kernel import inlined, inner, kernel
from fmd.kernels.library import call_native
from fmd.kernels.machine import LoadedObject
from fmd.kernels.table import Table


@dataclass(frozen=True)
class _Section(Table):
    """Steps of a section, and the sum's derivatives by the end of a step."""

    adjoint: int  # address of the compiled function
    h: float
    q: Array  # (n_kept, n_positions): positions at each step's begin
    v: Array  # (n_kept, n): rates and accelerations there, and the rates half a step later
    a: Array
    ahead: Array
    sample: IntArray  # (n_times,): step that each output time is in
    offset: Array  # (n_times,): and the time since its begin [s]
    by_q: Array  # (n_times, n_positions): weights of positions, and (n_times, n) of rates
    by_v: Array
    sampled_q: Array  # (n_positions,): derivatives by a step's begin of the output in it
    moved_q: Array
    moved_v: Array  # (n,)
    rate: Array
    left: IntArray  # (1,): output times that are still to come, from the last one back
    dq: Array  # (n_positions,): derivatives by positions
    dv: Array  # (n,): by rates half a step before them, and accelerations
    da: Array
    of_inputs: Array  # of an evaluation of the accelerations, by its arguments
    of_q: Array
    of_v: Array
    numbers: Array  # (n_numbers,)
    signals: Array  # (n_kept, 3 n_signals): by signals at each step's begin


@kernel
def _take_steps(p: Any, s: _Section, q: Array, v: Array, a: Array, first: int, count: int) -> None:
    """Take some steps, and keep them."""
    for k in range(count):
        for i in range(q.size):
            s.q[k, i] = q[i]
        for i in range(v.size):
            s.v[k, i] = v[i] + 0.5 * s.h * a[i]
        accelerations(p, (first + k) * s.h, s.q[k], s.v[k], a)
        for i in range(v.size):
            s.a[k, i] = a[i]
            v[i] += s.h * a[i]
            s.ahead[k, i] = v[i]
        advance(p, q, v, s.h, 0, v.size)


@kernel
def _take_back(p: Any, s: _Section, first: int, count: int) -> None:
    """Take the kept steps back."""
    n, h, dq, dv, da = s.dv.size, s.h, s.dq, s.dv, s.da
    for back in range(count):
        k = count - 1 - back
        for i in range(dq.size):
            s.sampled_q[i] = 0.0
        while s.left[0] > 0 and s.sample[s.left[0] - 1] == first + k:
            s.left[0] -= 1
            _add_sample(p, s, s.left[0], k)
        _advance_back(p, s.q[k], s.ahead[k], h, dq, dv)
        for i in range(n):
            da[i] += h * dv[i]
        _pull_back(p, s, (first + k) * h, k)
        for i in range(dq.size):
            dq[i] += s.of_q[i] + s.sampled_q[i]
        for i in range(n):
            dv[i] += s.of_v[i]
            da[i] = 0.5 * h * s.of_v[i]


@kernel
def _take_start_back(p: Any, s: _Section) -> None:
    """Go back to time 0 from half a step before it; the section has its state as its first step."""
    for i in range(s.dv.size):
        s.da[i] -= 0.5 * s.h * s.dv[i]
    _pull_back(p, s, 0.0, 0)
    for i in range(s.dq.size):
        s.dq[i] += s.of_q[i]
    for i in range(s.dv.size):
        s.dv[i] += s.of_v[i]


@kernel
def _sum_signals(address: int, times: Array, weights: Array, clock: Array, values: Array) -> float:
    """Return a weighted sum of what signals are over time."""
    found = 0.0
    for row in range(times.size):
        clock[0] = times[row]
        call_native(address, (clock, values))
        for i in range(values.size):
            found += weights[row, i] * values[i]
    return found


@inlined
def _add_sample(p: Any, s: _Section, number: int, k: int) -> None:
    """Add what an output has of its step's begin, rates and accelerations: Taylor's polynomial."""
    ahead = s.offset[number]
    for i in range(s.dq.size):
        s.moved_q[i] = s.by_q[number, i]
    for i in range(s.dv.size):
        s.moved_v[i] = s.by_v[number, i]
        s.rate[i] = s.ahead[k, i] + 0.5 * (ahead - s.h) * s.a[k, i]
    _advance_back(p, s.q[k], s.rate, ahead, s.moved_q, s.moved_v)
    for i in range(s.dq.size):
        s.sampled_q[i] += s.moved_q[i]
    for i in range(s.dv.size):
        s.dv[i] += s.moved_v[i]
        s.da[i] += 0.5 * (ahead - s.h) * s.moved_v[i] + 0.5 * ahead * s.by_v[number, i]


@inlined
def _advance_back(p: CompiledParameters, q: Array, v: Array, h: float, dq: Array, dv: Array) -> None:
    """Take derivatives by positions that rates v have moved for a time h back to those by positions q and by rates."""
    if p.quaternions.shape[0] == 0:
        for i in range(dv.size):
            dv[i] += h * dq[i]
        return
    for i in range(dv.size):
        if p.position[i] >= 0:
            dv[i] += h * dq[p.position[i]]
    for k in range(p.quaternions.shape[0]):
        _turn_back(q, p.quaternions[k, 1], v, p.quaternions[k, 0], h, dq, dv)


@inner
def _turn_back(q: Array, at: int, v: Array, turn: int, h: float, dq: Array, dv: Array) -> None:
    """Transpose the derivative of a unit quaternion's turn: ``e∘(s u, c)`` with ``u = ½ h ω``, s and c of its size."""
    ux, uy, uz = 0.5 * h * v[turn], 0.5 * h * v[turn + 1], 0.5 * h * v[turn + 2]
    size = math.sqrt(ux * ux + uy * uy + uz * uz)
    s, c = (math.sin(size) / size, math.cos(size)) if size > NO_TURN else (1.0, 1.0)
    # Of s, by half the size squared.
    bend = (c - s) / (size * size) if size > SMALL_TURN else -1.0 / 3.0 + size * size / 30.0
    x, y, z, w = q[at], q[at + 1], q[at + 2], q[at + 3]
    tx, ty, tz = s * ux, s * uy, s * uz
    e0, e1 = w * tx + y * tz - z * ty + x * c, w * ty - x * tz + z * tx + y * c
    e2, e3 = w * tz + x * ty - y * tx + z * c, w * c - x * tx - y * ty - z * tz
    norm = 1.0 / math.sqrt(e0 * e0 + e1 * e1 + e2 * e2 + e3 * e3)
    e0, e1, e2, e3 = norm * e0, norm * e1, norm * e2, norm * e3
    out = e0 * dq[at] + e1 * dq[at + 1] + e2 * dq[at + 2] + e3 * dq[at + 3]
    d0, d1 = norm * (dq[at] - out * e0), norm * (dq[at + 1] - out * e1)
    d2, d3 = norm * (dq[at + 2] - out * e2), norm * (dq[at + 3] - out * e3)
    dq[at] = c * d0 - tz * d1 + ty * d2 - tx * d3
    dq[at + 1] = tz * d0 + c * d1 - tx * d2 - ty * d3
    dq[at + 2] = -ty * d0 + tx * d1 + c * d2 - tz * d3
    dq[at + 3] = tx * d0 + ty * d1 + tz * d2 + c * d3
    by_x = w * d0 + z * d1 - y * d2 - x * d3
    by_y = -z * d0 + w * d1 + x * d2 - y * d3
    by_z = y * d0 - x * d1 + w * d2 - z * d3
    by_c = x * d0 + y * d1 + z * d2 + w * d3
    along = bend * (by_x * ux + by_y * uy + by_z * uz) - s * by_c
    dv[turn] += 0.5 * h * (s * by_x + along * ux)
    dv[turn + 1] += 0.5 * h * (s * by_y + along * uy)
    dv[turn + 2] += 0.5 * h * (s * by_z + along * uz)


@inlined
def _pull_back(p: Any, s: _Section, t: float, k: int) -> None:
    """Differentiate the accelerations of a kept step by all that they depend on, with the weights ``da``."""
    set_inputs(p, t)
    call_native(s.adjoint, (p.inputs, s.q[k], s.v[k], s.a[k], s.da, s.of_inputs, s.of_q, s.of_v))
    n_inputs = s.signals.shape[1]
    for i in range(n_inputs):
        s.signals[k, i] = s.of_inputs[i]
    for i in range(s.numbers.size):
        s.numbers[i] += s.of_inputs[n_inputs + i]


def _sum_along(codes: Sequence[Sequence[tuple[LoadedObject, float]]], times: Array, by_signals: Array) -> Array:
    """Return what the directions' signals at some times add to the sum's derivatives, (n_directions,)."""
    room = np.zeros(2), np.zeros(by_signals.shape[1])
    sums = (
        [weight * _sum_signals(code.address("signals"), times, by_signals, *room) for code, weight in own]
        for own in codes
    )
    return np.array([sum(each, 0.0) for each in sums])


def pull_back(
    method: CentralDifference,
    system: CompiledSystem,
    q0: Array,
    v0: Array,
    times: Array,
    by_q: Array,
    by_v: Array,
    directions: Sequence[Direction],
) -> Array:
    """Differentiate a weighted sum of a march's output along some directions, shape (n_directions,).

    Parameters
    ----------
    method : CentralDifference
        By which it is marched.
    system : CompiledSystem
        What is marched, one that `has_adjoint`.
    q0, v0 : ndarray, shapes (n_positions,) and (n,)
        Its start.
    times : ndarray, shape (n_times,)
        Output times [s].
    by_q, by_v : ndarray, shapes (n_times, n_positions) and (n_times, n)
        Weights of positions and rates.
    directions : sequence of Direction
        Those without variants.
    """
    n, h, inputs = system.n, method.step, system.parameters.inputs
    sample, offset = locate_samples(times, h)
    n_steps, n_inputs = int(sample[-1]) + 1, 3 * len(system.compiled.signals)
    kept = min(n_steps, max(1, MOST_STEPS_KEPT // max(system.n_positions, n_inputs)))
    steps = {name: np.zeros((kept, n)) for name in ("v", "a", "ahead")}
    room = {name: np.zeros(n) for name in ("dv", "da", "of_v", "moved_v", "rate")}
    placed = {name: np.zeros(system.n_positions) for name in ("dq", "of_q", "moved_q", "sampled_q")}
    section = _Section(
        adjoint=system.compiled.address("acceleration_adjoint"),
        h=h,
        q=np.zeros((kept, system.n_positions)),
        **steps,
        sample=sample,
        offset=offset,
        by_q=np.ascontiguousarray(by_q, dtype=float),
        by_v=np.ascontiguousarray(by_v, dtype=float),
        left=np.array([len(times)]),
        **room,
        **placed,
        of_inputs=np.zeros(inputs.size),
        numbers=np.zeros(inputs.size - n_inputs),
        signals=np.zeros((kept, n_inputs)),
    )
    codes = [[(load_signals(signals), weight) for signals, weight in each.signals] for each in directions]
    found = np.zeros(len(directions))
    p, state = system.parameters, method.start(system, q0, v0)
    begins: list[State] = []
    for first in range(0, n_steps, kept):
        begins.append(state.copy())
        _take_steps(p, section, state.q, state.v, state.a, first, min(kept, n_steps - first))
    for number, begin in reversed([*enumerate(begins)]):
        first, count = number * kept, min(kept, n_steps - number * kept)
        if number < len(begins) - 1:
            _take_steps(p, section, begin.q, begin.v, begin.a, first, count)
        _take_back(p, section, first, count)
        at = np.asarray(h * np.arange(first, first + count), dtype=float)
        found += _sum_along(codes, at, section.signals)
    section.q[0], section.v[0], section.a[0] = q0, v0, method.start(system, q0, v0).a
    _take_start_back(p, section)
    found += _sum_along(codes, np.zeros(1), section.signals)
    own = [section.dq @ each.q + section.dv @ each.v + section.numbers @ each.numbers for each in directions]
    return np.asarray(found + own)

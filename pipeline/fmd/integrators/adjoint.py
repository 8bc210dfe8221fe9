"""Adjoint of a march by central difference: how a weighted sum of its output changes with all that the march takes.

Steps are taken back from the last one, each by the transpose of its own derivative (Griewank & Walther, *Evaluating
Derivatives*, SIAM, 2008, chapters 3 and 12). With ``a = f(t, q, v + ½ h a₋)``, ``v₊ = v + h a``, ``q₊ = q + h v₊`` and
the sum's derivatives q̄, v̄, ā by a step's end, those by its begin are

    v̄ ← v̄ + h q̄,   ā ← ā + h v̄,   (q̂, v̂) = ā ∂f/∂(q, v),   q̄ ← q̄ + q̂,   v̄ ← v̄ + v̂,   ā₋ = ½ h v̂

The motion is marched anew in sections, from states that are kept at their begins, so that memory holds one section.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import MOST_STEPS_KEPT
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction
from fmd.dynamics.compiler.signal_code import load_signals
from fmd.dynamics.system import accelerations
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.fixed_step import locate_samples
from fmd.integrators.protocol import State
from fmd.kernels.kernel import inlined, kernel
from fmd.kernels.library import call_native
from fmd.kernels.machine import LoadedObject
from fmd.kernels.table import Table


@dataclass(frozen=True)
class _Section(Table):
    """Steps of a section, and the sum's derivatives by the end of a step."""

    adjoint: int  # address of the compiled function
    h: float
    q: Array  # (n_kept, n): positions at each step's begin, rates and accelerations there
    v: Array
    a: Array
    sample: IntArray  # (n_times,): step that each output time is in
    offset: Array  # (n_times,): and the time since its begin [s]
    by_q: Array  # (n_times, n): weights of positions and rates
    by_v: Array
    left: IntArray  # (1,): output times that are still to come, from the last one back
    dq: Array  # (n,): derivatives by positions, rates half a step before them, and accelerations
    dv: Array
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
        for i in range(v.size):
            s.q[k, i] = q[i]
            s.v[k, i] = v[i] + 0.5 * s.h * a[i]
        accelerations(p, (first + k) * s.h, s.q[k], s.v[k], a)
        for i in range(v.size):
            s.a[k, i] = a[i]
            v[i] += s.h * a[i]
            q[i] += s.h * v[i]


@kernel
def _take_back(p: Any, s: _Section, first: int, count: int) -> None:
    """Take the kept steps back."""
    n, h, dq, dv, da = s.dq.size, s.h, s.dq, s.dv, s.da
    for back in range(count):
        k = count - 1 - back
        until = s.left[0]
        while s.left[0] > 0 and s.sample[s.left[0] - 1] == first + k:
            s.left[0] -= 1
            _add_sample(s, s.left[0])
        for i in range(n):
            dv[i] += h * dq[i]
            da[i] += h * dv[i]
        _pull_back(p, s, (first + k) * h, k)
        for i in range(n):
            dq[i] += s.of_q[i]
            dv[i] += s.of_v[i]
            da[i] = 0.5 * h * s.of_v[i]
        for at in range(s.left[0], until):
            for i in range(n):
                dq[i] += s.by_q[at, i]


@kernel
def _take_start_back(p: Any, s: _Section) -> None:
    """Go back to time 0 from half a step before it; the section has its state as its first step."""
    for i in range(s.dq.size):
        s.da[i] -= 0.5 * s.h * s.dv[i]
    _pull_back(p, s, 0.0, 0)
    for i in range(s.dq.size):
        s.dq[i] += s.of_q[i]
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
def _add_sample(s: _Section, k: int) -> None:
    """Add what an output has of the rates and accelerations of its step: Taylor's polynomial."""
    ahead = s.offset[k]
    for i in range(s.dq.size):
        by_rate = s.by_v[k, i] + ahead * s.by_q[k, i]
        s.dv[i] += by_rate
        s.da[i] += 0.5 * (ahead - s.h) * by_rate + 0.5 * ahead * s.by_v[k, i]


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
    q0, v0 : ndarray, shape (n,)
        Its start.
    times : ndarray, shape (n_times,)
        Output times [s].
    by_q, by_v : ndarray, shape (n_times, n)
        Weights of positions and rates.
    directions : sequence of Direction
        Those without variants.
    """
    n, h, inputs = system.n, method.step, system.parameters.inputs
    sample, offset = locate_samples(times, h)
    n_steps, n_inputs = int(sample[-1]) + 1, 3 * len(system.compiled.signals)
    kept = min(n_steps, max(1, MOST_STEPS_KEPT // max(n, n_inputs)))
    steps = {name: np.zeros((kept, n)) for name in ("q", "v", "a")}
    room = {name: np.zeros(n) for name in ("dq", "dv", "da", "of_q", "of_v")}
    section = _Section(
        adjoint=system.compiled.address("acceleration_adjoint"),
        h=h,
        **steps,
        sample=sample,
        offset=offset,
        by_q=np.ascontiguousarray(by_q, dtype=float),
        by_v=np.ascontiguousarray(by_v, dtype=float),
        left=np.array([len(times)]),
        **room,
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

"""Adjoint of a march by central difference: how a weighted sum of its output changes with all that the march takes.

Steps are taken back from the last one, each by the transpose of its own derivative (Griewank & Walther, *Evaluating
Derivatives*, SIAM, 2008, chapters 3 and 12), see `fmd.dynamics.compiled_system.adjoint_kernels`. The motion is marched
anew in sections, from states that are kept at their begins, so that memory holds one section.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import StabilityError
from fmd.core.limits.memory import MOST_STEPS_KEPT
from fmd.dynamics.compiled_system import closed_adjoint  # noqa: F401 - registers the steps of loops
from fmd.dynamics.compiled_system.adjoint_kernels import (
    Evaluations,
    StepsBack,
    accelerate_back,
    advance_back,
    keep_step,
    project_back,
    step_back,
    sum_variants,
)
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangents import Direction, system_along, tabulate_variants
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.compiler.signal_code import load_signals
from fmd.dynamics.system import advance
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.fixed_step import locate_samples
from fmd.integrators.protocol import State
from fmd.kernels.kernel import inlined, kernel
from fmd.kernels.library import call_native
from fmd.kernels.table import Table


@dataclass(frozen=True)
class _Output(Table):
    """Weights of a march's output, and derivatives by a step's begin of what is in it."""

    t: Array  # (n_times,): output times [s]
    step: IntArray  # (n_times,): step that each is in
    offset: Array  # (n_times,): and the time since its begin [s]
    by_q: Array  # (n_times, n_positions): weights of positions, and (n_times, n) of rates
    by_v: Array
    left: IntArray  # (1,): output times that are still to come, from the last one back
    q: Array  # (n_positions,): the output itself
    v: Array  # (n,)
    dq: Array  # (n_positions,): its derivatives
    dv: Array  # (n,)
    rate: Array
    sum_q: Array  # (n_positions,): of all in a step


@kernel
def _take_steps(p: Any, s: StepsBack, q: Array, v: Array, a: Array, first: int, count: int) -> None:
    """Take some steps, and keep them."""
    for k in range(count):
        keep_step(p, s, (first + k) * s.h, k, q, v, a)


@kernel
def _take_back(p: Any, s: StepsBack, output: _Output, first: int, count: int) -> None:
    """Take the kept steps back."""
    for back in range(count):
        k = count - 1 - back
        for i in range(s.dq.size):
            output.sum_q[i] = 0.0
        while output.left[0] > 0 and output.step[output.left[0] - 1] == first + k:
            output.left[0] -= 1
            _add_output(p, s, output, output.left[0], k)
        step_back(p, s, (first + k) * s.h, k)
        for i in range(s.dq.size):
            s.dq[i] += s.of_q[i] + output.sum_q[i]
        for i in range(s.dv.size):
            s.dv[i] += s.of_v[i]
            s.da[i] = 0.5 * s.h * s.of_v[i]


@kernel
def _take_start_back(p: Any, s: StepsBack, q: Array, v: Array, a: Array) -> None:
    """Go back to time 0 from half a step before it."""
    for i in range(s.dv.size):
        s.da[i] -= 0.5 * s.h * s.dv[i]
    accelerate_back(p, s, 0.0, q, v, a)
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
def _add_output(p: Any, s: StepsBack, output: _Output, number: int, k: int) -> None:
    """Add what an output has of its step's begin, rates and accelerations: Taylor's polynomial, projected."""
    ahead = output.offset[number]
    for i in range(s.dq.size):
        output.dq[i] = output.by_q[number, i]
        output.q[i] = s.q[k, i]
    for i in range(s.dv.size):
        output.dv[i] = output.by_v[number, i]
        output.rate[i] = s.ahead[k, i] + 0.5 * (ahead - s.h) * s.a[k, i]
        output.v[i] = output.rate[i] + 0.5 * ahead * s.a[k, i]
    advance(p, output.q, output.rate, ahead, 0, s.dv.size)
    project_back(p, s, output.t[number], output.q, output.v, output.dq, output.dv)
    for i in range(s.dv.size):
        s.da[i] += 0.5 * ahead * output.dv[i]
        output.rate[i] = s.ahead[k, i] + 0.5 * (ahead - s.h) * s.a[k, i]
        output.v[i] = output.dv[i]
    advance_back(p, s.q[k], output.rate, ahead, output.dq, output.v)
    for i in range(s.dq.size):
        output.sum_q[i] += output.dq[i]
    for i in range(s.dv.size):
        s.dv[i] += output.v[i]
        s.da[i] += 0.5 * (ahead - s.h) * output.v[i]


class _Sums:
    """Derivatives of the sum along directions, as evaluations of the equations add to them.

    Of these come derivatives by numbers in the equations, signals and whatever else changes the equations.
    """

    def __init__(self, system: CompiledSystem, directions: Sequence[Direction]) -> None:
        self._directions, self._n_inputs = directions, 3 * len(system.compiled.signals)
        self._codes = [[(load_signals(signals), weight) for signals, weight in each.signals] for each in directions]
        self._tables = {}
        for first in range(0, len(directions), LANES):
            if any(each.variants for each in directions[first : first + LANES]):
                self._tables[first] = tabulate_variants(system, directions[first : first + LANES])
        self.found = np.zeros(len(directions))

    def take(self, known: Evaluations) -> None:
        """Add what evaluations have; there are none after."""
        count, n = int(known.count[0]), self._n_inputs
        times, by_signals = known.t[:count].copy(), known.inputs[:count, :n].copy()
        by_numbers, room = known.inputs[:count, n:].sum(axis=0), (np.zeros(2), np.zeros(n))
        for k, (direction, codes) in enumerate(zip(self._directions, self._codes, strict=True)):
            self.found[k] += by_numbers[: direction.numbers.size] @ direction.numbers
            for code, weight in codes:
                self.found[k] += weight * _sum_signals(code.address("signals"), times, by_signals, *room)
        for first, table in self._tables.items():
            sums = np.zeros(LANES)
            sum_variants(table, known, np.zeros(1), sums)
            own = self.found[first : first + LANES]
            own += sums[: len(own)]
        known.count[0] = 0


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
        What is marched, one that `has_tangents`.
    q0, v0 : ndarray, shapes (n_positions,) and (n,)
        Its start.
    times : ndarray, shape (n_times,)
        Output times [s].
    by_q, by_v : ndarray, shapes (n_times, n_positions) and (n_times, n)
        Weights of positions and rates.

    Raises
    ------
    StabilityError
        The adjoint grows without bounds.
    """
    system = system_along(system, directions)
    own, offset = locate_samples(times, method.step)
    n_steps = int(own[-1]) + 1
    per_step = _evaluations_in_step(system)
    widest = per_step * max(system.n_positions, system.parameters.inputs.size)
    kept = min(n_steps, max(1, MOST_STEPS_KEPT // widest))
    outputs = int(np.bincount(own // kept).max()) if system.has_loops else 0
    s = _make_room(system, method.step, kept, max(2, per_step * kept + 4 * outputs))
    n_positions, n = system.n_positions, system.n
    output = _Output(
        t=np.array(times, dtype=float),
        step=own,
        offset=offset,
        by_q=np.ascontiguousarray(by_q, dtype=float),
        by_v=np.ascontiguousarray(by_v, dtype=float),
        left=np.array([len(times)]),
        **{name: np.zeros(n_positions) for name in ("q", "dq", "sum_q")},
        **{name: np.zeros(n) for name in ("v", "dv", "rate")},
    )
    sums, p, state = _Sums(system, directions), system.parameters, method.start(system, q0, v0)
    begins: list[State] = []
    for first in range(0, n_steps, kept):
        begins.append(state.copy())
        _take_steps(p, s, state.q, state.v, state.a, first, min(kept, n_steps - first))
    for number, begin in reversed([*enumerate(begins)]):
        first, count = number * kept, min(kept, n_steps - number * kept)
        if number < len(begins) - 1:
            _take_steps(p, s, begin.q, begin.v, begin.a, first, count)
        _take_back(p, s, output, first, count)
        sums.take(s.known)
    start = [np.array(x, dtype=float) for x in (q0, v0, method.start(system, q0, v0).a)]
    _take_start_back(p, s, *start)
    sums.take(s.known)
    found = np.asarray(sums.found + [s.dq @ each.q + s.dv @ each.v for each in directions])
    if not np.isfinite(found).all():
        raise StabilityError("the adjoint of the march grows without bounds; a shorter step may help")
    return found


def _evaluations_in_step(system: CompiledSystem) -> int:
    if not system.has_loops:
        return 1
    return 2 if system.n_positions == system.n else 4


def _make_room(system: CompiledSystem, h: float, kept: int, most: int) -> StepsBack:
    """Return room for a section of so many steps, with so many evaluations of the equations at most."""
    n, n_positions, n_rows = system.n, system.n_positions, len(system.compiled.rows)
    n_inputs, address = system.parameters.inputs.size, system.compiled.address
    wide = {"q": n_positions, "v": n, "a": n, "f": n_rows, "x": n, "g": n_rows, "rates": n_rows, "w": n_rows}
    fields: dict[str, Any] = {name: np.zeros((most, size)) for name, size in (wide | {"inputs": n_inputs}).items()}
    known = Evaluations(count=np.zeros(1, dtype=np.int64), t=np.zeros(most), **fields)
    placed = ("dq", "of_q", "moved_q", "q_ahead", "projected_q")
    moving = ("dv", "da", "of_v", "of_a", "x", "moved_v", "rate", "v_ahead", "a_free", "push", "weights")
    room: dict[str, Any] = {name: np.zeros(n_positions) for name in placed} | {name: np.zeros(n) for name in moving}
    room |= {name: np.zeros(n_rows) for name in ("g", "rates", "w", "multiplier", "other", "none")}
    room |= {name: np.zeros((kept, n)) for name in ("v", "a", "ahead")}
    room |= {name: np.zeros((kept, n_rows)) for name in ("f", "pushes")}
    return StepsBack(
        acceleration=address("acceleration_adjoint"),
        residuals=address("residuals_adjoint") if n_rows else 0,
        closing=address("closing_adjoint") if n_rows else 0,
        h=h,
        q=np.zeros((kept + 1, n_positions)),
        **room,
        of_inputs=np.zeros(n_inputs),
        known=known,
    )

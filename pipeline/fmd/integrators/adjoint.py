"""Adjoint of a march: how a weighted sum of its output changes with all that the march takes.

Steps are taken back from the last one, each by the transpose of its own derivative (Griewank & Walther, *Evaluating
Derivatives*, SIAM, 2008, chapters 3 and 12), see `fmd.dynamics.compiled_system.adjoint_kernels`. How, is registered for
each method. The motion is marched anew in sections, so that memory holds one section's steps;
of a method that chooses its steps it holds the states at which all of them begin, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import singledispatch
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, StabilityError
from fmd.core.limits.fitting import WEIGHTS_LEFT
from fmd.core.limits.memory import MOST_STEPS_KEPT
from fmd.dynamics.compiled_system import closed_adjoint  # noqa: F401 - registers the steps of loops
from fmd.dynamics.compiled_system.adjoint_kernels import Evaluations, StepsBack, sum_variants
from fmd.dynamics.compiled_system.closed_tangents import require_one_linearisation
from fmd.dynamics.compiled_system.parameters import CompiledParameters
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.compiled_system.tangent_kernels import MechanismVariants
from fmd.dynamics.compiled_system.tangents import Direction, system_along, tabulate_variants
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.compiler.signal_code import load_signals
from fmd.dynamics.compiler.turns import make_turns
from fmd.integrators.fixed_step import locate_samples
from fmd.integrators.protocol import Integrator
from fmd.kernels.kernel import inlined, kernel
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


class NotTakenBackError(AccuracyError):
    """The steps of a march can't be taken back; its tangents don't depend on that."""


@dataclass(frozen=True)
class WeightedOutput(Table):
    """Weights of a march's output, which is taken from the last output time back."""

    t: Array  # (n_times,): output times [s], the step that each is in, and the time since its begin [s]
    step: IntArray
    offset: Array
    by_q: Array  # (n_times, n_positions): weights of positions, and (n_times, n) of rates
    by_v: Array
    left: IntArray  # (1,): output times that are still to come


@inlined
def has_next(output: WeightedOutput, step: int) -> bool:
    """Tell whether the last output time that is left is in a step."""
    last = int(output.left[0]) - 1
    return last >= 0 and int(output.step[last]) == step


@dataclass(frozen=True)
class WeightedMarch:
    """A march, and the weights of its output in a sum."""

    system: CompiledSystem
    parameters: CompiledParameters  # the system's own of this march
    q0: Array  # (n_positions,): positions at its start
    v0: Array  # (n,): rates at its start
    times: Array  # (n_times,): output times [s]
    by_q: Array  # (n_times, n_positions): weights of positions
    by_v: Array  # (n_times, n): weights of rates

    @property
    def n_kept(self) -> int:
        """Evaluations of the equations that an evaluation of accelerations is kept as."""
        return 2 if self.system.has_loops else 1

    @property
    def n_projected(self) -> int:
        """Evaluations of the equations that a projection is kept as."""
        return 4 if self.system.has_loops else 0

    def count_kept_steps(self, per_step: int) -> int:
        """Return how many steps are kept, where one has so many evaluations of the equations."""
        widest = max(self.system.n_positions, self.parameters.inputs.size)
        return max(1, MOST_STEPS_KEPT // (per_step * widest))

    def locate_output(self, step: float) -> WeightedOutput:
        """Return the output by steps [s]."""
        return self.output_in(*locate_samples(self.times, step))

    def output_in(self, steps: IntArray, offset: Array) -> WeightedOutput:
        """Return the output by the steps that it is in (n_times,), and the times since their begins (n_times,) [s]."""
        return WeightedOutput(self.times, steps, offset, self.by_q, self.by_v, np.array([len(self.times)]))

    def divide(self, output: WeightedOutput, per_step: int) -> tuple[int, int, int]:
        """Return numbers of steps, of those in a section, and of evaluations that projections of its output are."""
        n_steps = int(output.step[-1]) + 1
        kept = min(n_steps, self.count_kept_steps(per_step))
        return n_steps, kept, self.n_projected * int(np.bincount(output.step // kept).max())


@kernel
def _add_signals(address: int, weight: float, times: Array, clock: Array, values: Array, out: Array) -> None:
    """Add what signals are over time, with a weight."""
    for row in range(times.size):
        clock[0] = times[row]
        call_native(address, (clock, values))
        for i in range(values.size):
            out[row, i] += weight * values[i]


class Sums:
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

    def beside(self, function: str) -> Iterator[tuple[MechanismVariants, IntArray, Array]]:
        """Yield mechanisms beside the system's own, addresses of their function, and derivatives to add to.

        Each has them of up to eight directions.
        """
        for first, table in self._tables.items():
            addresses, found = np.zeros(4 * LANES, dtype=np.int64), np.zeros(LANES)
            chosen = self._directions[first : first + LANES]
            for lane, direction in enumerate(chosen):
                for k, each in enumerate(direction.variants):
                    addresses[4 * lane + k] = each.compiled.address(function)
            yield table, addresses, found
            self.found[first : first + LANES] += found[: len(chosen)]

    def take(self, known: Evaluations) -> None:
        """Add what evaluations have; there are none after."""
        count, n = int(known.count[0]), self._n_inputs
        times, by_signals = known.t[:count].copy(), known.inputs[:count, :n].copy()
        by_numbers, room = known.inputs[:count, n:].sum(axis=0), (np.zeros(2), np.zeros(n))
        for k, (direction, codes) in enumerate(zip(self._directions, self._codes, strict=True)):
            self.found[k] += by_numbers[: direction.numbers.size] @ direction.numbers
            changes = np.zeros((count, n))  # at each time: sums of signals would lose what little they differ by
            for code, weight in codes:
                _add_signals(code.address("signals"), weight, times, *room, changes)
            self.found[k] += (by_signals * changes).sum()
        for first, table in self._tables.items():
            sums = np.zeros(LANES)
            sum_variants(table, known, np.zeros(1), sums)
            own = self.found[first : first + LANES]
            own += sums[: len(own)]
        known.count[0] = 0


def sections_back(
    n_steps: int, kept: int, state: Any, keep: Callable[[Any, int, int], None]
) -> Iterator[tuple[int, int]]:
    """March from a state, which has a copy, in sections, and yield first step and length of each, the last one first.

    ``keep`` marches such a section on and keeps its steps, which are those at hand.
    """
    begins = []
    for first in range(0, n_steps, kept):
        begins.append(state.copy())
        keep(state, first, min(kept, n_steps - first))
    for number, begin in reversed([*enumerate(begins)]):
        first, count = number * kept, min(kept, n_steps - number * kept)
        if number < len(begins) - 1:
            keep(begin, first, count)
        yield first, count


@singledispatch
def take_back(method: Integrator, march: WeightedMarch, sums: Sums) -> tuple[Array, Array, float]:
    """March, take all steps back, and return derivatives by positions (n_positions,) and rates (n,) of the start.

    The third is the largest part that corrections left of weights that they were to make 0.
    """
    raise NotImplementedError


def pull_back(
    method: Integrator,
    system: CompiledSystem,
    q0: Array,
    v0: Array,
    times: Array,
    by_q: Array,
    by_v: Array,
    directions: Sequence[Direction],
) -> Array:
    """Differentiate a weighted sum of a march's output along some directions, shape (n_directions,).

    The method `carries_tangent`, and the system `has_tangents`; the rest is as `WeightedMarch` has it.

    Raises
    ------
    StabilityError
        The adjoint grows without bounds.
    LinearisedAnewError
        Loops were closed otherwise than a step's transpose takes it.
    NotTakenBackError
        Corrections left too much, or a method that chooses its steps took too many to keep their begins.
    """
    system = system_along(system, directions)
    output = [np.ascontiguousarray(x, dtype=float) for x in (times, by_q, by_v)]
    sums, p = Sums(system, directions), system.parameters
    p = replace(p, turns=make_turns(p.quaternions, "", "_back"))
    dq, dv, left = take_back(method, WeightedMarch(system, p, q0, v0, *output), sums)
    found = np.asarray(sums.found + [dq @ each.q + dv @ each.v for each in directions])
    if not np.isfinite(found).all():
        raise StabilityError(f"the adjoint of the march grows without bounds; {method.refinement}")
    require_one_linearisation(p, method.refinement)
    if not left <= WEIGHTS_LEFT:  # NaN, too
        raise NotTakenBackError(f"corrections left {left:.1e} of the adjoint's weights; {method.refinement}")
    return found


def make_room(system: CompiledSystem, h: float, kept: int, most: int) -> StepsBack:
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
        left=np.zeros(2),
        known=known,
    )

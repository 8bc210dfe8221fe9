"""Step bounds by force laws with short pieces: how far a step may go so that it misses none of them.

A step may enter a piece by half of the piece's length. So it ends in it, its stages feel the force, and a method whose
step follows the error takes over.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.stepping import INTO_PIECE, LEAST_PART, MOST_PART
from fmd.kernels.kernel import inner, kernel
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class StepBounds(Table):
    """Force laws with short pieces, and the elongations that they depend on."""

    elongations: int  # addresses of the compiled functions; 0 if there is no such law, or no load or motion that varies
    signals: int
    inputs: Array  # (3 n_signals,): values, rates and accelerations of the signals
    clock: Array  # (1,): time that they are of [s]
    edges: Array  # ends of the pieces of all laws, one after the other [m or rad]
    first: IntArray  # (n_laws + 1,): where those of each law begin
    beyond: Array  # (n_laws,): length of the pieces beyond a law's first and last edge [m or rad]
    rest: Array  # (n_laws,): length of each spring without elongation [m]; NaN for joints
    # (n_laws,), (n_laws,) and (n_laws, 3): elongations, their rates, and vectors from place to place at a step's begin
    x: Array
    rates: Array
    vectors: Array
    new_x: Array  # the same at its end
    new_rates: Array
    new_vectors: Array

    @property
    def n_laws(self) -> int:
        """Number of laws that bound a step."""
        return len(self.beyond)


@cache
def no_bounds() -> StepBounds:
    """Return the bounds by no law at all, in which no march writes."""
    return make_step_bounds(0, 0, 0, [], np.zeros(0), np.zeros(0))


def make_step_bounds(
    elongations: int, signals: int, n_signals: int, edges: list[Array], beyond: Array, rest: Array
) -> StepBounds:
    """Make step bounds, with room of their own; parameters are their members."""
    n = len(edges)
    first = np.concatenate([[0], np.cumsum([len(each) for each in edges])]).astype(np.int64)
    room = (np.zeros(n), np.zeros(n), np.zeros((n, 3)))
    copies = (x.copy() for x in room)
    together = np.concatenate([np.zeros(0), *edges])
    return StepBounds(
        elongations, signals, np.zeros(3 * n_signals), np.zeros(1), together, first, beyond, rest, *room, *copies
    )


@inner
def _elongate(w: StepBounds, t: float, q: Array, v: Array, x: Array, rates: Array, vectors: Array) -> None:
    w.clock[0] = t
    if w.signals != 0:
        call_native(w.signals, (w.clock, w.inputs))
    call_native(w.elongations, (w.inputs, q, v, x, rates, vectors))


@inner
def record_step_start(w: StepBounds, t: float, q: Array, v: Array) -> None:
    """Note the elongations at a time t [s], at which a step begins."""
    if w.elongations != 0:
        _elongate(w, t, q, v, w.x, w.rates, w.vectors)


@inner
def predicted_part(w: StepBounds, h: float) -> float:
    """Return the part of a step h [s] that misses no piece if the elongations go on at their rates."""
    part = 1.0
    if w.elongations != 0:
        for k in range(w.beyond.size):
            ahead = h * w.rates[k]
            part = min(part, _part_within(w, k, w.x[k] + min(ahead, 0.0), w.x[k] + max(ahead, 0.0)))
    return part


@inner
def allowed_part(w: StepBounds, t: float, h: float, q: Array, v: Array) -> float:
    """Return the part that may be tried next of a step h [s] which would end with q and v at a time t; 1 if it's fine.

    Between its ends an elongation is within the control polygon of the cubic through both with their rates, and beyond
    the shortest distance of two places that move straight on.
    """
    part = 1.0
    if w.elongations != 0:
        _elongate(w, t, q, v, w.new_x, w.new_rates, w.new_vectors)
        for k in range(w.beyond.size):
            x, new = w.x[k], w.new_x[k]
            one, other = x + h / 3.0 * w.rates[k], new - h / 3.0 * w.new_rates[k]
            low, high = min(x, new, one, other), max(x, new, one, other)
            if w.rest[k] >= 0.0:
                low = min(low, _closest(w.vectors[k], w.new_vectors[k]) - w.rest[k])
            part = min(part, _part_within(w, k, low, high))
    return part if part >= 1.0 else min(max(part, LEAST_PART), MOST_PART)


@inner
def _closest(a: Array, b: Array) -> float:
    """Return the shortest distance from 0 to the line from a to b."""
    along, length = 0.0, 0.0
    for i in range(3):
        along -= a[i] * (b[i] - a[i])
        length += (b[i] - a[i]) ** 2
    s = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    total = 0.0
    for i in range(3):
        total += (a[i] + s * (b[i] - a[i])) ** 2
    return math.sqrt(total)


@inner
def _part_within(w: StepBounds, k: int, low: float, high: float) -> float:
    """Return the part of the way from ``w.x[k]`` to a lowest and to a highest elongation that passes no piece."""
    x, first, last = w.x[k], w.first[k], w.first[k + 1]
    before, after = first - 1, last  # edges next to x on both sides
    while after - before > 1:
        middle = (before + after) // 2
        if w.edges[middle] <= x:
            before = middle
        else:
            after = middle
    part, reach = 1.0, math.inf
    for i in range(before, last):  # pieces from that of x upwards
        begin = w.edges[i] if i >= first else -math.inf
        if begin >= high or begin - x > reach:
            break
        length = w.edges[i + 1] - begin if first <= i < last - 1 else w.beyond[k]
        reach = min(reach, max(begin - x, 0.0) + INTO_PIECE * length)
    if high - x > reach:
        part = reach / (high - x)
    reach = math.inf
    for i in range(before, first - 2, -1):  # and downwards
        end = w.edges[i + 1] if i + 1 < last else math.inf
        if end <= low or x - end > reach:
            break
        length = end - w.edges[i] if first <= i < last - 1 else w.beyond[k]
        reach = min(reach, max(x - end, 0.0) + INTO_PIECE * length)
    if x - low > reach:
        part = min(part, reach / (x - low))
    return part


@kernel
def record_step_start_of(w: StepBounds, t: float, q: Array, v: Array) -> None:
    """Note the elongations at a step's begin, for a loop in Python."""
    record_step_start(w, t, q, v)


@kernel
def allowed_part_of(w: StepBounds, t: float, h: float, q: Array, v: Array) -> float:
    """Return the part of a step to be tried next, for a loop in Python."""
    return allowed_part(w, t, h, q, v)

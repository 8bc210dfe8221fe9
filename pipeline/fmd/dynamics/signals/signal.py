"""Functions of time: loads and prescribed motions, with their first two derivatives.

A signal is an expression graph, which is differentiated, evaluated and printed as a mechanism's is. So position, rate
and acceleration of a prescribed motion belong together by construction.
"""

import math
from collections.abc import Sequence
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np

from fmd.core import formula as operation
from fmd.core.arrays import Array, require_shape
from fmd.core.data_classes import dataclass
from fmd.core.formula import Formula
from fmd.core.limits.loads import PIECES_APART
from fmd.core.splines import spline_pieces
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.formulas import trace_formula, trace_table
from fmd.dynamics.compiler.graph import Graph, Scalar
from fmd.dynamics.compiler.graph import total as sum_up
from fmd.dynamics.compiler.interpret import Evaluation, evaluation_of

CONSTANT, PROGRAM, TABLE = range(3)
"""Kinds of a term."""

Beyond = Literal["hold", "zero", "repeat"]
"""How a table goes on before and after its samples."""

ALWAYS = (-math.inf, math.inf)
"""Support of a term that never ends."""


@dataclass(frozen=True)
class Term:
    """One of the terms whose sum is a signal; zero outside of its support."""

    kind: int
    codes: tuple[int, ...] = ()
    numbers: tuple[float, ...] = ()
    knots: tuple[float, ...] = ()
    cubics: tuple[tuple[float, float, float, float], ...] = ()  # from each knot on, lowest power first
    support: tuple[float, float] = ALWAYS

    def trace(self, t: Scalar) -> Scalar:
        """Trace its value at a time."""
        if self.kind == PROGRAM:
            return self._while_acting(trace_formula(self.codes, self.numbers, t), t)
        return trace_table(self.knots, self.cubics, t) if self.kind == TABLE else t.graph.number(self.numbers[0])

    def trace_activity(self, t: Scalar) -> Scalar:
        """Trace 1 while a time is within the support, else 0."""
        return self._while_acting(t.graph.number(1.0), t)

    def _while_acting(self, value: Scalar, t: Scalar) -> Scalar:
        if self.support == ALWAYS:
            return value
        (first, last), nothing = self.support, t.graph.number(0.0)
        return (first - t).select(nothing, (t - last).select(nothing, value))


@dataclass(frozen=True)
class Signal:
    """A function of time, made by the functions of this module."""

    terms: tuple[Term, ...]
    # Times at which it or its first derivative may jump, and the ends of a smooth table, at which its second one does
    # [s], ascending. Kinks of abs, min and max in a formula are not among them.
    breakpoints: tuple[float, ...] = ()

    @property
    def is_constant(self) -> bool:
        """True if it never changes."""
        return all(term.kind == CONSTANT for term in self.terms)

    def value(self, t: float) -> tuple[float, float, float]:
        """Value, first and second time derivative at time t [s]."""
        value, rate, acceleration = self.values(np.array([t]))[0]
        return float(value), float(rate), float(acceleration)

    def values(self, times: Array) -> Array:
        """Value, first and second time derivative at each time [s], shape (n_times, 3)."""
        return _evaluate(self.terms).over({"time": times[None]}, len(times))

    @cached_property
    def jumps(self) -> tuple[tuple[float, Array, Array], ...]:
        """Times at which the value or its first derivative jumps [s], with both (2,) before and after."""
        times = np.array(self.breakpoints)
        before, after = (self.values(np.nextafter(times, side))[:, :2] for side in (-np.inf, np.inf))
        apart = ~np.isclose(before, after, rtol=PIECES_APART, atol=PIECES_APART).all(axis=1)
        return tuple(zip(times[apart].tolist(), before[apart], after[apart], strict=True))

    def trace(self, t: Scalar) -> list[Scalar]:
        """Trace value, first and second derivative at a time, which is an input of its graph."""
        value = sum_up([t.graph.number(0.0), *(term.trace(t) for term in self.terms)])
        rate = _slope(value, t)
        return [value, rate, _slope(rate, t)]


def quiet_times(signals: Sequence[Signal]) -> list[tuple[float, float]]:
    """Return begin and end of the times [s] in which no term of any signal acts or changes, between breakpoints."""
    terms = [term for signal in signals for term in signal.terms if term.kind != CONSTANT or term.support != ALWAYS]
    ends = {-math.inf, math.inf, *(t for term in terms for t in term.support)}
    times = sorted(ends.union(*(signal.breakpoints for signal in signals)))
    return [(a, b) for a, b in pairwise(times) if all(term.support[1] <= a or b <= term.support[0] for term in terms)]


def _slope(value: Scalar, t: Scalar) -> Scalar:
    (slope,) = differentiate(t.graph, [value], {t.node: t.graph.number(1.0)})
    assert isinstance(slope, Scalar)
    return slope


@lru_cache(maxsize=256)
def _evaluate(terms: tuple[Term, ...]) -> Evaluation:
    """Return the evaluation of value, first and second derivative of a sum of terms by the argument ``time``."""
    return evaluation_of(Signal(terms).trace(Graph().scalar_input("time", 0)))


def constant(value: float) -> Signal:
    """Make a signal that doesn't change.

    Raises
    ------
    ValueError
        It isn't finite.
    """
    return Signal((Term(CONSTANT, numbers=(_finite("the constant", value),)),))


def formula(expression: Formula, factor: float = 1.0) -> Signal:
    """Make a signal of a formula times a factor, the SI units in one unit of its values.

    Where a formula has no real value (a root or a logarithm of a negative number, a varying power of one) the signal is
    not a number, which stops a march; so it does where a derivative that is wanted doesn't exist, as of ``sqrt(t)`` at
    0. On a kink, the derivatives of abs are those after it for a rising argument, and min and max have those of their
    first argument.

    Raises
    ------
    ValueError
        The factor isn't finite.
    """
    factor = _finite("the factor", factor)
    if expression.codes == (operation.CONSTANT,):
        return constant(factor * expression.constants[0])
    codes, numbers = expression.codes, expression.constants
    if factor != 1.0:
        codes, numbers = (*codes, operation.CONSTANT, operation.MULTIPLY), (*numbers, factor)
    return Signal((Term(PROGRAM, codes, numbers),), expression.breakpoints)


def half_sine(start: float, duration: float, peak: float, power: int = 1) -> Signal:
    """Make ``peak sin(π (t − start)/duration)^power`` while that lasts, else 0; times in s.

    Its impulse is ``2/π peak duration``, of the second power, which has no kinks at its ends, half of ``peak
    duration``.

    Raises
    ------
    ValueError
        The duration isn't above 0, or a number isn't finite.
    """
    start, peak = _finite("the start", start), _finite("the peak", peak)
    end = start + _finite("the duration", duration)
    if not end > start:
        raise ValueError(f"a half sine that begins at {start:g} s can't last {duration:g} s; give more than 0")
    codes = (
        operation.TIME,
        operation.CONSTANT,
        operation.SUBTRACT,
        operation.CONSTANT,
        operation.MULTIPLY,
        operation.SIN,
        *[operation.CONSTANT, operation.POWER] * (power > 1),
        operation.CONSTANT,
        operation.MULTIPLY,
    )
    numbers = (start, math.pi / duration, *[float(power)] * (power > 1), peak)
    term = Term(PROGRAM, codes, numbers, support=(start, end))
    return Signal((term,), (start, end))


def linear_table(times: Array, values: Array, beyond: Beyond = "hold", until: float = 0.0) -> Signal:
    """Make straight lines between samples (n,) at ascending times (n,) [s], 2 at least.

    Before and after them the first and the last value hold (``"hold"``), the signal is 0 (``"zero"``), or the samples
    begin anew (``"repeat"``) until a time [s].

    Raises
    ------
    ValueError
        Shapes disagree, times don't ascend, a number isn't finite.
    """
    times, values = _samples(times, values)
    slopes = np.diff(values) / np.diff(times)
    pieces = np.column_stack([values[:-1], slopes, np.zeros((len(slopes), 2))])
    bends = times[1:-1][np.diff(slopes) != 0.0]
    return _go_on(times, pieces, (values[-1], slopes[-1]), bends, beyond, until)


def smooth_table(times: Array, values: Array, beyond: Beyond = "hold", until: float = 0.0) -> Signal:
    """Make the cubic spline through samples, at rest at both ends, or periodic if they repeat.

    It has a continuous first derivative and between its ends a continuous second one: fit for a prescribed motion,
    whose acceleration acts as a load. Parameters and errors are those of `linear_table`; samples that repeat end with
    their first value.
    """
    times, values = _samples(times, values)
    if beyond == "repeat":
        values = np.append(values[:-1], values[0])
    repeats = beyond == "repeat"
    pieces = spline_pieces(times, values, "periodic" if repeats else "clamped")
    final = (values[-1], pieces[0, 1] if repeats else 0.0)
    return _go_on(times, pieces, final, times[:0] if repeats else times[[0, -1]], beyond, until)


def _go_on(
    times: Array, pieces: Array, final: tuple[float, float], breakpoints: Array, beyond: Beyond, until: float
) -> Signal:
    """Make a signal of cubics (n - 1, 4) and their final value and rate, which goes on beyond its n times."""
    begin, end = float(times[0]), float(times[-1])
    if beyond == "repeat":
        period = end - begin
        starts = period * np.arange(math.floor(-begin / period), math.ceil((until - begin) / period) + 1)
        knots, inside = ((at + starts[:, None]).ravel() for at in (times[:-1], breakpoints))
        joins = starts[:0] if final == tuple(pieces[0, :2]) else starts + begin
        return Signal((_table(knots, np.tile(pieces, (len(starts), 1))),), tuple(np.union1d(inside, joins).tolist()))
    holds = beyond == "hold"
    before, after = (np.array([value if holds else 0.0, 0.0, 0.0, 0.0]) for value in (pieces[0, 0], final[0]))
    ends = [
        at for at, one, other in ((begin, before, pieces[0, :2]), (end, after, final)) if tuple(one[:2]) != tuple(other)
    ]
    cubics = np.vstack([*([] if holds else [before]), pieces, after])
    knots = times if holds else np.insert(times, 0, begin - 1.0)  # zero before, too
    return Signal((_table(knots, cubics),), tuple(np.union1d(breakpoints, ends).tolist()))


def total(signals: Sequence[Signal]) -> Signal:
    """Add signals up; none at all make zero."""
    if len(signals) == 1:
        return signals[0]
    breakpoints = {time for signal in signals for time in signal.breakpoints}
    return Signal(tuple(term for signal in signals for term in signal.terms), tuple(sorted(breakpoints)))


def _finite(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{name} of a signal is {value}, which isn't finite")
    return float(value)


def _samples(times: Array, values: Array) -> tuple[Array, Array]:
    times, values = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    require_shape("times", times, (None,))
    require_shape("values", values, times.shape)
    if len(times) < 2:
        raise ValueError(f"a table of {len(times)} times is none; give 2 at least, or a constant")
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise ValueError("a table holds a number that isn't finite")
    if (late := np.flatnonzero(np.diff(times) <= 0.0)).size:
        before, after = times[late[0]], times[late[0] + 1]
        raise ValueError(f"the times of a table must ascend, but {after:g} s comes after {before:g} s")
    return times, values


def _table(times: Array, cubics: Array) -> Term:
    pieces = tuple((a, b, c, d) for a, b, c, d in cubics.tolist())
    return Term(TABLE, knots=tuple(times.tolist()), cubics=pieces)

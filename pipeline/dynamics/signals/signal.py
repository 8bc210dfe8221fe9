"""Functions of time: loads and prescribed motions, with their first two derivatives.

A formula is run on truncated Taylor series (f, f', f''), so that position, rate and acceleration of a prescribed motion
belong together by construction (Griewank & Walther, Evaluating Derivatives, 2nd ed., SIAM, 2008, ch. 13).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.core.arrays import Array, IntArray, require_shape
from pipeline.core.formula import MOST_DEPTH, Formula
from pipeline.dynamics.jit.compiled import addressed, inner, kernel
from pipeline.dynamics.jit.table import Table, address_of, call

_CONSTANT, _PROGRAM, _TABLE = range(3)
# The codes of `pipeline.core.formula`, written out: compiled kernels are kept until a source in this folder changes.
(
    _NUMBER, _TIME, _ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _POWER, _NEGATE,
    _SIN, _COS, _TAN, _EXP, _LOG, _SQRT, _TANH, _ABS, _MINIMUM, _MAXIMUM, _BEFORE,
) = range(19)  # fmt: skip


@dataclass(frozen=True)
class Term:
    """One of the terms whose sum is a signal; zero outside of its support."""

    kind: int
    codes: tuple[int, ...] = ()
    numbers: tuple[float, ...] = ()
    knots: tuple[float, ...] = ()
    cubics: tuple[tuple[float, float, float, float], ...] = ()  # from each knot on, lowest power first
    support: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True)
class Signal:
    """A function of time, made by the functions of this module.

    Attributes
    ----------
    terms : tuple
        Its sum.
    breakpoints : tuple of float
        Times at which it or its first derivative may jump, and the ends of a smooth table, at which its second one
        does [s], ascending. Kinks of abs, min and max in a formula are not among them.
    pulse : tuple of float, optional
        Start [s], duration [s] and peak, if the signal is one half sine.
    """

    terms: tuple[Term, ...]
    breakpoints: tuple[float, ...] = ()
    pulse: tuple[float, float, float] | None = None

    @property
    def is_constant(self) -> bool:
        """True if it never changes."""
        return all(term.kind == _CONSTANT for term in self.terms)

    def value(self, t: float) -> tuple[float, float, float]:
        """Value, first and second time derivative at time t [s], by the kernel that a march uses."""
        value, rate, acceleration = self.values(np.array([t]))[0]
        return float(value), float(rate), float(acceleration)

    def values(self, times: Array) -> Array:
        """Value, first and second time derivative at each time [s], shape (n_times, 3)."""
        packed, out = pack([self]), np.empty((times.size, 3))
        for t, at in zip(times, out, strict=True):
            evaluate_signal(packed, 0, float(t), at)
        return out


def constant(value: float) -> Signal:
    """Make a signal that doesn't change.

    Raises
    ------
    ValueError
        It isn't finite.
    """
    return Signal((Term(_CONSTANT, numbers=(_finite("the constant", value),)),))


def formula(expression: Formula, factor: float = 1.0) -> Signal:
    """Make a signal of a formula times a factor.

    Where a formula has no real value (a root or a logarithm of a negative number, a varying power of one) the signal
    is not a number, which stops a march; so it does where a derivative that is wanted doesn't exist, as of ``sqrt(t)``
    at 0. On a kink, the derivatives of abs are those after it for a rising argument, and min and max have those of
    their first argument.

    Parameters
    ----------
    expression : Formula
        What `pipeline.core.formula.parse_formula` makes of the text.
    factor : float
        SI units in one unit of the formula's values.

    Raises
    ------
    ValueError
        The factor isn't finite.
    """
    factor = _finite("the factor", factor)
    if expression.codes == (_NUMBER,):
        return constant(factor * expression.constants[0])
    codes, numbers = expression.codes, expression.constants
    if factor != 1.0:
        codes, numbers = (*codes, _NUMBER, _MULTIPLY), (*numbers, factor)
    return Signal((Term(_PROGRAM, codes, numbers),), expression.breakpoints)


def half_sine(start: float, duration: float, peak: float) -> Signal:
    """Make ``peak sin(π (t − start)/duration)`` while that lasts, else 0: an impulse of ``2/π peak duration``.

    Parameters
    ----------
    start, duration : float
        When it begins and how long it lasts [s].
    peak : float
        Its largest value.

    Raises
    ------
    ValueError
        The duration isn't above 0, or a number isn't finite.
    """
    start, peak = _finite("the start", start), _finite("the peak", peak)
    end = start + _finite("the duration", duration)
    if not end > start:
        raise ValueError(f"a half sine that begins at {start:g} s can't last {duration:g} s; give more than 0")
    codes = (_TIME, _NUMBER, _SUBTRACT, _NUMBER, _MULTIPLY, _SIN, _NUMBER, _MULTIPLY)
    numbers = (start, math.pi / duration, peak)
    term = Term(_PROGRAM, codes, numbers, support=(start, end))
    return Signal((term,), (start, end), (start, float(duration), peak))


def linear_table(times: Array, values: Array) -> Signal:
    """Make straight lines between samples; the first and the last value hold before and after.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Of the samples [s], ascending, 2 at least.
    values : ndarray, shape (n,)
        One for each.

    Raises
    ------
    ValueError
        Shapes disagree, times don't ascend, a number isn't finite.
    """
    times, values = _samples(times, values)
    slopes = [0.0, *np.diff(values) / np.diff(times), 0.0]
    cubics = [(float(value), float(slope), 0.0, 0.0) for value, slope in zip(values, slopes[1:], strict=True)]
    bends = np.diff(slopes) != 0.0
    return Signal((_table(times, cubics),), tuple(times[bends].tolist()))


def smooth_table(times: Array, values: Array) -> Signal:
    """Make the cubic spline through samples, at rest at both ends, where the first and the last value hold on.

    It has a continuous first derivative everywhere and a continuous second one between its ends: fit for a prescribed
    motion, whose acceleration acts as a load. Parameters and errors are those of `linear_table`.
    """
    from scipy.interpolate import CubicSpline

    times, values = _samples(times, values)
    pieces = CubicSpline(times, values, bc_type="clamped").c[::-1].T
    cubics = [*pieces.tolist(), (float(values[-1]), 0.0, 0.0, 0.0)]
    return Signal((_table(times, cubics),), (float(times[0]), float(times[-1])))


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


def _table(times: Array, cubics: Sequence[Sequence[float]]) -> Term:
    pieces = tuple((a, b, c, d) for a, b, c, d in cubics)
    return Term(_TABLE, knots=tuple(times.tolist()), cubics=pieces)


@dataclass(frozen=True)
class SignalTable(Table):
    """Any number of signals as flat arrays for the kernels; ``stack`` is room to work in, for one thread."""

    evaluate_term: int  # address of `_evaluate_term`, 0 if all are constants
    first_term: IntArray  # (n_signals + 1,)
    kind: IntArray  # (n_terms,)
    support: Array  # (n_terms, 2)
    first_code: IntArray  # (n_terms + 1,)
    first_number: IntArray  # (n_terms + 1,)
    first_knot: IntArray  # (n_terms + 1,)
    codes: IntArray
    numbers: Array
    knots: Array
    cubics: Array  # (n_knots, 4)
    stack: Array  # (MOST_DEPTH, 3)

    def with_room(self) -> SignalTable:
        """Give room to work in that is the caller's own."""
        return replace(self, stack=np.zeros((MOST_DEPTH, 3)))


def pack(signals: Sequence[Signal]) -> SignalTable:
    """Gather signals, numbered in their order."""
    terms = [term for signal in signals for term in signal.terms]

    def starts(sizes: Sequence[int]) -> IntArray:
        return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)

    table = SignalTable(
        evaluate_term=0,
        first_term=starts([len(signal.terms) for signal in signals]),
        kind=np.array([term.kind for term in terms], dtype=np.int64),
        support=np.array([term.support for term in terms]).reshape(-1, 2),
        first_code=starts([len(term.codes) for term in terms]),
        first_number=starts([len(term.numbers) for term in terms]),
        first_knot=starts([len(term.knots) for term in terms]),
        codes=np.array([c for term in terms for c in term.codes], dtype=np.int64),
        numbers=np.array([x for term in terms for x in term.numbers], dtype=float),
        knots=np.array([x for term in terms for x in term.knots], dtype=float),
        cubics=np.array([x for term in terms for x in term.cubics], dtype=float).reshape(-1, 4),
        stack=np.zeros((MOST_DEPTH, 3)),
    )
    if all(term.kind == _CONSTANT for term in terms):
        return table
    return replace(table, evaluate_term=address_of(_evaluate_term, table, 0, 0.0))


@kernel
def signal_value(s: SignalTable, k: int, t: float) -> float:
    """Value of signal k at time t [s]."""
    total = 0.0
    for term in range(s.first_term[k], s.first_term[k + 1]):
        if s.kind[term] == _CONSTANT:
            total += s.numbers[s.first_number[term]]
        elif s.support[term, 0] <= t <= s.support[term, 1]:
            call(s.evaluate_term, (s, term, float(t)))
            total += s.stack[0, 0]
    return total


@kernel
def evaluate_signal(s: SignalTable, k: int, t: float, out: Array) -> None:
    """Value, first and second time derivative of signal k at time t [s], into out (3,)."""
    out[0], out[1], out[2] = 0.0, 0.0, 0.0
    for term in range(s.first_term[k], s.first_term[k + 1]):
        if s.kind[term] == _CONSTANT:
            out[0] += s.numbers[s.first_number[term]]
        elif s.support[term, 0] <= t <= s.support[term, 1]:
            call(s.evaluate_term, (s, term, float(t)))
            for i in range(3):
                out[i] += s.stack[0, i]


@addressed
def _evaluate_term(s: SignalTable, term: int, t: float) -> None:
    """Leave a term's value and derivatives on the bottom of the stack."""
    if s.kind[term] == _PROGRAM:
        _run(s, term, t)
        return
    first, last, knots = s.first_knot[term], s.first_knot[term + 1] - 1, s.knots
    bottom = s.stack[0]
    if t < knots[first]:
        bottom[0], bottom[1], bottom[2] = s.cubics[first, 0], 0.0, 0.0
        return
    while last - first > 1:  # the last knot that is not after t
        middle = (first + last) // 2
        if knots[middle] <= t:
            first = middle
        else:
            last = middle
    if knots[last] <= t:
        first = last
    x, c = t - knots[first], s.cubics[first]
    bottom[0] = c[0] + x * (c[1] + x * (c[2] + x * c[3]))
    bottom[1] = c[1] + x * (2.0 * c[2] + 3.0 * x * c[3])
    bottom[2] = 2.0 * c[2] + 6.0 * x * c[3]


@inner
def _run(s: SignalTable, term: int, t: float) -> None:
    """Run a postfix program on (f, f', f'')."""
    top, number = -1, s.first_number[term]
    for at in range(s.first_code[term], s.first_code[term + 1]):
        op = s.codes[at]
        if op == _NUMBER:
            top += 1
            s.stack[top, 0], s.stack[top, 1], s.stack[top, 2] = s.numbers[number], 0.0, 0.0
            number += 1
        elif op == _TIME:
            top += 1
            s.stack[top, 0], s.stack[top, 1], s.stack[top, 2] = t, 1.0, 0.0
        elif op == _NEGATE or _SIN <= op <= _ABS:
            _apply_function(op, s.stack[top])
        elif op >= _BEFORE:  # what holds later, what holds before, and the time of the switch
            switch = s.stack[top, 0]
            top -= 2
            if (t < switch) if op == _BEFORE else (t <= switch):
                for i in range(3):
                    s.stack[top, i] = s.stack[top + 1, i]
        else:
            top -= 1
            _combine(op, s.stack[top], s.stack[top + 1])


@inner
def _apply_function(op: int, a: Array) -> None:
    """``a = f(a)`` with f' = f₁ a' and f'' = f₂ a'² + f₁ a''; of what stands still, 0 even where f₁ isn't finite."""
    x = a[0]
    if op == _NEGATE:
        f, f1, f2 = -x, -1.0, 0.0
    elif op == _SIN:
        f, f1 = math.sin(x), math.cos(x)
        f2 = -f
    elif op == _COS:
        f, f1 = math.cos(x), -math.sin(x)
        f2 = -f
    elif op == _TAN:
        f = math.tan(x)
        f1 = 1.0 + f * f
        f2 = 2.0 * f * f1
    elif op == _EXP:
        f = math.exp(x)
        f1, f2 = f, f
    elif op == _LOG:
        f = math.log(x) if x > 0.0 else math.nan
        f1, f2 = 1.0 / x, -1.0 / (x * x)
    elif op == _SQRT:
        f = math.sqrt(x) if x >= 0.0 else math.nan
        f1, f2 = 0.5 / f, -0.25 / (f * x)
    elif op == _TANH:
        f = math.tanh(x)
        f1 = 1.0 - f * f
        f2 = -2.0 * f * f1
    else:
        f, f1, f2 = abs(x), 1.0 if x >= 0.0 else -1.0, 0.0
    a[0] = f
    if a[1] != 0.0 or a[2] != 0.0:  # the root of max(t - 1, 0) stands still before t = 1
        a[2] = f2 * a[1] * a[1] + f1 * a[2]
        a[1] *= f1


@inner
def _combine(op: int, a: Array, b: Array) -> None:
    """``a = a op b``."""
    if op in (_ADD, _SUBTRACT):
        sign = 1.0 if op == _ADD else -1.0
        for i in range(3):
            a[i] += sign * b[i]
    elif op == _MULTIPLY:
        a[2] = a[2] * b[0] + 2.0 * a[1] * b[1] + a[0] * b[2]
        a[1] = a[1] * b[0] + a[0] * b[1]
        a[0] *= b[0]
    elif op == _DIVIDE:
        a[0] /= b[0]
        a[1] = (a[1] - a[0] * b[1]) / b[0]
        a[2] = (a[2] - 2.0 * a[1] * b[1] - a[0] * b[2]) / b[0]
    elif op == _POWER:
        _raise(a, b)
    elif math.isnan(b[0]) or ((b[0] < a[0]) if op == _MINIMUM else (b[0] > a[0])):
        for i in range(3):
            a[i] = b[i]


@inner
def _raise(a: Array, b: Array) -> None:
    """``a = a ** b``; a constant exponent needs no logarithm, so the base may be 0 or negative."""
    x, n = a[0], b[0]
    if b[1] == 0.0 and b[2] == 0.0:
        a[0] = x**n
        if a[1] != 0.0 or a[2] != 0.0:
            f1 = n * x ** (n - 1.0) if n != 0.0 else 0.0
            f2 = n * (n - 1.0) * x ** (n - 2.0) if n not in (0.0, 1.0) else 0.0
            a[2] = f2 * a[1] * a[1] + f1 * a[2]
            a[1] *= f1
        return
    log = math.log(x) if x > 0.0 else math.nan
    slope = b[1] * log + n * a[1] / x
    bend = b[2] * log + 2.0 * b[1] * a[1] / x + n * (a[2] / x - (a[1] / x) ** 2)
    a[0] = x**n
    a[2] = a[0] * (slope * slope + bend)
    a[1] = a[0] * slope

"""Bounds of a signal over intervals of time: where it acts and how fast it varies, known before a march.

A term's program is run on truncated Taylor series whose coefficients are intervals, many pieces of time at once (Moore,
Kearfott & Cloud, Introduction to Interval Analysis, SIAM, 2009, ch. 9). Rounding isn't directed outwards: bounds are
compared with parts of the signal far above round-off.
"""

import math
from collections.abc import Callable

import numpy as np

from fmd.core import formula as codes
from fmd.core.arrays import Array, BoolArray

Series = list[Array]
"""Bounds of Taylor coefficients f, f', f''/2, …, each of shape (2, n_pieces): lower and upper ones."""


class PieceBounds:
    """Interval arithmetic on Taylor series of ``n_terms`` over pieces of time (n_pieces,), between their ends [s].

    In those that are ``rough`` (n_pieces,), abs, min, max or a condition may change its branch.
    """

    def __init__(self, begin: Array, end: Array, n_terms: int) -> None:
        self.t, self.n_terms = np.stack([begin, end]), n_terms
        self.rough = np.zeros(len(begin), dtype=bool)

    def constant(self, value: float) -> Series:
        """Return the series of a constant."""
        first = np.full(self.t.shape, value)
        return [first, *(np.zeros_like(first) for _ in range(self.n_terms - 1))]

    def time(self) -> Series:
        """Return the series of the time itself."""
        series = self.constant(0.0)
        series[0] = self.t.copy()
        if self.n_terms > 1:
            series[1] = np.ones_like(self.t)
        return series

    def run_program(self, program: tuple[int, ...], numbers: tuple[float, ...]) -> Series:
        """Run a postfix program of `fmd.core.formula` and return the series of its value."""
        stack: list[Series] = []
        values = iter(numbers)
        for code in program:
            if code == codes.CONSTANT:
                stack.append(self.constant(next(values)))
            elif code == codes.TIME:
                stack.append(self.time())
            elif code in _UNARY:
                stack.append(_UNARY[code](stack.pop()))
            elif code == codes.ABS:
                a = stack.pop()
                stack.append(self._greater(a, _negated(a)))
            elif code in (codes.BEFORE, codes.UNTIL):
                switch, first, second = stack.pop(), stack.pop(), stack.pop()
                stack.append(self._chosen(first, second, self.t[1] <= switch[0][0], self.t[0] >= switch[0][0]))
            else:
                b, a = stack.pop(), stack.pop()
                stack.append(self._combined(code, a, b))
        return stack[0]

    def cubic(self, coefficients: Array, knots: Array) -> Series:
        """Return the series of cubics, one for each piece, in the time from its knot on; coefficients (n_pieces, 4)."""
        x, series = self.time(), self.constant(0.0)
        x[0] = x[0] - knots
        for k in range(3, -1, -1):
            series = _product(series, x)
            series[0] = series[0] + coefficients[:, k]
        return series

    def _combined(self, code: int, a: Series, b: Series) -> Series:
        if code == codes.ADD:
            return _sum(a, b)
        if code == codes.SUBTRACT:
            return _sum(a, _negated(b))
        if code == codes.MULTIPLY:
            return _product(a, b)
        if code == codes.DIVIDE:
            return _quotient(a, b)
        if code == codes.POWER:
            return self._power(a, b)
        if code == codes.MAXIMUM:
            return self._greater(a, b)
        return _negated(self._greater(_negated(a), _negated(b)))

    def _greater(self, a: Series, b: Series) -> Series:
        chosen = self._chosen(a, b, a[0][0] >= b[0][1], b[0][0] >= a[0][1])
        chosen[0] = np.maximum(a[0], b[0])
        return chosen

    def _chosen(self, a: Series, b: Series, is_a: BoolArray, is_b: BoolArray) -> Series:
        """Return a, b or the hull of both, where neither is certain; such pieces are rough."""
        self.rough |= ~(is_a | is_b)
        hulls = [np.stack([np.minimum(x[0], y[0]), np.maximum(x[1], y[1])]) for x, y in zip(a, b, strict=True)]
        return [np.where(is_a, x, np.where(is_b, y, h)) for x, y, h in zip(a, b, hulls, strict=True)]

    def _power(self, a: Series, b: Series) -> Series:
        exponent = float(b[0][0, 0]) if b[0].size else 0.0
        fixed = bool((b[0] == exponent).all()) and not any(x.any() for x in b[1:])
        if not (fixed and exponent.is_integer() and abs(exponent) <= 64):
            return _exp(_product(b, _log(a)))
        n = abs(int(exponent))
        power, square = self.constant(1.0), a
        for bit in range(n.bit_length()):
            power = _product(power, square) if n >> bit & 1 else power
            square = _product(square, square)
        ends = a[0] ** n
        power[0] = np.stack([ends.min(axis=0), ends.max(axis=0)])
        if n and n % 2 == 0:
            power[0][0] = np.where((a[0][0] <= 0.0) & (a[0][1] >= 0.0), 0.0, power[0][0])
        return power if exponent >= 0.0 else _quotient(self.constant(1.0), power)


def _clean(x: Array) -> Array:
    """Return bounds with −∞ and ∞ in place of what isn't a number."""
    bad = np.isnan(x).any(axis=0)
    return np.where(bad, np.array([[-math.inf], [math.inf]]), x) if bad.any() else x


def _times(a: Array, b: Array) -> Array:
    """Multiply intervals; 0 times infinity is 0."""
    products = np.stack([a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]])
    products[np.isnan(products)] = 0.0
    return np.stack([products.min(axis=0), products.max(axis=0)])


def _divided(a: Array, b: Array) -> Array:
    """Divide intervals; by one that holds 0 the quotient is unbounded."""
    holds_zero = (b[0] <= 0.0) & (b[1] >= 0.0)
    inverse = 1.0 / np.where(holds_zero, 1.0, b)[::-1]
    return np.where(holds_zero, np.array([[-math.inf], [math.inf]]), _times(a, inverse))


def _negated(a: Series) -> Series:
    return [-x[::-1] for x in a]


def _sum(a: Series, b: Series) -> Series:
    return [_clean(x + y) for x, y in zip(a, b, strict=True)]


def _convolved(a: Series, b: Series, k: int, first: int = 0, weighted: bool = False) -> Array:
    """Return ``Σ a_j b_{k−j}`` from j = first on; weighted, each by j."""
    total = np.zeros_like(a[0])
    for j in range(first, k + 1):
        total = _clean(total + (j if weighted else 1) * _times(a[j], b[k - j]))
    return total


def _product(a: Series, b: Series) -> Series:
    return [_convolved(a, b, k) for k in range(len(a))]


def _quotient(a: Series, b: Series) -> Series:
    out: Series = []
    for k, x in enumerate(a):
        out.append(np.zeros_like(x))
        rest = _convolved(b, out, k, first=1)
        out[k] = _divided(_clean(x - rest[::-1]), b[0])
    return out


def _grown(value: Array, a: Series, rate: Callable[[Series], Series]) -> Series:
    """Return the series of f(a) whose derivative is ``rate(f) a'``, from the range of its value."""
    out = [value]
    for k in range(1, len(a)):
        out.append(_convolved(a, rate(out), k, first=1, weighted=True) / k)
    return out


def _exp(a: Series) -> Series:
    return _grown(np.exp(a[0]), a, lambda out: out)


def _sine_and_cosine(a: Series) -> tuple[Series, Series]:
    sine, cosine = [_sine_range(a[0])], [_sine_range(a[0] + 0.5 * math.pi)]
    for k in range(1, len(a)):
        up = _convolved(a, cosine, k, first=1, weighted=True) / k
        down = _convolved(a, sine, k, first=1, weighted=True) / k
        sine.append(up)
        cosine.append(-down[::-1])
    return sine, cosine


def _sine_range(x: Array) -> Array:
    ends = np.sin(x)
    turns = (x - 0.5 * math.pi) / (2 * math.pi), (x + 0.5 * math.pi) / (2 * math.pi)
    top, bottom = (np.floor(turn[1]) >= np.ceil(turn[0]) for turn in turns)
    lower, upper = np.where(bottom, -1.0, ends.min(axis=0)), np.where(top, 1.0, ends.max(axis=0))
    endless = ~np.isfinite(x).all(axis=0)
    return np.stack([np.where(endless, -1.0, lower), np.where(endless, 1.0, upper)])


def _tanh(a: Series) -> Series:
    def rate(out: Series) -> Series:
        square = [-x[::-1] for x in _product(out, out)]
        ends = out[0] ** 2
        least = np.where((out[0][0] <= 0.0) & (out[0][1] >= 0.0), 0.0, ends.min(axis=0))
        square[0] = np.stack([1.0 - ends.max(axis=0), 1.0 - least])
        return square

    return _grown(np.tanh(a[0]), a, rate)


def _log(a: Series) -> Series:
    out = [_clean(np.log(np.maximum(a[0], 0.0)))]
    for k in range(1, len(a)):
        rest = _convolved([*out, np.zeros_like(a[0])], a, k, first=1, weighted=True)
        out.append(_divided(_clean(a[k] - rest[::-1] / k), a[0]))
    return out


def _sqrt(a: Series) -> Series:
    out = [np.sqrt(np.maximum(a[0], 0.0))]
    for k in range(1, len(a)):
        rest = sum((_times(out[j], out[k - j]) for j in range(1, k)), np.zeros_like(a[0]))
        out.append(_divided(_clean(a[k] - rest[::-1]), 2.0 * out[0]))
    return out


_UNARY: dict[int, Callable[[Series], Series]] = {
    codes.NEGATE: _negated,
    codes.SIN: lambda a: _sine_and_cosine(a)[0],
    codes.COS: lambda a: _sine_and_cosine(a)[1],
    codes.TAN: lambda a: _quotient(*_sine_and_cosine(a)),
    codes.EXP: _exp,
    codes.LOG: _log,
    codes.SQRT: _sqrt,
    codes.TANH: _tanh,
}

"""Value and first two derivatives of a signal's terms at many times, by NumPy on truncated Taylor series."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fmd.core import formula as codes
from fmd.core.arrays import Array

Series = Array
"""Value, first and second derivative at each time, shape (3, n_times)."""


def run_program(program: tuple[int, ...], numbers: tuple[float, ...], t: Array) -> Series:
    """Run a postfix program of `fmd.core.formula` at times t (n_times,)."""
    stack: list[Series] = []
    values = iter(numbers)
    for code in program:
        if code == codes.CONSTANT:
            stack.append(_series(np.full_like(t, next(values))))
        elif code == codes.TIME:
            stack.append(_series(t, 1.0))
        elif code in _FUNCTIONS:
            stack.append(_chain(stack.pop(), _FUNCTIONS[code]))
        elif code in (codes.BEFORE, codes.UNTIL):
            switch, before, after = stack.pop()[0], stack.pop(), stack.pop()
            stack.append(np.where(t < switch if code == codes.BEFORE else t <= switch, before, after))
        else:
            b, a = stack.pop(), stack.pop()
            stack.append(_OPERATIONS[code](a, b))
    return stack.pop()


def run_table(knots: Array, cubics: Array, t: Array) -> Series:
    """Evaluate pieces of cubics (n_knots, 4) from knots (n_knots,) on; the first value holds before the first knot."""
    piece = np.searchsorted(knots, t, side="right") - 1
    c = cubics[np.maximum(piece, 0)].T
    x = t - knots[np.maximum(piece, 0)]
    out = np.stack(
        [
            c[0] + x * (c[1] + x * (c[2] + x * c[3])),
            c[1] + x * (2.0 * c[2] + 3.0 * x * c[3]),
            2.0 * c[2] + 6.0 * x * c[3],
        ]
    )
    return np.where(piece < 0, _series(np.full_like(t, cubics[0, 0])), out)


def _series(values: Array, rate: float = 0.0) -> Series:
    return np.stack([values, np.full_like(values, rate), np.zeros_like(values)])


def _chain(a: Series, function: Callable[[Array], tuple[Array, Array, Array]]) -> Series:
    """Apply f: f' = f₁ a' and f'' = f₂ a'² + f₁ a''; of what stands still, 0 even where f₁ isn't finite."""
    f, f1, f2 = function(a[0])
    moves = (a[1] != 0.0) | (a[2] != 0.0)
    return np.stack([f, np.where(moves, f1 * a[1], a[1]), np.where(moves, f2 * a[1] * a[1] + f1 * a[2], a[2])])


def _tangent(x: Array) -> tuple[Array, Array, Array]:
    f = np.tan(x)
    return f, 1.0 + f * f, 2.0 * f * (1.0 + f * f)


def _hyperbolic_tangent(x: Array) -> tuple[Array, Array, Array]:
    f = np.tanh(x)
    return f, 1.0 - f * f, -2.0 * f * (1.0 - f * f)


def _root(x: Array) -> tuple[Array, Array, Array]:
    f = np.sqrt(x)
    return f, 0.5 / f, -0.25 / (f * x)


def _logarithm(x: Array) -> tuple[Array, Array, Array]:
    return np.where(x > 0.0, np.log(x), np.nan), 1.0 / x, -1.0 / (x * x)


def _multiply(a: Series, b: Series) -> Series:
    return np.stack([a[0] * b[0], a[1] * b[0] + a[0] * b[1], a[2] * b[0] + 2.0 * a[1] * b[1] + a[0] * b[2]])


def _divide(a: Series, b: Series) -> Series:
    value = a[0] / b[0]
    rate = (a[1] - value * b[1]) / b[0]
    return np.stack([value, rate, (a[2] - 2.0 * rate * b[1] - value * b[2]) / b[0]])


def _raise(a: Series, b: Series) -> Series:
    """Raise to a power; a constant exponent needs no logarithm, so that the base may be 0 or negative."""
    x, n = a[0], b[0]
    value = x**n

    def power(base: Array) -> tuple[Array, Array, Array]:
        slope = np.where(n != 0.0, n * base ** (n - 1.0), 0.0)
        return value, slope, np.where((n == 0.0) | (n == 1.0), 0.0, n * (n - 1.0) * base ** (n - 2.0))

    log = np.where(x > 0.0, np.log(x), np.nan)
    slope = b[1] * log + n * a[1] / x
    bend = b[2] * log + 2.0 * b[1] * a[1] / x + n * (a[2] / x - (a[1] / x) ** 2)
    varying = np.stack([value, value * slope, value * (slope * slope + bend)])
    return np.where((b[1] == 0.0) & (b[2] == 0.0), _chain(a, power), varying)


def _choose(second: Callable[[Array, Array], NDArray[np.bool_]]) -> Callable[[Series, Series], Series]:
    return lambda a, b: np.where(np.isnan(b[0]) | second(a[0], b[0]), b, a)


_FUNCTIONS: dict[int, Callable[[Array], tuple[Array, Array, Array]]] = {
    codes.NEGATE: lambda x: (-x, np.full_like(x, -1.0), np.zeros_like(x)),
    codes.SIN: lambda x: (np.sin(x), np.cos(x), -np.sin(x)),
    codes.COS: lambda x: (np.cos(x), -np.sin(x), -np.cos(x)),
    codes.TAN: _tangent,
    codes.EXP: lambda x: (np.exp(x), np.exp(x), np.exp(x)),
    codes.LOG: _logarithm,
    codes.SQRT: _root,
    codes.TANH: _hyperbolic_tangent,
    codes.ABS: lambda x: (np.abs(x), np.where(x >= 0.0, 1.0, -1.0), np.zeros_like(x)),
}
_OPERATIONS: dict[int, Callable[[Series, Series], Series]] = {
    codes.ADD: lambda a, b: a + b,
    codes.SUBTRACT: lambda a, b: a - b,
    codes.MULTIPLY: _multiply,
    codes.DIVIDE: _divide,
    codes.POWER: _raise,
    codes.MINIMUM: _choose(lambda a, b: b < a),
    codes.MAXIMUM: _choose(lambda a, b: b > a),
}

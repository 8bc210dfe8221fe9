"""Cubic splines through points; SciPy's would take longer to load than most scenes to read."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from fmd.core.arrays import Array

Ends = Literal["clamped", "natural", "periodic"]
"""How a spline ends: with slope 0, straight, or as it begins."""


def spline_pieces(x: Sequence[float] | Array, y: Sequence[float] | Array, ends: Ends) -> Array:
    """Return the cubics between n points of ascending x, rows ``a + b h + c h² + d h³`` of a step h, (n - 1, 4).

    Slopes s at the points make second derivatives continuous (de Boor, A Practical Guide to Splines, 1978, chapter 4)::

        h₁ s₀ + 2 (h₀ + h₁) s₁ + h₀ s₂ = 3 (h₁ d₀ + h₀ d₁)        d = Δy/h
    """
    h, y = np.diff(x), np.asarray(y, dtype=float)
    d = np.diff(y) / h
    right = np.zeros(len(y))
    right[1:-1] = 3.0 * (h[1:] * d[:-1] + h[:-1] * d[1:])
    if ends == "natural":
        right[[0, -1]] = 3.0 * d[[0, -1]]
        slopes = _solve(h, right, (2.0, 1.0))
    else:
        slopes = _solve(h, right, (1.0, 0.0))
    if ends == "periodic":
        right[:] = 0.0
        right[[0, -1]] = 1.0
        both = slopes, _solve(h, right, (1.0, 0.0))  # with slope 0 at both ends, and what slope 1 there adds
        rest, factor = (h[-1] * own[1] + h[0] * own[-2] + 2.0 * (h[0] + h[-1]) * own[0] for own in both)
        slopes = slopes + (3.0 * (h[0] * d[-1] + h[-1] * d[0]) - rest) / factor * both[1]
    bend = (slopes[:-1] + slopes[1:] - 2.0 * d) / h
    return np.column_stack([y[:-1], slopes[:-1], (d - slopes[:-1]) / h - bend, bend / h])


def _solve(h: Array, right: Array, ends: tuple[float, float]) -> Array:
    """Solve for slopes (n,) by elimination; equations at both ends have factors of their own slope and the next."""
    own, beside = ends
    lower, upper = [*h[1:].tolist(), beside], [beside, *h[:-1].tolist()]
    diagonal, found = [own, *(2.0 * (h[:-1] + h[1:])).tolist(), own], right.tolist()
    for k, (below, above) in enumerate(zip(lower, upper, strict=True), start=1):
        factor = below / diagonal[k - 1]
        diagonal[k] -= factor * above
        found[k] -= factor * found[k - 1]
    found[-1] /= diagonal[-1]
    for k in range(len(upper) - 1, -1, -1):
        found[k] = (found[k] - upper[k] * found[k + 1]) / diagonal[k]
    return np.array(found)

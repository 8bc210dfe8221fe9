"""Stumpff functions, by which a rotation vector's rotation and rate are free of divisions by its length.

``c_k(x) = 1/k! − x/(k+2)! + x²/(k+4)! − …``, so that for a rotation by θ with x = |θ|²: c₀ = cos|θ|, c₁ = sin|θ|/|θ|,
``c_k = 1/k! − x c_{k+2}`` and ``dc_k/dx = (k c_{k+2} − c_{k+1})/2`` (Stiefel & Scheifele, Linear and Regular Celestial
Mechanics, Springer, 1971, section 11).
"""

from __future__ import annotations

import math

import numpy as np

from fmd.core.arrays import Array

FIRST, LAST = 4, 9
"""The functions that graphs use: c₄ and c₅, and those that their first and second derivatives bring in."""

LIMIT = 4.0
"""The series serves up to this x, to round-off; beyond it sine and cosine do, from which nothing cancels there."""

_TERMS = 11


def coefficients(k: int) -> tuple[float, ...]:
    """Coefficients of the series of c_k, lowest power first."""
    return tuple((-1) ** j / math.factorial(k + 2 * j) for j in range(_TERMS))


def stumpff(k: int, x: Array | float) -> Array:
    """Return c_k(x) for x not below 0."""
    near = np.polynomial.polynomial.polyval(np.minimum(x, LIMIT), coefficients(k))
    if np.all(np.less(x, LIMIT)):
        return np.asarray(near)
    far = np.maximum(x, LIMIT)
    root = np.sqrt(far)
    value = np.sin(root) / root if k % 2 else np.cos(root)
    for j in range(k % 2, k, 2):
        value = (1.0 / math.factorial(j) - value) / far
    return np.where(np.less(x, LIMIT), near, value)

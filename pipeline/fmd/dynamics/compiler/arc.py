"""A rotation's vector from its matrix, without a division by its angle.

For a rotation by θ with ``y = sin²(θ/2) = (3 − tr R)/4`` its vector is ``arc₀(y) s`` with ``s = sin θ n`` the axial
vector of R, where

    arc₀(y) = θ/sin θ = arcsin √y / √(y (1 − y)) = Σ (2ⁿ n!)²/(2n + 1)! yⁿ        arc_k = dᵏ arc₀/dyᵏ

and ``2 y (1 − y) arc_{k+1} + (2k + 1)(1 − 2y) arc_k = 2 k² arc_{k−1}``, or 1 for k = 0. All are smooth up to half a
turn, y = 1. The rate of the vector for an angular velocity ω in the axes before the turn is ``A⁻¹ ω`` with
``A⁻¹ = 1 − ½ θ̃ + h s̃²`` and ``h = ½ arc₁ − ¼ arc₀/(1 − y)``.

References
----------
Abramowitz & Stegun, Handbook of Mathematical Functions, 1964, 15.1.6: arc₀ is ₂F₁(1, 1; 3/2; y).
"""

from __future__ import annotations

import math

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.writer import Writer, literal

LAST = 3
"""The last derivative: forces take arc₁, their derivatives and those of these two more."""

LIMIT = 0.2
"""The series serves up to this y, the closed form and the recurrence beyond it."""

_TERMS = 28


def coefficients(k: int) -> tuple[float, ...]:
    """Coefficients of the series of arc_k, lowest power first."""
    own = [2**n * math.factorial(n) / math.prod(range(1, 2 * n + 2, 2)) for n in range(_TERMS + k)]  # (2ⁿ n!)²/(2n+1)!
    return tuple(own[n + k] * math.factorial(n + k) / math.factorial(n) for n in range(_TERMS))


def arc(k: int, y: Array | float) -> Array:
    """Return arc_k(y) for y below 1; not a number from there on."""
    near = np.polynomial.polynomial.polyval(np.minimum(y, LIMIT), coefficients(k))
    if np.all(np.less(y, LIMIT)):
        return np.asarray(near)
    y = np.asarray(y)
    far = np.where(y < 1.0, np.maximum(y, LIMIT), np.nan)
    product = far * (1.0 - far)
    values = [np.arcsin(np.sqrt(far)) / np.sqrt(product)]
    for j in range(k):
        rest = 2.0 * j * j * values[j - 1] if j else 1.0
        values.append((rest - (2 * j + 1) * (1.0 - 2.0 * far) * values[j]) / (2.0 * product))
    return np.where(y < LIMIT, near, values[k])


def arc_function(k: int, name: str) -> str:
    """Write arc_k as a function of LLVM's language."""
    out = Writer()
    near = out.polynomial("%x", coefficients(k))
    far = Writer("far")
    rest = far.value(f"fsub double {literal(1.0)}, %x")
    product = far.value(f"fmul double %x, {rest}")
    root = far.value("call double @llvm.sqrt.f64(double %x)")
    angle = far.value(f"call double @asin(double {root})")
    values = [far.value(f"fdiv double {angle}, {far.value(f'call double @llvm.sqrt.f64(double {product})')}")]
    twice = far.value(f"fmul double {product}, {literal(2.0)}")
    slope = far.value(f"fsub double {rest}, %x")
    for j in range(k):
        known = far.value(f"fmul double {values[j - 1]}, {literal(2.0 * j * j)}") if j else literal(1.0)
        factor = far.value(f"fmul double {slope}, {literal(2.0 * j + 1.0)}")
        own = far.value(f"fsub double {known}, {far.value(f'fmul double {factor}, {values[j]}')}")
        values.append(far.value(f"fdiv double {own}, {twice}"))
    lines = [
        f"define internal double @{name}(double %x) noinline nounwind {{",
        f"%small = fcmp olt double %x, {literal(LIMIT)}",
        "br i1 %small, label %near, label %far",
        "near:",
        *out.lines,
        f"ret double {near}",
        "far:",
        *far.lines,
        f"ret double {values[k]}",
        "}",
    ]
    return "\n".join(lines)

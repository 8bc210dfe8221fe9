"""Functions of one scalar that a graph may apply: their values and their machine code.

Beside sine and cosine there are square root, exponential, logarithm and hyperbolic tangent; ``floor``, the whole number
below; ``positive`` x, which is x above 0 and else 0, and ``step``, its slope. ``far_sin`` and ``far_cos`` are those of
angles however large, others' are up to 1e9. Two families have a series near 0, up to `SERIES_LIMITS`, and a closed form
beyond it:

- the Stumpff functions ``c_k(x) = 1/k! − x/(k+2)! + x²/(k+4)! − …``, by which a rotation vector's rotation and rate are
  free of divisions by its length: with x = |θ|², c₀ = cos|θ|, c₁ = sin|θ|/|θ|, ``c_k = 1/k! − x c_{k+2}`` and
  ``dc_k/dx = (k c_{k+2} − c_{k+1})/2``;
- ``arc_k``, by which a rotation's vector follows from its matrix without a division by its angle: with
  ``y = sin²(θ/2) = (3 − tr R)/4`` the vector is ``arc₀(y) s`` with ``s = sin θ n`` the axial vector of R, where

      arc₀(y) = θ/sin θ = arcsin √y / √(y (1 − y)) = Σ (2ⁿ n!)²/(2n + 1)! yⁿ        arc_k = dᵏ arc₀/dyᵏ

  and ``2 y (1 − y) arc_{k+1} + (2k + 1)(1 − 2y) arc_k = 2 k² arc_{k−1}``, or 1 for k = 0. All are smooth up to half a
  turn, y = 1. The rate of the vector for an angular velocity ω in the axes before the turn is ``A⁻¹ ω`` with
  ``A⁻¹ = 1 − ½ θ̃ + h s̃²`` and ``h = ½ arc₁ − ¼ arc₀/(1 − y)``.

References
----------
Stiefel & Scheifele, Linear and Regular Celestial Mechanics, Springer, 1971, section 11.
Abramowitz & Stegun, Handbook of Mathematical Functions, 1964, 15.1.6: arc₀ is ₂F₁(1, 1; 3/2; y).
"""

import math
from collections.abc import Callable

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.code import FAR_ANGLE
from fmd.dynamics.compiler.writer import Writer, literal, literals, type_of

FIRST_STUMPFF, LAST_STUMPFF, LAST_ARC = 4, 9, 3
"""Graphs use c₄, c₅ and arc₁; the others are what their first and second derivatives bring in."""

SERIES_LIMITS = {"stumpff": 4.0, "arc": 0.2}
"""A family's series serves up to these, to round-off; beyond them its closed form does, from which nothing cancels."""

STUMPFF = tuple(f"stumpff{k}" for k in range(FIRST_STUMPFF, LAST_STUMPFF + 1))
ARC = tuple(f"arc{k}" for k in range(LAST_ARC + 1))
_LIBRARY = ("exp", "log", "tanh", "floor", "asin", "sin", "cos")
_SIMPLE = ("sqrt", "exp", "log", "tanh", "floor", "positive", "step", "far_sin", "far_cos")
FUNCTIONS = ("sin", "cos", *STUMPFF, *ARC, *_SIMPLE)
"""Functions of one scalar that a node may apply."""

CHOICES: dict[str, Callable[..., Array]] = {
    "power": np.power,
    "below": lambda a, b: np.where(np.less(a, b) | np.isnan(a), 1.0, 0.0),
    "select": lambda c, a, b: np.asarray(np.where(np.greater(c, 0.0), a, b), dtype=float),
    "moving": lambda slope, rate: np.where(np.equal(rate, 0.0), 0.0, slope * rate),
}
"""Functions of several scalars that a node may apply, beside sums and products.

``power`` a to the b; ``below``, which is 1 where a is below b or no number, else 0; ``select``, which is a where c is
above 0, else b; ``moving``, a slope times a rate, but 0 for what stands still, whatever the slope.
"""

DECLARATIONS = (*(f"declare double @{name}(double)" for name in _LIBRARY), "declare double @pow(double, double)")
"""Functions of the C library that the code of `FUNCTIONS` calls."""


def series_of(function: str) -> tuple[int, float, tuple[float, ...]]:
    """Return k of one of `STUMPFF` or `ARC`, where its series ends, and the coefficients, lowest power first."""
    if function in STUMPFF:
        k = int(function.removeprefix("stumpff"))
        return k, SERIES_LIMITS["stumpff"], tuple((-1) ** j / math.factorial(k + 2 * j) for j in range(11))
    k, count = int(function.removeprefix("arc")), 28
    own = [2**n * math.factorial(n) / math.prod(range(1, 2 * n + 2, 2)) for n in range(count + k)]  # (2ⁿ n!)²/(2n+1)!
    slopes = (own[n + k] * math.factorial(n + k) / math.factorial(n) for n in range(count))
    return k, SERIES_LIMITS["arc"], tuple(slopes)


def evaluate_function(function: str, x: Array | float) -> Array:
    """Return the values of one of `FUNCTIONS`; not a number where it has none."""
    if function in (*STUMPFF, *ARC):
        k, limit, coefficients = series_of(function)
        near = np.polynomial.polynomial.polyval(np.minimum(x, limit), coefficients)
        if np.all(np.less(x, limit)):
            return np.asarray(near)
        return np.where(np.less(x, limit), near, (_far_stumpff if function in STUMPFF else _far_arc)(k, x, limit))
    if function in ("positive", "step"):
        return np.where(np.greater(x, 0.0), x if function == "positive" else 1.0, 0.0)
    with np.errstate(all="ignore"):
        return np.asarray(getattr(np, function.removeprefix("far_"))(x))


def _far_stumpff(k: int, x: Array | float, limit: float) -> Array:
    far = np.maximum(x, limit)
    root = np.sqrt(far)
    value = np.sin(root) / root if k % 2 else np.cos(root)
    for j in range(k % 2, k, 2):
        value = (1.0 / math.factorial(j) - value) / far
    return np.asarray(value)


def _far_arc(k: int, y: Array | float, limit: float) -> Array:
    far = np.where(np.less(y, 1.0), np.maximum(y, limit), np.nan)
    product = far * (1.0 - far)
    values = [np.arcsin(np.sqrt(far)) / np.sqrt(product)]
    for j in range(k):
        rest = 2.0 * j * j * values[j - 1] if j else 1.0
        values.append((rest - (2 * j + 1) * (1.0 - 2.0 * far) * values[j]) / (2.0 * product))
    return np.asarray(values[k])


def function_code(function: str) -> str:
    """Write one of `FUNCTIONS`, but for sine and cosine, as a function of LLVM's language, ``@of_NAME``.

    Beside those there are ``power``; ``turn``, which writes sine and cosine of any angle to two places; and ``piece``,
    which finds the last of ascending numbers that a scalar isn't below, or the first.
    """
    if function in _OF_OTHERS:
        return _OF_OTHERS[function]()
    if function in (*STUMPFF, *ARC):
        return _branched_function(function)
    out = Writer()
    if function in ("positive", "step"):
        above = out.value(f"fcmp ogt double %x, {literal(0.0)}")
        then = "%x" if function == "positive" else literal(1.0)
        value = out.value(f"select i1 {above}, double {then}, double {literal(0.0)}")
    elif function in ("far_sin", "far_cos"):
        value = out.sine_or_cosine_far("%x")[function == "far_cos"]
    elif function == "sqrt":
        value = out.value("call double @llvm.sqrt.f64(double %x)")
    else:
        value = out.value(f"call double @{function}(double %x)")
    body = [f"define internal double @of_{function}(double %x) nounwind {{", *out.lines, f"ret double {value}", "}"]
    return "\n".join(body)


def _power_function() -> str:
    body = ["%z = call double @pow(double %x, double %y)", "ret double %z", "}"]
    return "\n".join(["define internal double @of_power(double %x, double %y) nounwind {", *body])


def _branched_function(function: str) -> str:
    """Write a function by its series, or by its closed form; its own, for the branch."""
    k, limit, coefficients = series_of(function)
    near, far = Writer(), Writer("far")
    series = near.polynomial("%x", coefficients)
    value = (_write_far_stumpff if function in STUMPFF else _write_far_arc)(far, k)
    lines = [
        f"define internal double @of_{function}(double %x) noinline nounwind {{",
        f"%small = fcmp olt double %x, {literal(limit)}",
        "br i1 %small, label %near, label %far",
        "near:",
        *near.lines,
        f"ret double {series}",
        "far:",
        *far.lines,
        f"ret double {value}",
        "}",
    ]
    return "\n".join(lines)


def _write_far_stumpff(far: Writer, k: int) -> str:
    root = far.value("call double @llvm.sqrt.f64(double %x)")
    sine, cosine = far.sine_and_cosine(root)
    value = far.value(f"fdiv double {sine}, {root}") if k % 2 else cosine
    for j in range(k % 2, k, 2):
        rest = far.value(f"fsub double {literal(1.0 / math.factorial(j))}, {value}")
        value = far.value(f"fdiv double {rest}, %x")
    return value


def _write_far_arc(far: Writer, k: int) -> str:
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
    return values[k]


def _turning_function() -> str:
    """Sine and cosine of any angle as a function, to two places: by a short reduction, or the library's."""
    near = Writer()
    sine, cosine = near.sine_and_cosine("%x")
    return "\n".join(
        [
            "define internal void @of_turn(double %x, ptr %out) noinline nounwind {",
            f"%small = fcmp olt double %x, {literal(FAR_ANGLE)}",
            f"%large = fcmp ogt double %x, {literal(-FAR_ANGLE)}",
            "%near_zero = and i1 %small, %large",
            "%second = getelementptr double, ptr %out, i64 1",
            "br i1 %near_zero, label %near, label %far",
            "near:",
            *near.lines,
            f"store double {sine}, ptr %out, align 8",
            f"store double {cosine}, ptr %second, align 8",
            "ret void",
            "far:",
            "%sine = call double @sin(double %x)",
            "%cosine = call double @cos(double %x)",
            "store double %sine, ptr %out, align 8",
            "store double %cosine, ptr %second, align 8",
            "ret void",
            "}",
        ]
    )


def _turning_lanes_function(width: int = 8) -> str:
    """Sine and cosine of some angles as a function, to two places: together if all are near, else one by one."""
    near, far, kind = Writer(), Writer("far"), type_of(width)
    bits = near.value(f"and <{width} x i1> %small, %large")
    whole = near.value(f"bitcast <{width} x i1> {bits} to i{width}")
    all_near = near.value(f"icmp eq i{width} {whole}, -1")
    head, near.lines = near.lines, []
    sine, cosine = near.sine_and_cosine("%x", width)
    room = far.value("alloca [2 x double], align 8")
    second = far.value(f"getelementptr double, ptr {room}, i64 1")
    sines = cosines = "poison"
    for lane in range(width):
        x = far.value(f"extractelement {kind} %x, i32 {lane}")
        far.lines.append(f"call void @of_turn(double {x}, ptr {room})")
        one, other = (far.value(f"load double, ptr {place}, align 8") for place in (room, second))
        sines = far.value(f"insertelement {kind} {sines}, double {one}, i32 {lane}")
        cosines = far.value(f"insertelement {kind} {cosines}, double {other}, i32 {lane}")
    return "\n".join(
        [
            f"define internal void @of_turn_lanes({kind} %x, ptr %out) noinline nounwind {{",
            f"%small = fcmp olt {kind} %x, {literals(FAR_ANGLE, width)}",
            f"%large = fcmp ogt {kind} %x, {literals(-FAR_ANGLE, width)}",
            f"%second = getelementptr {kind}, ptr %out, i64 1",
            *head,
            f"br i1 {all_near}, label %near, label %far",
            "near:",
            *near.lines,
            f"store {kind} {sine}, ptr %out, align 64",
            f"store {kind} {cosine}, ptr %second, align 64",
            "ret void",
            "far:",
            *far.lines,
            f"store {kind} {sines}, ptr %out, align 64",
            f"store {kind} {cosines}, ptr %second, align 64",
            "ret void",
            "}",
        ]
    )


def _piece_function() -> str:
    """The number of the last of n ascending knots that x isn't below, or 0, as a function: by bisection."""
    return "\n".join(
        [
            "define internal double @of_piece(double %x, ptr %knots, i64 %n) noinline nounwind {",
            "entry:",
            "br label %search",
            "search:",
            "%low = phi i64 [0, %entry], [%new_low, %halve]",
            "%high = phi i64 [%n, %entry], [%new_high, %halve]",
            "%width = sub i64 %high, %low",
            "%wide = icmp sgt i64 %width, 1",
            "br i1 %wide, label %halve, label %piece",
            "halve:",
            "%sum = add i64 %low, %high",
            "%middle = lshr i64 %sum, 1",
            "%at_knot = getelementptr double, ptr %knots, i64 %middle",
            "%knot = load double, ptr %at_knot, align 8",
            "%passed = fcmp ole double %knot, %x",
            "%new_low = select i1 %passed, i64 %middle, i64 %low",
            "%new_high = select i1 %passed, i64 %high, i64 %middle",
            "br label %search",
            "piece:",
            "%number = sitofp i64 %low to double",
            "ret double %number",
            "}",
        ]
    )


_OF_OTHERS = {
    "power": _power_function,
    "turn": _turning_function,
    "turn_lanes": _turning_lanes_function,
    "piece": _piece_function,
}

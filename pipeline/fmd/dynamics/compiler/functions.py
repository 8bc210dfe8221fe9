"""Functions of one scalar that a graph may apply: their values and their machine code.

Beside sine and cosine and the Stumpff functions there are square root, exponential, logarithm and hyperbolic tangent;
``positive`` x, which is x above 0 and else 0, and ``step``, its slope; and ``arc0``, by which a rotation's vector is
found from its matrix, with its derivatives ``arc1`` … (see `arc`). ``far_sin`` and ``far_cos`` are sine and cosine of
angles however large, the others' are up to 1e9.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.arc import LAST as LAST_ARC
from fmd.dynamics.compiler.arc import arc, arc_function
from fmd.dynamics.compiler.stumpff import FIRST, LAST, stumpff
from fmd.dynamics.compiler.writer import (
    Writer,
    literal,
    piece_function,
    stumpff_function,
    turning_function,
    turning_lanes_function,
)

STUMPFF = tuple(f"stumpff{k}" for k in range(FIRST, LAST + 1))
ARC = tuple(f"arc{k}" for k in range(LAST_ARC + 1))
_LIBRARY = ("exp", "log", "tanh", "asin", "sin", "cos")
FUNCTIONS = ("sin", "cos", *STUMPFF, *ARC, "sqrt", "exp", "log", "tanh", "positive", "step", "far_sin", "far_cos")
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


def evaluate_function(function: str, x: Array | float) -> Array:
    """Return the values of one of `FUNCTIONS`; not a number where it has none."""
    if function in STUMPFF:
        return stumpff(int(function.removeprefix("stumpff")), x)
    if function in ARC:
        return arc(int(function.removeprefix("arc")), x)
    if function in ("positive", "step"):
        return np.where(np.greater(x, 0.0), x if function == "positive" else 1.0, 0.0)
    with np.errstate(all="ignore"):
        return np.asarray(getattr(np, function.removeprefix("far_"))(x))


def function_code(function: str) -> str:
    """Write one of `FUNCTIONS`, but for sine and cosine, as a function of LLVM's language, ``@of_NAME``.

    Beside those there are ``power``; ``turn``, which writes sine and cosine of any angle to two places; and ``piece``,
    which finds the last of ascending numbers that a scalar isn't below, or the first.
    """
    if function in _OF_OTHERS:
        return _OF_OTHERS[function]()
    if function in STUMPFF:
        return stumpff_function(int(function.removeprefix("stumpff")), f"of_{function}")
    if function in ARC:
        return arc_function(int(function.removeprefix("arc")), f"of_{function}")
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


_OF_OTHERS = {
    "power": _power_function,
    "turn": turning_function,
    "turn_lanes": turning_lanes_function,
    "piece": piece_function,
}

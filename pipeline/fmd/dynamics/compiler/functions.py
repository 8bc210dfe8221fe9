"""Functions of one scalar that a graph may apply: their values and their machine code.

Beside sine and cosine and the Stumpff functions there are square root, exponential, logarithm and hyperbolic tangent;
``positive`` x, which is x above 0 and else 0, and ``step``, its slope; and ``arc0``, by which a rotation's vector is
found from its matrix, with its derivatives ``arc1`` … (see `arc`).
"""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.arc import LAST as LAST_ARC
from fmd.dynamics.compiler.arc import arc, arc_function
from fmd.dynamics.compiler.stumpff import FIRST, LAST, stumpff
from fmd.dynamics.compiler.writer import Writer, literal, stumpff_function

STUMPFF = tuple(f"stumpff{k}" for k in range(FIRST, LAST + 1))
ARC = tuple(f"arc{k}" for k in range(LAST_ARC + 1))
_LIBRARY = ("exp", "log", "tanh", "asin")
FUNCTIONS = ("sin", "cos", *STUMPFF, *ARC, "sqrt", "exp", "log", "tanh", "positive", "step")
"""Functions of one scalar that a node may apply."""

DECLARATIONS = tuple(f"declare double @{name}(double)" for name in _LIBRARY)
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
        return np.asarray(getattr(np, function)(x))


def function_code(function: str) -> str:
    """Write one of `FUNCTIONS`, but for sine and cosine, as a function of LLVM's language, ``@of_NAME``."""
    if function in STUMPFF:
        return stumpff_function(int(function.removeprefix("stumpff")), f"of_{function}")
    if function in ARC:
        return arc_function(int(function.removeprefix("arc")), f"of_{function}")
    out = Writer()
    if function in ("positive", "step"):
        above = out.value(f"fcmp ogt double %x, {literal(0.0)}")
        then = "%x" if function == "positive" else literal(1.0)
        value = out.value(f"select i1 {above}, double {then}, double {literal(0.0)}")
    elif function == "sqrt":
        value = out.value("call double @llvm.sqrt.f64(double %x)")
    else:
        value = out.value(f"call double @{function}(double %x)")
    body = [f"define internal double @of_{function}(double %x) nounwind {{", *out.lines, f"ret double {value}", "}"]
    return "\n".join(body)

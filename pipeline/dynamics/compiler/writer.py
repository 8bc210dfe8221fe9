"""Lines of LLVM's intermediate language: names, literals, and the functions of one scalar.

A product and a sum may contract to one rounding (``fma``); nothing else about floating-point arithmetic is relaxed, so
sums have the order that they are written in and what is not a number stays so.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from pipeline.core.arrays import Array
from pipeline.dynamics.compiler.stumpff import LIMIT, coefficients

# Sine and cosine on −π/4 … π/4 (Moshier, Methods and Programs for Mathematical Functions, 1989: Cephes), lowest first.
_SINE = (
    -1.66666666666666307295e-1, 8.33333333332211858878e-3, -1.98412698295895385996e-4,
    2.75573136213857245213e-6, -2.50507477628578072866e-8, 1.58962301576546568060e-10,
)  # fmt: skip
_COSINE = (
    4.16666666666665929218e-2, -1.38888888888730564116e-3, 2.48015872888517045348e-5,
    -2.75573141792967388112e-7, 2.08757008419747316778e-9, -1.13585365213876817300e-11,
)  # fmt: skip
_HALF_PI = (1.57079632679489655800e00, 6.12323399573676603587e-17)
_ROUNDING = 1.5 * 2.0**52  # adding it leaves the nearest integer in the lowest bits


def literal(value: float) -> str:
    """Return a double as LLVM reads it, bit for bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def type_of(width: int) -> str:
    """Return the type of a chunk."""
    return "double" if width == 1 else f"<{width} x double>"


class Writer:
    """Writes the lines of one function and names its values.

    Parameters
    ----------
    prefix : str
        Of the names, so that two writers can share a function.

    Attributes
    ----------
    lines : list of str
        The function's body.
    room : list of str
        Memory of its own, which is named on entry.
    tables : list of str
        Constant arrays of its module.
    """

    def __init__(self, prefix: str = "t") -> None:
        self.lines: list[str] = []
        self.room: list[str] = []
        self.tables: list[str] = []
        self._prefix, self._count, self._block, self._n_loops = prefix, 0, "entry", 0

    def name(self) -> str:
        """Return a name that no other value has."""
        self._count += 1
        return f"%{self._prefix}{self._count}"

    def value(self, instruction: str) -> str:
        """Write an instruction that gives a value, and return its name."""
        name = self.name()
        self.lines.append(f"{name} = {instruction}")
        return name

    def binary(self, operation: str, a: str, b: str, width: int = 1) -> str:
        """Write ``a operation b``; products and sums may contract."""
        return self.value(f"{operation} contract {type_of(width)} {a}, {b}")

    def table(self, values: Array) -> str:
        """Name a constant array, row by row."""
        name = f"@table{len(self.tables)}"
        entries = ", ".join(f"double {literal(float(x))}" for x in values.ravel())
        self.tables.append(f"{name} = private unnamed_addr constant [{values.size} x double] [{entries}], align 64")
        return name

    def new_loop(self) -> tuple[str, str, str]:
        """Begin a loop; its label, that of what comes after it and that of what comes before."""
        label, before = f"loop{self._n_loops}", self._block
        self._n_loops += 1
        self.lines += [f"br label %{label}", f"{label}:"]
        return label, f"after_{label}", before

    def end_loop(self, going_on: str, label: str, after: str) -> None:
        """End a loop that runs again while a comparison holds."""
        self.lines += [f"br i1 {self.value(going_on)}, label %{label}, label %{after}", f"{after}:"]
        self._block = after

    def fma(self, a: str, b: str, c: str) -> str:
        """Write ``a b + c``, rounded once."""
        return self.value(f"call double @llvm.fma.f64(double {a}, double {b}, double {c})")

    def polynomial(self, x: str, lowest_first: Sequence[float]) -> str:
        """Write a polynomial by Horner's rule."""
        *others, value = (literal(c) for c in lowest_first)
        for coefficient in reversed(others):
            value = self.fma(x, value, coefficient)
        return value

    def sine_and_cosine(self, x: str) -> tuple[str, str]:
        """Write sine and cosine, each to the last bit or the one before, for |x| up to 1e9."""
        quarters = self.value(f"fmul double {x}, {literal(2.0 / math.pi)}")
        shifted = self.value(f"fadd double {quarters}, {literal(_ROUNDING)}")
        bits = self.value(f"bitcast double {shifted} to i64")
        turns = self.value(f"fsub double {literal(_ROUNDING)}, {shifted}")  # minus the quarter turns
        for part in _HALF_PI:
            x = self.fma(turns, literal(part), x)
        square = self.value(f"fmul double {x}, {x}")
        sine = self.fma(self.value(f"fmul double {x}, {square}"), self.polynomial(square, _SINE), x)
        halved = self.fma(square, literal(-0.5), literal(1.0))
        fourth = self.value(f"fmul double {square}, {square}")
        cosine = self.fma(fourth, self.polynomial(square, _COSINE), halved)
        odd = self.value(f"trunc i64 {bits} to i1")
        first = self.value(f"select i1 {odd}, double {cosine}, double {sine}")
        second = self.value(f"select i1 {odd}, double {sine}, double {cosine}")
        after = self.value(f"add i64 {bits}, 1")
        return self._signed(first, bits), self._signed(second, after)

    def _signed(self, value: str, quarter: str) -> str:
        """Turn a value's sign if bit 1 of the quarter is set."""
        sign = self.value(f"shl i64 {self.value(f'and i64 {quarter}, 2')}, 62")
        turned = self.value(f"xor i64 {self.value(f'bitcast double {value} to i64')}, {sign}")
        return self.value(f"bitcast i64 {turned} to double")


def stumpff_function(k: int) -> str:
    """A function of its own, for its branch: by series, or by sine and cosine; see `stumpff`."""
    out = Writer()
    near = out.polynomial("%x", coefficients(k))
    far = Writer("far")
    root = far.value("call double @llvm.sqrt.f64(double %x)")
    sine, cosine = far.sine_and_cosine(root)
    value = far.value(f"fdiv double {sine}, {root}") if k % 2 else cosine
    for j in range(k % 2, k, 2):
        rest = far.value(f"fsub double {literal(1.0 / math.factorial(j))}, {value}")
        value = far.value(f"fdiv double {rest}, %x")
    lines = [
        f"define internal double @stumpff{k}(double %x) noinline nounwind {{",
        f"%small = fcmp olt double %x, {literal(LIMIT)}",
        "br i1 %small, label %near, label %far",
        "near:",
        *out.lines,
        f"ret double {near}",
        "far:",
        *far.lines,
        f"ret double {value}",
        "}",
    ]
    return "\n".join(lines)

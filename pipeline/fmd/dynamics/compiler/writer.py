"""Lines of LLVM's intermediate language: names, literals, and the functions of one scalar.

A product and a sum may contract to one rounding (``fma``); nothing else about floating-point arithmetic is relaxed, so
sums have the order that they are written in and what is not a number stays so.
"""

import math
import struct
from collections.abc import Callable, Sequence

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.code import DOUBLES_IN_LINE, STRUCTURAL

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
_SUFFIX = {1: "f64", 8: "v8f64"}
_ROUNDING = 1.5 * 2.0**52  # adding it leaves the nearest integer in the lowest bits


def literal(value: float) -> str:
    """Return a double as LLVM reads it, bit for bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def type_of(width: int, of: str = "double") -> str:
    """Return the type of a chunk."""
    return of if width == 1 else f"<{width} x {of}>"


class Writer:
    """Writes the lines of one function and names its values.

    Names have a prefix, so that two writers can share a function. Its code reads ``constants`` at an address, so that
    others give the same code; it has ``room``, memory of its own, which is named on entry.
    """

    def __init__(self, prefix: str = "t", constants: str = "@constants") -> None:
        self.lines: list[str] = []
        self.room: list[str] = []
        self.constants: list[float] = []
        self._address = constants
        self._prefix, self._count, self._block, self._n_loops = prefix, 0, "entry", 0
        self._free = range(0)  # places among the constants that are kept for single numbers

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

    def number(self, value: float) -> str:
        """Return 0, 1, -1 or what isn't finite as it is; write the load of any other number from the constants."""
        if value in STRUCTURAL or not math.isfinite(value):
            return literal(value)
        if not self._free:
            self._free = range(self._keep(np.zeros(DOUBLES_IN_LINE)), len(self.constants))
        place, self._free = self._free[0], self._free[1:]
        self.constants[place] = value
        return self.load_constant(self.value(f"getelementptr double, ptr {self._address}, i64 {place}"))

    def load_constant(self, address: str, width: int = 1) -> str:
        """Write the load of a chunk of constants."""
        return self.value(f"load {type_of(width)}, ptr {address}, align 8, !invariant.load !0")

    def table(self, values: Array) -> str:
        """Write the address of an array of constants, row by row."""
        return self.value(f"getelementptr double, ptr {self._address}, i64 {self._keep(values)}")

    def _keep(self, values: Array) -> int:
        """Add constants that begin a line of the cache, and return the place of the first."""
        first = len(self.constants)
        self.constants += [*values.ravel().tolist(), *[0.0] * (-values.size % DOUBLES_IN_LINE)]
        return first

    def new_loop(self) -> tuple[str, str, str]:
        """Begin a loop; its label, that of what comes after it and that of what comes before."""
        label, before = f"loop{self._n_loops}", self._block
        self._n_loops += 1
        self.lines += [f"br label %{label}", f"{label}:"]
        return label, f"after_{label}", before

    def leave_unless(self, going_on: str, stores: Sequence[str]) -> None:
        """Leave the function after some stores unless a comparison holds."""
        self.lines += [f"br i1 {self.value(going_on)}, label %going_on, label %leaving"]
        self.lines += ["leaving:", *stores, "ret void", "going_on:"]
        self._block = "going_on"

    def end_loop(self, going_on: str, label: str, after: str) -> None:
        """End a loop that runs again while a comparison holds."""
        self.lines += [f"br i1 {self.value(going_on)}, label %{label}, label %{after}", f"{after}:"]
        self._block = after

    def repeat(
        self, count: str, start: Sequence[tuple[str, int]], body: Callable[[str, list[str]], list[str]]
    ) -> list[str]:
        """Write a loop that replaces values so often, or not at all, by those that a body makes of its number and them.

        What the body shares with code after the loop has to be written before.
        """
        some, before, label = self.value(f"icmp sgt i64 {count}, 0"), self._block, f"loop{self._n_loops}"
        self._n_loops, after = self._n_loops + 1, f"after_{label}"
        self.lines += [f"br i1 {some}, label %{label}, label %{after}", f"{label}:"]
        number, following, now = self.name(), self.name(), [self.name() for _ in start]
        place = len(self.lines)
        self._block = label
        made = body(number, now)
        phis = [f"{number} = phi i64 [ 0, %{before} ], [ {following}, %{self._block} ]"]
        pairs = list(zip(start, now, made, strict=True))
        for (value, width), name, updated in pairs:
            phis.append(f"{name} = phi {type_of(width)} [ {value}, %{before} ], [ {updated}, %{self._block} ]")
        self.lines[place:place] = phis
        self.lines.append(f"{following} = add i64 {number}, 1")
        last = self._block
        self.end_loop(f"icmp slt i64 {following}, {count}", label, after)
        return [
            self.value(f"phi {type_of(width)} [ {value}, %{before} ], [ {updated}, %{last} ]")
            for (value, width), _, updated in pairs
        ]

    def either(
        self, condition: str, widths: Sequence[int], first: Callable[[], list[str]], second: Callable[[], list[str]]
    ) -> list[str]:
        """Write two ways to values of some widths, of which a condition takes the first, and return the values.

        What a way shares with other code has to be written before.
        """
        number, ends = self._n_loops, list[tuple[list[str], str]]()
        self._n_loops += 1
        self.lines.append(f"br i1 {condition}, label %way{number}, label %detour{number}")
        for label, write in ((f"way{number}", first), (f"detour{number}", second)):
            self.lines.append(f"{label}:")
            self._block = label
            ends.append((write(), self._block))
            self.lines.append(f"br label %joined{number}")
        self._block = f"joined{number}"
        self.lines.append(f"{self._block}:")
        (ones, before), (others, after) = ends
        return [
            self.value(f"phi {type_of(width)} [ {one}, %{before} ], [ {other}, %{after} ]")
            for width, one, other in zip(widths, ones, others, strict=True)
        ]

    def fma(self, a: str, b: str, c: str, width: int = 1) -> str:
        """Write ``a b + c``, rounded once."""
        kind = type_of(width)
        return self.value(f"call {kind} @llvm.fma.{_SUFFIX[width]}({kind} {a}, {kind} {b}, {kind} {c})")

    def polynomial(self, x: str, lowest_first: Sequence[float], width: int = 1) -> str:
        """Write a polynomial by Horner's rule."""
        *others, value = (literals(c, width) for c in lowest_first)
        for coefficient in reversed(others):
            value = self.fma(x, value, coefficient, width)
        return value

    def sine_and_cosine(self, x: str, width: int = 1) -> tuple[str, str]:
        """Write sine and cosine, each to the last bit or the one before, for |x| up to 1e9."""
        kind, whole, bit = type_of(width), type_of(width, "i64"), type_of(width, "i1")
        quarters = self.value(f"fmul {kind} {x}, {literals(2.0 / math.pi, width)}")
        shifted = self.value(f"fadd {kind} {quarters}, {literals(_ROUNDING, width)}")
        bits = self.value(f"bitcast {kind} {shifted} to {whole}")
        turns = self.value(f"fsub {kind} {literals(_ROUNDING, width)}, {shifted}")  # minus the quarter turns
        for part in _HALF_PI:
            x = self.fma(turns, literals(part, width), x, width)
        square = self.value(f"fmul {kind} {x}, {x}")
        cube = self.value(f"fmul {kind} {x}, {square}")
        sine = self.fma(cube, self.polynomial(square, _SINE, width), x, width)
        halved = self.fma(square, literals(-0.5, width), literals(1.0, width), width)
        fourth = self.value(f"fmul {kind} {square}, {square}")
        cosine = self.fma(fourth, self.polynomial(square, _COSINE, width), halved, width)
        odd = self.value(f"trunc {whole} {bits} to {bit}")
        first = self.value(f"select {bit} {odd}, {kind} {cosine}, {kind} {sine}")
        second = self.value(f"select {bit} {odd}, {kind} {sine}, {kind} {cosine}")
        after = self.value(f"add {whole} {bits}, {_integers(1, width)}")
        return self._signed(first, bits, width), self._signed(second, after, width)

    def sine_or_cosine_far(self, x: str) -> tuple[str, str]:
        """Write a call for sine and cosine of any angle."""
        room = self.value("alloca [2 x double], align 8")
        self.lines.append(f"call void @of_turn(double {x}, ptr {room})")
        sine = self.value(f"load double, ptr {room}, align 8")
        second = self.value(f"getelementptr double, ptr {room}, i64 1")
        return sine, self.value(f"load double, ptr {second}, align 8")

    def choose(self, operation: str, values: Sequence[str], width: int = 1) -> str:
        """Write a choice of scalars: ``below``, ``select`` or ``moving``; see `functions.CHOICES`."""
        kind, nothing, (a, b, *_) = type_of(width), literals(0.0, width), values
        if operation == "select":
            above = self.value(f"fcmp ogt {kind} {a}, {nothing}")
            return self.value(f"select {type_of(width, 'i1')} {above}, {kind} {b}, {kind} {values[2]}")
        if operation == "moving":
            still = self.value(f"fcmp oeq {kind} {b}, {nothing}")
            product = self.value(f"fmul {kind} {a}, {b}")
            return self.value(f"select {type_of(width, 'i1')} {still}, {kind} {nothing}, {kind} {product}")
        less, unknown = self.value(f"fcmp olt {kind} {a}, {b}"), self.value(f"fcmp uno {kind} {a}, {a}")
        either = self.value(f"or {type_of(width, 'i1')} {less}, {unknown}")
        one = literals(1.0, width)
        return self.value(f"select {type_of(width, 'i1')} {either}, {kind} {one}, {kind} {nothing}")

    def _signed(self, value: str, quarter: str, width: int) -> str:
        """Turn a value's sign if bit 1 of the quarter is set."""
        kind, whole = type_of(width), type_of(width, "i64")
        masked = self.value(f"and {whole} {quarter}, {_integers(2, width)}")
        sign = self.value(f"shl {whole} {masked}, {_integers(62, width)}")
        as_bits = self.value(f"bitcast {kind} {value} to {whole}")
        turned = self.value(f"xor {whole} {as_bits}, {sign}")
        return self.value(f"bitcast {whole} {turned} to {kind}")


def literals(value: float, width: int) -> str:
    """Return a double in all entries of a chunk."""
    return literal(value) if width == 1 else "<" + ", ".join([f"double {literal(value)}"] * width) + ">"


def _integers(value: int, width: int) -> str:
    return str(value) if width == 1 else "<" + ", ".join([f"i64 {value}"] * width) + ">"

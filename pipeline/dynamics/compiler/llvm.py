"""LLVM's intermediate language for a program's graph: straight-line code, but for products with large matrices.

A scalar is a double. A modal vector is kept as chunks of the processor's vector width and a shorter rest; the padding
of a rest of three is zero in inputs and constants and stays so. A product and a sum may contract to one rounding
(``fma``); nothing else about floating-point arithmetic is relaxed, so sums have the order that the graph gives them and
what is not a number stays so.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.compiler.graph import FUNCTIONS
from pipeline.dynamics.compiler.program import Program
from pipeline.dynamics.compiler.stumpff import LIMIT, coefficients

_UNROLLED = 16
"""Matrices of so many columns are multiplied without a loop, their columns in the code."""

_ACCUMULATORS = 8
"""Vector registers that a matrix product sums in: enough to hide the latency of ``fma``."""

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

Chunk = tuple[str, int]
"""A value of LLVM's and its width: a double for 1, else a vector."""


def literal(value: float) -> str:
    """Return a double as LLVM reads it, bit for bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def chunk_widths(size: int, register: int) -> list[int]:
    """Return the widths of the chunks of a vector: whole registers, and a rest that is padded only to spare a chunk."""
    widths, rest = [register] * (size // register), size % register
    while rest:
        width = 1 << rest.bit_length() - 1
        if rest == 2 * width - 1 and width > 1:
            width *= 2
        widths.append(width)
        rest = max(rest - width, 0)
    return widths


def type_of(width: int) -> str:
    """Return the type of a chunk."""
    return "double" if width == 1 else f"<{width} x double>"


class Writer:
    """Lines of one function, and names for its values."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.room: list[str] = []  # memory of its own, named on entry
        self._count = 0

    def name(self) -> str:
        """Return a name that no other value has."""
        self._count += 1
        return f"%t{self._count}"

    def value(self, instruction: str) -> str:
        """Write an instruction that gives a value, and return its name."""
        name = self.name()
        self.lines.append(f"{name} = {instruction}")
        return name

    def binary(self, operation: str, a: str, b: str, width: int = 1) -> str:
        """Write ``a operation b``; products and sums may contract."""
        return self.value(f"{operation} contract {type_of(width)} {a}, {b}")

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


def emit(program: Program, register: int) -> str:
    """Write a program as a module of LLVM's language, for vector registers of so many doubles."""
    return _Emitter(program, register).module()


class _Emitter:
    """State of writing one program: names of scalars, chunks of vectors, constants and functions that it needs."""

    def __init__(self, program: Program, register: int) -> None:
        self._program, self._graph, self._register = program, program.graph, register
        self._out = Writer()
        self._scalars: dict[int, str] = {}
        self._vectors: dict[int, list[Chunk]] = {}
        self._turns: dict[int, tuple[str, str]] = {}
        self._splats: dict[tuple[str, int], str] = {}
        self._in_memory: dict[int, str] = {}
        self._tables: list[str] = []
        self._functions: set[int] = set()
        self._block, self._n_loops = "entry", 0

    def module(self) -> str:
        for number in self._program.nodes:
            self._write(number)
        for value, (argument, places) in self._program.outputs:
            if not places:
                continue
            if self._graph.nodes[value.node].size:
                self._store(self._vectors[value.node], argument, places)
            else:
                self._store([(self._scalars[value.node], 1)], argument, places)
        arguments = ", ".join(f"ptr noalias %{name}" for name in self._program.arguments)
        parts = [
            "declare double @llvm.fma.f64(double, double, double)",
            "declare double @llvm.sqrt.f64(double)",
            *self._tables,
            *(_stumpff_function(k) for k in sorted(self._functions)),
            f"define void @{self._program.name}({arguments}) nounwind {{",
            "entry:",
            *self._out.room,
            *self._out.lines,
            "ret void",
            "}",
        ]
        return "\n".join(parts) + "\n"

    def _write(self, number: int) -> None:
        operation, arguments, data, _ = self._graph.nodes[number]
        out, scalars = self._out, self._scalars
        if operation == "number":
            scalars[number] = literal(float(data))  # type: ignore[arg-type]
        elif operation in ("input", "vector input"):
            name, places = data  # type: ignore[misc]
            chunks = self._load(name, places)
            if operation == "input":
                scalars[number] = chunks[0][0]
            else:
                self._vectors[number] = chunks
        elif operation == "array":
            self._vectors[number] = self._constant(self._graph.arrays[data])  # type: ignore[index]
        elif operation in ("add", "subtract", "multiply"):
            instruction = {"add": "fadd", "subtract": "fsub", "multiply": "fmul"}[operation]
            scalars[number] = out.binary(instruction, scalars[arguments[0]], scalars[arguments[1]])
        elif operation == "negate":
            scalars[number] = out.value(f"fneg double {scalars[arguments[0]]}")
        elif operation == "invert":
            scalars[number] = out.value(f"fdiv double {literal(1.0)}, {scalars[arguments[0]]}")
        elif operation in FUNCTIONS:
            scalars[number] = self._function(operation, arguments[0])
        elif operation == "dot":
            scalars[number] = self._dot(self._vectors[arguments[0]], self._vectors[arguments[1]])
        elif operation == "combine":
            self._vectors[number] = self._combine(arguments)
        elif operation == "diagonal":
            constant = self._constant(self._graph.arrays[data])  # type: ignore[index]
            pairs = zip(constant, self._vectors[arguments[0]], strict=True)
            self._vectors[number] = [(out.binary("fmul", a, b, width), width) for (a, width), (b, _) in pairs]
        else:
            matrix = self._graph.arrays[data]  # type: ignore[index]
            if matrix.shape[1] <= _UNROLLED:
                self._vectors[number] = self._unrolled_product(matrix, self._vectors[arguments[0]])
            else:
                self._vectors[number] = self._looped_product(matrix, arguments[0])

    # Memory

    def _load(self, argument: str, places: tuple[int, ...]) -> list[Chunk]:
        chunks, first = [], 0
        for width in chunk_widths(len(places), self._register):
            chunks.append((self._load_chunk(argument, places[first : first + width], width), width))
            first += width
        return chunks

    def _load_chunk(self, argument: str, places: tuple[int, ...], width: int) -> str:
        whole = len(places) == width and places == tuple(range(places[0], places[0] + width))
        if whole:
            return self._out.value(f"load {type_of(width)}, ptr {self._address(argument, places[0])}, align 8")
        value = "zeroinitializer"
        for k, place in enumerate(places):
            entry = self._out.value(f"load double, ptr {self._address(argument, place)}, align 8")
            value = self._out.value(f"insertelement {type_of(width)} {value}, double {entry}, i32 {k}")
        return value

    def _store(self, chunks: list[Chunk], argument: str, places: tuple[int, ...]) -> None:
        first = 0
        for value, width in chunks:
            at = places[first : first + width]
            if len(at) == width and at == tuple(range(at[0], at[0] + width)):
                self._out.lines.append(f"store {type_of(width)} {value}, ptr {self._address(argument, at[0])}, align 8")
            else:
                for k, place in enumerate(at):
                    entry = self._out.value(f"extractelement {type_of(width)} {value}, i32 {k}")
                    self._out.lines.append(f"store double {entry}, ptr {self._address(argument, place)}, align 8")
            first += width

    def _address(self, argument: str, place: int) -> str:
        return self._out.value(f"getelementptr double, ptr %{argument}, i64 {place}") if place else f"%{argument}"

    # Chunks

    def _constant(self, values: Array) -> list[Chunk]:
        chunks, first = [], 0
        for width in chunk_widths(values.size, self._register):
            entries = np.zeros(width)
            entries[: values[first : first + width].size] = values[first : first + width]
            if width == 1:
                text = literal(entries[0])
            elif entries.any():
                text = "<" + ", ".join(f"double {literal(x)}" for x in entries) + ">"
            else:
                text = "zeroinitializer"
            chunks.append((text, width))
            first += width
        return chunks

    def _splat(self, scalar: str, width: int) -> str:
        """A scalar in all entries of a chunk."""
        if width == 1:
            return scalar
        if scalar.startswith("0x"):
            return "<" + ", ".join([f"double {scalar}"] * width) + ">"
        if (scalar, width) not in self._splats:
            one = self._out.value(f"insertelement {type_of(width)} poison, double {scalar}, i32 0")
            self._splats[scalar, width] = self._spread(one, 0, width, width)
        return self._splats[scalar, width]

    def _spread(self, chunk: str, entry: int, width: int, to: int) -> str:
        """An entry of a chunk in all entries of another."""
        return self._shuffle(chunk, width, [entry] * to)

    def _shuffle(self, chunk: str, width: int, entries: Sequence[int]) -> str:
        mask = ", ".join(f"i32 {k}" for k in entries)
        kind = type_of(width)
        return self._out.value(f"shufflevector {kind} {chunk}, {kind} poison, <{len(entries)} x i32> <{mask}>")

    def _accumulate(self, total: str | None, factor: str, chunk: str, width: int) -> str:
        """Add a product to a sum, or begin one."""
        product = self._out.binary("fmul", factor, chunk, width)
        return product if total is None else self._out.binary("fadd", total, product, width)

    def _combine(self, arguments: tuple[int, ...]) -> list[Chunk]:
        terms = [(self._scalars[s], self._vectors[v]) for s, v in zip(arguments[::2], arguments[1::2], strict=True)]
        out = []
        for k, (_, width) in enumerate(terms[0][1]):
            total: str | None = None
            # What has no factor first: the others then all contract.
            for factor, chunks in sorted(terms, key=lambda term: term[0] != literal(1.0)):
                if _is_zero(chunks[k][0]):
                    continue
                if factor == literal(1.0):
                    total = chunks[k][0] if total is None else self._out.binary("fadd", total, chunks[k][0], width)
                else:
                    total = self._accumulate(total, self._splat(factor, width), chunks[k][0], width)
            out.append((total or self._zero(width), width))
        return out

    def _zero(self, width: int) -> str:
        return literal(0.0) if width == 1 else "zeroinitializer"

    def _dot(self, a: list[Chunk], b: list[Chunk]) -> str:
        sums: dict[int, list[str]] = {}
        pairs = [(x, y, width) for (x, width), (y, _) in zip(a, b, strict=True) if not (_is_zero(x) or _is_zero(y))]
        for k, (x, y, width) in enumerate(pairs):
            lanes = sums.setdefault(width, [])
            if len(lanes) < 4:
                lanes.append(self._out.binary("fmul", x, y, width))
            else:
                lanes[k % 4] = self._accumulate(lanes[k % 4], x, y, width)
        while sums:
            width = max(sums)
            value, *others = sums.pop(width)
            for other in others:
                value = self._out.binary("fadd", value, other, width)
            if width == 1:
                return value
            sums.setdefault(width // 2, []).insert(0, self._folded(value, width))
        return literal(0.0)

    def _folded(self, value: str, width: int) -> str:
        """The lower half of a chunk plus its upper half."""
        half = width // 2
        if half == 1:
            low, high = (self._out.value(f"extractelement {type_of(width)} {value}, i32 {k}") for k in (0, 1))
        else:
            low, high = (self._shuffle(value, width, range(first, first + half)) for first in (0, half))
        return self._out.binary("fadd", low, high, half)

    # Functions

    def _function(self, operation: str, argument: int) -> str:
        if operation in ("sin", "cos"):
            if argument not in self._turns:
                self._turns[argument] = self._out.sine_and_cosine(self._scalars[argument])
            return self._turns[argument][operation == "cos"]
        k = int(operation.removeprefix("stumpff"))
        self._functions.add(k)
        return self._out.value(f"call double @stumpff{k}(double {self._scalars[argument]})")

    # Matrices

    def _unrolled_product(self, matrix: Array, vector: list[Chunk]) -> list[Chunk]:
        """Column by column, each entry of the vector spread over a chunk of rows."""
        columns = [self._constant(column) for column in matrix.T]
        out = []
        for k, width in enumerate(chunk_widths(len(matrix), self._register)):
            total: str | None = None
            first = 0
            for chunk, chunk_width in vector:
                for entry in range(min(chunk_width, matrix.shape[1] - first)):
                    column = columns[first + entry][k][0]
                    if _is_zero(column):
                        continue
                    factor = self._entry(chunk, entry, chunk_width, width)
                    total = self._accumulate(total, column, factor, width)
                first += chunk_width
            out.append((total or self._zero(width), width))
        return out

    def _entry(self, chunk: str, entry: int, width: int, to: int) -> str:
        """An entry of a chunk, spread over another."""
        key = (f"{chunk}[{entry}]", to)
        if key not in self._splats:
            if width == 1:
                self._splats[key] = self._splat(chunk, to)
            elif to == 1:
                self._splats[key] = self._out.value(f"extractelement {type_of(width)} {chunk}, i32 {entry}")
            else:
                self._splats[key] = self._spread(chunk, entry, width, to)
        return self._splats[key]

    def _looped_product(self, matrix: Array, argument: int) -> list[Chunk]:
        """By blocks of rows that are summed in registers, in a loop over columns."""
        widths = chunk_widths(len(matrix), self._register)
        columns = np.zeros((matrix.shape[1], sum(widths)))
        columns[:, : len(matrix)] = matrix.T
        table = self._table(columns)
        vector = self._stored(argument)
        out: list[Chunk] = []
        for first in range(0, len(widths), _ACCUMULATORS):
            block = widths[first : first + _ACCUMULATORS]
            out += self._block_product(table, vector, matrix.shape[1], sum(widths), sum(widths[:first]), block)
        return out

    def _table(self, values: Array) -> str:
        name = f"@table{len(self._tables)}"
        entries = ", ".join(f"double {literal(x)}" for x in values.ravel())
        self._tables.append(f"{name} = private unnamed_addr constant [{values.size} x double] [{entries}], align 64")
        return name

    def _stored(self, argument: int) -> str:
        """A vector's copy in memory, where a loop reads it entry by entry."""
        if argument not in self._in_memory:
            chunks = self._vectors[argument]
            name = self._out.name()
            self._out.room.append(f"{name} = alloca [{sum(width for _, width in chunks)} x double], align 64")
            first = 0
            for value, width in chunks:
                at = self._out.value(f"getelementptr double, ptr {name}, i64 {first}")
                self._out.lines.append(f"store {type_of(width)} {value}, ptr {at}, align 8")
                first += width
            self._in_memory[argument] = name
        return self._in_memory[argument]

    def _block_product(
        self, table: str, vector: str, n_columns: int, stride: int, first: int, widths: list[int]
    ) -> list[Chunk]:
        """A loop over two columns at a time, so that short blocks have sums enough to hide the latency too."""
        out, loop = self._out, f"loop{self._n_loops}"
        self._n_loops += 1
        before, after = self._block, f"after_{loop}"
        paired = n_columns - n_columns % 2
        counter, following = out.name(), out.name()
        sums = [(out.name(), out.name(), width) for width in widths for _ in range(2)]
        out.lines += [f"br label %{loop}", f"{loop}:"]
        out.lines.append(f"{counter} = phi i64 [ 0, %{before} ], [ {following}, %{loop} ]")
        for value, updated, width in sums:
            out.lines.append(
                f"{value} = phi {type_of(width)} [ {self._zero(width)}, %{before} ], [ {updated}, %{loop} ]"
            )
        for side in range(2):
            column = out.value(f"add i64 {counter}, {side}") if side else counter
            factor = out.value(f"load double, ptr {out.value(f'getelementptr double, ptr {vector}, i64 {column}')}")
            row = out.value(f"add i64 {out.value(f'mul i64 {column}, {stride}')}, {first}")
            spread: dict[int, str] = {1: factor}
            at = 0
            for k, width in enumerate(widths):
                if width not in spread:
                    one = out.value(f"insertelement {type_of(width)} poison, double {factor}, i32 0")
                    spread[width] = self._spread(one, 0, width, width)
                where = out.value(f"getelementptr double, ptr {table}, i64 {out.value(f'add i64 {row}, {at}')}")
                entries = out.value(f"load {type_of(width)}, ptr {where}, align 8")
                value, updated, _ = sums[2 * k + side]
                product = out.binary("fmul", entries, spread[width], width)
                out.lines.append(f"{updated} = fadd contract {type_of(width)} {value}, {product}")
                at += width
        out.lines.append(f"{following} = add i64 {counter}, 2")
        out.lines.append(f"br i1 {out.value(f'icmp slt i64 {following}, {paired}')}, label %{loop}, label %{after}")
        out.lines.append(f"{after}:")
        self._block = after
        chunks, at = [], first
        for k, width in enumerate(widths):
            total = out.binary("fadd", sums[2 * k][1], sums[2 * k + 1][1], width)
            if n_columns > paired:
                last = f"getelementptr double, ptr {vector}, i64 {paired}"
                factor = self._splat(out.value(f"load double, ptr {out.value(last)}"), width)
                where = out.value(f"getelementptr double, ptr {table}, i64 {paired * stride + at}")
                entries = out.value(f"load {type_of(width)}, ptr {where}, align 8")
                total = self._accumulate(total, entries, factor, width)
            chunks.append((total, width))
            at += width
        return chunks


def _is_zero(text: str) -> bool:
    return text in ("zeroinitializer", literal(0.0))


def _stumpff_function(k: int) -> str:
    """A function of its own, for its branch: by series, or by sine and cosine; see `stumpff`."""
    out = Writer()
    near = out.polynomial("%x", coefficients(k))
    far = Writer()
    far._count = 1000
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

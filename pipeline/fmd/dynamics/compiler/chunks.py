"""Modal vectors in LLVM's language: chunks of the processor's vector width, and a shorter rest.

The padding of a rest of three is zero in inputs and constants, and stays so in sums and products.
"""

from collections.abc import Sequence

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.code import ACCUMULATORS, MOST_GROUPED, STRUCTURAL, UNROLLED
from fmd.dynamics.compiler.writer import Writer, literal, type_of

Chunk = tuple[str, int]
"""A value of LLVM's and its width: a double for 1, else a vector."""


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


def is_zero(value: str) -> bool:
    """Return whether a value is the constant 0."""
    return value in ("zeroinitializer", literal(0.0))


def zero(width: int) -> str:
    """Return the constant 0 of a chunk."""
    return literal(0.0) if width == 1 else "zeroinitializer"


def order_of_groups(matrix: Array) -> IntArray:
    """Return the order of a matrix's rows in which those with entries in the same columns come together."""
    group = np.arange(len(matrix))
    for column in (matrix != 0.0).T:
        group[np.isin(group, group[column])] = group[column].min(initial=len(matrix))
    return np.argsort(group, kind="stable")


class ChunkWriter(Writer):
    """Writes operations of vectors as operations of their chunks, of as many doubles as a vector register has.

    Its code reads constants at an address.
    """

    def __init__(self, register: int, constants: str = "@constants") -> None:
        super().__init__(constants=constants)
        self._register = register
        self._copies: dict[tuple[str, int], str] = {}
        self._in_memory: dict[str, str] = {}

    def load(self, argument: str, places: tuple[int, ...]) -> list[Chunk]:
        """Write loads of a vector from places of an argument."""
        chunks, first = [], 0
        for width in chunk_widths(len(places), self._register):
            at = places[first : first + width]
            if at == tuple(range(at[0], at[0] + width)):
                value = self.value(f"load {type_of(width)}, ptr {self.address(argument, at[0])}, align 8")
            else:
                value = zero(width)
                for k, place in enumerate(at):
                    entry = self.value(f"load double, ptr {self.address(argument, place)}, align 8")
                    value = self.value(f"insertelement {type_of(width)} {value}, double {entry}, i32 {k}")
            chunks.append((value, width))
            first += width
        return chunks

    def store(self, chunks: list[Chunk], argument: str, places: tuple[int, ...]) -> None:
        """Write stores of a vector to places of an argument."""
        first = 0
        for value, width in chunks:
            at = places[first : first + width]
            if at == tuple(range(at[0], at[0] + width)):
                self.lines.append(f"store {type_of(width)} {value}, ptr {self.address(argument, at[0])}, align 8")
            else:
                for k, place in enumerate(at):
                    entry = self.value(f"extractelement {type_of(width)} {value}, i32 {k}")
                    self.lines.append(f"store double {entry}, ptr {self.address(argument, place)}, align 8")
            first += width

    def address(self, argument: str, place: int) -> str:
        """Write the address of a place of an argument."""
        return self.value(f"getelementptr double, ptr %{argument}, i64 {place}") if place else f"%{argument}"

    def constant(self, values: Array) -> list[Chunk]:
        """Write a constant vector: chunks of 0, 1 and -1 as they are, all others as loads."""
        chunks, first, table = list[Chunk](), 0, ""
        padded = [*values.tolist(), *[0.0] * (-values.size % self._register)]  # lists: chunks are short
        for width in chunk_widths(values.size, self._register):
            entries = padded[first : first + width]
            if not any(entries):
                text = zero(width)
            elif all(x in STRUCTURAL for x in entries):
                text = literal(entries[0]) if width == 1 else f"<{', '.join(f'double {literal(x)}' for x in entries)}>"
            else:
                table = table or self.table(np.array(padded))
                at = self.value(f"getelementptr double, ptr {table}, i64 {first}") if first else table
                text = self.load_constant(at, width)
            chunks.append((text, width))
            first += width
        return chunks

    def splat(self, scalar: str, width: int) -> str:
        """Write a scalar into all entries of a chunk."""
        if width == 1:
            return scalar
        if scalar.startswith("0x"):
            return "<" + ", ".join([f"double {scalar}"] * width) + ">"
        if (scalar, width) not in self._copies:
            one = self.value(f"insertelement {type_of(width)} poison, double {scalar}, i32 0")
            self._copies[scalar, width] = self._shuffle(one, width, [0] * width)
        return self._copies[scalar, width]

    def entry(self, vector: list[Chunk], place: int, to: int) -> str:
        """Write an entry of a vector into all entries of a chunk."""
        position = 0
        while place >= vector[position][1]:
            place -= vector[position][1]
            position += 1
        chunk, width = vector[position]
        if width == 1:
            return self.splat(chunk, to)
        key = (f"{chunk}[{place}]", to)
        if key not in self._copies:
            if to == 1:
                self._copies[key] = self.value(f"extractelement {type_of(width)} {chunk}, i32 {place}")
            else:
                self._copies[key] = self._shuffle(chunk, width, [place] * to)
        return self._copies[key]

    def combine(self, terms: list[tuple[str, list[Chunk]]]) -> list[Chunk]:
        """Write a sum of scalars times vectors."""
        out = []
        terms = sorted(terms, key=lambda term: term[0] != literal(1.0))  # so that all others contract
        for k, (_, width) in enumerate(terms[0][1]):
            total: str | None = None
            for factor, chunks in terms:
                chunk = chunks[k][0]
                if is_zero(chunk):
                    continue
                if factor == literal(1.0):
                    total = chunk if total is None else self.binary("fadd", total, chunk, width)
                else:
                    total = self.accumulate(total, self.splat(factor, width), chunk, width)
            out.append((total or zero(width), width))
        return out

    def accumulate(self, total: str | None, a: str, b: str, width: int) -> str:
        """Write the sum of a total, if there is one, and a product."""
        product = self.binary("fmul", a, b, width)
        return product if total is None else self.binary("fadd", total, product, width)

    def dot(self, a: list[Chunk], b: list[Chunk]) -> str:
        """Write the scalar product of two vectors: chunks first, then halves of them."""
        sums: dict[int, list[str]] = {}
        for k, ((x, width), (y, _)) in enumerate(zip(a, b, strict=True)):
            parts = sums.setdefault(width, [])
            if is_zero(x) or is_zero(y):
                continue
            if len(parts) < 4:
                parts.append(self.binary("fmul", x, y, width))
            else:
                parts[k % 4] = self.accumulate(parts[k % 4], x, y, width)
        while sums:
            width = max(sums)
            parts = sums.pop(width)
            if not parts:
                continue
            value, *others = parts
            for other in others:
                value = self.binary("fadd", value, other, width)
            if width == 1:
                return value
            sums.setdefault(width // 2, []).insert(0, self._folded(value, width))
        return literal(0.0)

    def _folded(self, value: str, width: int) -> str:
        """The lower half of a chunk plus its upper half."""
        half = width // 2
        if half == 1:
            low, high = (self.value(f"extractelement {type_of(width)} {value}, i32 {k}") for k in (0, 1))
        else:
            low, high = (self._shuffle(value, width, range(first, first + half)) for first in (0, half))
        return self.binary("fadd", low, high, half)

    def _shuffle(self, chunk: str, width: int, entries: Sequence[int]) -> str:
        return self._joined(chunk, "poison", width, entries)

    def _joined(self, chunk: str, other: str, width: int, entries: Sequence[int]) -> str:
        mask, kind = ", ".join(f"i32 {k}" for k in entries), type_of(width)
        return self.value(f"shufflevector {kind} {chunk}, {kind} {other}, <{len(entries)} x i32> <{mask}>")

    def multiply_diagonal(self, diagonal: Array, vector: list[Chunk]) -> list[Chunk]:
        """Write a constant diagonal matrix times a vector."""
        return self.multiply_entries(self.constant(diagonal), vector)

    def multiply_entries(self, one: list[Chunk], other: list[Chunk]) -> list[Chunk]:
        """Write the products of the entries of two vectors."""
        pairs = zip(one, other, strict=True)
        return [(self.binary("fmul", a, b, width), width) for (a, width), (b, _) in pairs]

    def multiply_matrix(self, matrix: Array, vector: list[Chunk]) -> list[Chunk]:
        """Write a constant matrix times a vector: without a loop, or by blocks of rows that are summed in registers.

        Where groups of rows share few columns, as of a rotor's blades, only products with these are written.
        """
        widths = chunk_widths(len(matrix), self._register)
        if matrix.shape[1] <= UNROLLED:
            return self._multiply_unrolled(matrix, vector, widths)
        order = order_of_groups(matrix)
        groups = [matrix[order[at : at + self._register]] for at in range(0, len(matrix), self._register)]
        count = sum(np.count_nonzero(rows.any(axis=0)) for rows in groups)
        if count <= min(MOST_GROUPED, len(groups) * matrix.shape[1] // 2):
            return self._multiply_in_groups(groups, self._stored(vector), np.argsort(order).tolist(), widths)
        columns = np.zeros((matrix.shape[1], sum(widths)))
        columns[:, : len(matrix)] = matrix.T
        table, stored, out = self.table(columns), self._stored(vector), list[Chunk]()
        for first in range(0, len(widths), ACCUMULATORS):
            block = widths[first : first + ACCUMULATORS]
            out += self._multiply_block(table, stored, columns.shape, sum(widths[:first]), block)
        return out

    def _multiply_unrolled(self, matrix: Array, vector: list[Chunk], widths: list[int]) -> list[Chunk]:
        """Column by column, each entry of the vector spread over a chunk of rows."""
        columns, out = [self.constant(column) for column in matrix.T], []
        for k, width in enumerate(widths):
            total: str | None = None
            for place, column in enumerate(columns):
                if not is_zero(column[k][0]):
                    total = self.accumulate(total, column[k][0], self.entry(vector, place, width), width)
            out.append((total or zero(width), width))
        return out

    def _multiply_in_groups(
        self, groups: list[Array], vector: str, places: list[int], widths: list[int]
    ) -> list[Chunk]:
        """By groups of rows, each with the columns in which it has entries; what they give comes to its place."""
        whole, found = self._register, list[str]()
        for rows in groups:
            padded = np.zeros((whole, rows.shape[1]))
            padded[: len(rows)] = rows
            totals: list[str | None] = [None, None]  # neither waits for the other
            for k, column in enumerate(np.flatnonzero(rows.any(axis=0)).tolist()):
                where = self.value(f"getelementptr double, ptr {vector}, i64 {column}")
                factor = self.splat(self.value(f"load double, ptr {where}, align 8"), whole)
                totals[k % 2] = self.accumulate(totals[k % 2], self.constant(padded[:, column])[0][0], factor, whole)
            one, other = (total or zero(whole) for total in totals)
            found.append(self.binary("fadd", one, other, whole))
        return self._entries(found, places, widths)

    def _entries(self, chunks: list[str], places: list[int], widths: list[int]) -> list[Chunk]:
        """Write the vector of some entries of whole chunks, and of zeros where its last chunk is padded."""
        size, out = self._register, list[Chunk]()
        while len(chunks) > 1:
            pairs = zip(chunks[::2], [*chunks[1::2], "zeroinitializer"], strict=False)
            chunks = [self._joined(one, other, size, range(2 * size)) for one, other in pairs]
            size *= 2
        for k, width in enumerate(widths):
            own = places[sum(widths[:k]) :][:width]
            if width == 1:
                out.append((self.value(f"extractelement {type_of(size)} {chunks[0]}, i32 {own[0]}"), 1))
            else:
                padding = range(size, size + width - len(own))
                out.append((self._joined(chunks[0], "zeroinitializer", size, [*own, *padding]), width))
        return out

    def _multiply_block(
        self, table: str, vector: str, shape: tuple[int, ...], first: int, widths: list[int]
    ) -> list[Chunk]:
        """A loop over some columns at a time: as many as the block's chunks leave accumulators for."""
        n_columns, stride = shape
        at_once = max(1, ACCUMULATORS // len(widths))
        looped = n_columns - n_columns % at_once
        totals = [[zero(width)] * at_once for width in widths]
        counter, label, after, before = self.name(), *self.new_loop()
        following = self.name()
        phis = [[(self.name(), self.name()) for _ in range(at_once)] for _ in widths]
        self.lines.append(f"{counter} = phi i64 [ 0, %{before} ], [ {following}, %{label} ]")
        for width, row in zip(widths, phis, strict=True):
            for value, updated in row:
                start = f"[ {zero(width)}, %{before} ]"
                self.lines.append(f"{value} = phi {type_of(width)} {start}, [ {updated}, %{label} ]")
        for side in range(at_once):
            column = self.value(f"add i64 {counter}, {side}")
            for k, (width, entries, factor) in enumerate(self._column(table, vector, column, stride, first, widths)):
                value, updated = phis[k][side]
                product = self.binary("fmul", entries, factor, width)
                self.lines.append(f"{updated} = fadd contract {type_of(width)} {value}, {product}")
                totals[k][side] = updated
        self.lines.append(f"{following} = add i64 {counter}, {at_once}")
        self.end_loop(f"icmp slt i64 {following}, {looped}", label, after)
        for number in range(looped, n_columns):
            column = self.value(f"add i64 {number}, 0")
            for k, (width, entries, factor) in enumerate(self._column(table, vector, column, stride, first, widths)):
                totals[k][0] = self.accumulate(totals[k][0], entries, factor, width)
        out = []
        for width, parts in zip(widths, totals, strict=True):
            value = parts[0]
            for part in parts[1:]:
                value = self.binary("fadd", value, part, width)
            out.append((value, width))
        return out

    def _column(
        self, table: str, vector: str, column: str, stride: int, first: int, widths: list[int]
    ) -> list[tuple[int, str, str]]:
        """Widths and values of a column's chunks, and the vector's entry spread over each."""
        where = self.value(f"getelementptr double, ptr {vector}, i64 {column}")
        factor, row = self.value(f"load double, ptr {where}, align 8"), self.value(f"mul i64 {column}, {stride}")
        out = []
        for width in widths:
            place = self.value(f"add i64 {row}, {first}")
            where = self.value(f"getelementptr double, ptr {table}, i64 {place}")
            entries = self.load_constant(where, width)
            out.append((width, entries, self.splat(factor, width)))
            first += width
        return out

    def _stored(self, vector: list[Chunk]) -> str:
        """A vector's copy in memory, where a loop reads it entry by entry."""
        key = repr(vector)
        if key not in self._in_memory:
            name, first = self.name(), 0
            self.room.append(f"{name} = alloca [{sum(width for _, width in vector)} x double], align 64")
            for value, width in vector:
                at = self.value(f"getelementptr double, ptr {name}, i64 {first}")
                self.lines.append(f"store {type_of(width)} {value}, ptr {at}, align 8")
                first += width
            self._in_memory[key] = name
        return self._in_memory[key]

"""Lines of one function in LLVM's language: its blocks, its values, and its variables, which LLVM makes registers."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from fmd.kernels.types import REAL, TRUTH, WHOLE, ArrayType, TupleType, Type, llvm_type


class NotInSubset(TypeError):  # noqa: N818 - it says what is wrong
    """A function does something that kernels can't."""

    placed = False  # whether the message has file and line


class Value(NamedTuple):
    """A value by its type and its text in LLVM's language.

    An array also has the texts of its dimensions, a tuple is its parts. A variable is alike, but for the texts, which
    are those of the memory that holds it.
    """

    type: Type
    text: str
    shape: tuple[str, ...] = ()
    parts: tuple[Value, ...] = ()

    def words(self, flag: str = "") -> list[str]:
        """Return the words that a function takes for the value: of an array an address and dimensions."""
        if isinstance(self.type, TupleType):
            raise NotInSubset("a tuple is no argument")
        return [f"{llvm_type(self.type)}{flag} {self.text}", *(f"i64 {n}" for n in self.shape)]

    @property
    def known(self) -> int | None:
        """The number, or truth, that the value always is; None if it isn't known."""
        if self.type == TRUTH:
            return {"true": True, "false": False}.get(self.text)
        return int(self.text) if self.type == WHOLE and not self.text.startswith("%") else None


def whole(number: int) -> Value:
    """Return a known integer, in two's complement of 64 bits."""
    return Value(WHOLE, str((number + 2**63) % 2**64 - 2**63))


def real(number: float) -> Value:
    """Return a known double."""
    return Value(REAL, f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}")


def tuple_of(parts: tuple[Value, ...]) -> Value:
    """Return the tuple of some values."""
    return Value(TupleType(tuple(part.type for part in parts)), "", (), parts)


class BlockWriter:
    """Collects the lines of a function, whose products and sums may be contracted to one rounding.

    Files and lines of bounds checks are noted if a list for them is given; by default none is made.
    """

    def __init__(self, contracted: bool, checks: list[tuple[str, int]] | None = None) -> None:
        self.flags, self.checks = (" contract" if contracted else ""), checks
        self.place = ("", 0)  # file and line of the statement that is being written
        self.lines: list[str] = []
        self.variables: list[str] = []
        self.is_open = True  # the present block has no end yet
        self._count = 0

    def new(self, name: str) -> str:
        """Return a name that nothing else has."""
        self._count += 1
        return f"{name}.{self._count}"

    def line(self, text: str) -> None:
        """Write a line; what stands after the end of a block is never reached."""
        if self.is_open:
            self.lines.append(text)

    def value(self, kind: Type, instruction: str) -> Value:
        """Write an instruction, and return its result."""
        name = "%" + self.new("x")
        self.line(f"{name} = {instruction}")
        return Value(kind, name)

    def label(self, name: str) -> None:
        """Begin a block."""
        self.is_open = True
        self.lines.append(f"{name}:")

    def jump(self, label: str, about: str = "") -> None:
        """End the block; ``about`` is what LLVM is told of the jump."""
        self.line(f"br label %{label}{about}")
        self.is_open = False

    def branch(self, test: Value, yes: str, no: str) -> None:
        """End the block by a test."""
        self.line(f"br i1 {test.text}, label %{yes}, label %{no}")
        self.is_open = False

    @contextmanager
    def aside(self) -> Iterator[list[str]]:
        """Collect lines apart from the others."""
        kept, self.lines = self.lines, []
        try:
            yield self.lines
        finally:
            self.lines = kept

    def reserve(self, kind: str) -> str:
        """Reserve memory for a number, 0 at first."""
        name = "%" + self.new("v")
        self.variables += [f"{name} = alloca {kind}", f"store {kind} zeroinitializer, ptr {name}"]
        return name

    def variable(self, kind: Type) -> Value:
        """Return a new variable."""
        if isinstance(kind, TupleType):
            return tuple_of(tuple(self.variable(member) for member in kind.members))
        shape = tuple(self.reserve(WHOLE) for _ in range(kind.n_axes)) if isinstance(kind, ArrayType) else ()
        return Value(kind, self.reserve(llvm_type(kind)), shape)

    def load(self, variable: Value) -> Value:
        """Return the value of a variable."""
        if isinstance(variable.type, TupleType):
            return tuple_of(tuple(self.load(part) for part in variable.parts))
        shape = tuple(self.value(WHOLE, f"load i64, ptr {n}").text for n in variable.shape)
        text = self.value(variable.type, f"load {llvm_type(variable.type)}, ptr {variable.text}").text
        return Value(variable.type, text, shape)

    def store(self, variable: Value, value: Value) -> None:
        """Set a variable to a value of its type."""
        for part, x in zip(variable.parts, value.parts, strict=True):
            self.store(part, x)
        if not variable.parts:
            self.line(f"store {llvm_type(value.type)} {value.text}, ptr {variable.text}")
        for place, n in zip(variable.shape, value.shape, strict=True):
            self.line(f"store i64 {n}, ptr {place}")

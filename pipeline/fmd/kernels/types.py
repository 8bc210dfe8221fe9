"""Types of the values in kernels, called as LLVM calls them where it has them."""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from fmd.core.data_classes import dataclass

REAL, WHOLE, TRUTH, NOTHING = "double", "i64", "i1", "void"
_NAMES = {REAL: "float", WHOLE: "int", TRUTH: "bool", NOTHING: "None"}


class ArrayType(NamedTuple):  # whose hash takes a tenth of a dataclass's: each call of a kernel looks types up
    """C-contiguous array of doubles or of 64-bit integers."""

    entry: str
    n_axes: int


@dataclass(frozen=True)
class TupleType:
    """Several values."""

    members: tuple[Type, ...]


@dataclass(frozen=True, eq=False)  # `table_type` makes one for equal members
class TableType:
    """A `Table` by its class and its members' types in the order of its words.

    A member that is true or false is its own type: a kernel is compiled for it, and what it never does costs nothing.
    """

    table: type
    members: tuple[tuple[str, Type | bool], ...]

    def find(self, name: str) -> tuple[int, Type | bool]:
        """Return the number of the word at which a member begins, and its type."""
        word = 0
        for member, kind in self.members:
            if member == name:
                return word, kind
            word += 1 + kind.n_axes if isinstance(kind, ArrayType) else 1
        raise AttributeError(f"{self.table.__name__} has no member {name}")

    def __repr__(self) -> str:
        return f"{self.table.__module__}.{self.table.__qualname__}{self.members}"


Type = str | ArrayType | TupleType | TableType


@dataclass(frozen=True)
class Compiling:
    """How a function is compiled: into each of its callers or where LLVM finds that it pays, and contracted or not."""

    inlined: bool = False
    contracted: bool = False
    unrolled: bool = False  # rounds of its innermost loops go several at a time


@cache
def array_type(dtype: np.dtype[Any], n_axes: int) -> ArrayType | None:
    """Return the type of arrays, None if kernels take none of such entries."""
    entry = {np.dtype(np.float64): REAL, np.dtype(np.int64): WHOLE}.get(dtype)
    return None if entry is None else ArrayType(entry, n_axes)


@cache
def member_names(table: Any) -> tuple[str, ...]:
    """Return the names of a table's members in their order."""
    return tuple(member.name for member in fields(table))


@cache
def table_type(table: type, kinds: tuple[Type | bool, ...]) -> TableType:
    """Return the type of tables of a class with members of such types."""
    return TableType(table, tuple(zip(member_names(table), kinds, strict=True)))


def type_of(x: Any) -> Type:
    """Return the type of a value that Python hands to a kernel.

    Raises
    ------
    TypeError
        Kernels take no such values.
    """
    if isinstance(x, np.ndarray):
        kind = array_type(x.dtype, x.ndim)
        if kind is None or not (x.flags.c_contiguous and x.flags.aligned):
            raise TypeError("must be a C-contiguous array of 64-bit numbers")
        return kind
    if (table := getattr(x, "kernel_type", None)) is not None:
        return table  # type: ignore[no-any-return]
    if isinstance(x, bool | np.bool_):
        return TRUTH
    if isinstance(x, int | np.integer):
        return WHOLE
    if isinstance(x, float):
        return REAL
    raise TypeError(f"must be a number, an array or a Table, not {type(x).__name__}")


def width_of(kind: Type) -> int:
    """Return how many doubles a vector holds; 0 if the type is no vector's."""
    return int(kind[1 : kind.index(" ")]) if isinstance(kind, str) and kind.startswith("<") else 0


def vector_type(width: int) -> str:
    """Return the type of so many doubles at once."""
    return f"<{width} x double>" if width > 1 else REAL


def llvm_type(kind: Type) -> str:
    """Return how LLVM calls a type: an array and a table are pointers there."""
    if isinstance(kind, TupleType):
        return "{" + ", ".join(llvm_type(member) for member in kind.members) + "}"
    return kind if isinstance(kind, str) else "ptr"


def name_of(kind: Type) -> str:
    """Return how Python calls a type, for messages."""
    if isinstance(kind, ArrayType):
        return f"array of {_NAMES[kind.entry]} with {kind.n_axes} axes"
    if isinstance(kind, TableType):
        return kind.table.__name__
    if isinstance(kind, TupleType):
        return f"({', '.join(name_of(member) for member in kind.members)})"
    return _NAMES.get(kind, f"vector {kind}")

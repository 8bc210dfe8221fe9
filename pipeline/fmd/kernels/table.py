"""Parameters of a mechanism that kernels take by one address, and arrays that begin cache lines."""

from __future__ import annotations

from ctypes import addressof, c_char
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.code import DOUBLES_IN_LINE
from fmd.kernels.types import TableType, member_names, table_type, type_of

_WORD = 8  # bytes


def whole_lines(size: int) -> int:
    """Return how many doubles the cache lines have that hold so many."""
    return -(-size // DOUBLES_IN_LINE) * DOUBLES_IN_LINE


def aligned(*sizes: int) -> list[Array]:
    """Zeroed vectors that each begin a cache line: straddling one costs a small kernel a third of its speed."""
    lines = [whole_lines(size) for size in sizes]
    block, start, vectors = _whole_block(sum(lines), np.float64), 0, list[Array]()
    for size, line in zip(sizes, lines, strict=True):
        vectors.append(block[start : start + size])
        start += line
    return vectors


def _whole_block(size: int, dtype: type) -> Any:
    """Return zeros that begin a cache line."""
    block: Any = np.zeros(size + DOUBLES_IN_LINE, dtype=dtype)
    first = -(address_of(block) // _WORD) % DOUBLES_IN_LINE
    return block[first : first + size]


class _Plan(NamedTuple):
    """Parts that copies of a table are made of: words, the content of arrays in lines, and where each of them is."""

    words: IntArray
    content: IntArray
    pointers: IntArray  # numbers of the words that are arrays' addresses
    offsets: IntArray  # of each array in the content [bytes]
    first: dict[str, int]  # word of the content at which each array begins
    tables: dict[str, tuple[int, Table]]  # numbers of the words that are tables' addresses, and these
    plain: dict[str, float]  # numbers, of which the class may have others as defaults


class Table:
    """Base of frozen dataclasses whose members are C-contiguous arrays, numbers and other tables.

    Kernels read the members by name. Members don't change; what is in the arrays may.

    Raises
    ------
    ValueError
        An array is not contiguous, or not of 64-bit numbers.
    """

    def __post_init__(self) -> None:
        for name, x in self._members.items():
            if isinstance(x, np.ndarray) and not (x.flags.c_contiguous and x.flags.aligned and x.itemsize == _WORD):
                raise ValueError(f"{name} must be a C-contiguous array of 64-bit numbers")

    def __reduce__(self) -> tuple[Any, ...]:
        """Make copies anew: addresses are this object's own."""
        return type(self), tuple(self._members.values())

    @cached_property
    def _members(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in member_names(type(self))}  # type: ignore[arg-type]

    @cached_property
    def kernel_type(self) -> TableType:
        """Class, and types of the members."""
        return table_type(type(self), tuple(_kind(x) for x in self._members.values()))  # type: ignore[arg-type]

    @cached_property
    def _words(self) -> IntArray:
        return np.array([word for x in self._members.values() for word in _words_of(x)], dtype=np.int64)

    @cached_property
    def address(self) -> int:
        """Where kernels find the members."""
        return int(self._words.ctypes.data)

    def renewed(self) -> Self:
        """Return a table with equal members whose arrays are its own, as they were when this was first called.

        It takes a tenth of the time that making one of its members does, which is longer than many a march: arrays are
        copied in one block, in which each begins a cache line, and Python sees them only where it asks for them.
        """
        plan = self._plan
        block, words = _whole_block(plan.content.size, np.int64), plan.words.copy()
        block[:] = plan.content
        words[plan.pointers] = plan.offsets + address_of(block)
        copy = object.__new__(type(self))
        known = copy.__dict__
        known |= plan.plain
        for name, (word, table) in plan.tables.items():
            known[name] = table.renewed()
            words[word] = known[name].address
        known["_source"], known["_block"] = self, block
        known["kernel_type"], known["_words"], known["address"] = self.kernel_type, words, address_of(words)
        return copy

    def __getattr__(self, name: str) -> Any:
        """Make a member of a renewed table when it is first asked for."""
        source = self.__dict__.get("_source")
        if source is None or name not in source._members:
            raise AttributeError(f"{type(self).__name__} has no member {name}")
        x = source._members[name]
        if isinstance(x, np.ndarray):
            first = source._plan.first[name]
            view = self._block[first : first + x.size].view(x.dtype).reshape(x.shape)
            view.flags.writeable = x.flags.writeable
            x = view
        self.__dict__[name] = x
        return x

    @cached_property
    def _plan(self) -> _Plan:
        first, tables = dict[str, int](), dict[str, tuple[int, Table]]()
        plain = {name: x for name, x in self._members.items() if not isinstance(x, np.ndarray | Table)}
        pointers, pieces, word, size = [], [np.zeros(0, dtype=np.int64)], 0, 0
        for name, x in self._members.items():
            if isinstance(x, np.ndarray):
                pointers.append(word)
                first[name] = size
                pieces += [x.view(np.int64).ravel(), np.zeros(-x.size % DOUBLES_IN_LINE, dtype=np.int64)]
                size += x.size + -x.size % DOUBLES_IN_LINE
            elif isinstance(x, Table):
                tables[name] = word, x
            word += 1 + x.ndim if isinstance(x, np.ndarray) else 1
        offsets = _WORD * np.array([*first.values()], dtype=np.int64)
        at = np.array(pointers, dtype=np.int64)
        return _Plan(self._words.copy(), np.concatenate(pieces), at, offsets, first, tables, plain)


def address_of(x: Array | IntArray) -> int:
    """Return where an array's entries begin."""
    try:
        return addressof(c_char.from_buffer(x))  # type: ignore[arg-type]
    except (TypeError, ValueError):  # read-only or empty; of any array this takes four times as long
        return int(x.__array_interface__["data"][0])


def _words_of(x: Any) -> list[int]:
    """Return the words that hold a member: of an array its address and its shape."""
    if isinstance(x, Table):
        return [x.address]
    if isinstance(x, np.ndarray):
        return [address_of(x), *x.shape]
    return [int(np.float64(x).view(np.int64)) if isinstance(x, float) else int(x)]


def _kind(x: Any) -> Any:
    """Return a member's type; a truth is its own."""
    return bool(x) if isinstance(x, bool | np.bool_) else type_of(x)

"""Parameters of a mechanism that kernels take by one address.

Numba hands a tuple on by its members: fifty arrays are four hundred arguments in each call of each kernel, and
compiling those took longer than compiling all arithmetic. A `Table` is one argument, and a kernel loads what it names.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators, allow-subclassing-any

from __future__ import annotations

from ctypes import addressof, c_char
from dataclasses import fields
from functools import cache, cached_property
from typing import Any, NamedTuple, Self

import numpy as np

import fmd.dynamics.jit.compiled  # noqa: F401 - sets Numba up, so it comes first
from fmd.core.arrays import Array, IntArray

# isort: split
import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, lower_getattr_generic, models, register_model, unbox

_WORD = 8  # bytes
_LINE = 8  # words


class _Plan(NamedTuple):
    """Parts that copies of a table are made of: words, the content of arrays in lines, and where each of them is."""

    words: IntArray
    content: IntArray
    pointers: IntArray  # numbers of the words that are arrays' addresses
    offsets: IntArray  # of each array in the content [bytes]
    first: dict[str, int]  # word of the content at which each array begins
    tables: dict[str, tuple[int, Table]]  # numbers of the words that are tables' addresses, and these


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
        return {name: getattr(self, name) for name in _names(type(self))}  # type: ignore[arg-type]

    @cached_property
    def _numba_type_(self) -> TableType:
        return _table_type(type(self), tuple(_kind(x) for x in self._members.values()))  # type: ignore[arg-type]

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
        block = np.empty(plan.content.size + _LINE, dtype=np.int64)
        first = -(_address_of(block) // _WORD) % _LINE
        block[first : first + plan.content.size] = plan.content
        words = plan.words.copy()
        words[plan.pointers] = plan.offsets + (_address_of(block) + _WORD * first)
        copy = object.__new__(type(self))
        known = copy.__dict__
        for name, (word, table) in plan.tables.items():
            known[name] = table.renewed()
            words[word] = known[name].address
        known["_source"], known["_block"] = self, block[first:]
        known["_numba_type_"], known["_words"], known["address"] = self._numba_type_, words, _address_of(words)
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
        first: dict[str, int] = {}
        tables: dict[str, tuple[int, Table]] = {}
        pointers, pieces, word, size = [], [np.zeros(0, dtype=np.int64)], 0, 0
        for name, x in self._members.items():
            if isinstance(x, np.ndarray):
                pointers.append(word)
                first[name] = size
                pieces += [x.view(np.int64).ravel(), np.zeros(-x.size % _LINE, dtype=np.int64)]
                size += x.size + -x.size % _LINE
            elif isinstance(x, Table):
                tables[name] = word, x
            word += 1 + x.ndim if isinstance(x, np.ndarray) else 1
        offsets = _WORD * np.array([*first.values()], dtype=np.int64)
        at = np.array(pointers, dtype=np.int64)
        return _Plan(self._words.copy(), np.concatenate(pieces), at, offsets, first, tables)


def _address_of(x: Array | IntArray) -> int:
    try:
        return addressof(c_char.from_buffer(x))  # type: ignore[arg-type]
    except (TypeError, ValueError):  # read-only or empty; of any array this takes four times as long
        return int(x.__array_interface__["data"][0])


def _words_of(x: Any) -> list[int]:
    """Return the words that hold a member: of an array its address and its shape."""
    if isinstance(x, Table):
        return [x.address]
    if isinstance(x, np.ndarray):
        return [_address_of(x), *x.shape]
    return [int(np.float64(x).view(np.int64)) if isinstance(x, float) else int(x)]


class TableType(types.Type):
    """Type of a `Table` in kernels: its class, and its members' names and types in their order."""

    def __init__(self, instance_class: type[Table], members: tuple[tuple[str, Any], ...]) -> None:
        self.instance_class, self.members = instance_class, members
        super().__init__(name=instance_class.__name__)

    @property
    def key(self) -> Any:
        """Class and members, by which Numba compares types."""
        return self.instance_class, self.members

    def word(self, name: str) -> int:
        """Number of the word at which a member begins."""
        at = 0
        for member, kind in self.members:
            if member == name:
                return at
            at += 1 + kind.ndim if isinstance(kind, types.Array) else 1
        raise AttributeError(name)


register_model(TableType)(models.OpaqueModel)


def _kind(x: Any) -> Any:
    """Return a member's kind: Numba's own look at each of fifty arrays takes longer than many a march."""
    if isinstance(x, np.ndarray):
        return x.dtype, x.ndim, x.flags.writeable
    return x._numba_type_ if isinstance(x, Table) else numba.typeof(x)


@cache
def _table_type(table: Any, kinds: tuple[Any, ...]) -> TableType:
    return TableType(table, tuple((name, _typed(kind)) for name, kind in zip(_names(table), kinds, strict=True)))


@cache
def _names(table: Any) -> tuple[str, ...]:
    """Return the names of a table's members in their order."""
    return tuple(member.name for member in fields(table))


def _typed(kind: Any) -> Any:
    if not isinstance(kind, tuple):
        return kind
    dtype, n_dimensions, writeable = kind
    return types.Array(numba.from_dtype(dtype), n_dimensions, "C", readonly=not writeable)


@unbox(TableType)
def _unbox(kind: TableType, value: Any, c: Any) -> Any:
    number = c.pyapi.object_getattr_string(value, "address")
    pointer = c.pyapi.long_as_voidptr(number)
    c.pyapi.decref(number)
    return NativeValue(pointer)


@infer_getattr
class _Members(AttributeTemplate):
    key = TableType

    def generic_resolve(self, kind: TableType, name: str) -> Any:  # type: ignore[override]
        return dict(kind.members).get(name)


@lower_getattr_generic(TableType)
def _load_member(context: Any, builder: Any, table: TableType, pointer: Any, name: str) -> Any:
    """Load a member; nothing in a table changes while a kernel runs, so that a loop needs it once."""
    kind, first, integer = dict(table.members)[name], table.word(name), ir.IntType(64)

    def load(word: int, as_type: Any) -> Any:
        place = cgutils.pointer_add(builder, pointer, _WORD * (first + word), as_type.as_pointer())
        value = builder.load(place)
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value

    if isinstance(kind, types.Boolean):
        return builder.icmp_unsigned("!=", load(0, integer), integer(0))
    if not isinstance(kind, types.Array):
        return load(0, context.get_value_type(kind))
    array = context.make_array(kind)(context, builder)
    shape = [load(1 + axis, integer) for axis in range(kind.ndim)]
    strides = [integer(_WORD)]
    for n in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], n))
    array.data, array.itemsize = load(0, array.data.type), integer(_WORD)
    array.nitems = builder.udiv(builder.mul(strides[0], shape[0]), integer(_WORD))
    array.shape, array.strides = cgutils.pack_array(builder, shape), cgutils.pack_array(builder, strides)
    array.meminfo, array.parent = (cgutils.get_null_value(x.type) for x in (array.meminfo, array.parent))
    return array._getvalue()

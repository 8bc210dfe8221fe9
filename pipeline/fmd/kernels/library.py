"""Functions of Python, `math` and NumPy that kernels call; vectors, and calls of machine code by address.

Each is written by a function of the writer and the values of its arguments.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fmd.kernels.arithmetic import common_type, compare, convert, truth
from fmd.kernels.places import find_vector, size_of
from fmd.kernels.types import NOTHING, REAL, TRUTH, WHOLE, ArrayType, TupleType, name_of, vector_type, width_of
from fmd.kernels.vectors import call_native, fill_vector, read_entries, read_vector, write_vector
from fmd.kernels.writer import BlockWriter, NotInSubset, Value, real

Write = Callable[[BlockWriter, Sequence[Value]], Value]

_INTRINSICS = {"sqrt": 1, "fabs": 1, "floor": 1, "ceil": 1, "copysign": 2}  # with their numbers of arguments
_ONE = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "expm1", "log", "log1p")
_C_LIBRARY = dict.fromkeys(_ONE, 1) | {"atan2": 2, "hypot": 2, "nextafter": 2, "pow": 2}


def _known_width(width: Value) -> int:
    if width.known is None:
        raise NotInSubset("a vector's width is a number that is known when the kernel is compiled")
    return width.known


def _read_vector(w: BlockWriter, x: Sequence[Value]) -> Value:
    place = find_vector(w, x[0], x[1], _known_width(x[2]))
    return w.value(place.type, f"load {place.type}, ptr {place.text}, align 8")


def _read_entries(w: BlockWriter, x: Sequence[Value]) -> Value:
    width = _known_width(x[2])
    place, kind, text = find_vector(w, x[0], x[1], width), vector_type(width), "poison"
    for k in range(width):  # atomic, or LLVM would join them
        at = w.value("ptr", f"getelementptr double, ptr {place.text}, i64 {k}").text
        entry = w.value(REAL, f"load atomic double, ptr {at} unordered, align 8").text
        text = w.value(kind, f"insertelement {kind} {text}, double {entry}, i32 {k}").text if width > 1 else entry
    return Value(kind, text)


def _fill_vector(w: BlockWriter, x: Sequence[Value]) -> Value:
    return convert(w, x[0], vector_type(_known_width(x[1])))


def _write_vector(w: BlockWriter, x: Sequence[Value]) -> Value:
    place = find_vector(w, x[0], x[1], max(1, width_of(x[2].type)))
    w.line(f"store {place.type} {x[2].text}, ptr {place.text}, align 8")
    return Value(NOTHING, "")


def _call_native(w: BlockWriter, x: Sequence[Value]) -> Value:
    for array in x[1].parts:
        if not isinstance(array.type, ArrayType):
            raise NotInSubset(f"{name_of(array.type)} is no array")
    pointer = w.value("ptr", f"inttoptr i64 {x[0].text} to ptr").text
    w.line(f"call void {pointer}({', '.join(f'ptr {array.text}' for array in x[1].parts)})")
    return Value(NOTHING, "")


def _called(name: str, n: int) -> Write:
    def write(w: BlockWriter, x: Sequence[Value]) -> Value:
        if len(x) != n:
            raise NotInSubset(f"{name} takes {n} numbers")
        words = ", ".join(f"double {convert(w, each, REAL).text}" for each in x)
        return w.value(REAL, f"call{w.flags} double @{name}({words})")

    return write


def _best_of(name: str) -> Write:
    """Take the first value unless a later one is better, so that of two with a NaN the first one stays."""

    def write(w: BlockWriter, x: Sequence[Value]) -> Value:
        if len(x) < 2:
            raise NotInSubset("min and max take several numbers")
        best = x[0]
        for other in x[1:]:
            kind = common_type(best.type, other.type)
            best, one = convert(w, best, kind), convert(w, other, kind)
            better = compare(w, name, one, best)
            best = w.value(kind, f"select i1 {better.text}, {kind} {one.text}, {kind} {best.text}")
        return best

    return write


def _absolute(w: BlockWriter, x: Sequence[Value]) -> Value:
    if x[0].type in (WHOLE, TRUTH):
        return w.value(WHOLE, f"call i64 @llvm.abs.i64(i64 {convert(w, x[0], WHOLE).text}, i1 false)")
    return _called("llvm.fabs.f64", 1)(w, x)


def _integer(w: BlockWriter, x: Sequence[Value]) -> Value:
    """Cut a double down towards 0, and to the nearest integer that there is; 0 if it is not a number."""
    if x[0].type == REAL:
        return w.value(WHOLE, f"call i64 @llvm.fptosi.sat.i64.f64(double {x[0].text})")
    return convert(w, x[0], WHOLE)


def _is_nan(w: BlockWriter, x: Sequence[Value]) -> Value:
    number = convert(w, x[0], REAL).text
    return w.value(TRUTH, f"fcmp uno double {number}, {number}")


def _is_finite(w: BlockWriter, x: Sequence[Value]) -> Value:
    return w.value(TRUTH, f"fcmp olt double {_absolute(w, [convert(w, x[0], REAL)]).text}, {real(math.inf).text}")


def _length(w: BlockWriter, x: Sequence[Value]) -> Value:
    if isinstance(x[0].type, TupleType):
        return Value(WHOLE, str(len(x[0].parts)))
    return Value(WHOLE, x[0].shape[0]) if x[0].shape else size_of(w, x[0])


def _rounded(name: str) -> Write:
    """Round to an integer, which Python's own functions return."""
    return lambda w, x: _integer(w, [_called(f"llvm.{name}.f64", 1)(w, x)])


FUNCTIONS: dict[Any, Write] = {
    read_vector: _read_vector,
    read_entries: _read_entries,
    fill_vector: _fill_vector,
    write_vector: _write_vector,
    call_native: _call_native,
    min: _best_of("lt"),
    max: _best_of("gt"),
    abs: _absolute,
    np.abs: _absolute,
    float: lambda w, x: convert(w, x[0], REAL),
    int: _integer,
    bool: lambda w, x: truth(w, x[0]),
    len: _length,
}
"""What kernels call, each with the function that writes it."""

for _module, _isnan, _isfinite in ((math, math.isnan, math.isfinite), (np, np.isnan, np.isfinite)):
    FUNCTIONS |= {_isnan: _is_nan, _isfinite: _is_finite}
    for _name, _n in (_INTRINSICS | _C_LIBRARY).items():
        if _function := getattr(_module, _name, None):
            FUNCTIONS[_function] = _called(f"llvm.{_name}.f64" if _name in _INTRINSICS else _name, _n)

FUNCTIONS |= {math.floor: _rounded("floor"), math.ceil: _rounded("ceil")}

DECLARATIONS = "\n".join(
    [
        *(f"declare double @llvm.{name}.f64({', '.join(['double'] * n)})" for name, n in _INTRINSICS.items()),
        *(f"declare double @{name}({', '.join(['double'] * n)})" for name, n in _C_LIBRARY.items()),
        "declare i64 @llvm.abs.i64(i64, i1)",
        "declare i64 @llvm.fptosi.sat.i64.f64(double)",
    ]
)
"""Of the functions that LLVM and the C library have."""

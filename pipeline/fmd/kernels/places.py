"""Entries, rows and slices of arrays in kernels, checked against the bounds where the writer is asked for that.

What is out of bounds is noted, and read and written elsewhere, so that the kernel ends and its caller can tell.
"""

import ast
from collections.abc import Sequence

from fmd.kernels.arithmetic import all_of, compute
from fmd.kernels.types import REAL, TRUTH, WHOLE, ArrayType, vector_type
from fmd.kernels.writer import BlockWriter, NotInSubset, Value, whole

CHECKS = """
@fault = global [3 x i64] zeroinitializer
@elsewhere = internal global [8 x double] zeroinitializer
define internal i1 @within(i64 %place, i64 %index, i64 %size) {
  %fine = icmp ult i64 %index, %size
  %before = load i64, ptr @fault
  %later = icmp ne i64 %before, 0
  %silent = or i1 %fine, %later
  br i1 %silent, label %done, label %note
note:
  store i64 %place, ptr @fault
  %second = getelementptr i64, ptr @fault, i64 1
  store i64 %index, ptr %second
  %third = getelementptr i64, ptr @fault, i64 2
  store i64 %size, ptr %third
  br label %done
done:
  ret i1 %fine
}
"""
"""What checked kernels note a fault with: where it is, the index, and the size that it passes."""


def size_of(w: BlockWriter, x: Value) -> Value:
    """Return how many entries an array has."""
    first, *others = x.shape or ("1",)
    size = Value(WHOLE, first)
    for n in others:
        size = compute(w, ast.Mult(), size, Value(WHOLE, n))
    return size


def find_entry(w: BlockWriter, x: Value, indices: Sequence[Value]) -> Value:
    """Return an entry's type and address."""
    return _find(w, x, indices)[0]


def row_of(w: BlockWriter, x: Value, indices: Sequence[Value]) -> Value:
    """Return the array that is left with some first indices fixed."""
    place, fine = _find(w, x, indices)
    shape = x.shape[len(indices) :]
    if fine is not None:
        shape = tuple(w.value(WHOLE, f"select i1 {fine.text}, i64 {n}, i64 0").text for n in shape)
    return Value(ArrayType(place.type, len(shape)), place.text, shape)  # type: ignore[arg-type]


def slice_of(w: BlockWriter, x: Value, start: Value | None, stop: Value | None) -> Value:
    """Return the rows of an array from one on up to another."""
    n = Value(WHOLE, x.shape[0])
    start = whole(0) if start is None else _from_begin(w, start, n)
    stop = n if stop is None else _from_begin(w, stop, n)
    count = compute(w, ast.Sub(), stop, start)
    if w.checks is not None:
        fine = [_within(w, k, compute(w, ast.Add(), end, whole(1))) for k, end in ((start, stop), (stop, n))]
        count = w.value(WHOLE, f"select i1 {all_of(w, fine).text}, i64 {count.text}, i64 0")
    step = _row_size(w, x, 1)
    flat = compute(w, ast.Mult(), start, step)
    place = _address(w, _entry(x), x.text, flat)
    return Value(x.type, place.text, (count.text, *x.shape[1:]))


def find_vector(w: BlockWriter, x: Value, at: Value, width: int) -> Value:
    """Return the type and the address of so many entries of an array's memory, from one on."""
    if not (isinstance(x.type, ArrayType) and x.type.entry == REAL):
        raise NotInSubset("vectors are of arrays of doubles")
    place = _address(w, REAL, x.text, at)
    if w.checks is not None:
        n, last = size_of(w, x), compute(w, ast.Add(), at, whole(width - 1))
        fine = all_of(w, [_within(w, at, n), _within(w, last, n)])
        place = w.value("ptr", f"select i1 {fine.text}, ptr {place.text}, ptr @elsewhere")
    return Value(vector_type(width), place.text)


def _find(w: BlockWriter, x: Value, indices: Sequence[Value]) -> tuple[Value, Value | None]:
    """Return the type and the address of an entry, or of a row's first one, and whether it is within bounds."""
    if len(indices) > len(x.shape):
        raise NotInSubset(f"{len(indices)} indices of an array with {len(x.shape)} axes")
    numbers = [_from_begin(w, k, Value(WHOLE, n)) for k, n in zip(indices, x.shape, strict=False)]
    flat = numbers[0]
    for number, n in zip(numbers[1:], x.shape[1:], strict=False):
        flat = _within_memory(w, "add", _within_memory(w, "mul", flat, Value(WHOLE, n)), number)
    if len(numbers) < len(x.shape):
        flat = _within_memory(w, "mul", flat, _row_size(w, x, len(numbers)))
    place = _address(w, _entry(x), x.text, flat)
    if w.checks is None:
        return place, None
    fine = all_of(w, [_within(w, k, Value(WHOLE, n)) for k, n in zip(numbers, x.shape, strict=False)])
    return Value(place.type, w.value("ptr", f"select i1 {fine.text}, ptr {place.text}, ptr @elsewhere").text), fine


def _entry(x: Value) -> str:
    assert isinstance(x.type, ArrayType)
    return x.type.entry


def _address(w: BlockWriter, entry: str, first: str, flat: Value) -> Value:
    return Value(entry, w.value("ptr", f"getelementptr inbounds {entry}, ptr {first}, i64 {flat.text}").text)


def _within_memory(w: BlockWriter, name: str, x: Value, y: Value) -> Value:
    """Return a sum or product that counts entries, and so doesn't wrap around; LLVM makes better loops of such ones."""
    return w.value(WHOLE, f"{name} nsw i64 {x.text}, {y.text}")


def _row_size(w: BlockWriter, x: Value, n_fixed: int) -> Value:
    return size_of(w, x._replace(shape=x.shape[n_fixed:]))


def _from_begin(w: BlockWriter, index: Value, n: Value) -> Value:
    """Return an index counted from the begin; a known one may count from the end."""
    if index.type != WHOLE:
        raise NotInSubset("an index is an integer")
    return compute(w, ast.Add(), n, index) if index.known is not None and index.known < 0 else index


def _within(w: BlockWriter, index: Value, n: Value) -> Value:
    assert w.checks is not None
    w.checks.append(w.place)
    return w.value(TRUTH, f"call i1 @within(i64 {len(w.checks)}, i64 {index.text}, i64 {n.text})")

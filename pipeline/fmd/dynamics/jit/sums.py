"""Weighted sums of a matrix's rows inside kernels, in pieces of eight, four, two and one entries.

LLVM makes of plain loops ones that read and write the sum for every few rows, and that first look whether arrays
overlap: with four entries to a row that takes longer than the sum. One row more, which may have been written just
before, is read entry by entry and added last: a processor can't yet read a vector where it has just written single
numbers, and waits for longer than the sum takes.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.code import ROWS_AT_ONCE
from fmd.dynamics.jit.compiled import inlined

# isort: split
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic


def _adder(width: int) -> Any:
    """Make the sum of `add_weighted_rows` for so many entries, from one on."""

    @intrinsic
    def add(
        typing_context: Any,
        base: Any,
        K: Any,
        row: Any,
        weight: Any,
        count: Any,
        latest: Any,
        latest_weight: Any,
        h: Any,
        out: Any,
        at: Any,
    ) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kinds, word = signature.args, ir.IntType(64)
            arrays = {
                k: context.make_array(kinds[k])(context, builder, values[k]) for k in range(len(kinds)) if k in _ARRAYS
            }
            base, K, row, weight, out = (arrays[k] for k in _ARRAYS)
            count, latest, latest_weight, h, at = (values[k] for k in _NUMBERS)
            n, vector = builder.extract_value(K.shape, 1), ir.VectorType(ir.DoubleType(), width)

            def place(data: Any, first: Any) -> Any:
                return builder.bitcast(builder.gep(data, [first]), vector.as_pointer())

            def load(data: Any, first: Any) -> Any:
                entries = builder.load(place(data, first))
                entries.align = 8
                return entries

            def spread(number: Any) -> Any:
                one = builder.insert_element(ir.Constant(vector, ir.Undefined), number, ir.IntType(32)(0))
                mask = ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width)
                return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), mask)

            before, loop, after = builder.block, builder.append_basic_block("sum"), builder.append_basic_block("summed")
            builder.branch(loop)
            builder.position_at_end(loop)
            counter = builder.phi(word)
            counter.add_incoming(word(0), before)
            sums = [builder.phi(vector) for _ in range(2)]
            totals: list[Any] = [*sums]
            for k in range(ROWS_AT_ONCE):
                number = builder.add(counter, word(k))
                first = builder.add(builder.mul(builder.load(builder.gep(row.data, [number])), n), at)
                factor = spread(builder.load(builder.gep(weight.data, [number])))
                product = builder.fmul(factor, load(K.data, first), flags=["contract"])
                totals[k % 2] = builder.fadd(totals[k % 2], product, flags=["contract"])
            following = builder.add(counter, word(ROWS_AT_ONCE))
            counter.add_incoming(following, loop)
            for phi, total in zip(sums, totals, strict=True):
                phi.add_incoming(ir.Constant(vector, None), before)
                phi.add_incoming(total, loop)
            builder.cbranch(builder.icmp_signed("<", following, count), loop, after)
            builder.position_at_end(after)
            start = builder.gep(K.data, [builder.add(builder.mul(latest, n), at)])
            entries = ir.Constant(vector, ir.Undefined)
            for k in range(width):  # atomic, or LLVM would join them
                entry = builder.load_atomic(builder.gep(start, [word(k)]), "unordered", 8)
                entries = builder.insert_element(entries, entry, ir.IntType(32)(k))
            change = builder.fmul(spread(h), builder.fadd(*totals), flags=["contract"])
            total = builder.fadd(load(base.data, at), change, flags=["contract"])
            change = builder.fmul(spread(builder.fmul(h, latest_weight)), entries, flags=["contract"])
            builder.store(builder.fadd(total, change, flags=["contract"]), place(out.data, at)).align = 8
            return context.get_dummy_value()

        integer, real = types.intp, types.float64
        return types.none(base, K, row, weight, integer, integer, real, real, out, integer), generate

    return add


_ARRAYS, _NUMBERS = (0, 1, 2, 3, 8), (4, 5, 6, 7, 9)
_add_eight, _add_four, _add_two, _add_one = (_adder(width) for width in (8, 4, 2, 1))


@inlined
def add_weighted_rows(
    base: Array,
    K: Array,
    row: IntArray,
    weight: Array,
    count: int,
    latest: int,
    latest_weight: float,
    h: float,
    out: Array,
) -> None:
    """Compute ``out = base + h (Σ weight_k K[row_k] + latest_weight K[latest])`` over ``count`` rows k.

    Parameters
    ----------
    base, out : ndarray, shape (n,)
        May be the same.
    K : ndarray, shape (any, n)
        Overlaps neither.
    row, weight : ndarray, shape (count or more,)
        Numbers of the rows, and their weights.
    count : int
        How many; a multiple of four, of four at least.
    latest : int
        Number of the row that was written last.
    """
    n, at = out.size, 0
    while at + 8 <= n:
        _add_eight(base, K, row, weight, count, latest, latest_weight, h, out, at)
        at += 8
    if at + 4 <= n:
        _add_four(base, K, row, weight, count, latest, latest_weight, h, out, at)
        at += 4
    if at + 2 <= n:
        _add_two(base, K, row, weight, count, latest, latest_weight, h, out, at)
        at += 2
    if at < n:
        _add_one(base, K, row, weight, count, latest, latest_weight, h, out, at)

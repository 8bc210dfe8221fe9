"""Products of small dense matrices inside kernels, in blocks of eight by eight that are summed in vector registers.

LLVM makes of a plain triple loop one that loads and stores a sum for every product, and goes one by one through what is
left of a row: for matrices of 12 to 60 rows that is a fourth of the speed, or less.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators

from __future__ import annotations

from typing import Any

from fmd.core.arrays import Array
from fmd.core.limits.code import SQUARE_SIDE
from fmd.dynamics.jit.compiled import inner

# isort: split
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic


@intrinsic
def _multiply_block(typing_context: Any, A: Any, B: Any, C: Any, row: Any, column: Any) -> Any:
    """Compute eight rows and columns of ``C = A B``, from a row and a column on, for square matrices."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        kinds, word = signature.args, ir.IntType(64)
        arrays = [context.make_array(kind)(context, builder, x) for kind, x in zip(kinds[:3], values[:3], strict=True)]
        (a, b, c), n = (array.data for array in arrays), builder.extract_value(arrays[0].shape, 0)
        first, at = values[3], values[4]
        vector = ir.VectorType(ir.DoubleType(), SQUARE_SIDE)
        rows = [builder.mul(builder.add(first, word(k)), n) for k in range(SQUARE_SIDE)]
        before, loop, after = builder.block, builder.append_basic_block("sum"), builder.append_basic_block("summed")
        builder.branch(loop)
        builder.position_at_end(loop)
        counter = builder.phi(word)
        counter.add_incoming(word(0), before)
        sums = [builder.phi(vector) for _ in range(SQUARE_SIDE)]
        place = builder.gep(b, [builder.add(builder.mul(counter, n), at)])
        entries = builder.load(builder.bitcast(place, vector.as_pointer()))
        entries.align = SQUARE_SIDE
        for start, total in zip(rows, sums, strict=True):
            factor = builder.load(builder.gep(a, [builder.add(start, counter)]))
            one = builder.insert_element(ir.Constant(vector, ir.Undefined), factor, ir.IntType(32)(0))
            mask = ir.Constant(ir.VectorType(ir.IntType(32), SQUARE_SIDE), [0] * SQUARE_SIDE)
            spread = builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), mask)
            product = builder.fmul(spread, entries, flags=["contract"])
            total.add_incoming(ir.Constant(vector, None), before)
            total.add_incoming(builder.fadd(total, product, flags=["contract"]), loop)
        following = builder.add(counter, word(1))
        counter.add_incoming(following, loop)
        builder.cbranch(builder.icmp_signed("<", following, n), loop, after)
        builder.position_at_end(after)
        for start, total in zip(rows, sums, strict=True):
            place = builder.bitcast(builder.gep(c, [builder.add(start, at)]), vector.as_pointer())
            builder.store(total.incomings[1][0], place).align = SQUARE_SIDE
        return context.get_dummy_value()

    return types.none(A, B, C, types.intp, types.intp), generate


multiply_block: Any = _multiply_block  # as kernels see it: without the context


@inner
def multiply_square(A: Array, B: Array, C: Array) -> None:
    """Multiply square matrices of one size: ``C = A B``; C overlaps neither. Blocks at the ends overlap others."""
    n = A.shape[0]
    if n < SQUARE_SIDE:
        for i in range(n):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += A[i, k] * B[k, j]
                C[i, j] = total
        return
    for i in range(0, n, SQUARE_SIDE):
        for j in range(0, n, SQUARE_SIDE):
            multiply_block(A, B, C, min(i, n - SQUARE_SIDE), min(j, n - SQUARE_SIDE))

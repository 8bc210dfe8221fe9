"""Products of small dense matrices inside kernels, in blocks of eight by eight that are summed in vector registers.

LLVM makes of a plain triple loop one that loads and stores a sum for every product, and goes one by one through what is
left of a row: for matrices of 12 to 60 rows that is a fourth of the speed, or less.
"""

from __future__ import annotations

from fmd.core.arrays import Array
from fmd.core.limits.code import SQUARE_SIDE
from fmd.kernels.kernel import contracted, inner
from fmd.kernels.library import fill_vector, read_vector, write_vector


@contracted
def _multiply_block(A: Array, B: Array, C: Array, row: int, column: int) -> None:
    """Compute eight rows and columns of ``C = A B``, from a row and a column on, for square matrices."""
    n, a, zeros = A.shape[0], row, fill_vector(0.0, SQUARE_SIDE)
    s0, s1, s2, s3, s4, s5, s6, s7 = zeros, zeros, zeros, zeros, zeros, zeros, zeros, zeros
    for k in range(n):
        entries = read_vector(B, k * n + column, SQUARE_SIDE)
        s0 = s0 + A[a, k] * entries
        s1 = s1 + A[a + 1, k] * entries
        s2 = s2 + A[a + 2, k] * entries
        s3 = s3 + A[a + 3, k] * entries
        s4 = s4 + A[a + 4, k] * entries
        s5 = s5 + A[a + 5, k] * entries
        s6 = s6 + A[a + 6, k] * entries
        s7 = s7 + A[a + 7, k] * entries
    at = row * n + column
    write_vector(C, at, s0)
    write_vector(C, at + n, s1)
    write_vector(C, at + 2 * n, s2)
    write_vector(C, at + 3 * n, s3)
    write_vector(C, at + 4 * n, s4)
    write_vector(C, at + 5 * n, s5)
    write_vector(C, at + 6 * n, s6)
    write_vector(C, at + 7 * n, s7)


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
            _multiply_block(A, B, C, min(i, n - SQUARE_SIDE), min(j, n - SQUARE_SIDE))

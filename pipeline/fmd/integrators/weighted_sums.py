"""Weighted sums of a matrix's rows inside kernels, in pieces of eight, four, two and one entries.

LLVM makes of plain loops ones that read and write the sum for every few rows, and that first look whether arrays
overlap: with four entries to a row that takes longer than the sum. One row more, which may have been written just
before, is read entry by entry and added last: a processor can't yet read a vector where it has just written single
numbers, and waits for longer than the sum takes.
"""

from __future__ import annotations

from typing import Any

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.code import ROWS_AT_ONCE
from fmd.kernels.kernel import contracted, inlined
from fmd.kernels.vectors import read_entries, read_vector, write_vector


def _adder(width: int) -> Any:
    """Make the sum of `add_weighted_rows` for so many entries, from one on."""

    @contracted
    def add(
        base: Array,
        K: Array,
        row: IntArray,
        weight: Array,
        count: int,
        latest: int,
        latest_weight: float,
        h: float,
        out: Array,
        at: int,
    ) -> None:
        n = K.shape[1]
        one = weight[0] * read_vector(K, row[0] * n + at, width)  # two sums, which don't wait for each other
        other = weight[1] * read_vector(K, row[1] * n + at, width)
        one = one + weight[2] * read_vector(K, row[2] * n + at, width)
        other = other + weight[3] * read_vector(K, row[3] * n + at, width)
        for k in range(ROWS_AT_ONCE, count, ROWS_AT_ONCE):
            one = one + weight[k] * read_vector(K, row[k] * n + at, width)
            other = other + weight[k + 1] * read_vector(K, row[k + 1] * n + at, width)
            one = one + weight[k + 2] * read_vector(K, row[k + 2] * n + at, width)
            other = other + weight[k + 3] * read_vector(K, row[k + 3] * n + at, width)
        last = read_entries(K, latest * n + at, width)
        total = read_vector(base, at, width) + h * (one + other)
        write_vector(out, at, total + (h * latest_weight) * last)

    return add


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

    Base and out (n,) may be the same, and overlap no row of K (any, n), of which number ``latest`` was written last.
    The count is four or a multiple of it; ``row`` and ``weight`` may be longer.
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

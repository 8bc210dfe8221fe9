"""Products of sparse matrices with many columns, as many at a time as a register of the processor holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import MOST_WIDENED
from fmd.kernels.kernel import contracted, kernel
from fmd.kernels.machine import register_width
from fmd.kernels.table import aligned
from fmd.kernels.vectors import fill_vector, read_vector, write_vector

LANES = register_width()  # columns at a time


class SparseProducts:
    """A sparse matrix (m, n) that is multiplied with many columns: each of its entries is read once for some of them.

    SciPy's product goes through all columns at each entry, which takes two to three times as long for eight. It is
    taken for very large matrices, for it needs no places of 64 bits.
    """

    def __init__(self, matrix: sp.csr_array) -> None:
        self.matrix = matrix
        self._entries: tuple[IntArray, IntArray, Array] | None = None

    def _find_entries(self) -> tuple[IntArray, IntArray, Array]:
        if self._entries is None:
            places = self.matrix.indptr.astype(np.int64), self.matrix.indices.astype(np.int64)
            self._entries = (*places, self.matrix.data.astype(float, copy=False))
        return self._entries

    def __matmul__(self, x: Array) -> Array:
        """Return the product with x, (n,) or (n, k)."""
        if x.ndim == 1 or x.shape[1] < 2 or self.matrix.nnz > MOST_WIDENED:
            return np.asarray(self.matrix @ x)
        (m, n), out = self.matrix.shape, np.empty((self.matrix.shape[0], x.shape[1]))
        some, product = (own.reshape(-1, LANES) for own in aligned(LANES * n, LANES * m))
        for first in range(0, x.shape[1], LANES):
            columns = x[:, first : first + LANES]
            some[:, : columns.shape[1]] = columns
            _multiply(*self._find_entries(), some, product)
            out[:, first : first + LANES] = product[:, : columns.shape[1]]
        return out

    def __abs__(self) -> Any:
        """Return the matrix of the entries' absolute values."""
        return abs(self.matrix)


@kernel
def _multiply(indptr: IntArray, indices: IntArray, data: Array, x: Array, product: Array) -> None:
    """Set ``product`` (m, lanes) to the matrix times x (n, lanes)."""
    for i in range(len(indptr) - 1):
        _multiply_row(indices, data, indptr[i], indptr[i + 1], x, LANES * i, product)


@contracted
def _multiply_row(indices: IntArray, data: Array, first: int, end: int, x: Array, at: int, product: Array) -> None:
    """Write a row's product, the sum of its entries from ``first`` to ``end``."""
    even = odd = fill_vector(0.0, LANES)  # two sums, of which neither waits for the other
    for k in range(first, end - 1, 2):
        even = even + data[k] * read_vector(x, LANES * indices[k], LANES)
        odd = odd + data[k + 1] * read_vector(x, LANES * indices[k + 1], LANES)
    if (end - first) % 2:
        even = even + data[end - 1] * read_vector(x, LANES * indices[end - 1], LANES)
    write_vector(product, at, even + odd)

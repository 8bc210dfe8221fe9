"""Products of sparse matrices with many columns, as many at a time as a register of the processor holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import SMALL_SYSTEM


def places_of(matrix: sp.csr_array) -> tuple[IntArray, IntArray]:
    """Return where a matrix' rows begin and its entries' columns, of 64 bits as kernels take them, which most are."""
    return matrix.indptr.astype(np.int64, copy=False), matrix.indices.astype(np.int64, copy=False)


class SparseProducts:
    """A sparse matrix (m, n) that is multiplied with many columns: each of its entries is read once for some of them.

    SciPy's product goes through all columns at each entry, which takes two to three times as long for eight. It is
    taken for small matrices, which need no machine code.
    """

    def __init__(self, matrix: sp.csr_array) -> None:
        self.matrix = matrix
        self._entries = *places_of(matrix), matrix.data.astype(float, copy=False)

    def __matmul__(self, x: Array) -> Array:
        """Return the product with x, (n,) or (n, k)."""
        if x.ndim == 1 or x.shape[1] < 2 or self.matrix.shape[0] < SMALL_SYSTEM:
            return np.asarray(self.matrix @ x)
        from fmd.fem.column_products import LANES, multiply_columns
        from fmd.kernels.table import aligned

        (m, n), out = self.matrix.shape, np.empty((self.matrix.shape[0], x.shape[1]))
        some, product = (own.reshape(-1, LANES) for own in aligned(LANES * n, LANES * m))
        for first in range(0, x.shape[1], LANES):
            columns = x[:, first : first + LANES]
            some[:, : columns.shape[1]] = columns
            multiply_columns(*self._entries, some, product)
            out[:, first : first + LANES] = product[:, : columns.shape[1]]
        return out

    def __abs__(self) -> Any:
        """Return the matrix of the entries' absolute values."""
        return abs(self.matrix)

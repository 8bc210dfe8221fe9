"""Products of sparse matrices with many columns, as many at a time as a register of the processor holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import MOST_WIDENED, SMALL_SYSTEM


class SparseProducts:
    """A sparse matrix (m, n) that is multiplied with many columns: each of its entries is read once for some of them.

    SciPy's product goes through all columns at each entry, which takes two to three times as long for eight. It is
    taken for very large matrices, for it needs no places of 64 bits, and for small ones, which need no machine code.
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
        small = self.matrix.shape[0] < SMALL_SYSTEM
        if x.ndim == 1 or x.shape[1] < 2 or small or self.matrix.nnz > MOST_WIDENED:
            return np.asarray(self.matrix @ x)
        from fmd.fem.column_products import LANES, multiply_columns
        from fmd.kernels.table import aligned

        (m, n), out = self.matrix.shape, np.empty((self.matrix.shape[0], x.shape[1]))
        some, product = (own.reshape(-1, LANES) for own in aligned(LANES * n, LANES * m))
        for first in range(0, x.shape[1], LANES):
            columns = x[:, first : first + LANES]
            some[:, : columns.shape[1]] = columns
            multiply_columns(*self._find_entries(), some, product)
            out[:, first : first + LANES] = product[:, : columns.shape[1]]
        return out

    def __abs__(self) -> Any:
        """Return the matrix of the entries' absolute values."""
        return abs(self.matrix)

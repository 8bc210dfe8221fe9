"""Size of a Cholesky factor, counted from the pattern of its matrix before anything is factorised."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import IntArray


def node_graph(A: sp.csr_array, size: int) -> sp.csr_array:
    """Graph of the nodes, of ``size`` unknowns each, that a matrix couples; symmetric, without loops."""
    n = A.shape[0]
    rows, columns = np.repeat(np.arange(n) // size, np.diff(A.indptr)), A.indices // size
    apart = rows != columns
    ones = np.ones(np.count_nonzero(apart), dtype=np.float32)
    return sp.csr_array(sp.coo_array((ones, (rows[apart], columns[apart])), (n // size, n // size)))


def factor_nonzeros(graph: sp.csr_array, size: int = 1) -> int:
    """Count the nonzeros of the Cholesky factor of a matrix with this graph, in this order.

    Column j of L holds a row i for each row whose subtree of the elimination tree j is in (Liu, SIAM J Matrix Anal Appl
    11, 1990); a node's unknowns have a column each, one shorter than the one before.
    """
    counts = np.ones(graph.shape[0], dtype=np.int64)
    work = np.full((2, graph.shape[0]), -1, dtype=np.int64)
    indptr, indices = graph.indptr.astype(np.int64), graph.indices.astype(np.int64)
    _count_columns()(indptr, indices, counts, *work)
    return int(size**2 * counts.sum() - size * (size - 1) // 2 * len(counts))


@cache
def _count_columns() -> Any:
    """Return `_counts` as a kernel."""
    from fmd.kernels.kernel import kernel

    return kernel(_counts)


def _counts(indptr: IntArray, indices: IntArray, counts: IntArray, parent: IntArray, seen: IntArray) -> None:
    """Add to each column's count the rows below the diagonal, walking up the elimination tree from each row."""
    for i in range(len(counts)):
        seen[i] = i
        for k in range(indptr[i], indptr[i + 1]):
            j = indices[k]
            while j < i and seen[j] != i:
                if parent[j] < 0:
                    parent[j] = i
                counts[j] += 1
                seen[j] = i
                j = parent[j]

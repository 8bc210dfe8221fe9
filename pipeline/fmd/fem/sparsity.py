"""The sparsity pattern of a mesh, built once, and the sums of element entries into it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, IntArray


class BlockStructure:
    """Pairs of nodes that share an element: the pattern of stiffness, mass and geometric stiffness.

    Two counting sorts, SciPy's conversions between compressed rows and columns, order the entries of all elements by
    the row's node and then by the column's. A sparse matrix of ones in that order, with a row for each pair, sums them.

    Parameters
    ----------
    element_nodes : ndarray, shape (n_elements, n_local)
        Node numbers of each element.
    n_nodes : int
        Number of nodes.
    """

    def __init__(self, element_nodes: IntArray, n_nodes: int) -> None:
        n_elements, n_local = element_nodes.shape
        index = np.int32 if n_elements * n_local**2 < 2**31 else np.int64
        nodes, local = element_nodes.astype(index), np.arange(n_local, dtype=index)
        place = np.arange(n_elements * n_local, dtype=index)
        by_element = (place, nodes.ravel(), np.append(place[::n_local], index(place.size)))
        by_node = sp.csr_array(by_element, shape=(n_elements, n_nodes)).tocsc()
        element, own = np.divmod(by_node.data, index(n_local))
        entry = ((element * index(n_local))[:, None] + local) * index(n_local) + own[:, None]
        by_row = (entry.ravel(), nodes[element].ravel(), by_node.indptr * index(n_local))
        sorted_entries = sp.csr_array(by_row, shape=(n_nodes, n_nodes)).tocsc()
        row = np.repeat(np.arange(n_nodes, dtype=index), np.diff(sorted_entries.indptr))
        column = sorted_entries.indices
        first = np.append(True, (column[1:] != column[:-1]) | (row[1:] != row[:-1]))
        start = np.append(np.flatnonzero(first), first.size)
        self._sums = sp.csr_array((np.ones(first.size), sorted_entries.data, start), shape=(start.size - 1, first.size))
        self._column = column[first]
        self._pointer = np.searchsorted(start, sorted_entries.indptr)
        self._n = n_nodes

    def sums(self, entries: Array) -> Array:
        """Sum entries (n_elements, n_local, n_local, …) over the elements of each pair of nodes, shape (n_pairs, …)."""
        total = self._sums @ entries.reshape(self._sums.shape[1], -1)
        return np.asarray(total.reshape(-1, *entries.shape[3:]))

    def scalar_matrix(self, pairs: Array) -> sp.csr_array:
        """Return the matrix (n_nodes, n_nodes) with a number for each pair, shape (n_pairs,)."""
        return sp.csr_array((pairs, self._column, self._pointer), shape=(self._n, self._n))

    def block_matrix(self, pairs: Array) -> sp.csr_array:
        """Return the matrix (3 n_nodes, 3 n_nodes) with a block for each pair, shape (n_pairs, 3, 3)."""
        n = 3 * self._n
        return sp.csr_array(sp.bsr_array((pairs, self._column, self._pointer), shape=(n, n)).tocsr())

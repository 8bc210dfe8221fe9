"""Orders in which the factor of a sparse symmetric matrix fills in little: nested dissection or minimum degree.

Of quadratic elements most nodes are in the middle of edges. All that such a node is coupled to is coupled to a corner,
too, so that its elimination right before the corner's fills in nothing more than that does (the order of the corners
decides), and a separator of the corners is one of all nodes. So corners alone are ordered, a sixth of the nodes.
Minimum degree eliminates a slender body from its ends, where dissection couples each part to two others: it leaves a
third fewer operations to a bar of 90 × 4 × 8 elements, and 1.7 times as many to a compact block.
"""

from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order

from fmd.core.arrays import IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import MOST_COUPLED, SHIFTED_BLOCKS, SLENDER
from fmd.fem.products import places_of
from fmd.kernels.kernel import kernel
from fmd.reduction.factor.superlu import superlu


@dataclass(frozen=True, slots=True)
class Order:
    """Order of the nodes that a matrix couples, in groups: one decides each, and those before it that it covers."""

    nodes: IntArray  # (n_nodes,): all nodes in their order
    ends: IntArray  # (n_groups,): places of the nodes that decide, each the last of its group
    graph: sp.csr_array  # (n_nodes, n_nodes): nodes that the matrix couples, in this order
    size: int  # unknowns of a node
    name: str  # method that orders: ``METIS``, or ``MMD`` (minimum degree)

    @property
    def unknowns(self) -> IntArray:
        """Places of all unknowns in this order, (n,)."""
        return unknowns_of(self.nodes, self.size)


def unknowns_of(nodes: IntArray, size: int) -> IntArray:
    """Return the places of the unknowns of nodes, ``size`` each."""
    return np.asarray((size * nodes.astype(np.int64)[:, None] + np.arange(size)).ravel())


def node_graph(A: sp.csr_array) -> tuple[sp.csr_array, int]:
    """Graph of the nodes that a matrix couples, symmetric, each to itself as well, and the number of a node's unknowns.

    That is three, or one where supports have shifted nodes against blocks of three.
    Differences of matrices drop entries that come out as zero, and round-off may leave one of a pair: it couples, too.
    """
    size = 3 if A.shape[0] % 3 == 0 else 1
    graph = _coupled_nodes(A, size)
    if size**2 * graph.nnz > SHIFTED_BLOCKS * A.nnz:
        size, graph = 1, _coupled_nodes(A, 1)
    begins, nodes = places_of(graph)
    if not _is_symmetric(begins, nodes, begins[:-1].copy()):
        graph = sp.csr_array(graph.maximum(graph.T))
    return graph, size


def _coupled_nodes(A: sp.csr_array, size: int) -> sp.csr_array:
    """Return the nodes of ``size`` unknowns that each node's rows of a matrix have entries of, in no order."""
    n = A.shape[0] // size
    nodes, ends, seen = np.empty(A.nnz, dtype=np.int64), np.zeros(n + 1, dtype=np.int64), np.full(n, -1)
    _list_coupled(*places_of(A), size, seen, nodes, ends)
    return sp.csr_array((np.ones(ends[-1], dtype=np.int8), nodes[: ends[-1]], ends), (n, n))


@kernel
def _list_coupled(
    indptr: IntArray, indices: IntArray, size: int, seen: IntArray, nodes: IntArray, ends: IntArray
) -> None:
    """List the nodes that each node's rows have entries of, each once, and where its list ends."""
    count = 0
    for node in range(len(ends) - 1):
        first = end = 0  # unknowns of the node before, which most entries follow
        for p in range(indptr[size * node], indptr[size * node + size]):
            unknown = indices[p]
            if unknown < first or unknown >= end:
                coupled = unknown // size
                first = size * coupled
                end = first + size
                if seen[coupled] != node:
                    seen[coupled] = node
                    nodes[count] = coupled
                    count += 1
        ends[node + 1] = count


@kernel
def _is_symmetric(indptr: IntArray, indices: IntArray, at: IntArray) -> bool:
    """Tell whether a graph is symmetric with its columns ascending; ``at`` begins as the rows' first places.

    Its entries are gone through row by row, by which those of each column come in the order of its mirrored row.
    """
    for i in range(len(at)):
        for p in range(indptr[i], indptr[i + 1]):
            j = indices[p]
            if at[j] == indptr[j + 1] or indices[at[j]] != i:
                return False
            at[j] += 1
    return True


def fill_reducing_order(graph: sp.csr_array, size: int) -> Order:
    """Order the nodes of a `node_graph` by METIS, or by SuperLU's minimum degree.

    The latter takes those of slender bodies, and all where pymetis isn't installed.
    """
    indptr, indices = places_of(graph)
    degrees, n = np.diff(indptr), graph.shape[0]
    decides, seen = np.full((2, n), -1)
    pairs, ends = np.empty((2, len(indices)), dtype=np.int64), np.zeros(1, dtype=np.int64)
    most = int(MOST_COUPLED * degrees.mean())
    _cover(indptr, indices, np.argsort(-degrees, kind="stable"), most, decides, seen, pairs, ends)
    covered, by = pairs[:, : ends[0]]
    deciding = np.flatnonzero(decides == 1)
    few = graph[deciding][:, deciding].astype(float)
    few.setdiag(0.0)
    few.eliminate_zeros()
    if find_spec("pymetis") is not None and few.nnz and not _is_slender(few):
        import pymetis

        adjacency = pymetis.CSRAdjacency(few.indptr, few.indices)
        name, order = "METIS", np.array(pymetis.nested_dissection(adjacency)[0])
    else:  # by a factorisation of the graph
        dominant = sp.csc_array(few + sp.diags_array(few.sum(axis=0) + 1.0))
        name, order = "MMD", np.argsort(superlu(dominant).perm_c)
    place = np.full(n, n)
    place[deciding[order]] = np.arange(len(order))
    np.minimum.at(place, covered, place[by])
    nodes = np.lexsort((decides, degrees, place))
    return Order(nodes, np.flatnonzero(decides[nodes] == 1), sp.csr_array(graph[nodes][:, nodes]), size, name)


def _is_slender(graph: sp.csr_array) -> bool:
    """Tell whether there are many steps from one end of a connected graph to the other, for the nodes at each."""
    order, before = breadth_first_order(graph, 0)
    order, before = breadth_first_order(graph, order[-1])
    length, node = 1, order[-1]
    while before[node] >= 0:
        length, node = length + 1, before[node]
    return len(order) == graph.shape[0] and length**2 > SLENDER * len(order)


@kernel
def _cover(
    indptr: IntArray,
    indices: IntArray,
    order: IntArray,
    most: int,
    decides: IntArray,
    seen: IntArray,
    pairs: IntArray,
    ends: IntArray,
) -> None:
    """Set ``decides`` to 1 of nodes that no other covers, 0 else, and list all pairs of a covered node and its cover.

    A node covers those that are coupled to nothing but it and what it is coupled to itself, at most ``most`` nodes.
    """
    for k in range(len(order)):
        a = order[k]
        if decides[a] < 0:
            decides[a], seen[a] = 1, a
            size = indptr[a + 1] - indptr[a]
            for p in range(indptr[a], indptr[a + 1]):
                seen[indices[p]] = a
            for p in range(indptr[a], indptr[a + 1]):
                e = indices[p]
                if size <= most and decides[e] < 1 and indptr[e + 1] - indptr[e] <= size:
                    q = indptr[e]
                    while q < indptr[e + 1] and seen[indices[q]] == a:
                        q += 1
                    if q == indptr[e + 1]:
                        decides[e] = 0
                        pairs[0, ends[0]], pairs[1, ends[0]] = e, a
                        ends[0] += 1

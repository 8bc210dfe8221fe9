"""Orders in which the factor of a sparse symmetric matrix fills in little: METIS' nested dissection of few nodes.

Of quadratic elements most nodes are in the middle of edges. All that such a node is coupled to is coupled to a corner,
too, so that its elimination right before the corner's fills in nothing more than that does (the order of the corners
decides), and a separator of the corners is one of all nodes. So corners alone are ordered, a sixth of the nodes.
"""

from importlib.util import find_spec

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.memory import MOST_COUPLED, SHIFTED_BLOCKS
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
    turned = sp.csr_array(graph.T)  # both have their columns ascending
    graph = sp.csr_array(turned.T)
    same = np.array_equal(graph.indptr, turned.indptr) and np.array_equal(graph.indices, turned.indices)
    return graph if same else sp.csr_array(graph.maximum(turned)), size


def _coupled_nodes(A: sp.csr_array, size: int) -> sp.csr_array:
    """Return the nodes of ``size`` unknowns that each node's rows of a matrix have entries of, in no order."""
    n = A.shape[0] // size
    nodes, ends, seen = np.empty(A.nnz, dtype=np.int64), np.zeros(n + 1, dtype=np.int64), np.full(n, -1)
    node_of = np.repeat(np.arange(n), size)
    _list_coupled(A.indptr.astype(np.int64), A.indices.astype(np.int64), node_of, seen, nodes, ends)
    return sp.csr_array((np.ones(ends[-1], dtype=np.int8), nodes[: ends[-1]], ends), (n, n))


@kernel
def _list_coupled(
    indptr: IntArray, indices: IntArray, node_of: IntArray, seen: IntArray, nodes: IntArray, ends: IntArray
) -> None:
    """List the nodes that each node's rows have entries of, each once, and where its list ends."""
    count = 0
    for row in range(len(indptr) - 1):
        node = node_of[row]
        for p in range(indptr[row], indptr[row + 1]):
            coupled = node_of[indices[p]]
            if seen[coupled] != node:
                seen[coupled] = node
                nodes[count] = coupled
                count += 1
        ends[node + 1] = count


def fill_reducing_order(graph: sp.csr_array, size: int) -> Order:
    """Order the nodes of a `node_graph` by METIS, or by SuperLU's minimum degree where pymetis isn't installed."""
    indptr, indices = graph.indptr.astype(np.int64), graph.indices.astype(np.int64)
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
    if find_spec("pymetis") is not None and few.nnz:
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

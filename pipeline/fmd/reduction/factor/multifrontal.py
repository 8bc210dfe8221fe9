"""Cholesky factor of a large sparse matrix by dense fronts, which LAPACK and BLAS factorise: the multifrontal method.

References
----------
Liu, The multifrontal method for sparse matrix solution: theory and practice, SIAM Review 34, 1992.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.memory import BYTES_FOR_FRONTS, FRONT_ZEROS, SHARE_OF_ZEROS
from fmd.core.limits.modes import SINGULAR
from fmd.fem.products import places_of
from fmd.kernels.kernel import inlined, kernel
from fmd.kernels.table import aligned
from fmd.reduction.factor.order import Order, unknowns_of
from fmd.reduction.factor.panels import LANES, pack_front, packed_entries, padded, solve_fronts
from fmd.reduction.inertia_relief import THIN


@dataclass(frozen=True, slots=True)
class Front:
    """Columns of a factor that follow one another and have their rows in common."""

    first: int  # the first of its columns
    width: int  # number of its columns
    below: IntArray  # (k,): rows below its own triangle, ascending
    children: tuple[int, ...]  # fronts before it, what is left of which it takes up

    @property
    def entries(self) -> int:
        """Number of entries that are kept of it."""
        return packed_entries(self.width, len(self.below))


def elimination_tree(graph: sp.csr_array) -> tuple[IntArray, IntArray]:
    """Count the entries of each column of the Cholesky factor of a matrix with this graph, in this order.

    Column j of L holds a row i for each row whose subtree of the elimination tree j is in (Liu, SIAM J Matrix Anal Appl
    11, 1990). Returned are the entries of each column, that of the diagonal too, and its parent in the tree, -1 of a
    root, (n,) each.
    """
    counts = np.ones(graph.shape[0], dtype=np.int64)
    parent, seen = np.full((2, graph.shape[0]), -1, dtype=np.int64)
    _count_columns(*places_of(graph), counts, parent, seen)
    return counts, parent


def plan_fronts(order: Order, counts: IntArray, parent: IntArray) -> tuple[IntArray, list[Front]]:
    """Plan the fronts of a matrix; small ones become part of their parents where that costs a few zeros.

    Its nodes have an order that fills in little, each the entries of its column of the factor, and its parent in the
    elimination tree, -1 of a root. A front begins as a group of nodes, whose last one is coupled to all that the others
    are. Returned are an order of the unknowns in that order (n,) that fills in as little and has each front's together,
    and the fronts by unknowns in this order, each after its children.
    """
    graph, size, ends = order.graph, order.size, order.ends
    n, few = len(ends), FRONT_ZEROS // size**2
    begins, own = np.append(0, ends[:-1] + 1), np.diff(ends, prepend=-1)
    group = np.append(np.repeat(np.arange(n), own), -1)
    heights, widths = (counts[ends] + own - 1).tolist(), own.tolist()
    members: list[list[int]] = [[k] for k in range(n)]
    children: list[list[int]] = [[] for _ in range(n)]
    for node, above in enumerate(group[parent[ends]].tolist()):
        kept: list[int] = []
        for child in sorted(children[node], key=heights.__getitem__, reverse=True):
            height, width = heights[node] + widths[child], widths[node] + widths[child]
            whole = _entries(height, width)
            zeros = whole - _entries(heights[child], widths[child]) - _entries(heights[node], widths[node])
            if zeros <= max(few, SHARE_OF_ZEROS * whole):
                heights[node], widths[node] = height, width
                members[node] = members[child] + members[node]
                kept += children[child]
            else:
                kept.append(child)
        children[node] = kept
        if above >= 0:
            children[above].append(node)
    sequence, waiting = [], np.flatnonzero(parent[ends] < 0).tolist()
    while waiting:  # parents before children, and then turned around
        sequence.append(waiting.pop())
        waiting += children[sequence[-1]]
    sequence.reverse()
    groups = np.concatenate([members[node] for node in sequence])
    behind = np.cumsum(own[groups])
    nodes = np.repeat(begins[groups] + own[groups] - behind, own[groups]) + np.arange(len(parent))
    place = np.empty(len(parent), dtype=np.int64)
    place[nodes] = np.arange(len(place))
    coupled = graph[ends[groups]]
    columns = place[coupled.indices]
    fronts: list[Front] = []
    rows_below: dict[int, IntArray] = {}
    number: dict[int, int] = {}
    first = done = 0
    for node in sequence:
        last, end = first + widths[node], done + len(members[node])
        own_rows = columns[coupled.indptr[done] : coupled.indptr[end]]
        rows = np.concatenate([own_rows, *(rows_below.pop(child) for child in children[node])])
        rows = np.sort(rows[rows >= last])  # np.unique makes a table of them, which takes as long as all else here
        rows_below[node] = rows = rows[np.diff(rows, prepend=-1) > 0]
        number[node] = len(fronts)
        below = unknowns_of(rows, size)
        fronts.append(Front(size * first, size * widths[node], below, tuple(number[c] for c in children[node])))
        first, done = last, end
    return unknowns_of(nodes, size), fronts


def plan_stack(fronts: Sequence[Front]) -> tuple[list[int], int]:
    """Return where each front leaves what its parent takes up, and the numbers that there must be room for.

    Fronts of odd and even depth have a stack each, at both ends of the room: what a front takes up lies on top of one
    while it leaves its own on the other.
    """
    depth = [0] * len(fronts)
    for k in range(len(fronts) - 1, -1, -1):
        for child in fronts[k].children:
            depth[child] = depth[k] + 1
    begins, tops, room = [], [0, 0], 0
    for front, level in zip(fronts, depth, strict=True):
        begins.append(tops[level % 2])
        tops[level % 2] += len(front.below) ** 2
        room = max(room, sum(tops))
        tops[1 - level % 2] -= sum(len(fronts[child].below) ** 2 for child in front.children)
    turned = [room - begin - len(front.below) ** 2 for begin, front in zip(begins, fronts, strict=True)]
    return [(turned if level % 2 else begins)[k] for k, level in enumerate(depth)], room


def widest_columns(fronts: Sequence[Front]) -> int:
    """Return the entries of the columns of the front that has most of them, its square whole."""
    return max(front.width * (front.width + len(front.below)) for front in fronts)


def bytes_beside(fronts: Sequence[Front], stack: tuple[list[int], int], nonzeros: int) -> float:
    """Return the memory that a matrix of so many nonzeros takes beside its factor while it is factorised [bytes]."""
    return 8.0 * (stack[1] + widest_columns(fronts)) + BYTES_FOR_FRONTS * nonzeros


def _require_regular(shares: Array) -> None:
    """Raise ``AccuracyError`` if the smallest pivot, as a share of the matrix's diagonal, is round-off."""
    worst = int(shares.argmin())
    if not shares[worst] > SINGULAR:
        raise AccuracyError(
            f"the shifted stiffness is singular to round-off: pivot {worst + 1} of its factor is {shares[worst]:.1e} "
            f"of its diagonal, which has to be above {SINGULAR:.0e}, {THIN}"
        )


def factorise_fronts(
    A: sp.csr_array, order: IntArray, fronts: Sequence[Front], stack: tuple[list[int], int]
) -> Callable[[Array], Array]:
    """Factorise a symmetric positive definite matrix by fronts; returns the solve, which takes many loads at a time.

    Both triangles of A (n, n) are given; ``order`` (n,) has its unknowns in the fronts' order, ``stack`` is by
    `plan_stack`.

    Raises
    ------
    AccuracyError
        A is not positive definite, or singular to round-off; the message gives the pivot.
    """
    n = A.shape[0]
    place, local, places = (np.zeros(n, dtype=np.int64) for _ in range(3))
    place[order] = np.arange(n)
    matrix = (*places_of(A), A.data, order.astype(np.int64), place)
    begins, room = stack
    ends = np.cumsum([0, *(front.entries for front in fronts)])
    (L,), left, pivots = aligned(int(ends[-1])), np.empty(room), np.empty(n)
    own, diagonal = np.empty(widest_columns(fronts)), A.diagonal()[order]

    def rest(k: int) -> Array:
        width = len(fronts[k].below)
        return left[begins[k] : begins[k] + width**2].reshape(width, width)

    for k, front in enumerate(fronts):
        middle, end = front.width**2, front.width * (front.width + len(front.below))
        own[:end] = 0.0
        D, B, U = own[:middle].reshape(front.width, -1), own[middle:end].reshape(front.width, -1), rest(k)
        _gather(*matrix, local, front.first, front.below, D, B)
        for child in front.children:
            _extend_own(fronts[child].below, rest(child), local, places, D, B)
        # Columns lie in rows here, which are columns to LAPACK, and it writes into them.
        _, wrong = dpotrf(D.T, lower=1, overwrite_a=1, clean=0)
        if wrong:
            at = front.first + wrong - 1
            raise AccuracyError(
                f"the shifted stiffness is not positive definite: the factor ends at pivot {at + 1}, which is "
                f"{D[wrong - 1, wrong - 1]:.1e} of a diagonal of {diagonal[at]:.1e}"
            )
        pivots[front.first : front.first + front.width] = D.diagonal()
        if B.size:
            dtrsm(1.0, D.T, B.T, side=1, lower=1, trans_a=1, overwrite_b=1)
            dsyrk(-1.0, B.T, 0.0, U.T, lower=1, overwrite_c=1)
            for child in front.children:
                _extend_rest(fronts[child].below, rest(child), local, places, front.width, U)
        pack_front(D, B, L, ends[k])
    _require_regular(pivots**2 / diagonal)
    below = np.cumsum([0, *(len(front.below) for front in fronts)])
    rows = np.concatenate([front.below for front in fronts])
    plan = (np.array([front.first for front in fronts]), np.array([front.width for front in fronts]), below, rows, ends)
    height = max(padded(front.width) + padded(len(front.below)) for front in fronts)

    def solve(f: Array) -> Array:
        loads = np.asarray(f, dtype=float).reshape(n, -1)
        u, (x, z) = np.empty_like(loads), aligned(LANES * n, LANES * height)
        x, z = x.reshape(-1, LANES), z.reshape(-1, LANES)
        for column in range(0, loads.shape[1], LANES):
            some = loads[:, column : column + LANES]
            x[:, : some.shape[1]] = some[order]
            solve_fronts(*plan, L, x, z)
            u[order, column : column + LANES] = x[:, : some.shape[1]]
        return u.reshape(f.shape)

    return solve


def _entries(height: int, width: int) -> int:
    """Count the entries of columns that begin one below the other."""
    return width * height - width * (width - 1) // 2


@kernel
def _count_columns(indptr: IntArray, indices: IntArray, counts: IntArray, parent: IntArray, seen: IntArray) -> None:
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


@kernel
def _gather(
    indptr: IntArray,
    indices: IntArray,
    data: Array,
    order: IntArray,
    place: IntArray,
    local: IntArray,
    first: int,
    below: IntArray,
    D: Array,
    B: Array,
) -> None:
    """Set the columns of a front, rows of D and B, to the matrix' own, and ``local`` to its rows' places."""
    width = len(D)
    for i in range(width):
        local[first + i] = i
    for i in range(len(below)):
        local[below[i]] = width + i
    for column in range(width):
        unknown = order[first + column]
        for k in range(indptr[unknown], indptr[unknown + 1]):
            p = place[indices[k]]
            if p >= first + column:
                row = local[p]
                if row < width:
                    D[column, row] += data[k]
                else:
                    B[column, row - width] += data[k]


@kernel
def _extend_own(rows: IntArray, left: Array, local: IntArray, places: IntArray, D: Array, B: Array) -> None:
    """Add what a child has left to the columns of its parent."""
    n, width, own = len(rows), len(D), _own_rows(rows, local, places, len(D))
    for j in range(own):
        column = places[j]
        for i in range(j, own):
            D[column, places[i]] += left[j, i]
        for i in range(own, n):
            B[column, places[i] - width] += left[j, i]


@kernel
def _extend_rest(rows: IntArray, left: Array, local: IntArray, places: IntArray, width: int, U: Array) -> None:
    """Add what a child has left to what its parent leaves."""
    n = len(rows)
    for j in range(_own_rows(rows, local, places, width), n):
        column = places[j] - width
        for i in range(j, n):
            U[column, places[i] - width] += left[j, i]


@inlined
def _own_rows(rows: IntArray, local: IntArray, places: IntArray, width: int) -> int:
    """Set the places of a child's rows in its parent; returns how many of them are the parent's own."""
    own = 0
    for i in range(len(rows)):
        places[i] = local[rows[i]]
        if places[i] < width:
            own = i + 1
    return own

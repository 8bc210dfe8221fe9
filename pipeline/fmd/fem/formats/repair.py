"""Common faults of mesh files: functions that detect them and functions that mend them.

Each function takes plain arrays and returns new ones; `import_mesh` decides which mends to make and reports them.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.memory import CELLS_AT_ONCE
from fmd.core.limits.mesh import BENT_EDGE, COINCIDENT_NODES, MAJORITY, STRAIGHTENING_ROUNDS
from fmd.fem.cells.table import solid_cell
from fmd.fem.elements import jacobians, match_nodes, shape_functions


def edges(cells: IntArray, cell_type: str) -> IntArray:
    """Return the corners at the ends of each cell's edges, shape (n_cells, n_edges, 2)."""
    return np.asarray(cells[:, np.array(solid_cell(cell_type).shape.edges)])


def find_coincident(points: Array, cells: IntArray, cell_type: str) -> IntArray:
    """Return for each point the first of the points at its position, shape (n_points,), among those of cells."""
    first = np.arange(len(points))
    ends = points[edges(cells, cell_type)]
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    if not (lengths > 0).any():
        return first
    near = COINCIDENT_NODES * float(lengths[lengths > 0].min())
    used = np.unique(cells)
    while True:  # each point finds one other at a time: all pairs of a crowd would be too many
        kept = np.unique(first[used])
        distance, partner = cKDTree(points[kept]).query(points[kept], k=2, distance_upper_bound=near)
        own = np.arange(len(kept))
        other = np.where(partner[:, 0] == own, partner[:, 1], partner[:, 0])
        found = np.isfinite(distance[:, 1]) & (other < len(kept))
        if not found.any():
            return first
        pairs = sp.coo_array((np.ones(found.sum()), (own[found], other[found])), shape=(len(kept), len(kept)))
        n, group = connected_components(pairs, directed=False)
        lowest = np.full(n, len(points))
        np.minimum.at(lowest, group, kept)
        first[kept] = lowest[group]
        first = first[first]


def size_pieces(cells: IntArray, n_points: int, linked: Sequence[IntArray] = ()) -> IntArray:
    """Return the number of cells in each connected piece, the largest first; points of a linked group are joined."""
    n_cells = len(cells)
    rows = [np.repeat(np.arange(n_cells), cells.shape[1])]
    rows += [np.full(len(points), n_cells + k) for k, points in enumerate(linked)]
    columns = np.concatenate([cells.ravel(), *linked])
    n_groups = n_cells + len(linked)
    place = np.concatenate(rows), n_groups + columns
    graph = sp.coo_array((np.ones(columns.size, dtype=np.int8), place), 2 * [n_groups + n_points])
    sizes = np.bincount(connected_components(graph, directed=False)[1][:n_cells])
    return -np.sort(-sizes[sizes > 0])


def handedness(points: Array, cells: IntArray, cell_type: str) -> IntArray:
    """Return 1 for each right-handed cell, -1 for a left-handed one and 0 for a flat or twisted one."""
    cell = solid_cell(cell_type)
    quality = cell.shape.scaled_jacobian
    good = quality(points[cells[:, : cell.n_corners]]) > 0
    turned = quality(points[cells[:, cell.mirrored[: cell.n_corners]]]) > 0
    return np.where(good, 1, np.where(turned, -1, 0))


def mid_edge_offsets(points: Array, cells: IntArray, cell_type: str) -> Array:
    """Return the largest distance of a mid-edge node from its edge's middle over its length, shape (n_cells,)."""
    ends = points[edges(cells, cell_type)]
    n_corners, n_edges = solid_cell(cell_type).n_corners, ends.shape[1]
    with np.errstate(invalid="ignore", divide="ignore"):
        off = points[cells[:, n_corners : n_corners + n_edges]] - ends.mean(axis=2)
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        return np.asarray(np.nan_to_num(np.linalg.norm(off, axis=2) / length, nan=np.inf).max(axis=1))


def find_node_order(points: Array, cells: IntArray, cell_type: str) -> IntArray | None:
    """Return the order that puts mid-edge nodes near their edges, or ``None`` if the given one does or none."""
    if not len(cells) or (mid_edge_offsets(points, cells, cell_type) > BENT_EDGE).mean() < MAJORITY:
        return None
    sample = cells[np.linspace(0, len(cells) - 1, min(len(cells), 200)).astype(int)]
    nodes, n_corners = solid_cell(cell_type).nodes, solid_cell(cell_type).n_corners
    N, local = _straight_nodes(cell_type)
    # Compare the nodes with those of cells with straight edges.
    wanted = N.T @ points[sample[:, local]]
    distance = np.linalg.norm(wanted[:, :, None] - points[sample][:, None], axis=3)
    nearest = distance.argmin(axis=2)
    orders, count = np.unique(nearest, axis=0, return_counts=True)
    order = orders[count.argmax()]
    whole = np.array_equal(np.sort(order), np.arange(len(nodes))) and (order[:n_corners] == np.arange(n_corners)).all()
    return order if whole and count.max() >= MAJORITY * len(sample) else None


def find_inside_out(points: Array, cells: IntArray, cell_type: str) -> IntArray:
    """Return the cells of second order with a Jacobian that isn't positive at a quadrature point or a node."""
    kind = solid_cell(cell_type).element(2)
    local = match_nodes(kind.element.doflocs, solid_cell(cell_type).nodes)
    X = np.concatenate(
        [kind.quadrature(kind.stiffness_order)[0], kind.quadrature(kind.mass_order)[0], kind.element.doflocs.T], axis=1
    )
    n_inside = X.shape[1] - len(kind.element.doflocs)
    found = []
    for start in range(0, len(cells), CELLS_AT_ONCE):
        det = np.linalg.det(jacobians(kind.geometry, points[cells[start : start + CELLS_AT_ONCE][:, local]], X))
        size = np.abs(det[:, :n_inside]).max(axis=1, keepdims=True)
        # At a node a cell may be flat, as at the end of a fillet that meets a face.
        bad = (det[:, :n_inside] <= 0).any(axis=1) | (det[:, n_inside:] < -1e-6 * size).any(axis=1)
        found.append(start + np.flatnonzero(bad))
    return np.concatenate(found)


def straighten_cells(points: Array, cells: IntArray, cell_type: str, chosen: IntArray) -> tuple[Array, int, float]:
    """Straighten the edges of chosen cells, and of cells that this turns inside out.

    Returns the points, how many cells were straightened, and the largest displacement of a node.
    """
    points, done = points.copy(), np.zeros(len(cells), dtype=bool)
    before = points.copy()
    N, local = _straight_nodes(cell_type)
    n_corners = solid_cell(cell_type).n_corners
    for _ in range(STRAIGHTENING_ROUNDS):
        done[chosen] = True
        points[cells[chosen, n_corners:]] = (N.T @ points[cells[chosen][:, local]])[:, n_corners:]
        chosen = find_inside_out(points, cells, cell_type)
        if not len(chosen):
            break
    return points, int(done.sum()), float(np.linalg.norm(points - before, axis=1).max())


def _straight_nodes(cell_type: str) -> tuple[Array, IntArray]:
    """Return the weights (n_corners, n_nodes) of corners at a straight cell's nodes, and the corners in their order."""
    cell = solid_cell(cell_type)
    linear = solid_cell(cell.shape.name).element(1).geometry
    return shape_functions(linear, cell.nodes.T)[0], match_nodes(linear.doflocs, cell.shape.nodes(1))

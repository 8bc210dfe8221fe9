"""Meshes of several kinds of solid cells, split into tetrahedra of second order that meet at common nodes.

Each cell is a cone from the first of its corners, by number, over the faces that don't hold it, and a face of four
corners is split from the first of its own; so two cells split a common face alike. Nodes are those of the file, and new
ones in the middle of edges that have none.

References
----------
Dompierre, Labbé, Vallet & Camarero, How to subdivide pyramids, prisms, and hexahedra into tetrahedra, 8th International
Meshing Roundtable, 1999.
"""

from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.table import CELLS
from fmd.fem.elements import match_nodes, shape_functions
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.mesh import rows_among

_TETRA = CELLS["tetra10"]


def split_mixed(raw: RawMesh) -> RawMesh:
    """Return a mesh of several kinds of solid cells as one of tetrahedra of second order, another as it is.

    Raises
    ------
    MeshFileError
        Triangles of some cells lie on quadrilaterals of others, which are split the other way.
    """
    count = {kind: n for kind, n in replace(raw, others={}).count_elements().items() if kind in CELLS}
    if len(count) < 2:
        return raw
    if wrong := _count_cracks(raw):
        raise MeshFileError(
            f"{wrong} triangular facets of elements lie on quadrilateral ones of others, so that these don't meet; put "
            "pyramids between them, or tie two meshes"
        )
    middles = _Middles(raw.points)
    for kind, cells in raw.blocks:
        if kind in CELLS:
            middles.take_edges(CELLS[kind], cells)
    blocks, children = [], []
    for kind, cells in raw.blocks:
        if kind not in CELLS:
            is_quad = kind in ("quad", "quad8", "quad9")
            blocks.append(("triangle", split_facets(cells[:, :4])) if is_quad else (kind, cells))
            children.append(np.repeat(np.arange(len(cells)), 1 + is_quad))
            continue
        corners, parent = _split(CELLS[kind], cells)
        blocks.append((_TETRA.name, middles.complete(CELLS[kind], cells, corners, parent)))
        children.append(parent)
    cell_sets = {
        name: [np.flatnonzero(np.isin(own, each)) for own, each in zip(children, sets, strict=True)]
        for name, sets in raw.cell_sets.items()
    }
    mean = tuple(replace(each, facets=tuple(map(split_facets, each.facets))) for each in raw.connections.mean)
    return replace(
        raw,
        points=middles.all_points(),
        blocks=blocks,
        cell_sets=cell_sets,
        facet_sets={name: list(map(split_facets, facets)) for name, facets in raw.facet_sets.items()},
        connections=replace(raw.connections, mean=mean),
        notes=[
            f"elements of several kinds ({', '.join(f'{n} {kind}' for kind, n in count.items())}) are split into "
            f"{sum(len(cells) for kind, cells in blocks if kind == _TETRA.name)} tetrahedra of second order"
        ],
    )


def split_facets(corners: IntArray) -> IntArray:
    """Return triangles (n, 3) in place of facets of three or four corners."""
    if corners.shape[1] == 3:
        return corners
    first = corners.argmin(axis=1)[:, None]
    turned = np.take_along_axis(corners, (first + np.arange(4)) % 4, axis=1)
    return np.asarray(turned[:, [(0, 1, 2), (0, 2, 3)]].reshape(-1, 3))


def _count_cracks(raw: RawMesh) -> int:
    """Count the triangular facets that halve a quadrilateral one the other way than `split_facets` does."""
    facets: dict[int, list[IntArray]] = {3: [np.zeros((0, 3), dtype=np.int64)], 4: [np.zeros((0, 4), dtype=np.int64)]}
    for kind, cells in raw.blocks:
        for face in CELLS[kind].shape.faces if kind in CELLS else ():
            facets[len(face)].append(cells[:, face])
    triangles, quadrilaterals = np.sort(np.concatenate(facets[3]), axis=1), np.concatenate(facets[4])
    halves = np.sort(np.concatenate([np.delete(quadrilaterals, k, axis=1) for k in range(4)]), axis=1)
    own = np.sort(split_facets(quadrilaterals), axis=1)
    return int((rows_among(triangles, halves) & ~rows_among(triangles, own)).sum())


def _split(cell: SolidCell, cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return local corners (n, 4) of the tetrahedra in cells, and the cell of each, ascending."""
    first = cells[:, : cell.n_corners].argmin(axis=1)
    tetrahedra, parents = [np.zeros((0, 4), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for corner in range(cell.n_corners):
        own = np.flatnonzero(first == corner)
        for face in cell.shape.faces:
            if corner in face:
                continue
            around = np.array(face)
            start = cells[own][:, around].argmin(axis=1) if len(face) == 4 else np.zeros(len(own), dtype=np.int64)
            turned = around[(start[:, None] + np.arange(len(face))) % len(face)]
            for k in range(1, len(face) - 1):
                inward = turned[:, [0, k + 1, k]]  # faces are counter-clockwise from outside
                tetrahedra.append(np.column_stack([inward, np.full(len(own), corner)]))
                parents.append(own)
    parent = np.concatenate(parents)
    order = np.argsort(parent, kind="stable")
    return np.concatenate(tetrahedra)[order], parent[order]


class _Middles:
    """Nodes between two corners: those of the file, and new ones where it has none."""

    def __init__(self, points: Array) -> None:
        self._points, self._new = points, list[Array]()
        self._of: dict[tuple[int, int], int] = {}

    def take_edges(self, cell: SolidCell, cells: IntArray) -> None:
        """Take over the mid-edge nodes of cells of second order, and those in faces and within."""
        for pair, local in _middles_of(cell):
            keys = np.sort(cells[:, pair], axis=1).tolist()
            self._of.update(zip(map(tuple, keys), cells[:, local].tolist(), strict=True))

    def complete(self, cell: SolidCell, cells: IntArray, corners: IntArray, parent: IntArray) -> IntArray:
        """Return the ten nodes of tetrahedra, given their local corners in cells."""
        edges = np.array(_TETRA.shape.edges)
        ends = cells[parent[:, None, None], corners[:, edges]]
        nodes = np.empty((len(corners), 10), dtype=np.int64)
        nodes[:, :4] = cells[parent[:, None], corners]
        keys = np.sort(ends, axis=2)
        for k in range(len(edges)):
            for row, (key, own) in enumerate(zip(map(tuple, keys[:, k].tolist()), parent.tolist(), strict=True)):
                if key not in self._of:
                    self._of[key] = self._add(cell, cells[own], corners[row, edges[k]])
                nodes[row, 4 + k] = self._of[key]
        return nodes

    def all_points(self) -> Array:
        """Return the file's points and the new ones behind them."""
        return np.concatenate([self._points, *(each[None] for each in self._new)])

    def _add(self, cell: SolidCell, nodes: IntArray, ends: IntArray) -> int:
        """Add the point of a cell between two of its corners, on its curved geometry."""
        X = cell.nodes[ends].mean(axis=0)
        N, _ = shape_functions(cell.element(cell.order).geometry, X[:, None])
        local = match_nodes(cell.element(cell.order).geometry.doflocs, cell.nodes)
        self._new.append(N[:, 0] @ self._points[nodes[local]])
        return len(self._points) + len(self._new) - 1


def _middles_of(cell: SolidCell) -> list[tuple[list[int], int]]:
    """Return pairs of a cell's corners and the node between them; a node in a face is between both pairs across it."""
    if cell.order == 1:
        return []
    found = []
    x, n = cell.nodes, cell.n_corners
    for a in range(n):
        for b in range(a + 1, n):
            between = np.flatnonzero(np.abs(x - (x[a] + x[b]) / 2).max(axis=1) < 1e-9)
            found += [([a, b], int(between[0]))] if len(between) else []
    return found

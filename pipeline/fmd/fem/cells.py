"""Tables of the solid cells: corners, faces, edges and reference nodes in meshio's order, which is VTK's."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array

# meshio's cell types, and the cell with straight edges and the same corners.
STRAIGHT = {
    "tetra": "tetra",
    "tetra10": "tetra",
    "hexahedron": "hexahedron",
    "hexahedron20": "hexahedron",
    "hexahedron27": "hexahedron",
    "wedge": "wedge",
    "wedge15": "wedge",
}
N_CORNERS = {"tetra": 4, "hexahedron": 8, "wedge": 6}
N_NODES = N_CORNERS | {"tetra10": 10, "hexahedron20": 20, "hexahedron27": 27, "wedge15": 15}

# Corners around each face, counter-clockwise seen from outside.
FACES = {
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
}
# Corners at the ends of each edge, in the order of the mid-edge nodes.
EDGES = {
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4),
        (0, 4), (1, 5), (2, 6), (3, 7),
    ),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
}  # fmt: skip
# Each corner, and the other ends of the three edges that leave it, right-handed.
_CORNER_EDGES = {
    "tetra": ((0, 1, 2, 3), (1, 2, 0, 3), (2, 0, 1, 3), (3, 0, 2, 1)),
    "hexahedron": (
        (0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7),
        (4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3),
    ),
    "wedge": ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5), (3, 5, 4, 0), (4, 3, 5, 1), (5, 4, 3, 2)),
}  # fmt: skip
# Triple product of the unit edges at a corner of the ideal cell: regular tetrahedron, cube, wedge of equal edges.
_IDEAL = {"tetra": 0.5**0.5, "hexahedron": 1.0, "wedge": 0.75**0.5}
_REFERENCE_CORNERS = {
    "tetra": ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "hexahedron": (
        (0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
        (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1),
    ),
    "wedge": ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)),
}  # fmt: skip
# Faces of the hexahedron of 27 nodes in the order of the nodes at their centres; the node inside comes last.
_HEX27_FACES = ((0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7))


def vtk_nodes(cell_type: str, order: int) -> Array:
    """Return the reference coordinates of an element's nodes in VTK's and meshio's order, shape (n_local, 3).

    Parameters
    ----------
    cell_type : str
        meshio's name of the cell.
    order : int
        Order of the element on it, 1 or 2.
    """
    straight = STRAIGHT[cell_type]
    corners = np.array(_REFERENCE_CORNERS[straight], dtype=float)
    if order == 1:
        return corners
    nodes = [corners, corners[np.array(EDGES[straight])].mean(axis=1)]
    if cell_type == "hexahedron27":
        nodes += [corners[np.array(_HEX27_FACES)].mean(axis=1), corners.mean(axis=0, keepdims=True)]
    return np.concatenate(nodes)


def scaled_jacobian(x: Array, cell_type: str) -> Array:
    """Return the smallest scaled Jacobian over the corners of each straight cell, shape (n_cells,).

    Parameters
    ----------
    x : ndarray, shape (n_cells, n_corners, 3)
        Corner positions [m].
    cell_type : str
        ``tetra``, ``hexahedron`` or ``wedge``.
    """
    corner, *ends = np.array(_CORNER_EDGES[cell_type]).T
    edges = np.stack([x[:, end] - x[:, corner] for end in ends], axis=-2)
    lengths = np.linalg.norm(edges, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scaled = np.linalg.det(edges / lengths[..., None]) / _IDEAL[cell_type]
    return np.asarray(np.nan_to_num(scaled, nan=0.0).min(axis=1))

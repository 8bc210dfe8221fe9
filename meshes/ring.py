"""Conversions of cells with edges along r, θ and z to tetrahedra and to second order."""

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from fmd.meshes.gmsh_session import MeshArrays

Floats = NDArray[np.float64]

# Corners at the ends of each edge, in the order of meshio's (VTK's) mid-edge nodes.
_EDGES = {
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
}
_SECOND_ORDER = {"tetra": "tetra10", "hexahedron": "hexahedron20"}


def split_into_tetrahedra(mesh: MeshArrays) -> MeshArrays:
    """Split each hexahedron into the six tetrahedra around its diagonal towards greater r, θ and z (Kuhn 1960).

    All cells are split in the same sense, so the tetrahedra conform and keep the cyclic symmetry.
    """
    polar = _polar(mesh.points[mesh.cells])
    upper = polar > polar.mean(axis=1, keepdims=True)
    corners = np.take_along_axis(mesh.cells, np.argsort(upper @ (4, 2, 1), axis=1), axis=1)
    split = [(0, 4 >> a, 7 - (4 >> c), 7) for a, _, c in permutations(range(3))]
    even = [np.linalg.det(np.eye(3)[list(axes)]) > 0 for axes in permutations(range(3))]
    split = [path if direct else (*path[:2], *path[:1:-1]) for path, direct in zip(split, even, strict=True)]
    each = np.arange(len(split))
    parts = {name: (len(split) * cells[:, None] + each).ravel() for name, cells in mesh.parts.items()}
    return mesh._replace(cells=corners[:, split].reshape(-1, 4), cell_type="tetra", parts=parts)


def add_mid_edge_nodes(mesh: MeshArrays) -> MeshArrays:
    """Add a node in the middle of each edge, the middle in r, θ and z."""
    ends = np.sort(mesh.cells[:, _EDGES[mesh.cell_type]], axis=-1)
    edges, number = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    r, angle, z = np.moveaxis(_polar(mesh.points[edges]).mean(axis=1), -1, 0)
    start = mesh.points[edges[:, 0]]
    angle = angle + np.arctan2(start[:, 1], start[:, 0])
    middles = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    cells = np.concatenate([mesh.cells, len(mesh.points) + number.reshape(len(mesh.cells), -1)], axis=1)
    return mesh._replace(
        points=np.concatenate([mesh.points, middles]), cells=cells, cell_type=_SECOND_ORDER[mesh.cell_type]
    )


def _polar(x: Floats) -> Floats:
    """Return (r, θ, z) of points (n, k, 3), with angles from the first of each k."""
    angle = np.arctan2(x[..., 1], x[..., 0])
    turned = (angle - angle[:, :1] + np.pi) % (2 * np.pi) - np.pi
    return np.stack([np.hypot(x[..., 0], x[..., 1]), turned, x[..., 2]], axis=-1)

"""The solid mesh: points, cells, named parts and faces, checked once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.checks import AccuracyError, Array, IntArray, read_only, require_finite, require_shape

# Corners of each cell and the three that end the edges leaving it, in meshio's order.
_CORNERS = {
    "tetra": ((0, 1, 2, 3), (1, 2, 0, 3), (2, 0, 1, 3), (3, 0, 2, 1)),
    "hexahedron": (
        (0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7),
        (4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3),
    ),
}  # fmt: skip
# Corners around each face, seen from outside.
_FACES = {
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
# Triple product of unit edges in the ideal cell: 1 for a cube, 1/√2 for the regular tetrahedron.
_IDEAL = {"tetra": 0.5**0.5, "hexahedron": 1.0}


@dataclass(frozen=True)
class SolidMesh:
    """A mesh of one kind of solid cell.

    Parameters
    ----------
    points : ndarray, shape (n_points, 3)
        Positions [m].
    cells : ndarray, shape (n_cells, 4 or 8)
        Point numbers in meshio's order.
    cell_type : str
        ``tetra`` or ``hexahedron``.
    parts, faces : mapping of str to ndarray
        Cell numbers of each part; point numbers on each face.
    sectors : int
        How many equal parts a turn about the z axis carries into each other: 1 if the mesh is not cyclic.

    Raises
    ------
    AccuracyError
        A cell is inverted or flat; the message counts them.
    """

    points: Array
    cells: IntArray
    cell_type: str
    parts: Mapping[str, IntArray]
    faces: Mapping[str, IntArray]
    sectors: int = 1

    def __post_init__(self) -> None:
        if self.cell_type not in _CORNERS:
            raise ValueError(f"cell_type is {self.cell_type!r}, expected one of {', '.join(_CORNERS)}")
        require_shape("points", self.points, (None, 3))
        require_shape("cells", self.cells, (None, len(_CORNERS[self.cell_type]) if self.cell_type != "tetra" else 4))
        require_finite("points", self.points)
        if self.cells.min() < 0 or self.cells.max() >= len(self.points):
            raise ValueError(f"cells name points outside 0…{len(self.points) - 1}")
        read_only(self.points)
        read_only(self.cells)
        bad = np.count_nonzero(self.quality <= 0)
        if bad:
            raise AccuracyError(f"{bad} of {len(self.cells)} cells are inverted or flat (scaled Jacobian ≤ 0)")

    @cached_property
    def quality(self) -> Array:
        """Smallest scaled Jacobian over the corners of each cell, shape (n_cells,): 1 is the ideal cell."""
        corner, *ends = np.array(_CORNERS[self.cell_type]).T
        x = self.points[self.cells]
        edges = np.stack([x[:, end] - x[:, corner] for end in ends], axis=-2)
        lengths = np.linalg.norm(edges, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            scaled = np.linalg.det(edges / lengths[..., None]) / _IDEAL[self.cell_type]
        return np.asarray(np.nan_to_num(scaled, nan=0.0).min(axis=1))

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [m³], exact for cells with straight edges: each is summed over tetrahedra from its faces."""
        x = self.points[self.cells]
        faces = np.array(_FACES[self.cell_type])
        corners = x[:, faces]  # (n_cells, n_faces, n_around, 3)
        middle = corners.mean(axis=2, keepdims=True)
        following = np.roll(corners, -1, axis=2)
        return float(
            np.abs(np.einsum("efci,efci->", np.cross(corners, following), np.broadcast_to(middle, corners.shape))) / 6
        )

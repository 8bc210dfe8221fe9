"""The solid mesh: points, cells, named parts and faces, checked once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.core.arrays import Array, IntArray, read_only, require_finite, require_shape
from pipeline.core.errors import AccuracyError

# Corners of each cell and the three that end the edges leaving it, in meshio's order.
_CORNERS = {
    "tetra": ((0, 1, 2, 3), (1, 2, 0, 3), (2, 0, 1, 3), (3, 0, 2, 1)),
    "hexahedron": (
        (0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7),
        (4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3),
    ),
    "wedge": ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5), (3, 5, 4, 0), (4, 3, 5, 1), (5, 4, 3, 2)),
}  # fmt: skip
# Corners around each face, seen from outside.
FACES = {
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
}
# Triple product of unit edges in the ideal cell: 1 for a cube, 1/√2 for the regular tetrahedron, its face's on a wedge.
_IDEAL = {"tetra": 0.5**0.5, "hexahedron": 1.0, "wedge": 0.75**0.5}
# meshio's cells: the one with straight edges that each may bend, its corners, all its nodes.
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


@dataclass(frozen=True)
class SolidMesh:
    """A mesh of one kind of solid cell.

    Parameters
    ----------
    points : ndarray, shape (n_points, 3)
        Positions [m].
    cells : ndarray, shape (n_cells, n_local)
        Point numbers in meshio's order, those of mid-edge nodes too if the cells are of second order.
    cell_type : str
        ``tetra``, ``hexahedron``, ``wedge``; with curved edges ``tetra10``, ``hexahedron20``, ``hexahedron27``,
        ``wedge15``.
    parts, faces : mapping of str to ndarray
        Cell numbers of each part; of each face its point numbers (n,), or the corners (n_facets, 3 or 4) of its facets.
    sectors : int
        How many equal parts a turn about the z axis carries into each other: 1 if the mesh is not cyclic.
    notes : tuple of str
        What was found in the file that the mesh comes from and set aside or mended, with counts.

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
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.cell_type not in STRAIGHT:
            raise ValueError(f"cell_type is {self.cell_type!r}, expected one of {', '.join(STRAIGHT)}")
        require_shape("points", self.points, (None, 3))
        require_shape("cells", self.cells, (None, N_NODES[self.cell_type]))
        require_finite("points", self.points)
        if self.cells.min() < 0 or self.cells.max() >= len(self.points):
            raise ValueError(f"cells name points outside 0…{len(self.points) - 1}")
        read_only(self.points)
        read_only(self.cells)
        bad = np.count_nonzero(self.quality <= 0)
        if bad:
            raise AccuracyError(f"{bad} of {len(self.cells)} cells are inverted or flat (scaled Jacobian ≤ 0)")

    @property
    def corners(self) -> IntArray:
        """Point numbers of the cells' corners, shape (n_cells, 4, 6 or 8)."""
        return self.cells[:, : N_CORNERS[STRAIGHT[self.cell_type]]]

    @property
    def order(self) -> int:
        """Order of the cells' own nodes: 2 if they have mid-edge nodes."""
        return 1 if self.cell_type in N_CORNERS else 2

    @cached_property
    def quality(self) -> Array:
        """Smallest scaled Jacobian over the corners of each cell, shape (n_cells,): 1 is the ideal cell."""
        return scaled_jacobian(self.points[self.corners], STRAIGHT[self.cell_type])

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [m³]; of cells with straight edges exactly: each is summed over tetrahedra from its faces."""
        if self.order == 2:
            from pipeline.fem.model import Discretisation

            return float(Discretisation(self, 2).volumes.sum())
        x = self.points[self.cells]
        volume = 0.0
        for face in FACES[self.cell_type]:
            corners = x[:, face]  # (n_cells, n_around, 3)
            following = np.roll(corners, -1, axis=1)
            volume += float(np.einsum("eci,ei->", np.cross(corners, following), corners.mean(axis=1)))
        return abs(volume) / 6


def rows_among(rows: IntArray, table: IntArray) -> NDArray[np.bool_]:
    """Whether each of the rows (n, k) is a row of the table (m, k)."""
    _, number = np.unique(np.concatenate([table, rows]), axis=0, return_inverse=True)
    return np.isin(number[len(table) :], number[: len(table)])


def scaled_jacobian(x: Array, cell_type: str) -> Array:
    """Smallest scaled Jacobian over the corners x (n_cells, n_corners, 3) of each straight cell, shape (n_cells,)."""
    corner, *ends = np.array(_CORNERS[cell_type]).T
    edges = np.stack([x[:, end] - x[:, corner] for end in ends], axis=-2)
    lengths = np.linalg.norm(edges, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scaled = np.linalg.det(edges / lengths[..., None]) / _IDEAL[cell_type]
    return np.asarray(np.nan_to_num(scaled, nan=0.0).min(axis=1))

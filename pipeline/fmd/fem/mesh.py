"""The solid mesh: points, cells, named parts and faces, checked when it is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array, IntArray, read_only, require_finite, require_shape, short_repr
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.table import solid_cell
from fmd.fem.connections import Connections
from fmd.fem.elements import jacobians, match_nodes
from fmd.fem.midsurface import Layup, Midsurface


@dataclass(frozen=True)
class SolidMesh:
    """A mesh of one type of solid cell.

    Raises
    ------
    AccuracyError
        A cell is inverted or flat; the message counts them.
    """

    points: Array  # (n_points, 3): positions [m]
    # (n_cells, n_local): point numbers in meshio's order, those of mid-edge nodes too if the cells are of second order
    cells: IntArray
    cell_type: str  # meshio's name of a cell in `fem.cells.table`, e.g. ``tetra``; with curved edges ``tetra10``
    parts: Mapping[str, IntArray]  # cell numbers of each part
    # of each face its point numbers (n,), or the corners (n_facets, 3 or 4) of its facets
    faces: Mapping[str, IntArray]
    # Number of equal sectors around the z axis, whose cells follow one another; 1 if the mesh is not cyclic.
    sectors: int = 1
    notes: tuple[str, ...] = ()  # faults of the file that the mesh was read from, and how they were mended, with counts
    connections: Connections | None = None  # links, masses, springs and equations of the file
    # That of a shell, whose cells are one layer between both faces, or the line of beams.
    midsurface: Midsurface | None = None
    # (4,): area [m²] and centre [m] of faces by their geometry, which CAD files have beside the mesh
    centres: Mapping[str, Array] = field(default_factory=dict)
    geometry_volume: float = 0.0  # of the geometry [m³], 0 where that isn't known

    __repr__ = short_repr

    def __post_init__(self) -> None:
        require_shape("points", self.points, (None, 3))
        require_shape("cells", self.cells, (None, len(self.cell.nodes)))
        require_finite("points", self.points)
        if self.cells.min() < 0 or self.cells.max() >= len(self.points):
            raise ValueError(f"cells name points outside 0…{len(self.points) - 1}")
        read_only(self.points)
        read_only(self.cells)
        bad = np.count_nonzero(self.quality <= 0)
        if bad:
            raise AccuracyError(f"{bad} of {len(self.cells)} cells are inverted or flat (scaled Jacobian ≤ 0)")

    @property
    def cell(self) -> SolidCell:
        """The type of the cells."""
        return solid_cell(self.cell_type) if self.midsurface is None else self.midsurface.cell(self.cell_type)

    @property
    def corners(self) -> IntArray:
        """Point numbers of the cells' corners, shape (n_cells, n_corners)."""
        return self.cells[:, : self.cell.n_corners]

    @property
    def order(self) -> int:
        """Order of the cells' own nodes: 2 if they have mid-edge nodes."""
        return self.cell.order

    @property
    def members(self) -> tuple[SolidMesh, ...]:
        """The mesh as the only one of a body."""
        return (self,)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cells)

    @property
    def layup(self) -> Layup | None:
        """Layers of a shell's elements by its deck."""
        return None if self.midsurface is None else self.midsurface.layup

    @cached_property
    def quality(self) -> Array:
        """Smallest scaled Jacobian over the corners of each cell, shape (n_cells,): 1 is the ideal cell."""
        return self.cell.shape.scaled_jacobian(self.points[self.corners])

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [m³], exact for cells with straight edges."""
        if self.order == 2:
            return self._curved_volume()
        x = self.points[self.cells]
        volume = 0.0
        for face in self.cell.shape.faces:  # tetrahedra from the origin to the faces, these split about their centres
            corners = x[:, face]  # (n_cells, n_around, 3)
            following = np.roll(corners, -1, axis=1)
            volume += float(np.einsum("eci,ei->", np.cross(corners, following), corners.mean(axis=1)))
        return abs(volume) / 6

    def _curved_volume(self) -> float:
        """Integrate the Jacobian determinants of cells with curved edges [m³]."""
        kind = self.cell.element(2)
        local = match_nodes(kind.element.doflocs, self.cell.nodes)
        X, w = kind.quadrature(kind.mass_order)
        determinants = np.linalg.det(jacobians(kind.geometry, self.points[self.cells[:, local]], X))
        return float(np.abs(determinants @ w).sum())


def three_corners(corners: IntArray) -> IntArray:
    """Return three corners of each facet, ascending, which identify one of four corners too."""
    return np.asarray(np.sort(corners, axis=1)[:, :3])


def rows_among(rows: IntArray, table: IntArray) -> NDArray[np.bool_]:
    """Return for each of the rows (n, k) whether it is a row of the table (m, k), shape (n,)."""
    _, number = np.unique(np.concatenate([table, rows]), axis=0, return_inverse=True)
    return np.isin(number[len(table) :], number[: len(table)])

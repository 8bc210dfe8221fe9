"""Tetrahedra of 4 and 10 nodes."""

import numpy as np

from fmd.core.arrays import Array
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.shape import CellShape, skfem_element, skfem_quadrature
from fmd.fem.elements import ElementKind


class Tetrahedron(CellShape):
    """The tetrahedron x, y, z ≥ 0, x + y + z ≤ 1."""

    name = "tetra"
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))
    edges = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
    faces = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
    abaqus_faces = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
    corner_edges = ((0, 1, 2, 3), (1, 2, 0, 3), (2, 0, 1, 3), (3, 0, 2, 1))
    ideal = 0.5**0.5

    @staticmethod
    def quadrature(order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,), exact to a polynomial degree."""
        return skfem_quadrature("RefTet", order)

    @staticmethod
    def reach(x: Array) -> float:
        """Return x + y + z, at most 1 inside."""
        return float(x.sum())

    @staticmethod
    def stress_terms(x: Array) -> tuple[Array, ...]:
        """Return the constant and the linear functions at places x (3, n)."""
        return np.ones(x.shape[1]), *x


_P1, _P2 = skfem_element("ElementTetP1"), skfem_element("ElementTetP2")
_TET4 = ElementKind("tet4", 10, Tetrahedron, 1, _P1, _P1, 0, 2, 0, is_affine=True)
_STRAIGHT_TET10 = ElementKind("tet10", 24, Tetrahedron, 2, _P2, _P1, 2, 4, 2, is_affine=True)
_CURVED_TET10 = ElementKind("tet10", 24, Tetrahedron, 2, _P2, _P2, 2, 5, 2)

CELLS = (
    SolidCell("tetra", Tetrahedron, 1, (_TET4, _STRAIGHT_TET10), nastran=("CTETRA",)),
    SolidCell("tetra10", Tetrahedron, 2, (_CURVED_TET10,), nastran=("CTETRA",)),
)

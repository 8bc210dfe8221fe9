"""Hexahedra of 8, 20 and 27 nodes."""

import numpy as np

from fmd.core.arrays import Array
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.shape import CellShape, skfem_element, skfem_quadrature
from fmd.fem.elements import ElementKind


class Hexahedron(CellShape):
    """The cube 0 ≤ x, y, z ≤ 1."""

    name = "hexahedron"
    corners = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
    edges = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
    faces = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
    abaqus_faces = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))
    corner_edges = (
        *((0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7)),
        *((4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3)),
    )
    ideal = 1.0

    @staticmethod
    def quadrature(order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,), exact to a degree along each axis."""
        return skfem_quadrature("RefHex", order)

    @staticmethod
    def reach(x: Array) -> float:
        """Return the largest coordinate, at most 1 inside."""
        return float(x.max())

    @staticmethod
    def stress_terms(x: Array) -> tuple[Array, ...]:
        """Return the trilinear functions at places x (3, n)."""
        xy = x[0] * x[1]
        return np.ones(x.shape[1]), *x, xy, x[1] * x[2], x[2] * x[0], xy * x[2]


_LINEAR, _SERENDIPITY, _FULL = (skfem_element(name) for name in ("ElementHex1", "ElementHexS2", "ElementHex2"))
_HEX8 = ElementKind("hex8", 12, Hexahedron, 1, _LINEAR, _LINEAR, 3, 3, 3, can_be_enhanced=True)
_STRAIGHT_HEX20 = ElementKind("hex20", 25, Hexahedron, 2, _SERENDIPITY, _LINEAR, 5, 5, 3)
_CURVED_HEX20 = ElementKind("hex20", 25, Hexahedron, 2, _SERENDIPITY, _SERENDIPITY, 5, 7, 3)
_HEX27 = ElementKind("hex27", 29, Hexahedron, 2, _FULL, _FULL, 5, 7, 3)
# The faces in the order of the nodes at their centres; the node inside comes last.
_CENTRES = ((0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7), tuple(range(8)))

CELLS = (
    SolidCell("hexahedron", Hexahedron, 1, (_HEX8, _STRAIGHT_HEX20), nastran=("CHEXA",)),
    SolidCell(
        "hexahedron20",
        Hexahedron,
        2,
        (_CURVED_HEX20,),
        nastran=("CHEXA",),
        nastran_order=(*range(12), *range(16, 20), *range(12, 16)),  # its upright edges come before the upper ones
    ),
    SolidCell(
        "hexahedron27",
        Hexahedron,
        2,
        (_HEX27,),
        centres=_CENTRES,
        abaqus_order=(*range(20), 26, 24, 23, 25, 21, 22, 20),  # its inner node comes before those in the faces
    ),
)

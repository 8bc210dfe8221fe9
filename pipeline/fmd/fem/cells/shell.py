"""Shells of four and three nodes, as solid cells of one layer between the points at both faces."""

from functools import partial

import numpy as np

from fmd.core.arrays import Array
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.hexahedron import Hexahedron
from fmd.fem.cells.shape import OwnElement, skfem_quadrature
from fmd.fem.cells.wedge import Wedge, WedgeElement
from fmd.fem.elements import ElementKind
from fmd.fem.shell_strain import across_plane_stress, from_middle, quadrilateral_strain, triangle_strain


def _quadrature(cell: str, order: int) -> tuple[Array, Array]:
    """Return points (3, n_q) and weights (n_q,) exact to a degree in the plane and across it, place by place there."""
    of_shear = 4  # the square of its parabola
    (XY, w_plane), (Z, w_line) = skfem_quadrature(cell, order), skfem_quadrature("RefLine", max(order, of_shear))
    X = np.concatenate([np.tile(XY, len(w_line)), np.repeat(Z, len(w_plane), axis=1)])
    return X, np.tile(w_plane, len(w_line)) * np.repeat(w_line, len(w_plane))


def _at_faces(cell: str, order: int) -> Array:
    """Return the points of a rule in the plane, on the lower face and then on the upper one, shape (3, 2 n)."""
    XY, _ = skfem_quadrature(cell, order)
    return np.concatenate([np.tile(XY, 2), np.repeat([[0.0, 1.0]], XY.shape[1], axis=1)])


class ShellQuadrilateral(Hexahedron):
    """The cube, whose third coordinate runs through the thickness."""

    @staticmethod
    def quadrature(order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,), exact to a degree in the plane and across it."""
        return _quadrature("RefQuad", order)

    @classmethod
    def stress_points(cls, order: int) -> Array:
        """Return the points (3, 8) on both faces at which stresses are taken."""
        return _at_faces("RefQuad", order)


class ShellTriangle(Wedge):
    """The wedge, whose third coordinate runs through the thickness."""

    @staticmethod
    def quadrature(order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,), exact to a degree in the plane and across it."""
        return _quadrature("RefTri", order)

    @classmethod
    def stress_points(cls, order: int) -> Array:
        """Return the points (3, 6) on both faces at which stresses are taken."""
        return _at_faces("RefTri", order)


class QuadrilateralElement(OwnElement):
    """Trilinear functions of the eight points of a shell's quadrilateral."""

    shape = ShellQuadrilateral

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Return value (n_q,) and gradient (3, n_q) of shape function i at points X (3, n_q)."""
        corner = np.array(self.shape.corners[i], dtype=float)[:, None]
        f, slope = 1 - corner + (2 * corner - 1) * X, 2 * corner[:, 0] - 1
        return f.prod(axis=0), np.stack([slope[a] * f[(a + 1) % 3] * f[(a + 2) % 3] for a in range(3)])


_QUAD, _TRI = partial(QuadrilateralElement, 1), partial(WedgeElement, 1)
_MITC4 = ElementKind(
    "mitc4",
    12,
    ShellQuadrilateral,
    1,
    _QUAD,
    _QUAD,
    3,
    3,
    3,
    strain_matrix=quadrilateral_strain,
    stressed=across_plane_stress,
    from_middle=from_middle,
)
_MITC3 = ElementKind(
    "mitc3+",
    13,
    ShellTriangle,
    1,
    _TRI,
    _TRI,
    4,
    3,
    2,
    strain_matrix=triangle_strain,
    stressed=across_plane_stress,
    from_middle=from_middle,
)

SHELLS = {
    cell.name: cell
    for cell in (
        SolidCell("hexahedron", ShellQuadrilateral, 1, (_MITC4,)),
        SolidCell("wedge", ShellTriangle, 1, (_MITC3,)),
    )
}

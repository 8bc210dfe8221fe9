"""Wedges of 6 and 15 nodes, of which scikit-fem has the shape functions only in part.

Reference cell: the triangle r, s ≥ 0, r + s ≤ 1 times 0 ≤ t ≤ 1. With L = (1 − r − s, r, s) and ζ = 2t − 1 the nodes of
the serendipity wedge have (Zienkiewicz & Taylor, The Finite Element Method, vol. 1, 5th ed., section 8.12)

    corners     ½ L_i ((2 L_i − 1)(1 + ζ ζ_i) − (1 − ζ²))
    triangles   2 L_i L_j (1 + ζ ζ_i)
    uprights    L_i (1 − ζ²)
"""

from functools import partial

import numpy as np

from fmd.core.arrays import Array
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.shape import CellShape, OwnElement, skfem_quadrature
from fmd.fem.elements import ElementKind

_CORNERS = ((0, -1), (1, -1), (2, -1), (0, 1), (1, 1), (2, 1))  # corner of the triangle, and ζ
_SIDES = ((0, 1, -1), (1, 2, -1), (0, 2, -1), (0, 1, 1), (1, 2, 1), (0, 2, 1))
_SLOPES = np.array([(-1.0, -1.0), (1.0, 0.0), (0.0, 1.0)])  # of L by r, s


class Wedge(CellShape):
    """The triangle x, y ≥ 0, x + y ≤ 1 times 0 ≤ z ≤ 1."""

    name = "wedge"
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1))
    edges = ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
    faces = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
    abaqus_faces = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
    corner_edges = ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5), (3, 5, 4, 0), (4, 3, 5, 1), (5, 4, 3, 2))
    ideal = 0.75**0.5

    @staticmethod
    def quadrature(order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,), exact to a degree in the triangle's plane and along z."""
        (XY, w_plane), (Z, w_line) = skfem_quadrature("RefTri", order), skfem_quadrature("RefLine", order)
        n_plane, n_line = len(w_plane), len(w_line)
        X = np.concatenate([np.tile(XY, n_line), np.repeat(Z, n_plane, axis=1)])
        return X, np.tile(w_plane, n_line) * np.repeat(w_line, n_plane)

    @staticmethod
    def reach(x: Array) -> float:
        """Return the larger of x + y and z, at most 1 inside."""
        return float(max(x[0] + x[1], x[2]))

    @staticmethod
    def stress_terms(x: Array) -> tuple[Array, ...]:
        """Return the functions at places x (3, n) that are linear in the triangle and along it."""
        return np.ones(x.shape[1]), *x, x[1] * x[2], x[2] * x[0]


class WedgeElement(OwnElement):
    """Shape functions of a wedge of 6 or 15 nodes."""

    shape = Wedge

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Return value (n_q,) and gradient (3, n_q) of shape function i at points X (3, n_q)."""
        L, zeta = np.array([1 - X[0] - X[1], X[0], X[1]]), 2 * X[2] - 1
        one = np.ones_like(zeta)
        if i < 6:
            a, end = _CORNERS[i]
            if self.edge_dofs:
                value = 0.5 * L[a] * ((2 * L[a] - 1) * (1 + zeta * end) - (1 - zeta**2))
                by_L = {a: 0.5 * ((4 * L[a] - 1) * (1 + zeta * end) - (1 - zeta**2))}
                by_zeta = 0.5 * L[a] * ((2 * L[a] - 1) * end + 2 * zeta)
            else:
                value = 0.5 * L[a] * (1 + zeta * end)
                by_L, by_zeta = {a: 0.5 * (1 + zeta * end)}, 0.5 * L[a] * end
        elif i < 12:
            a, b, end = _SIDES[i - 6]
            value = 2 * L[a] * L[b] * (1 + zeta * end)
            by_L = {a: 2 * L[b] * (1 + zeta * end), b: 2 * L[a] * (1 + zeta * end)}
            by_zeta = 2 * L[a] * L[b] * end
        else:
            a = i - 12
            value = L[a] * (1 - zeta**2)
            by_L, by_zeta = {a: 1 - zeta**2}, -2 * L[a] * zeta
        plane = np.sum([np.outer(_SLOPES[k], slope) for k, slope in by_L.items()], axis=0)
        return value, np.concatenate([plane, [2 * by_zeta * one]])


_LINEAR, _QUADRATIC = partial(WedgeElement, 1), partial(WedgeElement, 2)
_WEDGE6 = ElementKind("wedge6", 13, Wedge, 1, _LINEAR, _LINEAR, 2, 3, 2)

CELLS = (
    SolidCell("wedge", Wedge, 1, (_WEDGE6,), nastran=("CPENTA",)),
    SolidCell(
        "wedge15",
        Wedge,
        2,
        (ElementKind("wedge15", 26, Wedge, 2, _QUADRATIC, _QUADRATIC, 4, 6, 2),),
        nastran=("CPENTA",),
        nastran_order=(*range(9), *range(12, 15), *range(9, 12)),  # its upright edges come before the upper ones
    ),
)

"""Wedges of 6 and 15 nodes: shape functions and quadrature, which scikit-fem has only in part.

Reference cell: the triangle r, s ≥ 0, r + s ≤ 1 times 0 ≤ t ≤ 1. With L = (1 − r − s, r, s) and ζ = 2t − 1 the nodes of
the serendipity wedge have (Zienkiewicz & Taylor, The Finite Element Method, vol. 1, 5th ed., section 8.12)

    corners     ½ L_i ((2 L_i − 1)(1 + ζ ζ_i) − (1 − ζ²))
    triangles   2 L_i L_j (1 + ζ ζ_i)
    uprights    L_i (1 − ζ²)
"""

from __future__ import annotations

import numpy as np
from skfem.quadrature import get_quadrature
from skfem.refdom import RefLine, RefTri, RefWedge

from fmd.core.arrays import Array

_CORNERS = ((0, -1), (1, -1), (2, -1), (0, 1), (1, 1), (2, 1))  # corner of the triangle, and ζ
_SIDES = ((0, 1, -1), (1, 2, -1), (0, 2, -1), (0, 1, 1), (1, 2, 1), (0, 2, 1))
_TRIANGLE = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
_SLOPES = np.array([(-1.0, -1.0), (1.0, 0.0), (0.0, 1.0)])  # of L by r, s


class Wedge:
    """A wedge of 6 or 15 nodes with the attributes of a scikit-fem element that `elements` reads.

    Parameters
    ----------
    order : int
        1 or 2.
    """

    refdom = RefWedge

    def __init__(self, order: int) -> None:
        self.edge_dofs = order - 1
        corners = [(*_TRIANGLE[i], (zeta + 1) / 2) for i, zeta in _CORNERS]
        sides = [(*_TRIANGLE[[i, j]].mean(axis=0), (zeta + 1) / 2) for i, j, zeta in _SIDES]
        uprights = [(*corner, 0.5) for corner in _TRIANGLE]
        self.doflocs: Array = np.array(corners if order == 1 else corners + sides + uprights)

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


def wedge_quadrature(order: int) -> tuple[Array, Array]:
    """Return points (3, n_q) and weights (n_q,), exact to a degree in the triangle's plane and along t."""
    (XY, w_plane), (Z, w_line) = get_quadrature(RefTri, order), get_quadrature(RefLine, order)
    n_plane, n_line = len(w_plane), len(w_line)
    X = np.concatenate([np.tile(XY, n_line), np.repeat(Z, n_plane, axis=1)])
    return X, np.tile(w_plane, n_line) * np.repeat(w_line, n_plane)

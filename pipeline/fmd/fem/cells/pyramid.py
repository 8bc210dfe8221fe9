"""Pyramids of 5 and 13 nodes, which join hexahedra to tetrahedra.

Reference cell: 0 ≤ x, y ≤ 1 − z, 0 ≤ z ≤ 1. With ``u = x / (1 − z)``, ``v = y / (1 − z)`` from 0 to 1, ``ξ = 2u − 1``
and ``η = 2v − 1`` the shape functions are those of Bedrosian (Int J Num Meth Eng 35, 1992), rational in x, y, z:

    5 nodes     base corners   ¼ (1 − z) (1 + ξ ξ_i) (1 + η η_i)
                apex           z
    13 nodes    base corners   ¼ (1 − z) (1 + ξ ξ_i) (1 + η η_i) ((1 − z) (ξ ξ_i + η η_i) − 1)
                base sides     ½ (1 − z)² (1 − ξ²) (1 + η η_i),  ½ (1 − z)² (1 + ξ ξ_i) (1 − η²)
                slanted sides  z (1 − z) (1 + ξ ξ_i) (1 + η η_i)
                apex           z (2 z − 1)

They span the linear functions and ``xy / (1 − z)``, or the quadratic ones and ``xy``, ``x²y``, ``xy²`` over ``1 − z``;
on the faces they are those of the neighbours, triangles of 3 or 6 nodes and quadrilaterals of 4 or 8. Being polynomials
of u, v and z, where ``dx dy dz = (1 − z)² du dv dz``, they are integrated by Gauss points along u and v and by
Gauss–Jacobi points along z (Stroud, Approximate Calculation of Multiple Integrals, 1971, section 2.4). At the apex,
where gradients depend on the direction, they are those along the axis.
"""

from functools import partial

import numpy as np

from fmd.core.arrays import Array
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.shape import CellShape, OwnElement
from fmd.fem.elements import ElementKind

_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))  # ξ and η of the base's corners
_SIDES = ((0, -1), (1, 0), (0, 1), (-1, 0))  # ξ and η of the middles of the base's sides


class Pyramid(CellShape):
    """The pyramid 0 ≤ x, y ≤ 1 − z, 0 ≤ z ≤ 1 with its apex above the first corner."""

    name = "pyramid"
    corners = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1))
    edges = ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4))
    faces = ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4))
    abaqus_faces = ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0))
    corner_edges = (
        *((0, 1, 3, 4), (1, 2, 0, 4), (2, 3, 1, 4), (3, 0, 2, 4)),
        *((4, 1, 0, 3), (4, 2, 1, 0), (4, 3, 2, 1), (4, 0, 3, 2)),
    )
    ideal = 0.5**0.5

    @staticmethod
    def quadrature(order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,), exact to a degree along u, v and z each."""
        from scipy.special import roots_jacobi, roots_legendre

        n = order // 2 + 1
        (line, w_line), (height, w_height) = roots_legendre(n), roots_jacobi(n, 2, 0)
        u, v, z = (0.5 * (1 + each) for each in np.meshgrid(line, line, height, indexing="ij"))
        w = w_line[:, None, None] * w_line[:, None] * w_height / 32
        return np.stack([u * (1 - z), v * (1 - z), z]).reshape(3, -1), w.ravel()

    @staticmethod
    def reach(x: Array) -> float:
        """Return the larger of x + z and y + z, at most 1 inside."""
        return float(max(x[0], x[1]) + x[2])

    @staticmethod
    def stress_terms(x: Array) -> tuple[Array, ...]:
        """Return the shape functions' five terms at places x (3, n)."""
        return np.ones(x.shape[1]), *x, x[0] * _collapsed(x)[1]

    @classmethod
    def stress_points(cls, order: int) -> Array:
        """Return the five points of the rule of degree two (Felippa, Engineering Computations 21, 2004)."""
        if order != 2:
            raise ValueError(f"stresses of pyramids are taken at the points of degree 2, not {order}")
        off = 0.8 * np.sqrt(2 / 15)
        around = [(5 / 6 * (0.5 + off * xi), 5 / 6 * (0.5 + off * eta), 1 / 6) for xi, eta in _CORNERS]
        return np.array([*around, (0.15, 0.15, 0.7)]).T


class PyramidElement(OwnElement):
    """Shape functions of a pyramid of 5 or 13 nodes."""

    shape = Pyramid

    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Return value (n_q,) and gradient (3, n_q) of shape function i at points X (3, n_q)."""
        z, flat = X[2], np.zeros_like(X[2])
        if i == 4:
            value, slope = (z * (2 * z - 1), 4 * z - 1) if self.edge_dofs else (z, flat + 1)
            return value, np.stack([flat, flat, slope])
        s, (xi, eta) = 1 - z, (2 * each - 1 for each in _collapsed(X))
        p, by_xi, by_eta, by_s = self._over_height(i, xi, eta, s)
        by_z = (1 + xi) * by_xi + (1 + eta) * by_eta - p - s * by_s
        return s * p, np.stack([2 * by_xi, 2 * by_eta, by_z])

    def _over_height(self, i: int, xi: Array, eta: Array, s: Array) -> tuple[Array, Array, Array, Array]:
        """Return a shape function over ``s = 1 − z``, and its derivatives by ξ, η and s."""
        a, b = (*_CORNERS, (0, 0), *_SIDES, *_CORNERS)[i]
        A, A_xi = (1 + a * xi, a + 0 * xi) if a else (1 - xi**2, -2 * xi)
        B, B_eta = (1 + b * eta, b + 0 * eta) if b else (1 - eta**2, -2 * eta)
        if i >= 9:  # slanted sides
            factor, by_xi, by_eta, by_s = 1 - s, 0 * s, 0 * s, 0 * s - 1
        elif i >= 5:  # sides of the base
            factor, by_xi, by_eta, by_s = s / 2, 0 * s, 0 * s, 0 * s + 0.5
        elif self.edge_dofs:
            around = a * xi + b * eta
            factor, by_xi, by_eta, by_s = (s * around - 1) / 4, s * a / 4, s * b / 4, around / 4
        else:
            factor, by_xi, by_eta, by_s = 0 * s + 0.25, 0 * s, 0 * s, 0 * s
        return A * B * factor, B * (A_xi * factor + A * by_xi), A * (B_eta * factor + B * by_eta), A * B * by_s


def _collapsed(X: Array) -> Array:
    """Return u and v at points X (3, n_q), on the axis at the apex, shape (2, n_q)."""
    s = 1 - X[2]
    return np.asarray(np.divide(X[:2], s, out=np.full_like(X[:2], 0.5), where=s > 0))


_LINEAR, _QUADRATIC = partial(PyramidElement, 1), partial(PyramidElement, 2)
_PYRAMID5 = ElementKind("pyramid5", 14, Pyramid, 1, _LINEAR, _LINEAR, 2, 3, 2)
_PYRAMID13 = ElementKind("pyramid13", 27, Pyramid, 2, _QUADRATIC, _QUADRATIC, 5, 7, 2)

CELLS = (
    SolidCell("pyramid", Pyramid, 1, (_PYRAMID5,), nastran=("CPYRAM", "CPYRA")),
    SolidCell("pyramid13", Pyramid, 2, (_PYRAMID13,), nastran=("CPYRAM", "CPYRA")),
)

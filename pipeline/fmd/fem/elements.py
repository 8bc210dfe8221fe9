"""Solid finite elements: shape functions, quadrature and local numbering, from scikit-fem's reference data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
import skfem
from skfem.quadrature import get_quadrature

from fmd.core.arrays import Array, IntArray, read_only
from fmd.fem.wedge import Wedge, wedge_quadrature

# Linear hexahedra with enhanced assumed strain, or with the strain of their displacement alone; others have no choice.
Formulation = Literal["enhanced", "plain"]


@dataclass(frozen=True)
class ElementKind:
    """A displacement element together with its geometry and its quadrature.

    Parameters
    ----------
    name : str
        The element's name in the literature, e.g. ``hex20``.
    element, geometry : skfem.Element
        Scalar shape functions of the displacement and of the position.
    stiffness_order, mass_order : int
        Polynomial degree that the quadrature of K and M integrates exactly: the integrand on cells with a constant
        Jacobian; on curved cells, mass and first moments.
    stress_order : int
        Degree of the quadrature at whose points stresses are most accurate (Barlow 1976).
    """

    name: str
    element: Any
    geometry: Any
    stiffness_order: int
    mass_order: int
    stress_order: int

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,) on the reference cell, exact to a polynomial degree."""
        if isinstance(self.element, Wedge):
            return wedge_quadrature(order)
        X, w = get_quadrature(self.element.refdom, order)
        return X, w

    @property
    def order(self) -> int:
        """Order of the displacement, 1 or 2."""
        return 2 if self.element.edge_dofs else 1

    @property
    def curved(self) -> bool:
        """True if the edges of the cell may be curved."""
        return bool(self.geometry.edge_dofs)

    @property
    def is_affine(self) -> bool:
        """True if the Jacobian is constant over a cell."""
        return isinstance(self.geometry, skfem.ElementTetP1)

    @cached_property
    def facet_corners(self) -> tuple[list[int], ...]:
        """Local corners around each facet."""
        # scikit-fem repeats the first corner of a wedge's triangles
        return tuple(list(dict.fromkeys(facet)) for facet in self.element.refdom.facets)

    @cached_property
    def facet_polygons(self) -> tuple[IntArray, ...]:
        """Local nodes around each facet, mid-edge nodes between the corners."""
        refdom = self.element.refdom
        edge = {frozenset(ends): k for k, ends in enumerate(refdom.edges)}
        polygons = []
        for corners in self.facet_corners:
            around = []
            for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
                around.append(a)
                if self.element.edge_dofs:
                    around.append(refdom.nnodes + edge[frozenset((a, b))])
            polygons.append(np.array(around, dtype=np.int64))
        return tuple(polygons)


def shape_functions(element: Any, X: Array) -> tuple[Array, Array]:
    """Return values (n_nodes, n_q) and reference gradients (n_nodes, 3, n_q) at points X (3, n_q), read-only."""
    return _tabulate(element, X.astype(float).tobytes(), X.shape[1])


@lru_cache(maxsize=16)  # every batch of elements has the same quadrature points
def _tabulate(element: Any, points: bytes, n_q: int) -> tuple[Array, Array]:
    """Return `shape_functions` at the points that the bytes hold."""
    X = np.frombuffer(points).reshape(3, n_q)
    values, gradients = zip(*(element.lbasis(X, i) for i in range(element.doflocs.shape[0])), strict=True)
    ones = np.ones(n_q)
    return (
        read_only(np.array([value * ones for value in values])),
        read_only(np.array([np.broadcast_to(np.asarray(g, dtype=float), X.shape) for g in gradients])),
    )


def jacobians(geometry: Any, x: Array, X: Array) -> Array:
    """Return the derivatives of position by reference coordinates, shape (n_elements, n_q, 3, 3), last axis reference.

    Parameters
    ----------
    geometry : skfem.Element
        Scalar shape functions of the position.
    x : ndarray, shape (n_elements, n_geometry, 3)
        Positions of the geometry's nodes [m].
    X : ndarray, shape (3, n_q)
        Points on the reference cell.
    """
    _, dN = shape_functions(geometry, X)
    J = np.ascontiguousarray(x.transpose(2, 0, 1)) @ dN.reshape(len(dN), -1)
    return np.asarray(J.reshape(3, -1, *dN.shape[1:]).transpose(1, 3, 0, 2))


@lru_cache
def element_kind(cell_type: str, order: int) -> ElementKind:
    """Return the element of displacement order 1 or 2 on a cell, which has meshio's name."""
    match cell_type, order:
        case "tetra", 1:
            return ElementKind("tet4", skfem.ElementTetP1(), skfem.ElementTetP1(), 0, 2, 0)
        case "tetra", 2:
            return ElementKind("tet10", skfem.ElementTetP2(), skfem.ElementTetP1(), 2, 4, 2)
        case "tetra10", 2:
            return ElementKind("tet10", skfem.ElementTetP2(), skfem.ElementTetP2(), 2, 5, 2)
        case "hexahedron", 1:
            return ElementKind("hex8", skfem.ElementHex1(), skfem.ElementHex1(), 3, 3, 3)
        case "hexahedron", 2:
            return ElementKind("hex20", skfem.ElementHexS2(), skfem.ElementHex1(), 5, 5, 3)
        case "hexahedron20", 2:
            return ElementKind("hex20", skfem.ElementHexS2(), skfem.ElementHexS2(), 5, 7, 3)
        case "hexahedron27", 2:
            return ElementKind("hex27", skfem.ElementHex2(), skfem.ElementHex2(), 5, 7, 3)
        case "wedge", 1:
            return ElementKind("wedge6", Wedge(1), Wedge(1), 2, 3, 2)
        case "wedge15", 2:
            return ElementKind("wedge15", Wedge(2), Wedge(2), 4, 6, 2)
    raise ValueError(f"no element of order {order} on {cell_type} cells")


def match_nodes(wanted: Array, nodes: Array) -> IntArray:
    """Return the numbers of the reference ``nodes`` (n, 3) that lie at the points ``wanted`` (n, 3)."""
    place, number = np.nonzero(np.abs(wanted[:, None] - nodes).max(axis=2) < 1e-12)
    if not np.array_equal(place, np.arange(len(wanted))):
        raise ValueError("the two orders of nodes aren't of the same element")
    return number

"""What the assembly needs to know of each finite element: all of it is scikit-fem's reference data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import skfem
from skfem.quadrature import get_quadrature

from pipeline.checks import Array, IntArray


@dataclass(frozen=True)
class ElementKind:
    """A displacement element on its geometry.

    Parameters
    ----------
    name : str
        The field's name of the element, e.g. ``hex20``.
    element, geometry : skfem.Element
        Scalar shape functions of the displacement and of the position.
    stiffness_order, mass_order : int
        Polynomial degree that the quadrature of K and M integrates exactly: all of both on cells with a constant
        Jacobian, mass and first moments on any.
    stress_order : int
        Degree of the quadrature whose points carry the most accurate stresses (Barlow 1976).
    """

    name: str
    element: Any
    geometry: Any
    stiffness_order: int
    mass_order: int
    stress_order: int

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Points (3, n_q) and weights (n_q,) on the reference cell."""
        X, w = get_quadrature(self.element.refdom, order)
        return X, w

    @property
    def is_affine(self) -> bool:
        """Whether the Jacobian is the same all over a cell."""
        return isinstance(self.geometry, skfem.ElementTetP1)

    @cached_property
    def facet_polygons(self) -> IntArray:
        """Local nodes around each facet, mid-edge nodes between corners, shape (n_facets, n_around)."""
        refdom = self.element.refdom
        n_corners = self.element.doflocs.shape[0] if self.element.edge_dofs == 0 else refdom.nnodes
        edge = {frozenset(ends): k for k, ends in enumerate(refdom.edges)}
        polygons = []
        for corners in refdom.facets:
            around = []
            for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
                around.append(a)
                if self.element.edge_dofs:
                    around.append(n_corners + edge[frozenset((a, b))])
            polygons.append(around)
        return np.array(polygons, dtype=np.int64)


def shape_functions(element: Any, X: Array) -> tuple[Array, Array]:
    """Values (n_nodes, n_q) and reference gradients (n_nodes, 3, n_q) at the points X (3, n_q)."""
    n_nodes = element.doflocs.shape[0]
    values, gradients = zip(*(element.lbasis(X, i) for i in range(n_nodes)), strict=True)
    ones = np.ones(X.shape[1])
    return (
        np.array([value * ones for value in values]),
        np.array([np.broadcast_to(np.asarray(g, dtype=float), X.shape) for g in gradients]),
    )


@lru_cache
def element_kind(cell_type: str, order: int) -> ElementKind:
    """Look up the element of displacement order 1 or 2 on cells of the given type."""
    match cell_type, order:
        case "tetra", 1:
            return ElementKind("tet4", skfem.ElementTetP1(), skfem.ElementTetP1(), 0, 2, 0)
        case "tetra", 2:
            return ElementKind("tet10", skfem.ElementTetP2(), skfem.ElementTetP1(), 2, 4, 2)
        case "hexahedron", 1:
            return ElementKind("hex8", skfem.ElementHex1(), skfem.ElementHex1(), 3, 3, 3)
        case "hexahedron", 2:
            return ElementKind("hex20", skfem.ElementHexS2(), skfem.ElementHex1(), 5, 5, 3)
    raise ValueError(f"no element of order {order} on {cell_type} cells")

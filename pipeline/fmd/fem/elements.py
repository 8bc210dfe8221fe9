"""Solid finite elements: shape functions, Jacobians, quadrature and local numbering."""

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Any, Literal, Protocol

import numpy as np

from fmd.core.arrays import Array, IntArray, read_only
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.fem.cells.shape import CellShape

# Linear hexahedra with enhanced assumed strain, or with the strain of their displacement alone; others have no choice.
Formulation = Literal["enhanced", "plain"]


@dataclass(frozen=True)
class ElementKind:
    """A displacement element together with its geometry and its quadrature."""

    name: str  # the element's name in the literature, e.g. ``hex20``
    vtk_type: int  # VTK's number of a cell with the element's nodes
    shape: type[CellShape]
    order: int  # order of the displacement, 1 or 2
    displacement: Callable[[], Any]  # makes the scalar shape functions of the displacement, on first use
    position: Callable[[], Any]  # makes the scalar shape functions of the position, on first use
    # Polynomial degree that the quadrature of K integrates exactly: the integrand on cells with a constant Jacobian.
    stiffness_order: int
    mass_order: int  # the same of M; on curved cells, mass and first moments
    stress_order: int  # degree of the quadrature at whose points stresses are most accurate (Barlow 1976)
    is_affine: bool = False  # true if the Jacobian is constant over every cell
    can_be_enhanced: bool = False  # true if strains of its own may be added to those of its displacement
    # Strains in place of those of its displacement's gradients: a function of the space, a material, reference points
    # and elements, with what `fmd.fem.strain.enhanced_matrix` returns.
    strain_matrix: Callable[..., tuple[Array, Array]] | None = None
    # What is left of strains (n_elements, n_q, 3, 3) where others follow without stress, as through a shell: a function
    # of strains, Jacobians, a material and elements.
    stressed: Callable[..., Array] | None = None
    # Strains whose transverse shear is that of the middle of a shell, as they are at places across it: a function of
    # what ``stressed`` takes, and of the places.
    from_middle: Callable[..., Array] | None = None

    @cached_property
    def element(self) -> Any:
        """Shape functions of the displacement, as scikit-fem's elements have them."""
        return self.displacement()

    @cached_property
    def geometry(self) -> Any:
        """Shape functions of the position."""
        return self.position()

    def quadrature(self, order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,) on the reference cell, exact to a polynomial degree."""
        return self.shape.quadrature(order)

    @cached_property
    def stress_points(self) -> Array:
        """Points (3, n_q) at which stresses are taken."""
        return self.shape.stress_points(self.stress_order)

    @cached_property
    def stress_to_nodes(self) -> Array:
        """Weights (n_local, n_q) that carry values at the `stress_points` to the element's nodes."""
        return self.stress_weights(self.element.doflocs.T)

    def stress_weights(self, X: Array) -> Array:
        """Return weights (n, n_q) that carry values at the `stress_points` to points X (3, n) of the cell."""
        n_q = self.stress_points.shape[1]
        at_points, there = (np.stack(self.shape.stress_terms(x)[:n_q]) for x in (self.stress_points, X))
        return np.asarray(np.linalg.solve(at_points, there).T)

    @cached_property
    def corners(self) -> Array:
        """Reference coordinates of the corners, the first nodes, shape (n_corners, 3)."""
        return np.asarray(self.element.doflocs[: len(self.shape.corners)])

    @property
    def curved(self) -> bool:
        """True if the edges of the cell may be curved."""
        return bool(self.geometry.edge_dofs)

    @cached_property
    def facet_corners(self) -> tuple[list[int], ...]:
        """Local corners around each facet."""
        return tuple(list(facet) for facet in self.element.refdom.facets)

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
                    around.append(len(self.corners) + edge[frozenset((a, b))])
            polygons.append(np.array(around, dtype=np.int64))
        return tuple(polygons)


class ElementSpace(Protocol):
    """Finite element space as far as elements and materials read it."""

    @property
    def kind(self) -> ElementKind:
        """The element."""

    @property
    def corner_coordinates(self) -> Array:
        """Positions of each element's points, shape (n_elements, n_local, 3) [m]."""

    def jacobians(self, X: Array, elements: slice | IntArray = ...) -> Array:
        """Return derivatives of position by reference coordinates, shape (n_elements, n_q, 3, 3)."""


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

    They are by the scalar functions ``geometry`` of nodes at x (n_elements, n_geometry, 3) [m], at points X (3, n_q).
    """
    _, dN = shape_functions(geometry, X)
    J = np.ascontiguousarray(x.transpose(2, 0, 1)) @ dN.reshape(len(dN), -1)
    return np.asarray(J.reshape(3, -1, *dN.shape[1:]).transpose(1, 3, 0, 2))


def match_nodes(wanted: Array, nodes: Array) -> IntArray:
    """Return the numbers of the reference ``nodes`` (n, 3) that lie at the points ``wanted`` (n, 3)."""
    place, number = np.nonzero(np.abs(wanted[:, None] - nodes).max(axis=2) < 1e-12)
    if not np.array_equal(place, np.arange(len(wanted))):
        raise ValueError("the two orders of nodes aren't of the same element")
    return number


def determinants(J: Array) -> Array:
    """Return the determinants of Jacobians J (n_elements, n_q, 3, 3), positive for left-handed elements too.

    scikit-fem's hexahedra are left-handed.

    Raises
    ------
    AccuracyError
        Determinants differ in sign; the message counts the elements.
    """
    return inverse_and_determinant(J)[1]


def inverse_and_determinant(J: Array) -> tuple[Array, Array]:
    """Return the inverses of Jacobians (n_elements, n_q, 3, 3) by Cramer's rule, and `determinants`."""
    J = np.moveaxis(J, (2, 3), (0, 1))
    cofactor = np.empty((3, 3, *J.shape[2:]))
    for i in range(3):
        for k in range(3):
            (a, b), (c, d) = ((i + 1) % 3, (i + 2) % 3), ((k + 1) % 3, (k + 2) % 3)
            cofactor[k, i] = J[a, c] * J[b, d] - J[a, d] * J[b, c]
    det = (J[0] * cofactor[:, 0]).sum(axis=0)
    hand = np.sign(np.median(det)) or 1.0
    if (hand * det).min() <= 0:
        bad = np.count_nonzero((hand * det <= 0).any(axis=1))
        raise AccuracyError(f"{bad} elements are inverted (Jacobian ≤ 0 at a quadrature point)")
    return np.ascontiguousarray(np.moveaxis(cofactor / det, (0, 1), (2, 3))), hand * det

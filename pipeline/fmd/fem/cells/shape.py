"""The shape of a solid cell, and the shape functions and quadrature that scikit-fem has for it or lacks."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np

from fmd.core.arrays import Array, read_only

Corners = tuple[int, ...]


class CellShape(ABC):
    """Corners, edges and faces of a solid cell, numbered as meshio and VTK number them."""

    name: ClassVar[str]
    # Reference coordinates; exchanging the first two of them mirrors the cell into itself.
    corners: ClassVar[tuple[tuple[float, float, float], ...]]
    edges: ClassVar[tuple[tuple[int, int], ...]]  # corners at the ends of each edge, in the order of the mid-edge nodes
    faces: ClassVar[tuple[Corners, ...]]  # corners around each face, counter-clockwise seen from outside
    abaqus_faces: ClassVar[tuple[Corners, ...]]  # the same in the order of Abaqus' faces S1, S2 …
    # A corner, and the other ends of three edges that leave it, right-handed.
    corner_edges: ClassVar[tuple[tuple[int, int, int, int], ...]]
    ideal: ClassVar[float]  # triple product of the unit edges at a corner of the cell with equal edges

    @staticmethod
    @abstractmethod
    def quadrature(order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,) on the reference cell, exact to a polynomial degree."""

    @staticmethod
    @abstractmethod
    def reach(x: Array) -> float:
        """Return the largest of the expressions of x (3,) that are at most 1 inside the reference cell."""

    @staticmethod
    @abstractmethod
    def stress_terms(x: Array) -> tuple[Array, ...]:
        """Return the functions of places x (3, n) by which stresses vary; few points take the first ones."""

    @classmethod
    def nodes(cls, order: int) -> Array:
        """Return the reference coordinates of the corners and, for order 2, of the middles of the edges."""
        corners = np.array(cls.corners, dtype=float)
        return corners if order == 1 else np.concatenate([corners, corners[np.array(cls.edges)].mean(axis=1)])

    @classmethod
    def stress_points(cls, order: int) -> Array:
        """Return the points (3, n_q) at which the stresses of an element are taken, those of a quadrature."""
        return cls.quadrature(order)[0]

    @classmethod
    def scaled_jacobian(cls, x: Array) -> Array:
        """Return the smallest scaled Jacobian over the corners of each straight cell x (n_cells, n_corners, 3)."""
        corner, *ends = np.array(cls.corner_edges).T
        edges = np.stack([x[:, end] - x[:, corner] for end in ends], axis=-2)
        lengths = np.linalg.norm(edges, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            scaled = np.linalg.det(edges / lengths[..., None]) / cls.ideal
        return np.asarray(np.nan_to_num(scaled, nan=0.0).min(axis=1))


def skfem_element(name: str) -> Callable[[], Any]:
    """Return a function that makes an element of scikit-fem, e.g. ``ElementTetP1``."""
    return partial(_make_element, name)


def _make_element(name: str) -> Any:
    import skfem

    return getattr(skfem, name)()


@cache  # scikit-fem takes longer to find them than small bodies to be assembled
def skfem_quadrature(cell: str, order: int) -> tuple[Array, Array]:
    """Return points (n_dim, n_q) and weights (n_q,) on a reference cell of scikit-fem, e.g. ``RefTet``.

    They are exact to a polynomial degree, on lines, squares and cubes along each axis.
    """
    from skfem import quadrature, refdom

    X, w = quadrature.get_quadrature(getattr(refdom, cell), order)
    return read_only(X), read_only(w)


class ReferenceDomain(NamedTuple):
    """Faces and edges of a reference cell by their corners."""

    facets: tuple[tuple[int, ...], ...]
    edges: tuple[tuple[int, int], ...]


class OwnElement(ABC):
    """Shape functions at the corners of a cell and, for order 2, in the middles of its edges."""

    shape: ClassVar[type[CellShape]]

    def __init__(self, order: int) -> None:
        self.edge_dofs = order - 1
        self.doflocs = self.shape.nodes(order)
        self.refdom = ReferenceDomain(self.shape.faces, self.shape.edges)

    @abstractmethod
    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Return value (n_q,) and gradient (3, n_q) of shape function i at points X (3, n_q)."""

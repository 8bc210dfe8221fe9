"""Elements that scikit-fem lacks, with those attributes of its elements that are read here."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

from fmd.core.arrays import Array
from fmd.fem.cells.shape import CellShape


class ReferenceDomain(NamedTuple):
    """Faces and edges of a reference cell by their corners."""

    facets: tuple[tuple[int, ...], ...]
    edges: tuple[tuple[int, int], ...]


class OwnElement(ABC):
    """Shape functions at the corners of a cell and, for order 2, in the middles of its edges.

    Parameters
    ----------
    order : int
        1 or 2.
    """

    shape: ClassVar[type[CellShape]]

    def __init__(self, order: int) -> None:
        self.edge_dofs = order - 1
        self.doflocs = self.shape.nodes(order)
        self.refdom = ReferenceDomain(self.shape.faces, self.shape.edges)

    @abstractmethod
    def lbasis(self, X: Array, i: int) -> tuple[Array, Array]:
        """Return value (n_q,) and gradient (3, n_q) of shape function i at points X (3, n_q)."""

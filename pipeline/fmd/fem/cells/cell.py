"""A type of solid cell: its shape, its nodes, the elements on it, and its names in the files of other programs."""

from functools import cached_property

import numpy as np

from fmd.core.arrays import Array, IntArray, read_only
from fmd.core.data_classes import dataclass
from fmd.fem.cells.shape import CellShape, Corners
from fmd.fem.elements import ElementKind, match_nodes


@dataclass(frozen=True)
class SolidCell:
    """A type of solid cell: a shape with or without mid-edge nodes."""

    name: str
    shape: type[CellShape]
    order: int  # 2 if it has mid-edge nodes
    elements: tuple[ElementKind, ...]  # the elements on it, of different orders of the displacement
    centres: tuple[Corners, ...] = ()  # corners at whose centres its further nodes lie, after the mid-edge nodes
    nastran: tuple[str, ...] = ()  # Nastran's names of the element; none if it has no such element
    nastran_order: Corners = ()  # places of its nodes in Nastran's order; empty if that is the same
    abaqus_order: Corners = ()  # places of its nodes in Abaqus' order; empty if that is the same

    @property
    def n_corners(self) -> int:
        """Number of corners; they are the first nodes."""
        return len(self.shape.corners)

    @cached_property
    def nodes(self) -> Array:
        """Reference coordinates of the cell's own nodes in meshio's order, shape (n_nodes, 3)."""
        return self.nodes_of_order(self.order)

    def nodes_of_order(self, order: int) -> Array:
        """Return the reference coordinates of an element's nodes in meshio's order, shape (n_local, 3)."""
        nodes = self.shape.nodes(order)
        return read_only(np.concatenate([nodes, *(nodes[None, list(group)].mean(axis=1) for group in self.centres)]))

    @cached_property
    def mirrored(self) -> IntArray:
        """Order of the nodes that turns an inverted cell right side out."""
        return match_nodes(self.nodes[:, [1, 0, 2]], self.nodes)

    def element(self, order: int) -> ElementKind:
        """Return the element of displacement order 1 or 2 on the cell."""
        for kind in self.elements:
            if kind.order == order:
                return kind
        raise ValueError(f"no element of order {order} on {self.name} cells")

"""A finite element model without elements, of another program's matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.fem.markers import Marker
from fmd.fem.model import FEModel


@dataclass(frozen=True)
class MatrixModel(FEModel):
    """A finite element model without elements: discretisation and material are ``None``.

    Attributes
    ----------
    positions : ndarray, shape (n_nodes, 3)
        Node positions [m].
    labels : ndarray, shape (n_nodes,)
        Node numbers in the other program.
    """

    positions: Array
    labels: IntArray

    @property
    def x(self) -> Array:
        """Node positions, shape (n_nodes, 3) [m]."""
        return self.positions

    def turning_marker(self, node: int) -> Marker | None:
        """Return the marker at a node that has rotations, by its place among the nodes; ``None`` if it has none."""
        return None

    def frequency_changes(self, shapes: Array) -> Array:
        """Return relative changes (n,) of the frequencies of modes (n_nodes, 3, n) by lumping of masses."""
        return np.zeros(shapes.shape[2])

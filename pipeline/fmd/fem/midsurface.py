"""The midsurface of a shell: its nodes, and the points at both faces that hang on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from fmd.core.arrays import Array, IntArray, read_only, require_finite, require_shape
from fmd.core.limits.mesh import ALIKE_DIRECTORS
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.table import shell_cell


@dataclass(frozen=True)
class Midsurface:
    """Nodes of a shell, each with the points of the mesh that turn with it.

    Parameters
    ----------
    nodes : ndarray, shape (n_nodes, 3)
        Positions of the nodes [m].
    owner : ndarray, shape (n_points,)
        The node of each point of the mesh. A node has two points on a director through the thickness, and more where
        the shell has a fold, a branch or a jump of thickness.

    Attributes
    ----------
    alike : float
        Second over first moment of a node's arms, below which they are one line, about which the node doesn't turn.
    has_sections : bool
        True if all points of a node are a section, as of beams.
    """

    nodes: Array
    owner: IntArray

    alike: ClassVar[float] = ALIKE_DIRECTORS
    has_sections: ClassVar[bool] = False

    def __post_init__(self) -> None:
        require_shape("nodes", self.nodes, (None, 3))
        require_finite("nodes", self.nodes)
        read_only(self.nodes)
        read_only(self.owner)

    def of_points(self, points: IntArray) -> Midsurface:
        """Return that of some points of the mesh, numbered as they are given, with the nodes that these hang on."""
        held, owner = np.unique(self.owner[points], return_inverse=True)
        return Midsurface(self.nodes[held], owner)

    def cell(self, name: str) -> SolidCell:
        """Return the type of the layer's cells by meshio's name."""
        return shell_cell(name)

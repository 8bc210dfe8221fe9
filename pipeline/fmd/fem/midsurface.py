"""The midsurface of a shell: its nodes, and the points at both faces that hang on them."""

from __future__ import annotations

from dataclasses import field
from typing import ClassVar

import numpy as np

from fmd.core.arrays import Array, BoolArray, IntArray, read_only, require_finite, require_shape
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import ALIKE_DIRECTORS
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.shell import SHELLS

DeckPly = tuple[str, float, float]
"""Material's name, thickness [m] and angle [rad] of a ply."""


@dataclass(frozen=True)
class Layup:
    """Layers of a shell's elements by its deck."""

    stacks: tuple[tuple[DeckPly, ...], ...]  # plies from the lower face to the upper one
    numbers: IntArray  # (n_cells,): place in ``stacks`` of each element's, -1 without layers
    directions: Array  # (n_cells, 3): vector of each element, from whose projection onto it angles count

    def turned_over(self, turned: BoolArray) -> Layup:
        """Return the layup of elements some of which have their normal to the other side now."""
        over = tuple(tuple((name, t, -angle) for name, t, angle in reversed(stack)) for stack in self.stacks)
        numbers = self.numbers + np.where(turned & (self.numbers >= 0), len(self.stacks), 0)
        return Layup(self.stacks + over, numbers, self.directions)


@dataclass(frozen=True)
class Midsurface:
    """Nodes of a shell, each with the points of the mesh that turn with it."""

    nodes: Array  # (n_nodes, 3): positions of the nodes [m]
    # (n_points,): The node of each point of the mesh. A node has two points on a director through the thickness, and
    # more where the shell has a fold, a branch or a jump of thickness.
    owner: IntArray
    layup: Layup | None = field(default=None, kw_only=True)  # layers of its elements, if a deck has them

    # Second over first moment of a node's arms, below which they are one line, about which the node doesn't turn.
    alike: ClassVar[float] = ALIKE_DIRECTORS
    has_sections: ClassVar[bool] = False  # true if all points of a node are a section, as of beams

    def __post_init__(self) -> None:
        require_shape("nodes", self.nodes, (None, 3))
        require_finite("nodes", self.nodes)
        read_only(self.nodes)
        read_only(self.owner)

    def of_points(self, points: IntArray) -> Midsurface:
        """Return that of some points of the mesh, numbered as they are given, with their nodes and without layers."""
        held, owner = np.unique(self.owner[points], return_inverse=True)
        return Midsurface(self.nodes[held], owner)

    def forced(self) -> Midsurface:
        """Return it with strains that give the body's forces, here itself."""
        return self

    def stressed(self) -> Midsurface | None:
        """Return it with strains that give the body's stress, here itself; ``None`` if stress isn't known."""
        return self

    def evenly_strained(self) -> Midsurface:
        """Return it with strains that interpolation between its points keeps; a shell's are so."""
        return self

    def cell(self, name: str) -> SolidCell:
        """Return the type of the layer's cells by meshio's name."""
        return SHELLS[name]

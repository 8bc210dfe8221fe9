"""A mesh as its file gives it: blocks of cells of any type and named sets, not yet checked."""

from dataclasses import field
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.fem.connections import Connections
from fmd.fem.formats.beam_sections import DeckBeams
from fmd.fem.midsurface import DeckPly


class MeshFileError(ValueError):
    """A mesh file can't be used; the message names the fault and a mend."""


@dataclass(frozen=True)
class ShellSection:
    """Section of a deck's shells."""

    thickness: float  # in the file's unit
    offset: float = 0.0  # distance of the middle from the nodes along the normal, in the file's unit
    fault: str = ""  # what of the section isn't read; empty if all is
    plies: tuple[DeckPly, ...] = ()  # layers from the lower face to the upper one, thicknesses in the file's unit
    # Vector from whose projection onto the shell their angles count.
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    nodal: bool = False  # True if the thickness is that of the deck's nodes


class BlockShells(NamedTuple):
    """Sections of a block's shells, lengths in the file's unit."""

    thickness: Array  # (n, n_local): at the nodes of each, NaN where there is no section
    offset: Array  # (n,): distance of the middle from the nodes along the normal
    stack: IntArray  # (n,): place of the layers of each among those of the mesh, -1 without layers
    direction: Array  # (n, 3): vector from whose projection onto the shell the angles of layers count


def at_all_nodes(t: Array, n_local: int) -> Array:
    """Return thickness at all nodes of shells, (…, n_local), from that at their corners, (…, 3 or 4)."""
    return np.concatenate([t, (t + np.roll(t, -1, axis=-1)) / 2], axis=-1)[..., :n_local]


@dataclass
class RawMesh:
    """Contents of a mesh file before any check."""

    points: Array  # (n_points, 3): positions in the file's unit
    # Cell type by meshio's name, and the points of each cell in meshio's order, shape (n, n_local).
    blocks: list[tuple[str, IntArray]] = field(default_factory=list)
    # Cells of each named set, an array for each block.
    cell_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    point_sets: dict[str, IntArray] = field(default_factory=dict)
    # Corners of the facets of each named surface, arrays (n, 3) or (n, 4).
    facet_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    others: dict[str, int] = field(default_factory=dict)  # number of elements and links that aren't read, by type
    # Links, equations, springs and lumped masses between points, in the file's units.
    connections: Connections = field(default_factory=Connections)
    # Sections of each block's elements; empty for files without sections.
    shells: list[BlockShells] = field(default_factory=list)
    stacks: list[tuple[DeckPly, ...]] = field(default_factory=list)  # layers of sections
    shell_faults: list[str] = field(default_factory=list)  # what of the sections of shells isn't read
    beams: DeckBeams = field(default_factory=DeckBeams)  # sections and orientation of beams of two nodes
    # (n_points,): numbers of the points in the file, if it is a deck of Abaqus
    numbers: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    notes: list[str] = field(default_factory=list)  # what was done to the mesh on the way

    def count_elements(self) -> dict[str, int]:
        """Return the number of elements of each type, those that aren't read included."""
        count = dict(self.others)
        for kind, cells in self.blocks:
            count[kind] = count.get(kind, 0) + len(cells)
        return {kind: n for kind, n in count.items() if n}

    def list_elements(self) -> str:
        """Return the number of elements of each type as a text."""
        return ", ".join(f"{n} {kind}" for kind, n in self.count_elements().items()) or "none"

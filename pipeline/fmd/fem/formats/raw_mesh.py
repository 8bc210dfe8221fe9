"""A mesh as its file gives it: blocks of cells of any type and named sets, not yet checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.fem.connections import Connections
from fmd.fem.formats.beam_sections import DeckBeams
from fmd.fem.midsurface import DeckPly


class MeshFileError(ValueError):
    """A mesh file can't be used; the message names the fault and a mend."""


@dataclass(frozen=True)
class ShellSection:
    """Section of a deck's shells.

    Attributes
    ----------
    thickness : float
        In the file's unit.
    offset : float
        Distance of the middle from the nodes along the normal, in the file's unit.
    fault : str
        What of the section isn't read; empty if all is.
    plies : tuple of DeckPly
        Layers from the lower face to the upper one, thicknesses in the file's unit.
    direction : tuple of float
        Vector from whose projection onto the shell their angles count.
    """

    thickness: float
    offset: float = 0.0
    fault: str = ""
    plies: tuple[DeckPly, ...] = ()
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)


class BlockShells(NamedTuple):
    """Sections of a block's shells, lengths in the file's unit.

    Attributes
    ----------
    thickness, offset : ndarray, shape (n,)
        NaN where there is no section; distance of the middle from the nodes along the normal.
    stack : ndarray, shape (n,)
        Place of the layers of each among those of the mesh, -1 without layers.
    direction : ndarray, shape (n, 3)
        Vector from whose projection onto the shell the angles of layers count.
    """

    thickness: Array
    offset: Array
    stack: IntArray
    direction: Array


@dataclass
class RawMesh:
    """Contents of a mesh file before any check.

    Attributes
    ----------
    points : ndarray, shape (n_points, 3)
        Positions in the file's unit.
    blocks : list of (str, ndarray)
        Cell type by meshio's name, and the points of each cell in meshio's order, shape (n, n_local).
    cell_sets : dict of str to list of ndarray
        Cells of each named set, an array for each block.
    facet_sets : dict of str to list of ndarray
        Corners of the facets of each named surface, arrays (n, 3) or (n, 4).
    others : dict of str to int
        Number of elements and links that aren't read, by type.
    connections : Connections
        Links, equations, springs and lumped masses between points, in the file's units.
    shells : list of BlockShells
        Sections of each block's elements; empty for files without sections.
    stacks : list of tuple
        Layers of sections.
    shell_faults : list of str
        What of the sections of shells isn't read.
    beams : DeckBeams
        Sections and orientation of beams of two nodes.
    numbers : ndarray, shape (n_points,)
        Numbers of the points in the file, if it is a deck of Abaqus.
    notes : list of str
        What was done to the mesh on the way.
    """

    points: Array
    blocks: list[tuple[str, IntArray]] = field(default_factory=list)
    cell_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    point_sets: dict[str, IntArray] = field(default_factory=dict)
    facet_sets: dict[str, list[IntArray]] = field(default_factory=dict)
    others: dict[str, int] = field(default_factory=dict)
    connections: Connections = field(default_factory=Connections)
    shells: list[BlockShells] = field(default_factory=list)
    stacks: list[tuple[DeckPly, ...]] = field(default_factory=list)
    shell_faults: list[str] = field(default_factory=list)
    beams: DeckBeams = field(default_factory=DeckBeams)
    numbers: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    notes: list[str] = field(default_factory=list)

    def count_elements(self) -> dict[str, int]:
        """Return the number of elements of each type, those that aren't read included."""
        count = dict(self.others)
        for kind, cells in self.blocks:
            count[kind] = count.get(kind, 0) + len(cells)
        return {kind: n for kind, n in count.items() if n}

    def list_elements(self) -> str:
        """Return the number of elements of each type as a text."""
        return ", ".join(f"{n} {kind}" for kind, n in self.count_elements().items()) or "none"

"""Pieces of a part's mesh, and the cuts between them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.encoding import encode
from fmd.core.limits.mesh import GRID

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.mesh import SolidMesh


@dataclass(frozen=True)
class Cut:
    """A cut between two pieces: their numbers, and the names of the markers that each has there."""

    first: int  # number of the first piece, from 0; in the tree it is nearer to the joint that carries the part
    second: int  # number of the second piece
    of_first: str  # name of the marker on the first piece
    of_second: str  # name of the marker on the second piece
    closes: bool  # the cut closes a ring of pieces; else it is a branch of the tree
    facets: IntArray = field(repr=False, compare=False)  # its facets, by their numbers among all between elements

    @property
    def pieces(self) -> tuple[int, int]:
        """Numbers of both pieces."""
        return self.first, self.second


@dataclass(frozen=True)
class PieceMesh:
    """Elements of one piece of a part."""

    cells: IntArray  # their numbers in the mesh of the whole
    mesh: SolidMesh  # the piece's mesh, its origin moved by ``offset``; its faces are those of its markers
    offset: Array  # (3,): origin of the piece's coordinates in those of the whole [m]
    cut_markers: tuple[str, ...]  # names of the markers at its cuts
    own_markers: tuple[str, ...]  # names of the whole part's markers that are on it
    # Those of them, by name, that aren't made from a face of the piece's mesh.
    given: Mapping[str, Marker] = field(default_factory=dict)

    @cached_property
    def digest(self) -> str:
        """Digest of the mesh, its faces and its markers, equal for equal pieces."""
        h = hashlib.sha256()
        for array in (self.mesh.points, self.mesh.cells):
            h.update(np.ascontiguousarray(array).tobytes())
        for table in (self.mesh.faces, self.mesh.parts):
            for name, array in table.items():
                h.update(f"{name}:{array.shape}".encode())
                h.update(np.ascontiguousarray(array).tobytes())
        if self.mesh.midsurface is not None:
            h.update(np.ascontiguousarray(self.mesh.midsurface.nodes).tobytes())
            h.update(np.ascontiguousarray(self.mesh.midsurface.owner).tobytes())
        if self.mesh.connections is not None:
            h.update(encode(self.mesh.connections))
        for name, marker in self.given.items():
            h.update(f"{name}:{len(marker.nodes)}".encode())
            for array in (marker.position, marker.nodes, marker.translation_weights, marker.rotation_weights):
                h.update(np.ascontiguousarray(array).tobytes())
        return h.hexdigest()


@dataclass(frozen=True)
class CutPart:
    """A part's mesh cut into pieces."""

    # The first carries the marker of the part's joint, each other comes after one that it is welded to.
    pieces: tuple[PieceMesh, ...]
    cuts: tuple[Cut, ...]  # cuts between them, those that close rings last

    def holds(self, marker: str) -> int:
        """Return the number of the piece that a marker of the whole is on."""
        return next(k for k, piece in enumerate(self.pieces) if marker in piece.own_markers)

    def weld_again(self, cut: Cut) -> tuple[CutPart, Cut]:
        """Return the part with one more weld at one of its cuts, and that weld, which closes a ring."""
        pieces, names = list(self.pieces), []
        for number, marker in ((cut.first, cut.of_first), (cut.second, cut.of_second)):
            piece = pieces[number]
            name = CLOSING + str(1 + sum(known.startswith(CLOSING) for known in piece.cut_markers))
            faces = {**piece.mesh.faces, face_of(name): piece.mesh.faces[face_of(marker)]}
            markers = (*piece.cut_markers, name)
            pieces[number] = replace(piece, mesh=replace(piece.mesh, faces=faces), cut_markers=markers)
            names.append(name)
        weld = replace(cut, of_first=names[0], of_second=names[1], closes=True)
        return CutPart(tuple(pieces), (*self.cuts, weld)), weld


def face_of(marker: str) -> str:
    """Return the name of the face that a piece's mesh has for a marker."""
    return f"at-{marker}"


def link_name(link: str) -> str:
    """Return the name of a link among the markers of a part; no marker of a scene has a colon in its name."""
    return f"link:{link}"


def deck_name(number: int, label: str) -> str:
    """Return the name, among the markers of a part, of a group of the deck's links by the label of its first."""
    return f"deck:{number}:{label}"


def round_to_grid(x: Array, extent: float) -> Array:
    """Round positions [m] in a part of an extent [m] to a grid finer than any node's place matters."""
    return np.asarray(np.round(x / (GRID * extent)) * (GRID * extent))


ROOT_CUT = "cut:inboard"  # no marker of a scene has a colon in its name
CLOSING = "cut:closing-"

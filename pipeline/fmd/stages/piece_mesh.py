"""Pieces of a part's mesh, and the cuts between them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.pieces import CONTACT, GRID
from fmd.fem.partition import PartitionError, facet_areas
from fmd.fem.space import Discretisation

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.mesh import SolidMesh


@dataclass(frozen=True)
class Cut:
    """A cut between two pieces: their numbers, and the names of the markers that each has there.

    Attributes
    ----------
    first, second : int
        Numbers of the pieces, from 0; in the tree the first is nearer to the joint that carries the part.
    of_first, of_second : str
        Names of the markers on both sides.
    closes : bool
        The cut closes a ring of pieces; else it is a branch of the tree.
    facets : ndarray of int
        Its facets, by their numbers among all between elements.
    """

    first: int
    second: int
    of_first: str
    of_second: str
    closes: bool
    facets: IntArray = field(repr=False, compare=False)

    @property
    def pieces(self) -> tuple[int, int]:
        """Numbers of both pieces."""
        return self.first, self.second


@dataclass(frozen=True)
class PieceMesh:
    """Elements of one piece of a part.

    Attributes
    ----------
    cells : ndarray of int
        Their numbers in the mesh of the whole.
    mesh : SolidMesh
        The piece's mesh, its origin moved by ``offset``; its faces are those of its markers.
    offset : ndarray, shape (3,)
        Origin of the piece's coordinates in those of the whole [m].
    cut_markers, own_markers : tuple of str
        Names of the markers at its cuts, and of the whole part's markers that are on it.
    given : mapping of str to Marker
        Those of them, by name, that aren't made from a face of the piece's mesh.
    """

    cells: IntArray
    mesh: SolidMesh
    offset: Array
    cut_markers: tuple[str, ...]
    own_markers: tuple[str, ...]
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
        for name, marker in self.given.items():
            h.update(f"{name}:{len(marker.nodes)}".encode())
            for array in (marker.position, marker.nodes, marker.translation_weights, marker.rotation_weights):
                h.update(np.ascontiguousarray(array).tobytes())
        return h.hexdigest()


@dataclass(frozen=True)
class CutPart:
    """A part's mesh cut into pieces.

    Attributes
    ----------
    pieces : tuple of PieceMesh
        The first carries the marker of the part's joint, each other comes after one that it is welded to.
    cuts : tuple of Cut
        Cuts between them, those that close rings last.
    """

    pieces: tuple[PieceMesh, ...]
    cuts: tuple[Cut, ...]

    def holds(self, marker: str) -> int:
        """Return the number of the piece that a marker of the whole is on."""
        return next(k for k, piece in enumerate(self.pieces) if marker in piece.own_markers)


def face_of(marker: str) -> str:
    """Return the name of the face that a piece's mesh has for a marker."""
    return f"at-{marker}"


def round_to_grid(x: Array, extent: float) -> Array:
    """Round positions [m] in a part of an extent [m] to a grid finer than any node's place matters."""
    return np.asarray(np.round(x / (GRID * extent)) * (GRID * extent))


ROOT_CUT = "cut:inboard"  # no marker of a scene has a colon in its name


def join_pieces(
    space: Discretisation, labels: IntArray, elements: IntArray, local: IntArray, root: int
) -> tuple[IntArray, list[Cut]]:
    """Find the cuts between pieces, and number the pieces from the root outwards.

    Two pieces that touch in several places, as beside a slot, have a cut in each: one of them is of the tree, and the
    others close rings.

    Parameters
    ----------
    space : Discretisation
        Elements of the body.
    labels : ndarray of int, shape (n_elements,)
        Number of each element's piece.
    elements, local : ndarray, shape (n_facets, 2)
        Facets between elements, as `interior_facets` finds them.
    root : int
        Number of the piece at the joint.

    Returns
    -------
    number : ndarray of int, shape (n_pieces,)
        New number of each piece.
    cuts : list of Cut
        By the new numbers, those that close rings last.

    Raises
    ------
    PartitionError
        A piece hardly touches the others.
    """
    patches = _find_patches(space, labels, elements, local)
    largest = max(area for area, _ in patches)
    ranked = sorted((patch for patch in patches if patch[0] > CONTACT * largest), key=lambda patch: -patch[0])
    pairs = [labels[elements[facets[0]]].tolist() for _, facets in ranked]
    order, tree = [root], dict[int, tuple[int, int]]()
    for piece in order:  # grows meanwhile: breadth first
        for k, pair in enumerate(pairs):
            other = pair[0] + pair[1] - piece
            if piece in pair and other not in order:
                order.append(other)
                tree[k] = piece, other
    count = int(labels.max()) + 1
    if len(order) < count:
        raise PartitionError(f"{count - len(order)} of the pieces hardly touch the others; take another number")
    number = np.empty(count, dtype=np.int64)
    number[order] = np.arange(count)
    found = [(*tree[k], ranked[k][1], False) for k in tree]
    found += [(*pair, ranked[k][1], True) for k, pair in enumerate(pairs) if k not in tree]
    return number, _name_cuts([(int(number[a]), int(number[b]), facets, closes) for a, b, facets, closes in found])


def _find_patches(
    space: Discretisation, labels: IntArray, elements: IntArray, local: IntArray
) -> list[tuple[float, IntArray]]:
    """Return the area [m²] and the facets of each connected patch between two pieces."""
    pairs = np.sort(labels[elements], axis=1)
    across = np.flatnonzero(pairs[:, 0] != pairs[:, 1])
    n_corners = np.array([len(set(corners)) for corners in space.kind.facet_corners])[local[across, 0]]
    corners = np.concatenate(
        [
            space.element_nodes[elements[k, 0], space.kind.facet_corners[local[k, 0]]]
            + len(space.x) * (pairs[k, 0] * (int(labels.max()) + 1) + pairs[k, 1])
            for k in across
        ]
    )
    _, vertex = np.unique(corners, return_inverse=True)  # a node of two pairs of pieces is two
    n = len(across)
    size = n + int(vertex.max()) + 1
    facet = np.repeat(np.arange(n), n_corners)
    graph = sp.coo_array((np.ones(len(vertex)), (facet, n + vertex)), shape=(size, size))
    patch = connected_components(graph, directed=False)[1][:n]
    areas = facet_areas(space, elements[across, 0], local[across, 0])
    return [(float(areas[patch == k].sum()), across[patch == k]) for k in np.unique(patch)]


def _name_cuts(found: Sequence[tuple[int, int, IntArray, bool]]) -> list[Cut]:
    """Name the markers on both sides of each cut: equal pieces have equal names."""
    outboard: dict[int, int] = {}
    closing: dict[int, int] = {}
    cuts = []
    for first, second, facets, closes in found:
        if closes:
            names = []
            for piece in (first, second):
                closing[piece] = closing.get(piece, 0) + 1
                names.append(f"cut:closing-{closing[piece]}")
            cuts.append(Cut(first, second, names[0], names[1], True, facets))
            continue
        outboard[first] = outboard.get(first, 0) + 1
        cuts.append(Cut(first, second, f"cut:outboard-{outboard[first]}", ROOT_CUT, False, facets))
    return cuts

"""Cuts between the pieces of a part: where they touch, and the tree that they make with the joint at its root."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from fmd.core.arrays import IntArray
from fmd.core.limits.pieces import CONTACT
from fmd.fem.partition import PartitionError, facet_areas
from fmd.fem.space import Discretisation
from fmd.stages.piece_mesh import Cut

INBOARD = "cut:inboard"  # no marker of a scene has a colon in its name


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
        cuts.append(Cut(first, second, f"cut:outboard-{outboard[first]}", INBOARD, False, facets))
    return cuts

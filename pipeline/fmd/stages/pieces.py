"""Parts cut into pieces, each a reduced body with a frame of its own, welded to its neighbours at the cuts.

A piece is a flexible part on a share of the elements of the whole part's mesh. Its cuts are faces with markers, which
make up its interface (Craig & Bampton); rotations between pieces may be of any size, those within one are small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fmd.core.arrays import IntArray
from fmd.core.errors import InputError, as_input_error
from fmd.core.limits.mesh import CONTACT, MOST_OF_PIECE, MOVES, SAME_PLACE
from fmd.fem.connections import Connections
from fmd.fem.markers import facets_on_face
from fmd.fem.mesh import SolidMesh
from fmd.fem.partition import PartitionError, divide_mesh, facet_areas, interior_facets, join_fragments, joined_nodes
from fmd.fem.space import Discretisation
from fmd.scene.places import MarkerPlace
from fmd.stages.deck_pieces import connections_on, group_connections
from fmd.stages.markers import find_link_facets, find_marker_facets, fixed_unknowns
from fmd.stages.meshing.bodies import find_name
from fmd.stages.piece_mesh import (
    CLOSING,
    ROOT_CUT,
    Cut,
    CutPart,
    PieceMesh,
    deck_name,
    face_of,
    link_name,
    round_to_grid,
)

if TYPE_CHECKING:
    from fmd.stages.part import FlexiblePart


def cut_part(part: FlexiblePart, count: int) -> CutPart:
    """Cut a part's mesh into connected pieces of about equal volume.

    Raises
    ------
    InputError
        The mesh is too coarse for so many pieces, a marker's face or the supports extend over several pieces, or the
        body hangs on no joint.
    """
    key, space = f"body.{part.name}", part.plain_space
    if not part.joint.marker:
        raise InputError(part.file, f"{key}.pieces", count, "the body hangs on no joint: it has modes, but no motion")
    faces = find_marker_facets(part.shape, space, part.file, part.name)
    links = find_link_facets(part.shape, space, part.file, part.name)
    linked = {name: _elements_around(space, facets) for name, facets in links.items()}
    markers = {link_name(name): mine for name, mine in linked.items()}
    deck, hung = part.plain_mesh.connections, dict[str, Connections]()
    with as_input_error(part.file, f"{key}.pieces", count, of=PartitionError):
        for k, (group, mine) in enumerate(group_connections(deck, space) if deck else ()):
            name = deck_name(k, group.all[0].label)
            hung[name], markers[name] = group, mine
            linked |= dict.fromkeys(group.named(group.names).names, mine)
    markers |= {name: np.unique(space.boundary_facets[0][facets]) for name, facets in faces.items()}
    for name, at in part.shape.marker.items():
        if name not in faces:
            own = part.markers[name].nodes  # which refuses links that aren't there
            link = at.link if isinstance(at, MarkerPlace) else None
            found = linked[find_name(linked, link, part.file, f"{key}.marker.{name}.link", "link")] if link else None
            markers[name] = _elements_among(space, own) if found is None else found
    faces |= {link_name(name): facets for name, facets in links.items()}
    with as_input_error(part.file, f"{key}.pieces", count, of=PartitionError):
        labels = divide_mesh(space, count, list(markers.values()))
    labels = _keep_markers_whole(part, labels, markers, count)
    root = int(labels[markers[part.joint.marker][0]])
    elements, local = interior_facets(space)
    with as_input_error(part.file, f"{key}.pieces", count, of=PartitionError):
        _require_common_points(space, labels, elements, local)
        number, cuts = join_pieces(space, labels, elements, local, root)
    labels = number[labels]
    _require_supports_on_first(part, labels)
    places = {name: int(labels[of[0]]) for name, of in markers.items()}
    pieces = []
    for k in range(count):
        on_it = [group for name, group in hung.items() if places[name] == k]
        pieces.append(_piece(part, k, labels, places, faces, cuts, elements, local, on_it))
    return CutPart(tuple(pieces), tuple(cuts))


def _elements_among(space: Discretisation, nodes: IntArray) -> IntArray:
    """Return the elements all of whose nodes are among the given ones: those that a point or an edge moves with."""
    return np.flatnonzero(np.isin(space.element_nodes, nodes).all(axis=1))


def _elements_around(space: Discretisation, facets: IntArray) -> IntArray:
    """Return the elements at the corners of boundary facets, so that no cut between others comes to them."""
    elements, local = (each[facets] for each in space.boundary_facets)
    corners = [space.element_nodes[e, space.kind.facet_corners[k]] for e, k in zip(elements, local, strict=True)]
    return np.flatnonzero(np.isin(space.element_nodes, np.concatenate(corners)).any(axis=1))


def _keep_markers_whole(part: FlexiblePart, labels: IntArray, markers: Mapping[str, IntArray], count: int) -> IntArray:
    """Move the elements of each marker into the piece that most of them are in, and loose ones after them."""
    pairs, volumes = interior_facets(part.plain_space)[0], part.plain_space.volumes
    for _ in range(MOVES):
        moved = labels.copy()
        for name, elements in markers.items():
            found = np.bincount(labels[elements], volumes[elements], minlength=count)
            if np.count_nonzero(found) > 1 and found.sum() > MOST_OF_PIECE * volumes.sum() / count:
                kind, _, label = name.rpartition(":")
                of_deck = kind.startswith("deck")
                key = f"body.{part.name}.{'mesh.file' if of_deck else (kind or 'marker') + '.' + label}"
                what = label if of_deck else "its face"
                over = f"{what} extends over {np.count_nonzero(found)} of the body's {count} pieces"
                raise InputError(part.file, key, None, f"{over}; take fewer pieces or a smaller face")
            moved[elements] = found.argmax()
        joined = join_fragments(moved, pairs, volumes, count)
        if joined is None:
            break
        if all((joined[elements] == joined[elements[0]]).all() for elements in markers.values()):
            return joined
        labels = joined
    problem = "faces of markers or links lie across the cuts; another number of pieces has its cuts elsewhere"
    raise InputError(part.file, f"body.{part.name}.pieces", count, problem)


def _require_common_points(space: Discretisation, labels: IntArray, elements: IntArray, local: IntArray) -> None:
    """Raise ``PartitionError`` where shells on both sides of a cut have common nodes and points of their own."""
    across = labels[elements[:, 0]] != labels[elements[:, 1]]
    corners = space.kind.facet_corners
    for pair, facets in zip(elements[across], local[across], strict=True):
        one, other = (set(space.element_nodes[e, corners[k]].tolist()) for e, k in zip(pair, facets, strict=True))
        if one != other:
            raise PartitionError("a cut would run along a fold or a jump of the shell's thickness; take another number")
    if space.mesh.midsurface is not None and cKDTree(space.x).query_pairs(
        SAME_PLACE * float(np.ptp(space.x, axis=0).max())
    ):
        problem = "points of shells coincide, where walls fold back or lie on one another"
        raise PartitionError(
            f"{problem}, so pieces wouldn't know what to join; leave pieces out, or move the walls apart"
        )


def _require_supports_on_first(part: FlexiblePart, labels: IntArray) -> None:
    if not part.shape.support:
        return
    fixed = np.unique(fixed_unknowns(part.shape, part.plain_space, part.file, part.name) // 3)
    if (midsurface := part.plain_mesh.midsurface) is not None:  # nodes are numbered behind points
        n = len(midsurface.owner)
        fixed = np.union1d(fixed[fixed < n], np.flatnonzero(np.isin(midsurface.owner, fixed[fixed >= n] - n)))
    touched = np.isin(part.plain_space.element_nodes[labels == 0], fixed)
    if np.isin(fixed, part.plain_space.element_nodes[labels == 0][touched]).all():
        return
    problem = (
        "a support fixes nodes of several pieces; in a body with pieces it must be on the piece at the joint, whose "
        "frame it fixes nodes in; fewer pieces, or joints in place of the support"
    )
    raise InputError(part.file, f"body.{part.name}.support", None, problem)


def _piece(
    part: FlexiblePart,
    k: int,
    labels: IntArray,
    places: Mapping[str, int],
    faces: Mapping[str, IntArray],
    cuts: Sequence[Cut],
    elements: IntArray,
    local: IntArray,
    hung: Sequence[Connections],
) -> PieceMesh:
    """Make the mesh of one piece, with a face for each of its markers and the links of the deck that are on it."""
    space, mesh = part.plain_space, part.plain_mesh
    mine = np.flatnonzero(labels == k)
    corners = space.kind.facet_corners
    own, found = [], dict[str, tuple[IntArray, IntArray]]()
    of_boundary, number = space.boundary_facets
    for name, at in places.items():
        if at != k:
            continue
        own += [] if ":" in name else [name]
        if name in faces:
            found[face_of(name)] = of_boundary[faces[name]], number[faces[name]]
    at_cuts = []
    for cut in cuts:
        if k not in (cut.first, cut.second):
            continue
        name = cut.of_first if k == cut.first else cut.of_second
        column = np.where(labels[elements[cut.facets, 0]] == k, 0, 1)
        at_cuts.append(name)
        found[face_of(name)] = elements[cut.facets, column], local[cut.facets, column]
    if k == 0 and part.shape.support:
        found |= _faces_for_supports(space, mesh, labels)
    offset = np.zeros(3)
    if ROOT_CUT in at_cuts:
        facets = zip(*found[face_of(ROOT_CUT)], strict=True)
        offset = np.mean([space.x[space.element_nodes[e, corners[f]]].mean(axis=0) for e, f in facets], axis=0)
    # Numbered by place, so that equal pieces have equal meshes.
    used = np.unique(mesh.cells[mine])
    extent = float(np.ptp(mesh.points, axis=0).max())
    points = round_to_grid(mesh.points[used] - offset, extent)
    order = np.lexsort(points.T)
    new = np.full(len(mesh.points), -1)
    new[used[order]] = np.arange(len(used))
    cells, points = new[mesh.cells[mine]], points[order]
    cell_order = np.lexsort(round_to_grid(points[cells].mean(axis=1), 1e3 * extent).T)
    numbers = np.full(len(mesh.cells), -1)
    numbers[mine[cell_order]] = np.arange(len(mine))
    parts = {name: np.sort(numbers[of[labels[of] == k]]) for name, of in mesh.parts.items()}
    faces = {name: _corners(space, new, *facets) for name, facets in found.items()}
    midsurface = mesh.midsurface and mesh.midsurface.of_points(used[order])
    if midsurface is not None:
        midsurface = replace(midsurface, nodes=round_to_grid(midsurface.nodes - offset, extent))
    links = None
    if mesh.connections and (kept := [each for group in hung for each in group.all]):
        of_nodes = (used[order], len(mesh.points))
        if mesh.midsurface is not None:
            of_nodes = np.unique(mesh.midsurface.owner[used]), len(mesh.midsurface.nodes)
        links = connections_on(mesh.connections.only(kept), *of_nodes, offset)
    piece = SolidMesh(points, cells[cell_order], mesh.cell_type, parts, faces, connections=links, midsurface=midsurface)
    return PieceMesh(mine[cell_order], piece, offset, tuple(at_cuts), tuple(own))


def _corners(space: Discretisation, new: IntArray, elements: IntArray, local: IntArray) -> IntArray:
    """Return three corners of each facet by the new numbers of the mesh's points, shape (n_facets, 3)."""
    nodes, corners = space.element_nodes[elements], space.kind.facet_corners
    rows = np.array([np.sort(new[nodes[k, corners[facet]]])[:3] for k, facet in enumerate(local)], dtype=np.int64)
    return np.asarray(rows[np.lexsort(rows.T)])


def _faces_for_supports(
    space: Discretisation, mesh: SolidMesh, labels: IntArray
) -> dict[str, tuple[IntArray, IntArray]]:
    """Return the facets of the mesh's own faces that are on the first piece, which supports name."""
    elements, local = space.boundary_facets
    faces = {}
    for name, face in mesh.faces.items():
        facets = facets_on_face(space, face)
        facets = facets[labels[elements[facets]] == 0]
        if len(facets):
            faces[name] = elements[facets], local[facets]
    return faces


def join_pieces(
    space: Discretisation, labels: IntArray, elements: IntArray, local: IntArray, root: int
) -> tuple[IntArray, list[Cut]]:
    """Find the cuts between pieces, and number the pieces from the root outwards.

    Labels (n_elements,) are the numbers of elements' pieces, of which ``root`` is at the joint; facets between elements
    (n_facets, 2) are as `interior_facets` finds them. Two pieces that touch in several places, as beside a slot, have a
    cut in each: one of them is of the tree, and the others close rings. Returned are the new number of each piece
    (n_pieces,), and cuts by these, those that close rings last.

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
    nodes = joined_nodes(space)
    corners = np.concatenate(
        [
            nodes[elements[k, 0], space.kind.facet_corners[local[k, 0]]]
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
                names.append(f"{CLOSING}{closing[piece]}")
            cuts.append(Cut(first, second, names[0], names[1], True, facets))
            continue
        outboard[first] = outboard.get(first, 0) + 1
        cuts.append(Cut(first, second, f"cut:outboard-{outboard[first]}", ROOT_CUT, False, facets))
    return cuts

"""Facets, nodes and elements of a body, selected by their position in space."""

from collections.abc import Sequence
from functools import reduce

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.limits.mesh import FACE_IN_PLANE, NEAREST_ELEMENTS, NODES_ON_EDGE, SHARP_ANGLE
from fmd.core.limits.newton import LOCATING_CORRECTIONS
from fmd.fem.elements import shape_functions
from fmd.fem.joined import AnySpace
from fmd.fem.markers import face_marker
from fmd.fem.mesh import rows_among, three_corners
from fmd.fem.space import Discretisation

_SHARP = np.cos(np.deg2rad(SHARP_ANGLE))


def facets_in_plane(space: AnySpace, axis: int, place: float) -> IntArray:
    """Return the corners (n_facets, 3) of the boundary facets in the plane across an axis at ``place`` [m].

    A facet of four corners is identified by three of them.
    """
    near = FACE_IN_PLANE * float(np.ptp(space.x, axis=0).max())
    found = []
    for own in space.members:
        corners = _corners(own.space)
        off = np.abs(own.space.x[corners][..., axis] - place).max(axis=1)
        found.append(own.first + _keys(corners[off <= near]))
    return np.concatenate(found)


def facets_near(space: AnySpace, point: Array, faces: Sequence[IntArray] = ()) -> IntArray:
    """Return the corners (n_facets, 3), as `facets_in_plane` does, of the face nearest to a point (3,) [m].

    If none of the body's known faces (n, 3) holds the nearest facet, the face ends at edges sharper than 40°, which
    takes a mesh fine enough, or curved elements.
    """
    away = [_facet_distances(own.space, point) for own in space.members]
    member, each = min(zip(space.members, away, strict=True), key=lambda pair: float(pair[1].min()))
    corners, nearest = _corners(member.space), int(each.argmin())
    keys = _keys(corners)
    for face in faces:
        if rows_among(keys[nearest : nearest + 1], face)[0]:
            return face
    smooth = _label_smooth_faces(member.space, corners)
    return np.asarray(member.first + keys[smooth == smooth[nearest]])


def _facet_distances(space: Discretisation, point: Array) -> Array:
    """Return the distance of a point (3,) [m] from each boundary facet, shape (n_facets,)."""
    x = space.x[_corners(space)]
    return np.asarray(np.minimum(*(_distance(x[:, half], point) for half in ((0, 1, 2), (0, 2, 3)))))


def nodes_on_faces(space: AnySpace, faces: Sequence[IntArray]) -> IntArray:
    """Return the nodes that all faces share: of one face, of the edge of two, of the corner of three.

    A facet of the boundary lies on a face if all of its corners are among the face's mesh points.

    Raises
    ------
    ValueError
        The faces have no node in common.
    """
    nodes = reduce(np.intersect1d, [face_marker(space, points).nodes for points in faces])
    if not len(nodes):
        raise ValueError("the faces have no node in common")
    return nodes


def nodes_on_edge(space: AnySpace, ends: Array) -> IntArray:
    """Return the nodes on the straight line between two points, ``ends`` (2, 3) [m]; a shell's are in its midsurface.

    Raises
    ------
    ValueError
        No node lies there; the message gives the distance of the nearest.
    """
    along = ends[1] - ends[0]
    x, rows, _ = body_nodes(space)
    r = x - ends[0]
    share = np.clip(r @ along / (along @ along), 0.0, 1.0)
    away = np.linalg.norm(r - share[:, None] * along, axis=1)
    extent = float(np.ptp(x, axis=0).max())
    nodes = np.flatnonzero(away < NODES_ON_EDGE * extent)
    if not len(nodes):
        raise ValueError(f"no node of the mesh lies there; the nearest is {away.min():.4g} m away")
    return rows[nodes]


def node_at(space: AnySpace, point: Array) -> IntArray:
    """Return the node nearest to a point (3,) [m], of a shell that of its midsurface, shape (1,)."""
    x, rows, _ = body_nodes(space)
    return rows[[np.linalg.norm(x - point, axis=1).argmin()]]


def points_of_nodes(space: AnySpace, nodes: IntArray) -> IntArray:
    """Return the mesh's points that move with nodes: the nodes themselves, of a shell the points at both faces."""
    found = []
    for own in space.members:
        local = nodes[nodes >= own.first] - own.first
        midsurface, n = own.space.mesh.midsurface, len(own.space.x)
        held = local[local < n] if midsurface is None else np.flatnonzero(np.isin(midsurface.owner, local - n))
        found.append(own.first + held)
    return np.concatenate(found)


def body_nodes(space: AnySpace) -> tuple[Array, IntArray, BoolArray]:
    """Return positions (n, 3) [m] of a body's nodes, their rows among all points, and which of them have rotations.

    Those of a shell are on its midsurface.
    """
    x, rows, turning = [], [], []
    for own in reversed(space.members):  # of nodes at one place those with rotations come first
        midsurface, n = own.space.mesh.midsurface, len(own.space.x)
        x.append(own.space.x if midsurface is None else midsurface.nodes)
        rows.append(own.first + (0 if midsurface is None else n) + np.arange(len(x[-1])))
        turning.append(np.full(len(x[-1]), midsurface is not None))
    return np.concatenate(x), np.concatenate(rows), np.concatenate(turning)


def locate_points(space: Discretisation, points: Array) -> tuple[IntArray, Array]:
    """Return the element (n,) that holds each point (n, 3) [m], or comes nearest to it, and the reference coordinates.

    They are found by Newton's method, and are within the reference cell, (n, 3).
    """
    corners, geometry = space.corner_coordinates, space.kind.geometry
    count = min(NEAREST_ELEMENTS, len(corners))
    near = np.asarray(cKDTree(corners.mean(axis=1)).query(points, k=count)[1]).reshape(len(points), count)
    middle = space.kind.corners.mean(axis=0)
    elements, X = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 3))
    for k, (point, candidates) in enumerate(zip(points, near, strict=True)):
        best = np.inf
        for element in candidates:
            x = middle
            for _ in range(LOCATING_CORRECTIONS):
                N, dN = shape_functions(geometry, x[:, None])
                step = np.linalg.solve(corners[element].T @ dN[:, :, 0], point - N[:, 0] @ corners[element])
                x = np.clip(x + step, -1.0, 2.0)
                if np.abs(step).max() < 1e-12:
                    break
            outside = max(-x.min(), space.kind.shape.reach(x) - 1.0)
            if outside < best:
                best, elements[k], X[k] = outside, element, np.clip(x, 0.0, 1.0)
            if best <= 1e-9:
                break
    return elements, X


def interpolate_points(space: Discretisation, points: Array) -> tuple[IntArray, Array]:
    """Return the nodes of the element at each of some points (n, 3) [m], and their shape functions there."""
    elements, X = locate_points(space, points)
    weights = [shape_functions(space.kind.element, x[:, None])[0][:, 0] for x in X]
    return space.element_nodes[elements], np.stack(weights)


def _keys(corners: IntArray) -> IntArray:
    """Return three corners of each facet, ascending: of a quadrilateral the lowest three."""
    triangle = corners[:, 2] == corners[:, 3]
    keys = three_corners(corners)
    keys[triangle] = np.sort(corners[triangle, :3], axis=1)
    return keys


def _corners(space: Discretisation) -> IntArray:
    """Return the corners around each boundary facet, shape (n_facets, 4); a triangle's last one twice."""
    elements, local = space.boundary_facets
    table = np.array([[*facet, facet[-1]][:4] for facet in space.kind.facet_corners])
    return np.asarray(space.element_nodes[elements[:, None], table[local]])


def _label_smooth_faces(space: Discretisation, corners: IntArray) -> IntArray:
    """Return the number of each facet's smooth face, which ends at sharp edges, shape (n_facets,)."""
    normal = _normals_at_edges(space)
    facet = np.repeat(np.arange(len(corners)), 4)
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    real = ends[:, 0] != ends[:, 1]
    turned = np.where(ends[:, 0] < ends[:, 1], 1, -1)[real]
    ends, facet, normal = np.sort(ends[real], axis=1), facet[real], normal.reshape(-1, 3)[real]
    order = np.lexsort(ends.T)
    same = (np.diff(ends[order], axis=0) == 0).all(axis=1)
    a, b = order[:-1][same], order[1:][same]
    # Facets that run along their common edge in the same direction have normals to opposite sides.
    cosine = -turned[a] * turned[b] * np.einsum("ei,ei->e", normal[a], normal[b])
    joined = cosine > _SHARP
    pairs = facet[a][joined], facet[b][joined]
    graph = sp.coo_array((np.ones(len(pairs[0]), dtype=np.int8), pairs), shape=2 * [len(corners)])
    return np.asarray(connected_components(graph, directed=False)[1])


def _normals_at_edges(space: Discretisation) -> Array:
    """Return unit normals of the boundary facets in the middle of their sides, shape (n_facets, 4, 3)."""
    elements, local = space.boundary_facets
    normals = np.zeros((len(elements), 4, 3))
    for k, facet in enumerate(space.kind.facet_corners):
        mine = np.flatnonzero(local == k)
        around = space.kind.element.doflocs[facet]
        tangents = np.stack([around[1] - around[0], around[-1] - around[0]], axis=1)
        sides = (around + np.roll(around, -1, axis=0)) / 2
        place = [0, 1, 2, 3] if len(around) == 4 else [0, 1, 3]  # of a triangle the third side has no length
        t = space.jacobians(sides.T, elements[mine]) @ tangents
        normals[mine[:, None], place] = np.cross(t[..., 0], t[..., 1])
    size = np.linalg.norm(normals, axis=2, keepdims=True)
    return np.asarray(normals / np.where(size > 0, size, 1.0))


def _distance(x: Array, point: Array) -> Array:
    """Return the distance of a point (3,) from each triangle x (n, 3, 3), shape (n,)."""
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    size = np.linalg.norm(normal, axis=1)
    size[size == 0] = 1.0
    r = point - x
    sides = np.roll(x, -1, axis=1) - x
    inside = (np.einsum("tci,ti->tc", np.cross(sides, r), normal) >= 0).all(axis=1) & normal.any(axis=1)
    length2 = np.einsum("tci,tci->tc", sides, sides)
    length2[length2 == 0] = 1.0
    along = np.clip(np.einsum("tci,tci->tc", r, sides) / length2, 0.0, 1.0)
    to_sides = np.linalg.norm(r - along[..., None] * sides, axis=2).min(axis=1)
    return np.asarray(np.where(inside, np.abs(np.einsum("ti,ti->t", r[:, 0], normal)) / size, to_sides))

"""Faces told by their place on a body's surface: in a plane, or nearest to a point up to the next sharp edge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from pipeline.core.arrays import Array, IntArray
from pipeline.fem.mesh import rows_among
from pipeline.fem.model import Discretisation

_IN_PLANE = 1e-5  # of the body's extent
_SHARP = np.cos(np.deg2rad(40.0))


def facets_in_plane(space: Discretisation, axis: int, place: float) -> IntArray:
    """Corners (n_facets, 3) of the boundary facets that lie in a plane across an axis, at ``place`` [m] on it.

    Of a facet with four corners three are given, which tell it apart.
    """
    near = _IN_PLANE * float(np.ptp(space.x, axis=0).max())
    corners = _corners(space)
    off = np.abs(space.x[corners][..., axis] - place).max(axis=1)
    return _keys(corners[off <= near])


def facets_near(space: Discretisation, point: Array, faces: Sequence[IntArray] = ()) -> IntArray:
    """Corners (n_facets, 3), as those of `facets_in_plane`, of the face nearest to a point (3,) [m].

    Parameters
    ----------
    faces : sequence of ndarray, shape (n, 3)
        The body's faces; without, or where they leave a gap, a face goes on up to edges sharper than 40°. That takes a
        mesh fine enough, or curved elements.
    """
    corners = _corners(space)
    x = space.x[corners]
    nearest = int(np.minimum(*(_distance(x[:, half], point) for half in ((0, 1, 2), (0, 2, 3)))).argmin())
    keys = _keys(corners)
    for face in faces:
        if rows_among(keys[nearest : nearest + 1], face)[0]:
            return face
    smooth = _smooth(space, corners)
    return np.asarray(keys[smooth == smooth[nearest]])


def _keys(corners: IntArray) -> IntArray:
    """Three different corners of each facet, ascending: of a quadrilateral the least three."""
    triangle = corners[:, 2] == corners[:, 3]
    keys = np.sort(corners, axis=1)[:, :3]
    keys[triangle] = np.sort(corners[triangle, :3], axis=1)
    return keys


def _corners(space: Discretisation) -> IntArray:
    """Corners around each boundary facet, shape (n_facets, 4); a triangle's last is there twice."""
    elements, local = space.boundary_facets
    facets = [list(dict.fromkeys(facet)) for facet in space.kind.element.refdom.facets]
    table = np.array([[*facet, facet[-1]][:4] for facet in facets])
    return np.asarray(space.element_nodes[elements[:, None], table[local]])


def _smooth(space: Discretisation, corners: IntArray) -> IntArray:
    """Number of the smooth face that each facet belongs to, shape (n_facets,)."""
    normal = _normals_at_edges(space)
    facet = np.repeat(np.arange(len(corners)), 4)
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    real = ends[:, 0] != ends[:, 1]
    turned = np.where(ends[:, 0] < ends[:, 1], 1, -1)[real]
    ends, facet, normal = np.sort(ends[real], axis=1), facet[real], normal.reshape(-1, 3)[real]
    order = np.lexsort(ends.T)
    same = (np.diff(ends[order], axis=0) == 0).all(axis=1)
    a, b = order[:-1][same], order[1:][same]
    # Two facets that go around their common edge the same way have normals to opposite sides.
    cosine = -turned[a] * turned[b] * np.einsum("ei,ei->e", normal[a], normal[b])
    joined = cosine > _SHARP
    pairs = facet[a][joined], facet[b][joined]
    graph = sp.coo_array((np.ones(len(pairs[0]), dtype=np.int8), pairs), shape=2 * [len(corners)])
    return np.asarray(connected_components(graph, directed=False)[1])


def _normals_at_edges(space: Discretisation) -> Array:
    """Unit normals of the boundary facets in the middle of their sides, by the corners' order, (n_facets, 4, 3)."""
    elements, local = space.boundary_facets
    normals = np.zeros((len(elements), 4, 3))
    for k, facet in enumerate(space.kind.element.refdom.facets):
        mine = np.flatnonzero(local == k)
        around = space.kind.element.doflocs[list(dict.fromkeys(facet))]
        tangents = np.stack([around[1] - around[0], around[-1] - around[0]], axis=1)
        sides = (around + np.roll(around, -1, axis=0)) / 2
        place = [0, 1, 2, 3] if len(around) == 4 else [0, 1, 3]  # of a triangle the third side has no length
        t = space.jacobians(sides.T, elements[mine]) @ tangents
        normals[mine[:, None], place] = np.cross(t[..., 0], t[..., 1])
    size = np.linalg.norm(normals, axis=2, keepdims=True)
    return np.asarray(normals / np.where(size > 0, size, 1.0))


def _distance(x: Array, point: Array) -> Array:
    """Distance of a point from each triangle x (n, 3, 3)."""
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

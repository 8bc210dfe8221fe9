"""The outer surface of a mesh as triangles and element outlines through all nodes on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray, short_repr
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import REENTRANT_ANGLE

if TYPE_CHECKING:
    from fmd.fem.joined import AnySpace
    from fmd.fem.space import Discretisation


@dataclass(frozen=True, slots=True)
class SurfaceTopology:
    """Nodes, triangles and element outlines of a surface."""

    nodes: IntArray  # (n_surface,): node numbers of the discretisation, ascending
    triangles: IntArray  # (n_triangles, 3): positions in ``nodes``, counter-clockwise seen from outside
    edges: IntArray  # (n_edges, 2): positions in ``nodes``: outlines of the elements' faces

    __repr__ = short_repr


def surface_topology(space: AnySpace) -> SurfaceTopology:
    """Find the outer surface of a discretisation."""
    polygons = [own.first + around for own in space.members for _, around in boundary_polygons(own.space)]
    return polygon_surface(space.x, polygons)


def polygon_surface(x: Array, polygons_by_size: Sequence[IntArray]) -> SurfaceTopology:
    """Return the surface of polygons, counter-clockwise from outside; six or eight nodes have some between corners.

    All nodes are at x (n_nodes, 3); arrays (n_facets, n_around) hold those around facets of one size, a corner first.
    """
    triangles, edges = [], []
    for around in polygons_by_size:
        n_around = around.shape[1]
        polygons = _split_along_length(x, around) if n_around == 8 else around
        rim = np.arange(n_around)
        if n_around < 6:
            fan = np.array([(0, k, k + 1) for k in range(1, n_around - 1)])
        else:  # a triangle at each corner, and the polygon of the mid-edge nodes within
            corners = np.array([(k - 1, k, k + 1) for k in range(0, n_around, 2)]) % n_around
            middle = np.array([(1, k, k + 2) for k in range(3, n_around - 2, 2)])
            fan = np.concatenate([corners, middle])
        triangles.append(polygons[:, fan].reshape(-1, 3))
        edges.append(polygons[:, np.stack([rim, (rim + 1) % n_around], axis=1)].reshape(-1, 2))
    nodes, local = np.unique(np.concatenate(triangles), return_inverse=True)
    sides = np.searchsorted(nodes, np.sort(np.concatenate(edges), axis=1))
    return SurfaceTopology(nodes, local.reshape(-1, 3), np.unique(sides, axis=0))


def surface_normals(x: Array, surface: SurfaceTopology) -> Array:
    """Return unit normals (n_surface, 3) at a surface's nodes, among all at x: means of triangles around by area."""
    corners = x[surface.nodes][surface.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((len(surface.nodes), 3))
    for k in range(3):
        np.add.at(normals, surface.triangles[:, k], across)
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(sizes > 0.0, normals / np.where(sizes > 0.0, sizes, 1.0), [0.0, 0.0, 1.0])


def reentrant_angles(x: Array, surface: SurfaceTopology) -> Array:
    """Return the largest angle of material at a re-entrant edge through each of a surface's nodes [rad], (n_surface,).

    It is 0 where there is no such edge: those less sharp than `REENTRANT_ANGLE` are those of curved faces.
    """
    points, triangles = x[surface.nodes], surface.triangles
    corners = points[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.linalg.norm(across, axis=1, keepdims=True)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(sides.T)
    same = np.flatnonzero((sides[order[1:]] == sides[order[:-1]]).all(axis=1))
    one, other = order[same] // 3, order[same + 1] // 3
    turned = np.arccos(np.clip(np.einsum("ei,ei->e", normals[one], normals[other]), -1.0, 1.0))
    above = np.einsum("ei,ei->e", normals[one], corners[other].mean(axis=1) - corners[one].mean(axis=1)) > 0.0
    sharp = above & (turned > np.deg2rad(REENTRANT_ANGLE))
    angles = np.zeros(len(points))
    np.maximum.at(angles, sides[order[same][sharp]].ravel(), np.repeat(np.pi + turned[sharp], 2))
    return angles


def surface_facets(space: AnySpace) -> IntArray:
    """Return the boundary facet of each triangle of `surface_topology`, shape (n_triangles,)."""
    return np.concatenate(
        [
            own.first_facet + np.repeat(facets, around.shape[1] - 2)
            for own in space.members
            for facets, around in boundary_polygons(own.space)
        ]
    )


def surface_elements(space: AnySpace) -> IntArray:
    """Return the element of each triangle of `surface_topology`, shape (n_triangles,)."""
    elements = np.concatenate([own.first_element + own.space.boundary_facets[0] for own in space.members])
    return np.asarray(elements[surface_facets(space)])


def boundary_polygons(space: Discretisation) -> list[tuple[IntArray, IntArray]]:
    """Return the numbers (n_facets,) of the boundary facets and the nodes (n_facets, n_around) around each.

    Counter-clockwise seen from outside; triangles and quadrilaterals are separate items.
    """
    elements, local = space.boundary_facets
    polygons = space.kind.facet_polygons
    result = []
    for n_around in sorted({len(polygon) for polygon in polygons}):
        numbers = [k for k, polygon in enumerate(polygons) if len(polygon) == n_around]
        of_kind = np.isin(local, numbers)
        if of_kind.any():
            table = np.zeros((len(polygons), n_around), dtype=np.int64)
            table[numbers] = [polygons[k] for k in numbers]
            own = elements[of_kind]
            around = space.element_nodes[own[:, None], table[local[of_kind]]]
            inside = space.corner_coordinates[own].mean(axis=1)
            result.append((np.flatnonzero(of_kind), turn_outwards(space.x, around, inside)))
    return result


def _split_along_length(x: Array, polygons: IntArray) -> IntArray:
    """Rotate quadrilaterals of eight nodes so that they are split between the mid-edge nodes further apart.

    Elements are longest in the direction of the smallest change, where interpolation errs least.
    """
    one, other = (np.linalg.norm(x[polygons[:, k]] - x[polygons[:, k + 4]], axis=1) for k in (1, 3))
    return np.where((other > one)[:, None], np.roll(polygons, -2, axis=1), polygons)


def turn_outwards(x: Array, polygons: IntArray, inside: Array) -> IntArray:
    """Return the nodes around facets (n_facets, n_around) counter-clockwise, seen from outside.

    All nodes are at x (n_nodes, 3); each facet's element holds a place ``inside`` (n_facets, 3).
    """
    polygons, has_middles = polygons.copy(), polygons.shape[1] >= 6
    corners = x[polygons[:, :: 1 + has_middles]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("fi,fi->f", normal, corners.mean(axis=1) - inside) < 0
    polygons[inward] = polygons[inward, ::-1]
    if has_middles:  # keep a corner in front: the reversal has put a mid-edge node there
        polygons[inward] = np.roll(polygons[inward], 1, axis=1)
    return np.asarray(polygons)

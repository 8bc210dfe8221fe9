"""The outer surface of a mesh as triangles and element outlines, through the mid-edge nodes too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.checks import IntArray

if TYPE_CHECKING:
    from pipeline.fem.model import Discretisation


@dataclass(frozen=True, slots=True)
class SurfaceTopology:
    """Which nodes lie on the surface and how they are joined.

    Attributes
    ----------
    nodes : ndarray, shape (n_surface,)
        Node numbers of the discretisation, ascending.
    triangles : ndarray, shape (n_triangles, 3)
        Positions in ``nodes``, counter-clockwise seen from outside.
    edges : ndarray, shape (n_edges, 2)
        Positions in ``nodes``: the outlines of the element faces.
    """

    nodes: IntArray
    triangles: IntArray
    edges: IntArray


def surface_topology(space: Discretisation) -> SurfaceTopology:
    """Find the outer surface of a discretisation."""
    polygons = boundary_polygons(space)
    n_around = polygons.shape[1]
    rim = np.arange(n_around)
    if space.order == 1:
        fan = np.array([(0, k, k + 1) for k in range(1, n_around - 1)])
    else:  # a triangle at each corner, and the polygon of the mid-edge nodes within
        corners = np.array([(k - 1, k, k + 1) for k in range(0, n_around, 2)]) % n_around
        middle = np.array([(1, k, k + 2) for k in range(3, n_around - 2, 2)])
        fan = np.concatenate([corners, middle])
    sides = np.stack([rim, (rim + 1) % n_around], axis=1)
    nodes, local = np.unique(polygons, return_inverse=True)
    local = local.reshape(polygons.shape)
    edges = np.unique(np.sort(local[:, sides].reshape(-1, 2), axis=1), axis=0)
    return SurfaceTopology(nodes, local[:, fan].reshape(-1, 3), edges)


def surface_elements(space: Discretisation) -> IntArray:
    """Element that each triangle of `surface_topology` belongs to, shape (n_triangles,)."""
    mesh = space.skfem_mesh
    elements = mesh.f2t[0, mesh.boundary_facets()]
    return np.repeat(elements, space.kind.facet_polygons.shape[1] - 2)


def boundary_polygons(space: Discretisation) -> IntArray:
    """Nodes around each boundary facet, shape (n_facets, n_around), counter-clockwise seen from outside."""
    mesh = space.skfem_mesh
    facets = mesh.boundary_facets()
    elements = mesh.f2t[0, facets]
    local_facet = np.argmax(mesh.t2f[:, elements] == facets, axis=0)
    polygons = space.element_nodes[elements[:, None], space.kind.facet_polygons[local_facet]]
    corners = space.x[polygons[:, :: space.order]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = corners.mean(axis=1) - space.corner_coordinates[elements].mean(axis=1)
    inward = np.einsum("fi,fi->f", normal, outward) < 0
    polygons[inward] = polygons[inward, ::-1]
    if space.order == 2:  # keep a corner in front: the reversal has put a mid-edge node there
        polygons[inward] = np.roll(polygons[inward], 1, axis=1)
    return np.asarray(polygons)

"""Ties: faces of parts without common nodes, which stay together where they are near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import RIGID_RESIDUAL
from fmd.core.limits.round_off import SOLVED
from fmd.core.rotations import rigid_motions
from fmd.fem.connections import TiedFaces
from fmd.fem.markers import facets_on_face, weighted_marker
from fmd.fem.mortar import follow_face
from fmd.fem.space import Discretisation


@dataclass(frozen=True)
class Tie:
    """Nodes whose displacements follow those of others."""

    label: str  # what it is, for messages
    nodes: IntArray  # (n,)
    others: IntArray  # (m,)
    weights: sp.csr_array  # (3 n, 3 m): displacements of the nodes by those of the others; rigid motions stay rigid


def tie_faces(space: Discretisation, given: TiedFaces) -> Tie:
    """Return how the first of two faces follows the second, where both are near.

    Across a gap, as between polygons of two meshes of one bore, a node moves as on an arm that turns as the other
    face's nodes around it do in the mean.

    Raises
    ------
    ValueError
        The faces have no facets, share nodes, or are too far apart; the message says how far.
    """
    if space.mesh.midsurface is not None:
        raise ValueError(f"{given.label} joins faces of shells or beams; ties are of solids")
    face, onto = (facets_on_face(space, each) for each in (given.face, given.onto))
    for name, facets in (("first", face), ("second", onto)):
        if not len(facets):
            raise ValueError(f"{given.label}: no facet of the mesh's boundary is on the {name} face")
    one, other = (_nodes(space, each) for each in (face, onto))
    if shared := len(np.intersect1d(one, other)):
        raise ValueError(f"{given.label}: its faces share {shared} nodes, by which they are joined already")
    found = follow_face(space, face, onto, given.within)
    x = space.x
    if not len(found.nodes):
        away = float(cKDTree(x[other]).query(x[one])[0].min())
        raise ValueError(
            f"{given.label}: its faces don't lie against each other; nodes of both come as near as {away:.3g} m. "
            "Give the distance that it may bridge (mesh.tie.within, or POSITION TOLERANCE of the deck)"
        )
    weights = sp.csr_array(sp.kron(found.weights, sp.eye_array(3)))
    arms = x[found.nodes] - found.weights @ x[found.others]
    extent = float(np.ptp(x, axis=0).max())
    far = np.flatnonzero(np.linalg.norm(arms, axis=1) > SOLVED * extent)
    if len(far):
        weights = sp.csr_array(weights + _turned(found.weights, x[found.others], arms, far))
    left = weights @ rigid_motions(x[found.others]).reshape(-1, 6) - rigid_motions(x[found.nodes]).reshape(-1, 6)
    if np.abs(left).max() > RIGID_RESIDUAL * max(extent, 1.0):
        raise ValueError(f"{given.label}: its faces meet on a line, about which one would turn on the other")
    return Tie(given.label, found.nodes, found.others, weights)


def _nodes(space: Discretisation, facets: IntArray) -> IntArray:
    """Return the corners of boundary facets."""
    elements, local = (each[facets] for each in space.boundary_facets)
    corners = [space.element_nodes[elements[local == k]][:, space.kind.facet_corners[k]].ravel() for k in set(local)]
    return np.unique(np.concatenate(corners))


def _turned(weights: sp.csr_array, x: Array, arms: Array, far: IntArray) -> sp.csr_array:
    """Return what the rotation of the nodes at x that each one follows adds to the weights, ``θ × arm``."""
    rows, columns, values = [], [], []
    for k in far:
        others = weights.indices[weights.indptr[k] : weights.indptr[k + 1]]
        turn = weighted_marker(others, x[others], np.ones(len(others))).rotation_weights
        moved = np.cross(turn, arms[k], axis=0).reshape(3, -1)
        values.append(moved.ravel())
        rows.append(np.repeat(3 * k + np.arange(3), moved.shape[1]))
        columns.append(np.tile((3 * others[:, None] + np.arange(3)).ravel(), 3))
    place = np.concatenate(rows), np.concatenate(columns)
    n, m = weights.shape
    return sp.csr_array((np.concatenate(values), place), shape=(3 * n, 3 * m))

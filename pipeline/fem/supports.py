"""Where a body is held: nodes on faces, on straight edges, at points."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from pipeline.core.arrays import Array, IntArray
from pipeline.fem.markers import face_marker
from pipeline.fem.model import Discretisation

_ON_EDGE = 1e-6  # of the body's extent


def nodes_on_faces(space: Discretisation, faces: Sequence[IntArray]) -> IntArray:
    """Nodes that all faces have in common: of one face, of the edge of two, of the corner of three.

    Parameters
    ----------
    faces : sequence of ndarray
        Mesh points of each face; a facet of the boundary lies on it if all of its corners do.

    Raises
    ------
    ValueError
        The faces have no node in common.
    """
    nodes = reduce(np.intersect1d, [face_marker(space, points).nodes for points in faces])
    if not len(nodes):
        raise ValueError("the faces have no node in common")
    return nodes


def nodes_on_edge(space: Discretisation, ends: Array) -> IntArray:
    """Nodes on the straight line between two points, ``ends`` (2, 3) [m].

    Raises
    ------
    ValueError
        There is none.
    """
    along = ends[1] - ends[0]
    r = space.x - ends[0]
    share = np.clip(r @ along / (along @ along), 0.0, 1.0)
    away = np.linalg.norm(r - share[:, None] * along, axis=1)
    extent = float(np.ptp(space.x, axis=0).max())
    nodes = np.flatnonzero(away < _ON_EDGE * extent)
    if not len(nodes):
        raise ValueError(f"no node of the mesh lies there; the nearest is {away.min():.4g} m away")
    return nodes


def node_at(space: Discretisation, point: Array) -> IntArray:
    """The node nearest to a point (3,) [m], shape (1,)."""
    return np.array([np.linalg.norm(space.x - point, axis=1).argmin()])

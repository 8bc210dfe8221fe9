"""Depths that wear takes from the faces of bodies that touch."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray

if TYPE_CHECKING:
    from fmd.contact.touching_body import ContactPoints
    from fmd.recovery.motion import Motion


class WornFace(NamedTuple):
    """A face of a flexible body, or of triangles of a rigid one, and the depth that it has lost since the start."""

    body: str
    face: str  # name of its marker
    points: IntArray  # (n,): numbers in the body's contact points
    depths: Array  # (n_times, n) [m]


def worn_faces(motion: Motion, contact: str) -> list[WornFace]:
    """Return the faces of a contact that wear, first that with the points at which pressure is found.

    The other one's depth is that of volumes spread by the weights of triangles, over a third of those around each node.
    """
    (touching,) = (own for own in motion.mechanism.contacts if contact in own.names)
    points, found = {own.body: own.points for own in motion.mechanism.contacts}, []
    for body, face in touching.faces_of(contact):
        if not points[body].has_primitives:
            numbers, areas = _areas(points[body], face, has_points=body == touching.body)
            found.append(WornFace(body, face, numbers, motion.contact_wear[body][:, numbers] / areas))
    return found


def _areas(points: ContactPoints, face: str, *, has_points: bool) -> tuple[IntArray, Array]:
    """Return numbers and areas [m²] of the points of a face that has the points, or the triangles."""
    if has_points:
        return points.faces[face], points.areas[face]
    triangles = points.surfaces[face]
    a, b, c = points.x[triangles].transpose(1, 0, 2)
    areas = np.zeros(len(points.x))
    np.add.at(areas, triangles, np.linalg.norm(np.cross(b - a, c - a), axis=1)[:, None] / 6.0)
    numbers = np.unique(triangles)
    return numbers, areas[numbers]

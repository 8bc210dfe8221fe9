"""Faults of surfaces that touch: the side that they look to, and a material that counts for nothing."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from fmd.contact.surfaces import find_rim, node_normals
from fmd.core.limits.contact import FACE_ALIKE, RIGID_BESIDE
from fmd.recovery.motion import Motion
from fmd.stages.pipeline import Pipeline
from fmd.stages.rigid_contacts import rigid_surface


def facing_faults(motion: Motion) -> Iterator[str]:
    """Yield which faces of triangles look the same way where they are nearest at the start: they pass through.

    Two closed ones don't, as they are refused inside out, though mean normals at their edges may be alike.
    """
    bodies, frames = {own.body: own for own in motion.mechanism.contacts}, motion.kinematics.frames
    for body in bodies.values():
        for pair in body.pairs:
            sides, is_open = [], False
            for name, face in ((body.body, pair.face), (pair.other, pair.other_face)):
                points, frame = bodies[name].points, frames[motion.mechanism.number_of(name)]
                if face in points.surfaces:
                    corners = np.unique(points.surfaces[face])
                    is_open |= bool(find_rim(points.surfaces[face]).any())
                    both = points.x[corners], node_normals(points, points.surfaces[face])[corners]
                    x, normals = (own @ frame.rotation[0].T for own in both)
                    sides.append((f"{name}.{face}", x + frame.origin[0], normals))
            if len(sides) < 2 or not is_open:
                continue
            (one, x, normals), (two, others, their_normals) = sides
            apart, nearest = cKDTree(others).query(x)
            if normals[k := int(apart.argmin())] @ their_normals[nearest[k]] > FACE_ALIKE:
                yield (
                    f"contact.{pair.name}: {one} and {two} look the same way where they are nearest at the start, so "
                    "that one passes through the other; corners of triangles go counter-clockwise seen from outside"
                )


def material_faults(run: Pipeline) -> Iterator[str]:
    """Yield which surfaces of rigid bodies are as soft as a face of elements that they touch, and count as rigid."""
    bodies = {own.body: own for own in run.motion.mechanism.contacts}
    for body in bodies.values():
        for pair in body.pairs:
            if pair.other_face in bodies[pair.other].points.primitives and body.points.elastic is not None:
                surface: Any = rigid_surface(run.scene, place := f"{pair.other}.{pair.other_face}")
                if RIGID_BESIDE * body.points.elastic[0] > surface.E:
                    yield (
                        f"contact.{pair.name}: {place} is rigid before a face of elements, and its E of "
                        f"{surface.E:.3g} Pa counts for nothing; a surface of type 'file' gives way there, too"
                    )

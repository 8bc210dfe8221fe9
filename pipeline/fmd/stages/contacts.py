"""From a scene's contacts to bodies that touch planes, with their points and their flexibility."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fmd.contact.flexibility import contact_points
from fmd.contact.touching_body import ContactPlane, ContactPoints, TouchingBody
from fmd.core.errors import InputError
from fmd.dynamics.mechanism import Mechanism
from fmd.stages.parent_joint import ground_place

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fmd.scene.scene import Scene
    from fmd.stages.part import FlexiblePart


class ScenesParts(Protocol):
    """A scene with its flexible parts."""

    scene: Scene

    @property
    def parts(self) -> Mapping[str, FlexiblePart]:
        """Parts by name."""


def find_contact_points(part: FlexiblePart) -> ContactPoints:
    """Find the points of a part's faces that may touch something.

    Raises
    ------
    InputError
        A face has no points that only push; the message tells which elements have.
    """
    if not part.has_mesh:
        raise InputError(
            part.file, f"body.{part.name}", None, "has contacts, but no mesh: a face of elements is needed"
        )
    faces = {name: part.markers[name] for name in part.contact_faces}
    try:
        return contact_points(part.fe, part.model.solver, part.body, faces)
    except ValueError as error:
        raise InputError(part.file, f"body.{part.name}.marker", None, str(error)) from error


def add_contacts(run: ScenesParts, mechanism: Mechanism) -> Mechanism:
    """Give a mechanism the contacts of its scene."""
    planes: dict[str, list[ContactPlane]] = {}
    for name, contact in run.scene.contact.items():
        place, (body, _, face) = contact.between[0], contact.between[1].partition(".")
        position, axes = ground_place(run.scene, place)
        normal = axes @ np.array(contact.normal, dtype=float)
        numbers = run.parts[body].contact_points.faces[face]
        plane = ContactPlane(name, position, normal / np.linalg.norm(normal), contact.friction, numbers)
        planes.setdefault(body, []).append(plane)
    bodies = [TouchingBody(body, run.parts[body].contact_points, tuple(own)) for body, own in planes.items()]
    return replace(mechanism, contacts=bodies)

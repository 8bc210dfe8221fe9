"""Contacts in a scene file: faces of flexible bodies that may touch something."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from fmd.scene.reading import SceneTable
from fmd.scene.values import Axis, Number, PlaceName


class Contact(SceneTable):
    """A plane of the ground that a face of a flexible body may touch, with or without Coulomb's friction.

    The face is that of an averaged marker; its points are those that a constant pressure acts on. What the body's modes
    leave out of the deflection by forces on them is known from the mesh, and so is the pressure.

    Parameters
    ----------
    between : tuple of str
        The ground or a place on it, where the plane is, and a marker on the face.
    normal : tuple of float
        Direction out of the ground, in the axes of the place; its length doesn't count.
    friction : float
        Coefficient of friction.

    Examples
    --------
    ::

        [contact.floor]
        between = ["ground", "block.bottom"]
        normal = [0, 0, 1]
        friction = 0.3
    """

    between: tuple[PlaceName, PlaceName]
    normal: Axis
    friction: Annotated[Number, Field(ge=0.0, le=10.0)] = 0.0

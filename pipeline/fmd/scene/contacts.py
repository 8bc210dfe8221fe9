"""Contacts in a scene file: faces of flexible bodies that may touch something."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from fmd.core.units import Length
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Axis, Number, PlaceName


class Contact(SceneTable):
    """What a face of a flexible body may touch, a plane of the ground or a face of another body, and its friction.

    A face is that of an averaged marker; its points are those that a constant pressure acts on. What the bodies' modes
    leave out of the deflection by forces on them is known from the meshes, and so is the pressure.

    Parameters
    ----------
    between : tuple of str
        The ground or a place on it, where the plane is, and a marker on the face; or markers on faces of two bodies.
    normal : tuple of float
        Direction out of the ground, in the axes of the place; its length doesn't count.
    friction : float
        Coefficient of friction.
    clearance : float
        What the gap is wider than drawn [m]; of an interference fit it is negative.

    Examples
    --------
    ::

        [contact.floor]
        between = ["ground", "block.bottom"]
        normal = [0, 0, 1]
        friction = 0.3

        [contact.strike]
        between = ["block.top", "rod.end"]
    """

    between: tuple[PlaceName, PlaceName]
    normal: Axis | None = None
    friction: Annotated[Number, Field(ge=0.0, le=10.0)] = 0.0
    clearance: Length = 0.0

    @field_validator("between", mode="before")
    @classmethod
    def _two_surfaces(cls, given: Any) -> Any:
        if isinstance(given, list | tuple) and len(given) > 2:
            raise ValueError("must be two surfaces; each two of more take a contact of their own")
        return given

    @model_validator(mode="after")
    def _plane_has_a_normal(self) -> Contact:
        if self.on_ground and self.normal is None:
            raise FaultError("is missing: the direction out of the ground, such as [0, 0, 1]", "normal")
        if not self.on_ground and self.normal is not None:
            raise FaultError("belongs to a plane of the ground; faces of bodies have normals of their own", "normal")
        return self

    @property
    def on_ground(self) -> bool:
        """True if a plane of the ground is touched."""
        return any(end.partition(".")[0] == "ground" for end in self.between)

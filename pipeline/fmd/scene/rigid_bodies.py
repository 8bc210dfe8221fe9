"""Rigid bodies in a scene file: rods, point masses and bodies given by their inertia."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fmd.core.limits.round_off import SOLVED
from fmd.core.units import MomentOfInertia, NonNegative, PositiveLength, PositiveMass
from fmd.scene.orientation import Orientation
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.rigid_surfaces import RigidSurface
from fmd.scene.values import Name, Point
from fmd.scene.visuals import Visuals

Moment = Annotated[MomentOfInertia, NonNegative]


def require_possible_moments(inertia: tuple[float, float, float]) -> None:
    """Raise ``FaultError`` for principal moments of inertia that no body has."""
    largest = max(inertia)
    if largest > (sum(inertia) - largest) * (1 + SOLVED):
        raise FaultError("isn't any body's: no moment is greater than the sum of the other two", "inertia")


class PointMarker(Orientation):
    """A named point of a rigid body, where joints and loads act and motion is recorded, with axes of its own.

    Example:

        [body.upper.marker]
        elbow = { at = ["0.5 m", "0 m", "0 m"] }
    """

    at: Point  # Position in the body's frame [m].


class Undeformable(SceneTable):
    """Keys that rigid bodies have in common."""

    mass: PositiveMass  # Mass of the body [kg].
    marker: dict[Name, PointMarker]  # Points for joints, loads and results, by name.
    # Shapes in pictures and films. By default a rod is one of its length, a point mass a ball, and any other body its
    # surfaces, else rods or a plate through its markers, or the box that has its inertia.
    visual: Visuals = ()
    # Balls, boxes, pins, bores and files of triangles that may touch something, by name.
    surface: dict[Name, RigidSurface] = Field(default_factory=dict)

    def _check(self) -> None:
        for name in self.surface:
            if name in self.marker:
                raise FaultError("is the name of a marker; another one works", "surface", name)


class Rod(Undeformable):
    """A uniform slender rigid rod along x, from the origin of its frame.

    Example:

        [body.rod]
        shape = "rod"
        mass = "2 kg"
        length = "2 m"
        marker = { hinge = { at = ["0 m", "0 m", "0 m"] } }
    """

    shape: Literal["rod"]
    length: PositiveLength  # Extent along x [m].


class PointMass(Undeformable):
    """A rigid body without extent: a mass in the origin of its frame.

    Example:

        [body.slider]
        shape = "point"
        mass = "5 kg"
        marker = { centre = { at = ["0 m", "0 m", "0 m"] } }
    """

    shape: Literal["point"]


class RigidBody(Undeformable):
    """A rigid body of any shape, given by its mass, centre of mass and moments of inertia.

    Example:

        [body.gripper]
        shape = "rigid"
        mass = "0.4 kg"
        centre = ["60 mm", "0 mm", "0 mm"]
        inertia = ["1e-4 kg m^2", "6e-4 kg m^2", "6e-4 kg m^2"]
        marker = { wrist = { at = ["0 m", "0 m", "0 m"] } }
    """

    shape: Literal["rigid"]
    centre: Point = (0.0, 0.0, 0.0)  # Centre of mass in the body's frame [m].
    # Principal moments about the centre of mass, along the frame's x, y and z [kg m²].
    inertia: tuple[Moment, Moment, Moment]

    def _check(self) -> None:
        require_possible_moments(self.inertia)

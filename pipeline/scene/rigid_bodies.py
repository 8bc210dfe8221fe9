"""Rigid bodies in a scene file: rods, point masses and bodies given by their inertia."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import model_validator

from pipeline.core.units import Length, MomentOfInertia, NonNegative, PositiveLength, PositiveMass
from pipeline.scene.reading import FaultError, SceneTable
from pipeline.scene.values import Name

Moment = Annotated[MomentOfInertia, NonNegative]

_ROUNDING = 1e-9  # a plate's moments, 0.1 and 0.2 and 0.3, are just possible whatever their last digit


class PointMarker(SceneTable):
    """A point of a rigid body, named for joints and results; ``at`` is its place in the body's frame [m]."""

    at: tuple[Length, Length, Length]


class Rod(SceneTable):
    """A uniform slender rigid rod along x, from the origin of its frame.

    Parameters
    ----------
    mass : float
        Its mass [kg].
    length : float
        Its extent along x [m].
    marker
        Its markers by name.
    """

    shape: Literal["rod"]
    mass: PositiveMass
    length: PositiveLength
    marker: dict[Name, PointMarker]


class PointMass(SceneTable):
    """A mass [kg] without extent, in the origin of its frame, and its markers by name."""

    shape: Literal["point"]
    mass: PositiveMass
    marker: dict[Name, PointMarker]


class RigidBody(SceneTable):
    """A rigid body of any shape, given by its inertia.

    Parameters
    ----------
    mass : float
        Its mass [kg].
    centre : tuple of float
        Where its centre of mass is, in its frame [m].
    inertia : tuple of float
        Principal moments about the centre of mass, along x, y and z of its frame [kg m²].
    marker
        Its markers by name.
    """

    shape: Literal["rigid"]
    mass: PositiveMass
    centre: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    inertia: tuple[Moment, Moment, Moment]
    marker: dict[Name, PointMarker]

    @model_validator(mode="after")
    def _inertia_of_a_body(self) -> RigidBody:
        largest = max(self.inertia)
        if largest > (sum(self.inertia) - largest) * (1 + _ROUNDING):
            raise FaultError("isn't any body's: no moment is greater than the sum of the other two", "inertia")
        return self

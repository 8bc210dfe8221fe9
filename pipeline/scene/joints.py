"""Joints in a scene file: how bodies hang on the ground and on one another."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from pipeline.core.units import (
    Angle,
    AngularRate,
    Length,
    NonNegative,
    RotationalDamping,
    RotationalStiffness,
    TranslationalDamping,
    TranslationalStiffness,
    Velocity,
)
from pipeline.scene.reading import SceneTable
from pipeline.scene.values import Axis, Place

Spin = tuple[AngularRate, AngularRate, AngularRate]


class Revolute(SceneTable):
    """A hinge.

    Parameters
    ----------
    parent, child : str
        ``"body.marker"``; the parent may be ``"ground"``.
    axis : tuple of float
        Its direction; the length is of no account.
    angle : float
        Angle at the start [rad].
    rate : float
        Angular rate at the start [rad/s].
    spring : float
        Stiffness of a spring about the axis [N m/rad].
    rest : float
        Angle at which the spring is unstretched [rad].
    damper : float
        Coefficient of a damper about the axis [N m s/rad].
    """

    type: Literal["revolute"]
    parent: Place
    child: Place
    axis: Axis
    angle: Angle = 0.0
    rate: AngularRate = 0.0
    spring: Annotated[RotationalStiffness, NonNegative] = 0.0
    rest: Angle = 0.0
    damper: Annotated[RotationalDamping, NonNegative] = 0.0


class Prismatic(SceneTable):
    """A slide.

    Parameters
    ----------
    parent, child : str
        ``"body.marker"``; the parent may be ``"ground"``.
    axis : tuple of float
        Its direction; the length is of no account.
    position : float
        Displacement of the child's marker from the parent's at the start [m].
    rate : float
        Speed at the start [m/s].
    spring : float
        Stiffness of a spring along the axis [N/m].
    rest : float
        Displacement at which the spring is unstretched [m].
    damper : float
        Coefficient of a damper along the axis [N s/m].
    """

    type: Literal["prismatic"]
    parent: Place
    child: Place
    axis: Axis
    position: Length = 0.0
    rate: Velocity = 0.0
    spring: Annotated[TranslationalStiffness, NonNegative] = 0.0
    rest: Length = 0.0
    damper: Annotated[TranslationalDamping, NonNegative] = 0.0


class Fixed(SceneTable):
    """A weld: the child's marker stays on the parent's, without turning."""

    type: Literal["fixed"]
    parent: Place
    child: Place


class Spherical(SceneTable):
    """A ball joint: the child's marker stays on the parent's and turns freely.

    Parameters
    ----------
    parent, child : str
        ``"body.marker"``; the parent may be ``"ground"``.
    spin : tuple of float
        Angular velocity against the parent at the start, along the child's axes [rad/s].
    """

    type: Literal["spherical"]
    parent: Place
    child: Place
    spin: Spin = (0.0, 0.0, 0.0)


class Free(SceneTable):
    """No constraint: the child moves freely against the parent.

    Parameters
    ----------
    parent, child : str
        ``"body.marker"``; the parent may be ``"ground"``.
    velocity : tuple of float
        Velocity of the child's marker against the parent at the start [m/s].
    spin : tuple of float
        Angular velocity against the parent at the start, along the child's axes [rad/s].
    """

    type: Literal["free"]
    parent: Place
    child: Place
    velocity: tuple[Velocity, Velocity, Velocity] = (0.0, 0.0, 0.0)
    spin: Spin = (0.0, 0.0, 0.0)


Joint = Annotated[Revolute | Prismatic | Fixed | Spherical | Free, Field(discriminator="type")]

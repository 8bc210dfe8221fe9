"""Joints in a scene file: how bodies hang on the ground and on one another."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from fmd.core.units import (
    Angle,
    AngularRate,
    Force,
    Length,
    NonNegative,
    Positive,
    RotationalDamping,
    RotationalStiffness,
    Torque,
    TranslationalDamping,
    TranslationalStiffness,
    Velocity,
)
from fmd.scene.compound_joints import Cylindrical, Planar, Screw, Universal
from fmd.scene.constraints import Distance, PointOnLine
from fmd.scene.force_elements import AngleStop, LengthStop
from fmd.scene.orientation import Orientation
from fmd.scene.values import Axis, MarkerName, PlaceName, Point

Spin = tuple[AngularRate, AngularRate, AngularRate]


class Revolute(Orientation):
    """A hinge: the child turns about one axis of the parent.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.
    axis : tuple of float
        Direction of the axis in the axes of the parent's marker or place; its length
        doesn't count.
    child_axis : tuple of float, optional
        The same direction in the axes of the child's marker or place, of a joint that closes a loop; the numbers of
        ``axis`` by default, which are right if the child doesn't turn against the parent but about the axis.
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
    stop : AngleStop, optional
        End stops.
    friction : float
        Largest friction about the axis [N m].
    friction_rate : float
        Angular rate at which friction has reached 71 % of that [rad/s].

    Examples
    --------
    ::

        [joint.elbow]
        type = "revolute"
        parent = "upper.elbow"
        child = "forearm.elbow"
        axis = [0, 0, 1]
        spring = "60 N m/rad"
        damper = "0.2 N m s/rad"
    """

    type: Literal["revolute"]
    parent: PlaceName
    child: MarkerName
    axis: Axis
    child_axis: Axis | None = None
    angle: Angle = 0.0
    rate: AngularRate = 0.0
    spring: Annotated[RotationalStiffness, NonNegative] = 0.0
    rest: Angle = 0.0
    damper: Annotated[RotationalDamping, NonNegative] = 0.0
    stop: AngleStop | None = None
    friction: Annotated[Torque, NonNegative] = 0.0
    friction_rate: Annotated[AngularRate, Positive] = 1e-2


class Prismatic(Orientation):
    """A slide: the child moves along one axis of the parent, without turning.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.
    axis : tuple of float
        Direction of the axis in the axes of the parent's marker or place; its length
        doesn't count.
    child_axis : tuple of float, optional
        The same direction in the axes of the child's marker or place, of a joint that closes a loop; the numbers of
        ``axis`` by default, which are right if the child doesn't turn against the parent but about the axis.
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
    stop : LengthStop, optional
        End stops.
    friction : float
        Largest friction along the axis [N].
    friction_rate : float
        Speed at which friction has reached 71 % of that [m/s].

    Examples
    --------
    ::

        [joint.slide]
        type = "prismatic"
        parent = "rod.rest"
        child = "slider.centre"
        axis = [1, 0, 0]
        position = "0.15 m"
        spring = "1000 N/m"
    """

    type: Literal["prismatic"]
    parent: PlaceName
    child: MarkerName
    axis: Axis
    child_axis: Axis | None = None
    position: Length = 0.0
    rate: Velocity = 0.0
    spring: Annotated[TranslationalStiffness, NonNegative] = 0.0
    rest: Length = 0.0
    damper: Annotated[TranslationalDamping, NonNegative] = 0.0
    stop: LengthStop | None = None
    friction: Annotated[Force, NonNegative] = 0.0
    friction_rate: Annotated[Velocity, Positive] = 1e-3


class Fixed(Orientation):
    """A weld: the child's marker stays on the parent's, in the joint's axes.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.

    Examples
    --------
    ::

        [joint.flange]
        type = "fixed"
        parent = "ground"
        child = "plate.rim"
    """

    type: Literal["fixed"]
    parent: PlaceName
    child: MarkerName


class Spherical(Orientation):
    """A ball joint: the child's marker stays on the parent's and turns freely.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.
    spin : tuple of float
        Angular velocity against the parent at the start, along the child's axes [rad/s].

    Examples
    --------
    ::

        [joint.ball]
        type = "spherical"
        parent = "ground"
        child = "top.foot"
        spin = ["0 rad/s", "0 rad/s", "100 rad/s"]
    """

    type: Literal["spherical"]
    parent: PlaceName
    child: MarkerName
    spin: Spin = (0.0, 0.0, 0.0)


class Free(Orientation):
    """No constraint: the child moves and turns freely against the parent, from the position and axes of the start.

    Parameters
    ----------
    parent : str
        Marker or place on the ground, ``"ground.NAME"``, that the joint hangs on; ``"ground"`` is its origin.
    child : str
        Marker of the body that the joint carries.
    position : tuple of float
        Displacement of the child's marker from the parent's at the start, in the axes of the parent's [m].
    velocity : tuple of float
        Velocity of the child's marker against the parent at the start, in the same axes [m/s].
    spin : tuple of float
        Angular velocity against the parent at the start, along the child's axes [rad/s].

    Examples
    --------
    ::

        [joint.flight]
        type = "free"
        parent = "ground"
        child = "box.corner"
        position = ["0 m", "0 m", "1.5 m"]
        rotate = ["0 deg", "30 deg", "0 deg"]
        velocity = ["1 m/s", "0 m/s", "2 m/s"]
    """

    type: Literal["free"]
    parent: PlaceName
    child: MarkerName
    position: Point = (0.0, 0.0, 0.0)
    velocity: tuple[Velocity, Velocity, Velocity] = (0.0, 0.0, 0.0)
    spin: Spin = (0.0, 0.0, 0.0)


Joint = Annotated[
    Revolute | Prismatic | Fixed | Spherical | Free | Universal | Cylindrical | Planar | Screw | Distance | PointOnLine,
    Field(discriminator="type"),
]

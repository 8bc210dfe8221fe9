"""The mechanism's tables in a scene file: rigid bodies, joints and drives."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from pipeline.core.units import (
    Angle,
    AngularRate,
    Length,
    MomentOfInertia,
    NonNegative,
    NonNegativeTime,
    PositiveLength,
    PositiveMass,
    PositiveTime,
    RotationalDamping,
    RotationalStiffness,
    Torque,
    TranslationalDamping,
    TranslationalStiffness,
    Velocity,
)
from pipeline.scene.bodies import Axis, Bar, Name, Place, Propeller
from pipeline.scene.imported_bodies import CadPart, MatrixPart, MeshedPart, with_shape
from pipeline.scene.reading import FaultError, Table
from pipeline.scene.time_functions import AngleOverTime, ForceOverTime, PositionOverTime, TorqueOverTime

Moment = Annotated[MomentOfInertia, NonNegative]
Spin = tuple[AngularRate, AngularRate, AngularRate]

_ROUNDING = 1e-9  # a plate's moments, 0.1 and 0.2 and 0.3, are just possible whatever their last digit


class PointMarker(Table):
    """A point of a rigid body, named for joints and results; ``at`` is its place in the body's frame [m]."""

    at: tuple[Length, Length, Length]


class Rod(Table):
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


class PointMass(Table):
    """A mass [kg] without extent, in the origin of its frame, and its markers by name."""

    shape: Literal["point"]
    mass: PositiveMass
    marker: dict[Name, PointMarker]


class RigidBody(Table):
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


class Revolute(Table):
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


class Prismatic(Table):
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


class Fixed(Table):
    """A weld: the child's marker stays on the parent's, without turning."""

    type: Literal["fixed"]
    parent: Place
    child: Place


class Spherical(Table):
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


class Free(Table):
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


class TorquePulse(Table):
    """A smooth torque about a joint that ends by itself, given by its effect or by its peak.

    Parameters
    ----------
    joint : str
        The joint that it drives.
    duration, start : float
        How long it lasts and when it begins [s].
    speed : float, optional
        Mean rate that it brings the joint to from rest [rad/s].
    torque : float, optional
        Its peak [N m].
    """

    type: Literal["torque pulse"]
    joint: Place
    duration: PositiveTime
    start: NonNegativeTime = 0.0
    speed: AngularRate | None = None
    torque: Torque | None = None

    @model_validator(mode="after")
    def _sized_one_way(self) -> TorquePulse:
        if self.speed is None and self.torque is None:
            raise FaultError("is missing: give it, e.g. '20 rad/s', or a torque, e.g. '1.5 N m'", "speed")
        if self.speed is not None and self.torque is not None:
            raise FaultError("can't stand beside speed: give one of the two", "torque")
        return self


class TorqueDrive(Table):
    """A ``torque`` [N m] about a revolute joint."""

    type: Literal["torque"]
    joint: Place
    torque: TorqueOverTime


class ForceDrive(Table):
    """A ``force`` [N] along a prismatic joint."""

    type: Literal["force"]
    joint: Place
    force: ForceOverTime


class MotionDrive(Table):
    """A prescribed motion of a revolute joint's ``angle`` [rad] or a prismatic one's ``position`` [m]."""

    type: Literal["motion"]
    joint: Place
    angle: AngleOverTime | None = None
    position: PositionOverTime | None = None


class PointForce(Table):
    """A force at a point of a body.

    Parameters
    ----------
    marker : str
        ``"body.marker"`` that it acts on.
    direction : tuple of float
        Its direction; the length is of no account.
    force : TimeFunction
        Its size [N].
    following : bool
        Whether the direction turns with the marker; else it is fixed in space.
    """

    type: Literal["point force"]
    marker: Place
    direction: Axis
    force: ForceOverTime
    following: bool = False


class PointTorque(Table):
    """A ``torque`` [N m] on a body's marker; else as a point force."""

    type: Literal["point torque"]
    marker: Place
    direction: Axis
    torque: TorqueOverTime
    following: bool = False


# Each is told apart by one key.
Flexible = Bar | Propeller | MeshedPart | CadPart | MatrixPart
Body = Annotated[
    Bar | Propeller | Rod | PointMass | RigidBody | MeshedPart | CadPart | MatrixPart,
    Field(discriminator="shape"),
    BeforeValidator(with_shape),
]
Joint = Annotated[Revolute | Prismatic | Fixed | Spherical | Free, Field(discriminator="type")]
Drive = Annotated[
    TorquePulse | TorqueDrive | ForceDrive | MotionDrive | PointForce | PointTorque, Field(discriminator="type")
]

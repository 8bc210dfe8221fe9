"""Loads in a scene file: what drives a joint, and forces and torques on markers."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.core.units import AngularRate, NonNegativeTime, PositiveTime, Torque
from pipeline.scene.reading import FaultError, SceneTable
from pipeline.scene.time_functions import AngleOverTime, ForceOverTime, PositionOverTime, TorqueOverTime
from pipeline.scene.values import Axis, Place


class PulseDrive(SceneTable):
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
    def _sized_one_way(self) -> PulseDrive:
        if self.speed is None and self.torque is None:
            raise FaultError("is missing: give it, e.g. '20 rad/s', or a torque, e.g. '1.5 N m'", "speed")
        if self.speed is not None and self.torque is not None:
            raise FaultError("can't stand beside speed: give one of the two", "torque")
        return self


class TorqueDrive(SceneTable):
    """A ``torque`` [N m] about a revolute joint."""

    type: Literal["torque"]
    joint: Place
    torque: TorqueOverTime


class ForceDrive(SceneTable):
    """A ``force`` [N] along a prismatic joint."""

    type: Literal["force"]
    joint: Place
    force: ForceOverTime


class MotionDrive(SceneTable):
    """A prescribed motion of a revolute joint's ``angle`` [rad] or a prismatic one's ``position`` [m]."""

    type: Literal["motion"]
    joint: Place
    angle: AngleOverTime | None = None
    position: PositionOverTime | None = None


class PointForce(SceneTable):
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


class PointTorque(SceneTable):
    """A ``torque`` [N m] on a body's marker; else as a point force."""

    type: Literal["point torque"]
    marker: Place
    direction: Axis
    torque: TorqueOverTime
    following: bool = False


Drive = Annotated[
    PulseDrive | TorqueDrive | ForceDrive | MotionDrive | PointForce | PointTorque, Field(discriminator="type")
]

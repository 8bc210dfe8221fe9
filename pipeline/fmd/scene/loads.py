"""Loads in a scene file: what drives a joint, and forces and torques on markers."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from fmd.core.units import AngularRate, NonNegativeTime, PositiveTime, Torque
from fmd.scene.curves import AngleOverTime, ForceOverTime, PositionOverTime, TorqueOverTime
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Axis, JointName, MarkerName


class PulseDrive(SceneTable):
    """A torque about a revolute joint that rises and falls as half a sine, given by its effect or by its peak.

    Parameters
    ----------
    joint : str
        Revolute joint that it drives.
    duration : float
        Time that it lasts [s].
    start : float
        Time at which it begins [s].
    speed : float, optional
        Mean angular rate that it brings the joint to from rest [rad/s]; this or ``torque``.
    torque : float, optional
        Peak of the torque [N m]; this or ``speed``.

    Examples
    --------
    ::

        [drive.spin_up]
        type = "torque pulse"
        joint = "hub"
        speed = "20 rad/s"
        duration = "0.1 s"
    """

    type: Literal["torque pulse"]
    joint: JointName
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
    """A torque about a revolute joint, constant or changing with time.

    Parameters
    ----------
    joint : str
        Revolute joint that it drives.
    torque : TorqueOverTime
        Torque on the child; the parent takes its opposite [N m].

    Examples
    --------
    ::

        [drive.swing]
        type = "torque"
        joint = "shoulder"
        torque = { formula = "12*sin(2*pi*t)", unit = "N m" }
    """

    type: Literal["torque"]
    joint: JointName
    torque: TorqueOverTime


class ForceDrive(SceneTable):
    """A force along a prismatic joint, constant or changing with time.

    Parameters
    ----------
    joint : str
        Prismatic joint that it drives.
    force : ForceOverTime
        Force on the child; the parent takes its opposite [N].

    Examples
    --------
    ::

        [drive.push]
        type = "force"
        joint = "slide"
        force = "10 N"
    """

    type: Literal["force"]
    joint: JointName
    force: ForceOverTime


class MotionDrive(SceneTable):
    """A prescribed motion of a joint, which then has no coordinate of its own, no spring and no damper.

    Parameters
    ----------
    joint : str
        Revolute or prismatic joint that it moves.
    angle : AngleOverTime, optional
        Angle of a revolute joint [rad]; required for one.
    position : PositionOverTime, optional
        Displacement of a prismatic joint [m]; required for one.

    Examples
    --------
    ::

        [drive.rotation]
        type = "motion"
        joint = "shaft"
        angle = { formula = "837.758*t", unit = "rad" }
    """

    type: Literal["motion"]
    joint: JointName
    angle: AngleOverTime | None = None
    position: PositionOverTime | None = None


class MarkerLoad(SceneTable):
    """A load on a marker of a body.

    Parameters
    ----------
    marker : str
        Marker that it acts on.
    direction : tuple of float
        Direction of the force or axis of the torque; its length doesn't count.
    following : bool
        True if the direction is in the marker's axes and turns with them, false if it is fixed in space.
    """

    marker: MarkerName
    direction: Axis
    following: bool = False


class PointForce(MarkerLoad):
    """A force on a marker of a body, in a direction that is fixed in space or turns with the marker.

    Parameters
    ----------
    force : ForceOverTime
        Size of the force [N].

    Examples
    --------
    ::

        [drive.gust]
        type = "point force"
        marker = "propeller.pressure"
        direction = [0, 0, 1]
        force = { formula = "1500*sin(pi*t/0.004)**2 if t < 0.004 else 0", unit = "N" }
    """

    type: Literal["point force"]
    force: ForceOverTime


class PointTorque(MarkerLoad):
    """A torque on a marker of a body, about a direction that is fixed in space or turns with the marker.

    Parameters
    ----------
    torque : TorqueOverTime
        Size of the torque [N m].

    Examples
    --------
    ::

        [drive.twist]
        type = "point torque"
        marker = "arm.wrist"
        direction = [1, 0, 0]
        torque = "0.5 N m"
        following = true
    """

    type: Literal["point torque"]
    torque: TorqueOverTime


Drive = Annotated[
    PulseDrive | TorqueDrive | ForceDrive | MotionDrive | PointForce | PointTorque, Field(discriminator="type")
]

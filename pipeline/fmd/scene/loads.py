"""Loads in a scene file: what drives a joint, and forces and torques on markers."""

import math
from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from fmd.core.units import AngularRate, NonNegativeTime, PositiveTime, Torque
from fmd.scene.curves import AngleOverTime, PositionOverTime, TimeFunction
from fmd.scene.kinds import KindBy
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.state_loads import ForceOverTime, TorqueOverTime
from fmd.scene.values import Axis, JointName, MarkerName


class JointDrive(SceneTable):
    """Something that acts on a joint."""

    joint_units: ClassVar[tuple[str, ...]] = ("rad",)
    unit: ClassVar[str] = "N m"

    joint: JointName  # Joint that it drives: revolute for a torque, prismatic for a force, either for a motion.

    @property
    def input_unit(self) -> str:
        """Unit of what it is as an input of a linear model: its load, or the acceleration of its motion."""
        return self.unit

    @property
    def load(self) -> TimeFunction | None:
        """Force or torque over time; ``None`` for a pulse and for a motion."""
        return None

    def pulse(self, _inertia: float) -> tuple[float, float, float, int] | None:
        """Return begin, duration [s], peak [N m] and power of a half sine on an inertia [kg m²], ``None`` of others."""
        return None

    def rests_until(self, _time: float) -> bool:
        """Return True if it is no load before a time [s], whatever its function of time."""
        return False


class PulseDrive(JointDrive):
    """A torque about a revolute joint that rises and falls as half a sine, given by its effect or by its peak.

    Example:

        [drive.spin_up]
        type = "torque pulse"
        joint = "hub"
        speed = "20 rad/s"
        duration = "0.1 s"
        smooth = true
    """

    type: Literal["torque pulse"]
    duration: PositiveTime  # Time that it lasts [s].
    start: NonNegativeTime = 0.0  # Time at which it begins [s].
    # Mean angular rate that it brings the joint to from rest [rad/s]; this or ``torque``.
    speed: AngularRate | None = None
    torque: Torque | None = None  # Peak of the torque [N m]; this or ``speed``.
    # True for the square of half a sine, which begins and ends without a kink. A kink makes all vibrations ring, with
    # accelerations that fall off so slowly towards the high ones that no number of modes has them.
    smooth: bool = False

    def _check(self) -> None:
        if self.speed is None and self.torque is None:
            raise FaultError("is missing: give it, e.g. '20 rad/s', or a torque, e.g. '1.5 N m'", "speed")
        if self.speed is not None and self.torque is not None:
            raise FaultError("can't stand beside speed: give one of the two", "torque")

    def pulse(self, inertia: float) -> tuple[float, float, float, int]:
        """Return begin, duration [s], peak [N m] and power of its half sine, which gives an inertia its speed."""
        power, mean = (2, 1 / 2) if self.smooth else (1, 2 / math.pi)
        if self.speed is None:
            assert self.torque is not None
            return self.start, self.duration, self.torque, power
        return self.start, self.duration, inertia * self.speed / (mean * self.duration), power

    def rests_until(self, time: float) -> bool:
        """Return True if it begins at a time [s] or later."""
        return self.start >= time


class TorqueDrive(JointDrive):
    """A torque about a revolute joint, constant or changing with time.

    Example:

        [drive.swing]
        type = "torque"
        joint = "shoulder"
        torque = { formula = "12*sin(2*pi*t)", unit = "N m" }
    """

    type: Literal["torque"]
    torque: TorqueOverTime  # Torque on the child; the parent takes its opposite [N m].

    @property
    def load(self) -> TimeFunction:
        """Torque over time."""
        return self.torque


class ForceDrive(JointDrive):
    """A force along a prismatic joint, constant or changing with time.

    Example:

        [drive.push]
        type = "force"
        joint = "slide"
        force = "10 N"
    """

    joint_units: ClassVar[tuple[str, ...]] = ("m",)
    unit: ClassVar[str] = "N"

    type: Literal["force"]
    force: ForceOverTime  # Force on the child; the parent takes its opposite [N].

    @property
    def load(self) -> TimeFunction:
        """Force over time."""
        return self.force


class MotionDrive(JointDrive):
    """A prescribed motion of a joint, which then has no coordinate of its own, no spring and no damper.

    Example:

        [drive.rotation]
        type = "motion"
        joint = "shaft"
        angle = { formula = "837.758*t", unit = "rad" }
    """

    joint_units: ClassVar[tuple[str, ...]] = ("m", "rad")

    type: Literal["motion"]
    angle: AngleOverTime | None = None  # Angle of a revolute joint [rad]; required for one.
    position: PositionOverTime | None = None  # Displacement of a prismatic joint [m]; required for one.

    @property
    def input_unit(self) -> str:
        """Unit of the acceleration of its motion."""
        return "m/s^2" if self.angle is None else "rad/s^2"

    @property
    def motion(self) -> TimeFunction:
        """Angle or position over time."""
        given = self.angle or self.position
        assert given is not None  # the scene's own check
        return given


class MarkerLoad(SceneTable):
    """A load on a marker of a body."""

    turns: ClassVar[bool] = False
    unit: ClassVar[str] = "N"

    marker: MarkerName  # Marker that it acts on.
    direction: Axis  # Direction of the force or axis of the torque; its length doesn't count.
    # True if the direction is in the marker's axes and turns with them, false if it is fixed in space.
    following: bool = False

    @property
    def size(self) -> TimeFunction:
        """Force or torque over time."""
        given: TimeFunction = getattr(self, "torque" if self.turns else "force")
        return given


class PointForce(MarkerLoad):
    """A force on a marker of a body, in a direction that is fixed in space or turns with the marker.

    Example:

        [drive.gust]
        type = "point force"
        marker = "propeller.pressure"
        direction = [0, 0, 1]
        force = { formula = "1500*sin(pi*t/0.004)**2 if t < 0.004 else 0", unit = "N" }
    """

    type: Literal["point force"]
    force: ForceOverTime  # Size of the force [N].


class PointTorque(MarkerLoad):
    """A torque on a marker of a body, about a direction that is fixed in space or turns with the marker.

    Example:

        [drive.twist]
        type = "point torque"
        marker = "arm.wrist"
        direction = [1, 0, 0]
        torque = "0.5 N m"
        following = true
    """

    turns: ClassVar[bool] = True
    unit: ClassVar[str] = "N m"

    type: Literal["point torque"]
    torque: TorqueOverTime  # Size of the torque [N m].


Drive = Annotated[PulseDrive | TorqueDrive | ForceDrive | MotionDrive | PointForce | PointTorque, KindBy("type")]


def find_motion(drives: Mapping[str, Drive], joint: str) -> tuple[str, MotionDrive] | None:
    """Find the motion that a scene prescribes to a joint, with the drive's name; ``None`` if the joint moves freely."""
    found = ((name, drive) for name, drive in drives.items() if isinstance(drive, MotionDrive) and drive.joint == joint)
    return next(found, None)

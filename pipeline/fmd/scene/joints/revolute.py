"""A hinge in a scene file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

from fmd.core.arrays import Array
from fmd.core.joint_kinds import ALIGNED, AXIS, SPACE, ElementaryMotion, JointKind
from fmd.core.units import Angle, AngularRate, NonNegative, Positive, RotationalDamping, RotationalStiffness, Torque
from fmd.scene.force_elements import AngleStop
from fmd.scene.joints.joint import Along, CarryingJoint, Mark, along_axis
from fmd.scene.values import Axis

REVOLUTE = JointKind("revolute", ("rad",), turns=(ElementaryMotion(AXIS),), points=SPACE, squares=ALIGNED)


class Revolute(CarryingJoint):
    """A hinge: the child turns about one axis of the parent.

    Parameters
    ----------
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

    kind = REVOLUTE
    title = "Revolute joint"
    mark = Mark("pin")
    closing_keys = ("child_axis",)

    type: Literal["revolute"]
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

    @property
    def along(self) -> tuple[Along, ...]:
        """Spring, damper, stops and friction along the axis."""
        return along_axis(self)

    def start(self, into_child: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return coordinates and rates at the start."""
        return [self.angle], [self.rate]

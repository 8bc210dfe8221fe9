"""A screw in a scene file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from fmd.core.arrays import Array
from fmd.core.joint_kinds import AXIS, ElementaryMotion, JointKind
from fmd.core.units import Angle, AngularRate, Length, NonNegative, Positive, Torque
from fmd.scene.force_elements import AngleStop, TurningDamping, TurningStiffness
from fmd.scene.joints.joint import Along, CarryingJoint, Mark, along_axis
from fmd.scene.values import Axis

SCREW = JointKind("screw", ("rad",), (ElementaryMotion(AXIS, by_lead=True),), (ElementaryMotion(AXIS),))


class Screw(CarryingJoint):
    """A screw: the child turns about an axis and moves along it in proportion.

    Parameters
    ----------
    axis : tuple of float
        Direction of the axis in the axes of the parent's marker or place; its length
        doesn't count.
    lead : float
        Displacement along the axis for a whole turn [m]; below 0 for a left-handed thread.
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

        [joint.spindle]
        type = "screw"
        parent = "ground"
        child = "nut.thread"
        axis = [0, 0, 1]
        lead = "5 mm"
        friction = "0.02 N m"
    """

    kind = SCREW
    title = "Screw joint"
    mark = Mark("pin")
    cannot_close = "can't close a loop; write it before the other joint that carries its child"

    type: Literal["screw"]
    axis: Axis
    lead: Length
    angle: Angle = 0.0
    rate: AngularRate = 0.0
    spring: TurningStiffness = 0.0
    rest: Angle = 0.0
    damper: TurningDamping = 0.0
    stop: AngleStop | None = None
    friction: Annotated[Torque, NonNegative] = 0.0
    friction_rate: Annotated[AngularRate, Positive] = 1e-2

    @property
    def along(self) -> tuple[Along, ...]:
        """Spring, damper, stops and friction along the axis."""
        return along_axis(self)

    @property
    def lead_per_angle(self) -> float:
        """Displacement along the axis for an angle [m/rad]."""
        return self.lead / (2 * math.pi)

    def start(self, into_child: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return coordinates and rates at the start."""
        return [self.angle], [self.rate]

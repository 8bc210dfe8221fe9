"""A slide that turns, in a scene file."""

from __future__ import annotations

from typing import Literal

from fmd.core.joint_kinds import ACROSS, ALIGNED, AXIS, ElementaryMotion, JointKind
from fmd.core.units import Angle, AngularRate, Length, Velocity
from fmd.scene.force_elements import Damping, Stiffness, TurningDamping, TurningStiffness
from fmd.scene.joints.joint import Along, CarryingJoint, Mark
from fmd.scene.values import Axis

CYLINDRICAL = JointKind(
    "cylindrical", ("m", "rad"), (ElementaryMotion(AXIS),), (ElementaryMotion(AXIS, 1),), points=ACROSS, squares=ALIGNED
)


class Cylindrical(CarryingJoint):
    """A slide that also lets the child turn about its axis.

    Parameters
    ----------
    axis : tuple of float
        Direction of the axis in the axes of the parent's marker or place; its length
        doesn't count.
    position : float
        Displacement of the child's marker from the parent's at the start [m].
    angle : float
        Angle at the start [rad].
    velocity : float
        Speed along the axis at the start [m/s].
    rate : float
        Angular rate at the start [rad/s].
    spring : float
        Stiffness of a spring along the axis [N/m].
    rest : float
        Displacement at which that spring is unstretched [m].
    damper : float
        Coefficient of a damper along the axis [N s/m].
    turning_spring : float
        Stiffness of a spring about the axis [N m/rad].
    rest_angle : float
        Angle at which that spring is unstretched [rad].
    turning_damper : float
        Coefficient of a damper about the axis [N m s/rad].

    Examples
    --------
    ::

        [joint.quill]
        type = "cylindrical"
        parent = "ground"
        child = "spindle.nose"
        axis = [0, 0, 1]
        spring = "12 N/mm"
        rate = "3000 rpm"
    """

    kind = CYLINDRICAL
    title = "Cylindrical joint"
    mark = Mark("pin", rail=True)
    start_keys = (("position", "angle"), ("velocity", "rate"))

    type: Literal["cylindrical"]
    axis: Axis
    position: Length = 0.0
    angle: Angle = 0.0
    velocity: Velocity = 0.0
    rate: AngularRate = 0.0
    spring: Stiffness = 0.0
    rest: Length = 0.0
    damper: Damping = 0.0
    turning_spring: TurningStiffness = 0.0
    rest_angle: Angle = 0.0
    turning_damper: TurningDamping = 0.0

    @property
    def along(self) -> tuple[Along, ...]:
        """Springs and dampers along the axis and about it."""
        turning = Along(self.turning_spring, self.rest_angle, self.turning_damper)
        return Along(self.spring, self.rest, self.damper), turning

"""A slide that turns, in a scene file."""

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

    Example:

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
    axis: Axis  # Direction of the axis in the axes of the parent's marker or place; its length doesn't count.
    position: Length = 0.0  # Displacement of the child's marker from the parent's at the start [m].
    angle: Angle = 0.0  # Angle at the start [rad].
    velocity: Velocity = 0.0  # Speed along the axis at the start [m/s].
    rate: AngularRate = 0.0  # Angular rate at the start [rad/s].
    spring: Stiffness = 0.0  # Stiffness of a spring along the axis [N/m].
    rest: Length = 0.0  # Displacement at which that spring is unstretched [m].
    damper: Damping = 0.0  # Coefficient of a damper along the axis [N s/m].
    turning_spring: TurningStiffness = 0.0  # Stiffness of a spring about the axis [N m/rad].
    rest_angle: Angle = 0.0  # Angle at which that spring is unstretched [rad].
    turning_damper: TurningDamping = 0.0  # Coefficient of a damper about the axis [N m s/rad].

    @property
    def along(self) -> tuple[Along, ...]:
        """Springs and dampers along the axis and about it."""
        turning = Along(self.turning_spring, self.rest_angle, self.turning_damper)
        return Along(self.spring, self.rest, self.damper), turning

"""A slide in a scene file."""

from typing import Annotated, Literal

from fmd.core.joint_kinds import ACROSS, AXIS, LOCKED, ElementaryMotion, JointKind
from fmd.core.units import Force, Length, NonNegative, Positive, TranslationalDamping, TranslationalStiffness, Velocity
from fmd.scene.force_elements import LengthStop
from fmd.scene.joints.joint import CarryingJoint, Mark
from fmd.scene.values import Axis

PRISMATIC = JointKind("prismatic", ("m",), slides=(ElementaryMotion(AXIS),), points=ACROSS, squares=LOCKED)


class Prismatic(CarryingJoint):
    """A slide: the child moves along one axis of the parent, without turning.

    Example:

        [joint.slide]
        type = "prismatic"
        parent = "rod.rest"
        child = "slider.centre"
        axis = [1, 0, 0]
        position = "0.15 m"
        spring = "1000 N/m"
    """

    kind = PRISMATIC
    title = "Prismatic joint"
    mark = Mark("box", (2.2, 2.2, 3.2), rail=True)
    closing_keys = ("child_axis",)
    start_keys = (("position",), ("rate",))

    type: Literal["prismatic"]
    axis: Axis  # Direction of the axis in the axes of the parent's marker or place; its length doesn't count.
    # The same direction in the axes of the child's marker or place, of a joint that closes a loop; the numbers of
    # ``axis`` by default, which are right if the child doesn't turn against the parent but about the axis.
    child_axis: Axis | None = None
    position: Length = 0.0  # Displacement of the child's marker from the parent's at the start [m].
    rate: Velocity = 0.0  # Speed at the start [m/s].
    spring: Annotated[TranslationalStiffness, NonNegative] = 0.0  # Stiffness of a spring along the axis [N/m].
    rest: Length = 0.0  # Displacement at which the spring is unstretched [m].
    damper: Annotated[TranslationalDamping, NonNegative] = 0.0  # Coefficient of a damper along the axis [N s/m].
    stop: LengthStop | None = None  # End stops.
    friction: Annotated[Force, NonNegative] = 0.0  # Largest friction along the axis [N].
    friction_rate: Annotated[Velocity, Positive] = 1e-3  # Speed at which friction has reached 71 % of that [m/s].

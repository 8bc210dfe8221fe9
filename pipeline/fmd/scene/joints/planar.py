"""A plane on a plane in a scene file."""

from typing import Literal

from fmd.core.joint_kinds import ACROSS, ALIGNED, AXIS, ElementaryMotion, JointKind
from fmd.core.units import Angle, AngularRate, Length, Velocity
from fmd.scene.joints.joint import CarryingJoint, Mark
from fmd.scene.values import Axis

PLANAR = JointKind(
    "planar",
    ("m", "m", "rad"),
    tuple(ElementaryMotion(way, k) for k, way in enumerate(ACROSS)),
    (ElementaryMotion(AXIS, 2),),
    points=(AXIS,),
    squares=ALIGNED,
)


class Planar(CarryingJoint):
    """A plane on a plane: the child slides in two directions and turns about their normal.

    Example:

        [joint.table]
        type = "planar"
        parent = "ground"
        child = "puck.middle"
        axis = [0, 0, 1]
        velocity = ["1 m/s", "0 m/s"]
        rate = "10 rad/s"
    """

    kind = PLANAR
    title = "Planar joint"
    mark = Mark("box", (3.2, 3.2, 1.0), stands=False)
    measured_across = True
    start_keys = (("position", "angle"), ("velocity", "rate"))

    type: Literal["planar"]
    axis: Axis  # Direction of the normal in the axes of the parent's marker or place; its length doesn't count.
    # Displacements of the child's marker from the parent's at the start [m]: along that of x, y and z that is most
    # across the normal, turned into the plane, and along the normal's cross product with it. They are x and y for the
    # normal z, and y and z for x.
    position: tuple[Length, Length] = (0.0, 0.0)
    angle: Angle = 0.0  # Angle at the start [rad].
    velocity: tuple[Velocity, Velocity] = (0.0, 0.0)  # Rates of both displacements at the start [m/s].
    rate: AngularRate = 0.0  # Angular rate at the start [rad/s].

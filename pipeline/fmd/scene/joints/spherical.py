"""A ball joint in a scene file."""

from typing import Literal

from fmd.core.joint_kinds import SPACE, JointKind
from fmd.scene.joints.joint import CarryingJoint, Mark
from fmd.scene.values import Spin

SPHERICAL = JointKind("spherical", turns_in_space=True, points=SPACE)


class Spherical(CarryingJoint):
    """A ball joint: the child's marker stays on the parent's and turns freely.

    Example:

        [joint.ball]
        type = "spherical"
        parent = "ground"
        child = "top.foot"
        spin = ["0 rad/s", "0 rad/s", "100 rad/s"]
    """

    kind = SPHERICAL
    title = "Spherical joint"
    mark = Mark("ball")
    start_keys = ((), ("spin",))

    type: Literal["spherical"]
    spin: Spin = (0.0, 0.0, 0.0)  # Angular velocity against the parent at the start, along the child's axes [rad/s].

"""A hinge in a scene file."""

from typing import Literal

from fmd.core.joint_kinds import ALIGNED, AXIS, SPACE, ElementaryMotion, JointKind
from fmd.scene.joints.joint import Mark, OneAngleJoint
from fmd.scene.values import Axis

REVOLUTE = JointKind("revolute", ("rad",), turns=(ElementaryMotion(AXIS),), points=SPACE, squares=ALIGNED)


class Revolute(OneAngleJoint):
    """A hinge: the child turns about one axis of the parent.

    Example:

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
    # The same direction in the axes of the child's marker or place, of a joint that closes a loop; the numbers of
    # ``axis`` by default, which are right if the child doesn't turn against the parent but about the axis.
    child_axis: Axis | None = None

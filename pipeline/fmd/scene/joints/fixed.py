"""A weld in a scene file."""

from typing import Literal

from fmd.core.joint_kinds import LOCKED, SPACE, JointKind
from fmd.scene.joints.joint import CarryingJoint

FIXED = JointKind("fixed", points=SPACE, squares=LOCKED)


class Fixed(CarryingJoint):
    """A weld: the child's marker stays on the parent's, in the joint's axes.

    Example:

        [joint.flange]
        type = "fixed"
        parent = "ground"
        child = "plate.rim"
    """

    kind = FIXED
    title = "Fixed joint"

    type: Literal["fixed"]

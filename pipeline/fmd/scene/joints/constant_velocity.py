"""A constant-velocity joint of drive shafts in a scene file.

It turns the child by half of one angle, by the other angle across, and by the half of the first again. The quaternion
of these turns reads the same from either end, which leaves it no part about the shaft: whatever the tilt, both shafts
turn by the same angle. Two Cardan joints that share a tilt evenly do the same.
"""

from typing import Literal

from fmd.core.joint_kinds import ACROSS, SPACE, ElementaryMotion, JointKind
from fmd.scene.joints.joint import Mark, TwoAngleJoint
from fmd.scene.values import Axis

_HALF = ElementaryMotion(ACROSS[0], factor=0.5)

CONSTANT_VELOCITY = JointKind(
    "constant-velocity",
    ("rad", "rad"),
    turns=(_HALF, ElementaryMotion(ACROSS[1], 1), _HALF),
    points=SPACE,
    squares=((ACROSS, (ACROSS[1], f"-{ACROSS[0]}")),),
)


class ConstantVelocity(TwoAngleJoint):
    """A constant-velocity joint: two shafts meet at a point, tilt, and turn equally fast at any tilt.

    The angles tilt about that of x, y and z that is most across the axis, turned across it, and about the axis's cross
    product with it. They are about x and y for a shaft along z, and about y and z for one along x.

    Example:

        [joint.outboard]
        type = "constant-velocity"
        parent = "shaft.end"
        child = "wheel.hub"
        axis = [1, 0, 0]
        angles = ["0 deg", "20 deg"]
    """

    kind = CONSTANT_VELOCITY
    title = "Constant-velocity joint"
    mark = Mark("ball")
    closing_keys = ("child_axis",)
    measured_across = True

    type: Literal["constant-velocity"]
    # Direction of the parent's shaft in the axes of its marker or place, and of the child's at angles 0; its length
    # doesn't count.
    axis: Axis
    # Direction of the child's shaft in the axes of its marker or place, of a joint that closes a loop; the numbers of
    # ``axis`` by default.
    child_axis: Axis | None = None

"""A universal (Cardan) joint in a scene file."""

import math
from typing import Literal

from fmd.core.joint_kinds import AXIS, OTHER, SPACE, ElementaryMotion, JointKind
from fmd.core.limits.round_off import SOLVED
from fmd.scene.joints.joint import Mark, TwoAngleJoint
from fmd.scene.reading import FaultError
from fmd.scene.values import Axis

UNIVERSAL = JointKind(
    "universal",
    ("rad",) * 2,
    turns=(ElementaryMotion(AXIS), ElementaryMotion(OTHER, 1)),
    points=SPACE,
    squares=(((AXIS, AXIS),),),
)


class Universal(TwoAngleJoint):
    """A universal (Cardan) joint: the child turns about an axis of the parent and about one of its own, across it.

    The angles are those about both axes.

    Example:

        [joint.cardan]
        type = "universal"
        parent = "shaft.end"
        child = "output.start"
        axis = [0, 1, 0]
        child_axis = [0, 0, 1]
    """

    kind = UNIVERSAL
    title = "Universal joint"
    mark = Mark("ball")

    type: Literal["universal"]
    axis: Axis  # Direction of the parent's axis, in the axes of its marker or place; its length doesn't count.
    child_axis: Axis  # Direction of the child's axis, in the axes of its marker; perpendicular to ``axis`` at angles 0.

    def _check(self) -> None:
        sizes = math.hypot(*self.axis) * math.hypot(*self.child_axis)
        if abs(sum(a * b for a, b in zip(self.axis, self.child_axis, strict=True))) > SOLVED * sizes:
            raise FaultError("must be perpendicular to axis", "child_axis")

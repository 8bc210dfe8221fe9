"""A pin in a slot in a scene file."""

from typing import Literal

from fmd.core.joint_kinds import ACROSS, JointKind
from fmd.scene.joints.joint import JointTable, Mark
from fmd.scene.values import Axis, PlaceName

POINT_ON_LINE = JointKind("point-on-line", points=ACROSS)


class PointOnLine(JointTable):
    """A pin in a slot: the child's place stays on a line of the parent, free to turn.

    Example:

        [joint.slot]
        type = "point-on-line"
        parent = "ground"
        child = "rod.end"
        axis = [1, 0, 0]
    """

    kind = POINT_ON_LINE
    title = "Point on a line"
    mark = Mark("ball")
    carries = False

    type: Literal["point-on-line"]
    parent: PlaceName  # Marker or place on the ground that the line goes through.
    child: PlaceName  # Marker or place that stays on it.
    axis: Axis  # Direction of the line in the axes of the parent's marker or place; its length doesn't count.

"""A pin in a slot in a scene file."""

from __future__ import annotations

from typing import Literal

from fmd.core.joint_kinds import ACROSS, JointKind
from fmd.scene.joints.joint import JointTable, Mark
from fmd.scene.values import Axis, PlaceName

POINT_ON_LINE = JointKind("point-on-line", points=ACROSS)


class PointOnLine(JointTable):
    """A pin in a slot: the child's place stays on a line of the parent, free to turn.

    Parameters
    ----------
    parent : str
        Marker or place on the ground that the line goes through.
    child : str
        Marker or place that stays on it.
    axis : tuple of float
        Direction of the line in the axes of the parent's marker or place; its length doesn't count.

    Examples
    --------
    ::

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
    parent: PlaceName
    child: PlaceName
    axis: Axis

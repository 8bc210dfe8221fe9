"""A screw in a scene file."""

import math
from typing import Literal

from fmd.core.joint_kinds import AXIS, ElementaryMotion, JointKind
from fmd.core.units import Length
from fmd.scene.joints.joint import Mark, OneAngleJoint

SCREW = JointKind("screw", ("rad",), (ElementaryMotion(AXIS, by_lead=True),), (ElementaryMotion(AXIS),))


class Screw(OneAngleJoint):
    """A screw: the child turns about an axis and moves along it in proportion.

    Example:

        [joint.spindle]
        type = "screw"
        parent = "ground"
        child = "nut.thread"
        axis = [0, 0, 1]
        lead = "5 mm"
        friction = "0.02 N m"
    """

    kind = SCREW
    title = "Screw joint"
    mark = Mark("pin")
    cannot_close = "can't close a loop; write it before the other joint that carries its child"

    type: Literal["screw"]
    lead: Length  # Displacement along the axis for a whole turn [m]; below 0 for a left-handed thread.

    @property
    def lead_per_angle(self) -> float:
        """Displacement along the axis for an angle [m/rad]."""
        return self.lead / (2 * math.pi)

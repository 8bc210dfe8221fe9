"""A kept distance in a scene file."""

from typing import Literal

from fmd.core.joint_kinds import JointKind
from fmd.core.units import PositiveLength
from fmd.scene.joints.joint import JointTable, Mark
from fmd.scene.values import PlaceName

DISTANCE = JointKind("distance")


class Distance(JointTable):
    """A massless rod: two places of bodies that hang on other joints keep their distance.

    Example:

        [joint.tie]
        type = "distance"
        parent = "ground.eye"
        child = "arm.tip"
        length = "0.4 m"
    """

    kind = DISTANCE
    title = "Distance"
    mark = Mark("line")
    carries = False

    type: Literal["distance"]
    # Markers or places on the ground.
    parent: PlaceName
    child: PlaceName
    length: PositiveLength  # Their distance [m].

    @property
    def kept_distance(self) -> float:
        """Distance that the joint keeps between its places [m]."""
        return self.length

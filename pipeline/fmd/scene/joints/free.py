"""A joint that holds nothing in a scene file."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from fmd.core.arrays import Array
from fmd.core.joint_kinds import SPACE, ElementaryMotion, JointKind
from fmd.core.rotations import quaternion_of_matrix
from fmd.core.units import Velocity
from fmd.scene.joints.joint import CarryingJoint, Mark
from fmd.scene.values import Point, Spin

FREE = JointKind(
    "free", ("m",) * 3, tuple(ElementaryMotion(way, k) for k, way in enumerate(SPACE)), turns_in_space=True
)


class Free(CarryingJoint):
    """No constraint: the child moves and turns freely against the parent, from the position and axes of the start.

    Example:

        [joint.flight]
        type = "free"
        parent = "ground"
        child = "box.corner"
        position = ["0 m", "0 m", "1.5 m"]
        rotate = ["0 deg", "30 deg", "0 deg"]
        velocity = ["1 m/s", "0 m/s", "2 m/s"]
    """

    kind = FREE
    title = "Free joint"
    mark = Mark(stands=False)
    starts_turned = True
    cannot_close = "holds nothing: the child hangs on another joint already"

    type: Literal["free"]
    # Displacement of the child's marker from the parent's at the start, in the axes of the parent's [m].
    position: Point = (0.0, 0.0, 0.0)
    # Velocity of the child's marker against the parent at the start, in the same axes [m/s].
    velocity: tuple[Velocity, Velocity, Velocity] = (0.0, 0.0, 0.0)
    spin: Spin = (0.0, 0.0, 0.0)  # Angular velocity against the parent at the start, along the child's axes [rad/s].

    def start(self, into_child: Array) -> tuple[Sequence[float], Sequence[float]]:
        """Return displacement and quaternion at the start, and their rates, in the axes of the child's body."""
        turn = into_child @ self.matrix @ into_child.T
        position, velocity = into_child @ np.array(self.position), into_child @ np.array(self.velocity)
        return [*position, *quaternion_of_matrix(turn[None])[0]], [*velocity, *self.spin]

"""How a flexible body hangs on the joint that carries it, as a scene tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pipeline.scene.scene import Scene


@dataclass(frozen=True)
class Inboard:
    """How a body hangs on its joint.

    Attributes
    ----------
    marker : str
        The body's marker at the joint.
    axis : tuple of float
        Normal of the plane of motion: the hinge's axis, or that of the other hinges.
    free : tuple
        Directions (k, 3) about which the joint lets the body turn by itself: its frame floats about them.
    floating : bool
        Whether the joint holds nothing at all.
    prescribed : bool
        Whether its motion is given.
    planar : bool
        Whether every joint of the scene keeps to the plane across ``axis``.
    normal : int
        Number of the coordinate axis that it turns about in space, on a hinge to the ground, and no other; else -1.
    """

    marker: str
    axis: tuple[float, float, float]
    free: tuple[tuple[float, float, float], ...]
    floating: bool
    prescribed: bool
    planar: bool
    normal: int = -1


def inboard_of(scene: Scene, body: str) -> Inboard:
    """Read from a scene how a body hangs on the joint that carries it."""
    carried = [(n, j) for n, j in scene.joint.items() if j.child.partition(".")[0] == body]
    if not carried:  # a scene of parts alone
        return Inboard("", (0.0, 0.0, 1.0), (), floating=True, prescribed=False, planar=False)
    name, joint = carried[0]
    prescribed = any(drive.type == "motion" and drive.joint == name for drive in scene.drive.values())
    hinges = [j.axis for j in scene.joint.values() if j.type == "revolute"]
    axis = joint.axis if joint.type == "revolute" else (hinges[0] if hinges else (0.0, 0.0, 1.0))
    in_plane = [not np.any(np.cross(axis, hinge)) for hinge in hinges]
    in_plane += [j.type not in ("spherical", "free") for j in scene.joint.values()]
    in_plane += [not np.dot(axis, j.axis) for j in scene.joint.values() if j.type == "prismatic"]
    free: tuple[tuple[float, float, float], ...] = ()
    if joint.type == "revolute" and not prescribed:
        free = (axis,)
    elif joint.type == "spherical":
        free = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    fixed = joint.type == "revolute" and joint.parent.partition(".")[0] == "ground" and np.count_nonzero(axis) == 1
    normal = int(np.argmax(np.abs(axis))) if fixed else -1
    return Inboard(joint.child.partition(".")[2], axis, free, joint.type == "free", prescribed, all(in_plane), normal)

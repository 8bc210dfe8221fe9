"""Axes of places, markers and joints of a scene, and those that bodies have in space before anything turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.round_off import EXACT
from fmd.scene.joints.any_joint import Joint
from fmd.scene.joints.joint import CarryingJoint
from fmd.scene.scene import Scene


@dataclass(frozen=True)
class JointAxes:
    """Axes of a joint that carries a body.

    Attributes
    ----------
    in_parent : ndarray, shape (3, 3)
        Rotation from the joint's axes into those of the parent's body, or into space.
    in_child : ndarray, shape (3, 3)
        Rotation from the joint's axes, with its coordinates at 0, into those of the child's body.
    """

    in_parent: Array
    in_child: Array

    @property
    def of_child(self) -> Array:
        """Rotation (3, 3) from the child's body axes into those of the parent's, with the coordinates at 0."""
        return np.asarray(self.in_parent @ self.in_child.T)

    def axis_in_child(self, direction: tuple[float, float, float] | Array) -> Array:
        """Return a direction (3,) of the joint in the child's body axes, without round-off where it is along them."""
        axis = self.in_child @ np.array(direction, dtype=float)
        return np.asarray(np.where(np.abs(axis) > EXACT * np.linalg.norm(axis), axis, 0.0))


def ground_place(scene: Scene, place: str) -> tuple[Array, Array]:
    """Return the position and the axes of ``"ground"`` or of a place on it.

    Returns
    -------
    tuple of ndarray, shapes (3,) and (3, 3)
        Position in space [m], and the rotation from the place's axes into those of space.
    """
    name = place.partition(".")[2]
    if not name:
        return np.zeros(3), np.eye(3)
    return np.array(scene.ground[name].at), scene.ground[name].matrix


def place_axes(scene: Scene, place: str) -> Array:
    """Return the rotation (3, 3) from the axes of a marker or a place into those of its body, or into space."""
    body, _, name = place.partition(".")
    return ground_place(scene, place)[1] if body == "ground" else scene.body[body].marker[name].matrix


def joint_axes(scene: Scene, joint: Joint) -> JointAxes:
    """Return the axes of a joint; those of one whose own turn is its start are its parent's."""
    in_parent = place_axes(scene, joint.parent)
    if isinstance(joint, CarryingJoint) and not joint.starts_turned:
        in_parent = in_parent @ joint.matrix
    return JointAxes(in_parent, place_axes(scene, joint.child))


def axes_in_space(scene: Scene, body: str) -> Array:
    """Return the rotation (3, 3) from a body's axes into space with all joints at 0."""
    carrying, axes = scene.carrying, np.eye(3)
    while body in carrying:
        joint = scene.joint[carrying[body]]
        axes = joint_axes(scene, joint).of_child @ axes
        body = joint.parent.partition(".")[0]
    return axes

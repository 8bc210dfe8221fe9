"""Places on the ground, and the axes that bodies have in space before anything turns."""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.rotations import rotation_matrix
from pipeline.scene.scene import Scene

_ROUND_OFF = 1e-15


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
    given = scene.ground[name]
    axes = rotation_matrix(np.array([given.rotation]))[0]
    whole = np.rint(axes) + 0.0  # 90° has zeros and ones
    return np.array(given.at), np.where(np.abs(axes - whole) <= _ROUND_OFF, whole, axes)


def axes_in_space(scene: Scene, body: str) -> Array:
    """Return the rotation (3, 3) from a body's axes into space with all joints at 0: that of the place it hangs on."""
    parents = {child: scene.joint[name].parent for child, name in scene.carrying.items()}
    while body in parents:
        place = parents[body]
        body = place.partition(".")[0]
        if body == "ground":
            return ground_place(scene, place)[1]
    return np.eye(3)

"""Axes of markers, places and joints in a scene file: turned by a rotation vector, or given by their directions."""

import math

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.round_off import EXACT
from fmd.core.limits.scene import SQUARE
from fmd.core.rotations import rotation_by
from fmd.scene.reading import FaultError, SceneTable
from fmd.scene.values import Axis, Turn


class AxisDirections(SceneTable):
    """Directions of two of three axes; the third completes a right-handed system.

    Example:

        [body.arm.marker.wrist.axes]
        x = [0.6, 0.8, 0]
        z = [0, 0, 1]
    """

    # Directions of two axes, perpendicular to each other; their lengths don't count.
    x: Axis | None = None
    y: Axis | None = None
    z: Axis | None = None

    @property
    def given(self) -> dict[str, tuple[float, float, float]]:
        """Directions of the two axes by their names, as unit vectors; the first is exact, the second nearly across."""
        found = {name: axis for name in "xyz" if (axis := getattr(self, name)) is not None}
        return {
            name: (x / size, y / size, z / size) for name, (x, y, z) in found.items() for size in [math.hypot(x, y, z)]
        }

    def _check(self) -> None:
        given = self.given
        if len(given) != 2:
            missing = next((name for name in "xyz" if name not in given), "z")
            message = "is missing: directions of two axes are wanted, the third follows from them"
            raise FaultError(message if len(given) < 2 else "is one too many: two axes tell the third", missing)
        (_, first), (name, second) = given.items()
        if abs(cosine := sum(a * b for a, b in zip(first, second, strict=True))) > SQUARE:
            angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
            raise FaultError(f"must be perpendicular to the other axis; the angle is {angle:.4g}°", name)


class Orientation(SceneTable):
    """Axes of a marker, of a place or of a joint, against those that it would have else."""

    rotate: Turn = (0.0, 0.0, 0.0)  # Rotation vector: the axes are turned about this vector by its length [rad].
    axes: AxisDirections | None = None  # Directions of the axes, in place of ``rotate``.

    def _check(self) -> None:
        if self.axes is not None and any(self.rotate):
            raise FaultError("can't stand beside rotate: give one of the two", "axes")

    @property
    def is_turned(self) -> bool:
        """True if there are axes other than those without these keys."""
        return self.axes is not None or any(self.rotate)

    @property
    def matrix(self) -> Array:
        """Rotation from these axes into those that there would be without these keys, shape (3, 3)."""
        if not self.is_turned:
            return np.eye(3)
        if self.axes is None:
            axes = rotation_by(self.rotate)
            whole = np.rint(axes) + 0.0  # 90° has zeros and ones
            return np.asarray(np.where(np.abs(axes - whole) <= EXACT, whole, axes))
        (name, first), (other, near) = ((name, np.array(axis)) for name, axis in self.axes.given.items())
        across = near - (near @ first) * first
        columns = {name: first, other: across / np.linalg.norm(across)}
        for third, before, after in (("x", "y", "z"), ("y", "z", "x"), ("z", "x", "y")):
            if third not in columns:
                columns[third] = np.cross(columns[before], columns[after])
        return np.stack([columns[axis] for axis in "xyz"], axis=1) + 0.0

"""Places on the ground in a scene file: where joints and force elements hold on to what stands still."""

from __future__ import annotations

from pipeline.scene.reading import SceneTable
from pipeline.scene.values import Point, Turn


class GroundPlace(SceneTable):
    """A named place on the ground, which stands still; joints hang on it as on a marker, ``"ground.NAME"``.

    Parameters
    ----------
    at : tuple of float
        Position in space [m].
    rotation : tuple of float
        Rotation vector of the place's axes: they are those of space, turned about this vector by its length [rad]. A
        joint's axis, and the body that it carries, are in the place's axes.

    Examples
    --------
    ::

        [ground.bearing]
        at = ["1 m", "0 m", "0 m"]
        rotation = ["0 deg", "0 deg", "90 deg"]
    """

    at: Point
    rotation: Turn = (0.0, 0.0, 0.0)

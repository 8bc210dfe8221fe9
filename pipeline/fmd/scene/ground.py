"""Places on the ground in a scene file: where joints and force elements hold on to what stands still."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from fmd.scene.orientation import Orientation
from fmd.scene.reading import FaultError
from fmd.scene.values import Point, Turn


class GroundPlace(Orientation):
    """A named place on the ground, which stands still; joints hang on it as on a marker, ``"ground.NAME"``.

    Its axes are those of space, or turned against them; a joint's axis, and the body that it carries, are in them.

    Parameters
    ----------
    at : tuple of float
        Position in space [m].
    rotation : tuple of float, optional
        Older name of ``rotate`` [rad].

    Examples
    --------
    ::

        [ground.bearing]
        at = ["1 m", "0 m", "0 m"]
        rotate = ["0 deg", "0 deg", "90 deg"]
    """

    at: Point
    rotation: Turn | None = None

    @model_validator(mode="after")
    def _read_the_older_name(self) -> Self:
        if self.rotation is None:
            return self
        if self.is_turned:
            raise FaultError("can't stand beside rotate or axes: give one of them", "rotation")
        return self.model_copy(update={"rotate": self.rotation, "rotation": None})

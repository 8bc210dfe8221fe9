"""A picture's camera, as drawing functions take it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.errors import InputError
from fmd.render.camera import PIXELS, Camera

if TYPE_CHECKING:
    from fmd.scene.pictures import PictureSettings
    from fmd.stages.pipeline import Pipeline


def camera_of(run: Pipeline, output: PictureSettings, size: tuple[int, int] | None = None) -> Camera:
    """Return a picture's camera, of ``size`` unless the scene gives one; by default of a still picture's."""
    angles = None if output.camera is None else (np.degrees(output.camera[0]), np.degrees(output.camera[1]))
    settings: dict[str, Any] = {"focus": output.focus, "extent": output.extent, "zoom": output.zoom}
    try:
        return Camera(angles=angles, size=output.size or size or PIXELS, colour_map=output.colour_map, **settings)
    except ValueError as error:
        raise InputError(run.scene.file, "output", output.colour_map, str(error)) from error

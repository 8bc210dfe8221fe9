"""The camera of a picture: its direction, its distance, the size of the picture and its colour map."""

import math

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.render.colours import LIGHT_TURBO, require_colour_map
from fmd.render.projection import (
    PART,
    TILT,
    Place,
    Projection,
    fit_projection,
    frame_projection,
    oblique_axes,
    upright_axes,
)

PIXELS = (1600, 900)
SHEET_PIXELS = (1800, 1200)
FILM_PIXELS = (1280, 720)


@dataclass(frozen=True, slots=True)
class Camera:
    """Direction, section, size and colours of a picture.

    Raises
    ------
    ValueError
        A value is out of range, or there is no such colour map; the message lists similar names.
    """

    # Azimuth of the camera about z, counted from x, and its elevation above the plane of x and y [degrees]. By default
    # it looks obliquely at the plane of the part's longest two extents.
    angles: tuple[float, float] | None = None
    zoom: float = 1.0  # factor on the part's size in the picture
    size: tuple[int, int] = PIXELS  # width and height [pixels]
    colour_map: str = LIGHT_TURBO  # map for scalar fields: ``light turbo``, or a name in Matplotlib
    focus: tuple[float, float, float] | None = None  # point in the middle of a close-up, shape (3,) [m]
    extent: float | None = None  # length over the picture's width [m]

    def __post_init__(self) -> None:
        if self.angles is not None and not (math.isfinite(self.angles[0]) and -90 <= self.angles[1] <= 90):
            raise ValueError(f"camera = {self.angles}: expected an azimuth and an elevation from -90 to 90 degrees")
        if not 0 < self.zoom < math.inf:
            raise ValueError(f"zoom = {self.zoom} must be positive")
        if min(self.size) < 1:
            raise ValueError(f"size = {self.size}: width and height must be positive")
        if self.focus is not None and not (np.shape(self.focus) == (3,) and np.all(np.isfinite(self.focus))):
            raise ValueError(f"focus = {self.focus}: expected three coordinates")
        if self.extent is not None and not 0 < self.extent < math.inf:
            raise ValueError(f"extent = {self.extent} must be positive")
        require_colour_map(self.colour_map)

    @property
    def is_close_up(self) -> bool:
        """True if the part may reach beyond its place in the picture."""
        return self.zoom > 1 or self.focus is not None or self.extent is not None

    def candidate_axes(self, points: Array, tilt: tuple[float, float] = TILT, up: Array | None = None) -> list[Array]:
        """Return the camera axes (3, 3) to choose from, the best first, for points (n, 3) [m].

        Without angles, ``up`` (3,) points upwards in the picture.
        """
        if self.angles is None:
            return list(oblique_axes(points, tilt) if up is None else upright_axes(points, up, tilt))
        azimuth, elevation = np.radians(self.angles)
        towards = np.array(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        )
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        return [np.array([right, np.cross(towards, right), towards])]

    def projection(self, axes: Array, points: Array, place: Place = PART) -> Projection:
        """Project points (n, 3) [m] along the last of ``axes`` so that they, or the close-up, fill a place."""
        projection = fit_projection(axes, points, self.size, place)
        if not self.is_close_up and self.zoom == 1:
            return projection
        scale = (projection.metres_per_pixel if self.extent is None else self.extent / self.size[0]) / self.zoom
        flat = points @ axes.T
        target = (flat.min(axis=0) + flat.max(axis=0)) / 2 @ axes if self.focus is None else np.array(self.focus)
        return frame_projection(axes, target, scale, self.size, place, points)

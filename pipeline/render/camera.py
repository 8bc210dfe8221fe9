"""How a picture is taken: from where, how large, in which colours."""

from __future__ import annotations

import math
from dataclasses import dataclass
from difflib import get_close_matches

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from pipeline.core.arrays import Array
from pipeline.render.projection import PART, TILT, Place, View, fitted_view, framed_view, oblique_axes

PIXELS = (1600, 900)


@dataclass(frozen=True, slots=True)
class Look:
    """How a picture is taken.

    Attributes
    ----------
    camera : tuple of float, optional
        Where the viewer stands [degrees]: azimuth about z, counted from x, and elevation above the plane of x and y.
        Without, oblique to the plane of the part's longest two extents.
    zoom : float
        Factor on the part's size in the picture.
    size : tuple of int
        Width and height [pixels].
    colour_map : str
        A name of Matplotlib's, for whatever is coloured by a quantity.
    focus : tuple of float, optional
        The point in the middle of a close-up, shape (3,) [m].
    extent : float, optional
        Length that the picture's width shows [m].

    Raises
    ------
    ValueError
        A value is of no use, or there is no such colour map; similar names are told.
    """

    camera: tuple[float, float] | None = None
    zoom: float = 1.0
    size: tuple[int, int] = PIXELS
    colour_map: str = "turbo"
    focus: tuple[float, float, float] | None = None
    extent: float | None = None

    def __post_init__(self) -> None:
        if self.camera is not None and not (math.isfinite(self.camera[0]) and -90 <= self.camera[1] <= 90):
            raise ValueError(f"camera = {self.camera}: expected an azimuth and an elevation from -90 to 90 degrees")
        if not 0 < self.zoom < math.inf:
            raise ValueError(f"zoom = {self.zoom} must be positive")
        if min(self.size) < 1:
            raise ValueError(f"size = {self.size}: width and height must be positive")
        if self.focus is not None and not (np.shape(self.focus) == (3,) and np.all(np.isfinite(self.focus))):
            raise ValueError(f"focus = {self.focus}: expected three coordinates")
        if self.extent is not None and not 0 < self.extent < math.inf:
            raise ValueError(f"extent = {self.extent} must be positive")
        if self.colour_map not in colormaps:
            near = get_close_matches(self.colour_map, list(colormaps), n=4, cutoff=0.5)
            hint = f"did you mean {', '.join(near)}?" if near else "e.g. turbo, viridis, cividis, coolwarm"
            raise ValueError(f"there is no colour map {self.colour_map!r}; {hint}")

    @property
    def is_close_up(self) -> bool:
        """Whether the part may reach beyond its place in the picture."""
        return self.zoom > 1 or self.focus is not None or self.extent is not None

    def colours(self, n: int) -> NDArray[np.uint8]:
        """Return n colours of the map from its lower to its upper end, shape (n, 3), 0 … 255."""
        return np.asarray(colormaps[self.colour_map](np.linspace(0, 1, n), bytes=True)[:, :3])

    def directions(self, points: Array, tilt: tuple[float, float] = TILT) -> list[Array]:
        """Return the camera axes (3, 3) to choose from, the best first, for points (n, 3) [m]."""
        if self.camera is None:
            return list(oblique_axes(points, tilt))
        azimuth, elevation = np.radians(self.camera)
        towards = np.array(
            [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
        )
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        return [np.array([right, np.cross(towards, right), towards])]

    def view(self, axes: Array, points: Array, place: Place = PART) -> View:
        """Look along the last of ``axes`` at points (n, 3) [m], or at a close-up of them, in a place of the picture."""
        view = fitted_view(axes, points, self.size, place)
        if not self.is_close_up and self.zoom == 1:
            return view
        scale = (view.metres_per_pixel if self.extent is None else self.extent / self.size[0]) / self.zoom
        flat = points @ axes.T
        target = (flat.min(axis=0) + flat.max(axis=0)) / 2 @ axes if self.focus is None else np.array(self.focus)
        return framed_view(axes, target, scale, self.size, place, points)

"""From where a part is looked at: the camera's directions, what it sees, and where points are in the picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from pipeline.checks import Array, IntArray

# Places in the picture are fractions of it: left, right, bottom, top.
Place = tuple[float, float, float, float]
PART = (0.04, 0.96, 0.24, 0.84)
TILT = (24.0, 22.0)  # of the camera [degrees], about the upright axis and about the horizontal one
SLENDER = 0.4  # second extent over longest
SAME_EXTENT = 1.3  # extents that differ by less than this factor count as equal


@dataclass(frozen=True, slots=True)
class View:
    """A parallel projection onto a picture.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Unit vectors as rows: to the right, up, and towards the viewer.
    centre : ndarray, shape (3,)
        The point in the middle of the picture [m].
    metres_per_pixel : float
        Length that a pixel shows.
    size : tuple of int
        Width and height in pixels.
    """

    axes: Array
    centre: Array
    metres_per_pixel: float
    size: tuple[int, int]

    def pixels(self, points: Array) -> Array:
        """Place points (n, 3) [m] in the picture: columns from the left, rows from the top, shape (n, 2)."""
        flat = (points - self.centre) @ self.axes[:2].T / self.metres_per_pixel
        return np.asarray(np.array(self.size) / 2 + flat * (1, -1))

    def lifted(self, points: Array) -> Array:
        """Move points (n, 3) [m] a little towards the viewer, so that lines lie over faces."""
        lift: Array = 3 * self.metres_per_pixel * self.axes[2]
        return points + lift


def fitted_view(axes: Array, points: Array, size: tuple[int, int], place: Place = PART) -> View:
    """Look along the last of ``axes`` so that ``points`` (n, 3) [m] fill a place in the picture."""
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    left, right, bottom, top = place
    room = np.array([(right - left) * size[0], (top - bottom) * size[1]])
    scale = float(np.max((high - low)[:2] / room)) or 1.0
    aside = np.array([(left + right - 1) * size[0], (bottom + top - 1) * size[1], 0.0]) / 2 * scale
    return View(axes, ((low + high) / 2 - aside) @ axes, scale, size)


def oblique_axes(points: Array, tilt: tuple[float, float] = TILT) -> Iterator[Array]:
    """Yield camera axes (3, 3), the best first, all oblique to the plane of the longest two extents."""
    extents = np.ptp(points, axis=0)
    steps = np.log(np.maximum(extents / extents.max(), 1e-9)) / np.log(SAME_EXTENT)
    slender = np.sort(extents)[1] < SLENDER * extents.max()
    right, up, _ = np.eye(3)[np.argsort(-np.round(steps), kind="stable")]
    if np.cross(right, up)[2] < 0:  # planar motion is looked at from above: turning left stays turning left
        up = -up
    front = np.array([right, up, np.cross(right, up)])
    for back, rise, turn in product((1, -1), (1, -1), (1, -1)):
        about_up, about_right = np.radians(tilt) * (turn, rise)
        c, s = np.cos(about_up), np.sin(about_up)
        aside = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        c, s = np.cos(about_right), np.sin(about_right)
        above = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        # A slender part lies level, any other stands upright.
        turned = aside @ above if slender else above @ aside
        yield turned @ (front * [[back], [1], [back]])


def is_seen(view_axes: Array, points: Array, triangles: IntArray, number: int) -> bool:
    """Tell whether no triangle lies between a point and the viewer."""
    seen = points @ view_axes.T - view_axes @ points[number]
    a, b, c = np.moveaxis(seen[triangles[np.all(triangles != number, axis=1)]], 1, 0)

    def doubled_area(p: Array, q: Array) -> Array:
        return np.asarray(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])

    weights = np.stack([doubled_area(b, c), doubled_area(c, a), doubled_area(a, b)], axis=1)
    over = np.all(weights >= 0, axis=1) | np.all(weights <= 0, axis=1)
    depth = np.einsum("tk,tk->t", weights, np.stack([a, b, c], axis=1)[:, :, 2])
    return not np.any(over & (depth * weights.sum(axis=1) > 0))


def view_of_hottest(candidates: list[Array], points: Array, triangles: IntArray, stress: Array) -> tuple[Array, int]:
    """Choose the first camera that sees a point as hot as the hottest, to a thousandth, and that point."""
    hot = np.flatnonzero(stress >= (1 - 1e-3) * stress.max())
    for axes, number in product(candidates, hot.tolist()):
        if is_seen(axes, points, triangles, number):
            return axes, number
    return candidates[0], int(np.argmax(stress))

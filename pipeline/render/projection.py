"""From where a part is looked at: the camera's directions, what it sees, and where points are in the picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from pipeline.core.arrays import Array, IntArray

# Places in the picture are fractions of it: left, right, bottom, top.
Place = tuple[float, float, float, float]
PART = (0.04, 0.96, 0.24, 0.84)
TILT = (24.0, 22.0)  # of the camera [degrees], about the upright axis and about the horizontal one
SLENDER = 0.4  # second extent over longest
MOST_HOT = 100  # points as hot as the hottest that are tried: with stress the same everywhere all of them are
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
    reach : float
        How far before and behind ``centre`` the picture shows anything [m].
    """

    axes: Array
    centre: Array
    metres_per_pixel: float
    size: tuple[int, int]
    reach: float

    def pixels(self, points: Array) -> Array:
        """Place points (n, 3) [m] in the picture: columns from the left, rows from the top, shape (n, 2)."""
        flat = (points - self.centre) @ self.axes[:2].T / self.metres_per_pixel
        return np.asarray(np.array(self.size) / 2 + flat * (1, -1))

    def holds(self, point: Array, place: Place) -> bool:
        """Tell whether a point (3,) [m] is within a place of the picture."""
        x, y = self.pixels(point[None])[0] / self.size
        left, right, bottom, top = place
        return bool(left <= x <= right and bottom <= 1 - y <= top)

    def moved(self, points: Array, right: float, up: float, towards: float) -> Array:
        """Move points (n, 3) [m] in the picture and towards the viewer [pixels]."""
        return points + self.metres_per_pixel * np.array([right, up, towards]) @ self.axes


def fitted_view(axes: Array, points: Array, size: tuple[int, int], place: Place = PART) -> View:
    """Look along the last of ``axes`` so that ``points`` (n, 3) [m] fill a place in the picture."""
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    left, right, bottom, top = place
    room = np.array([(right - left) * size[0], (top - bottom) * size[1]])
    scale = float(np.max((high - low)[:2] / room)) or 1.0
    return framed_view(axes, (low + high) / 2 @ axes, scale, size, place, points)


def framed_view(axes: Array, target: Array, scale: float, size: tuple[int, int], place: Place, points: Array) -> View:
    """Look along the last of ``axes`` with ``target`` (3,) [m] in the middle of a place, ``scale`` [m] to a pixel.

    No point of ``points`` (n, 3) [m] is too near or too far to be shown.
    """
    left, right, bottom, top = place
    aside = np.array([(left + right - 1) * size[0], (bottom + top - 1) * size[1], 0.0]) / 2 * scale
    depth = float(np.abs((points - target) @ axes[2]).max())
    return View(axes, target - aside @ axes, scale, size, max(scale * sum(size), 1.1 * depth))


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


def view_of_hottest(
    candidates: list[Array], points: Array, triangles: IntArray, strength: Array
) -> tuple[Array, int, bool]:
    """Choose the first camera that sees a point as hot as the hottest, to a thousandth; that point; whether it does."""
    hot = np.flatnonzero(strength >= (1 - 1e-3) * strength.max())[:MOST_HOT]
    for axes, number in product(candidates, hot.tolist()):
        if is_seen(axes, points, triangles, number):
            return axes, number, True
    return candidates[0], int(np.argmax(strength)), False

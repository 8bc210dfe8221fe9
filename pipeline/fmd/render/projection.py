"""Parallel projection of a part onto a picture, and the choice of its direction."""

from collections.abc import Iterator
from itertools import product

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass

# Places in the picture are fractions of it: left, right, bottom, top.
Place = tuple[float, float, float, float]
PART = (0.04, 0.96, 0.24, 0.84)
TILT = (24.0, 22.0)  # of the camera [degrees], about the upright axis and about the horizontal one
SLENDER = 0.4  # second extent over longest
MOST_CANDIDATES = 100  # points tried for the largest value: of a uniform field all points are equal
FLAT = 0.3  # least extent over the largest, below which a motion counts as one in a plane
IN_SPACE = (33.0, 22.0)  # tilt of the camera at any other motion [degrees]
SAME_EXTENT = 1.3  # extents that differ by less than this factor count as equal


@dataclass(frozen=True, slots=True)
class Projection:
    """A parallel projection onto a picture."""

    axes: Array  # (3, 3): unit vectors as rows: to the right, up, and towards the viewer
    centre: Array  # (3,): point in the middle of the picture [m]
    metres_per_pixel: float  # length of a pixel's side in space [m]
    size: tuple[int, int]  # width and height [pixels]
    half_depth: float  # distance before and behind ``centre`` up to which points are drawn [m]

    def pixels(self, points: Array) -> Array:
        """Project points (n, 3) [m] to columns from the left and rows from the top, shape (n, 2)."""
        flat = (points - self.centre) @ self.axes[:2].T / self.metres_per_pixel
        return np.asarray(np.array(self.size) / 2 + flat * (1, -1))

    def contains(self, point: Array, place: Place) -> bool:
        """Return whether a point (3,) [m] falls within a place of the picture."""
        x, y = self.pixels(point[None])[0] / self.size
        left, right, bottom, top = place
        return bool(left <= x <= right and bottom <= 1 - y <= top)

    def shift(self, points: Array, right: float, up: float, towards: float) -> Array:
        """Shift points (n, 3) [m] by pixels to the right, up and towards the viewer."""
        return points + self.metres_per_pixel * np.array([right, up, towards]) @ self.axes


def fit_projection(axes: Array, points: Array, size: tuple[int, int], place: Place = PART) -> Projection:
    """Project along the last of ``axes`` so that points (n, 3) [m] fill a place in the picture."""
    low, high = (points @ axes.T).min(axis=0), (points @ axes.T).max(axis=0)
    left, right, bottom, top = place
    room = np.array([(right - left) * size[0], (top - bottom) * size[1]])
    scale = float(np.max((high - low)[:2] / room)) or 1.0
    return frame_projection(axes, (low + high) / 2 @ axes, scale, size, place, points)


def frame_projection(
    axes: Array, target: Array, scale: float, size: tuple[int, int], place: Place, points: Array
) -> Projection:
    """Project along the last of ``axes`` with a target (3,) [m] in the middle of a place, at a given scale.

    Axes (3, 3) are to the right, up, towards the viewer; a pixel's side has the length ``scale`` [m]. The size is width
    and height [pixels]; the place has the picture's fractions left, right, bottom, top. Points (n, 3) [m] may not be
    cut off for being too near or too far.
    """
    left, right, bottom, top = place
    aside = np.array([(left + right - 1) * size[0], (bottom + top - 1) * size[1], 0.0]) / 2 * scale
    depth = float(np.abs((points - target) @ axes[2]).max())
    return Projection(axes, target - aside @ axes, scale, size, max(scale * sum(size), 1.1 * depth))


def oblique_axes(points: Array, tilt: tuple[float, float] = TILT) -> Iterator[Array]:
    """Yield camera axes (3, 3), the best first, all oblique to the plane of the longest two extents."""
    extents = np.ptp(points, axis=0)
    steps = np.log(np.maximum(extents / extents.max(), 1e-9)) / np.log(SAME_EXTENT)
    slender = np.sort(extents)[1] < SLENDER * extents.max()
    right, up, _ = np.eye(3)[np.argsort(-np.round(steps), kind="stable")]
    if np.cross(right, up)[2] < 0:  # plane motion is seen from above: turning left stays turning left
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


def upright_axes(points: Array, up: Array, tilt: tuple[float, float] = TILT) -> Iterator[Array]:
    """Yield camera axes (3, 3), the best first, with a direction ``up`` (3,) upwards and the longest extent level.

    Points (n, 3) [m] that fill a space, not a plane, are seen more from the side and from above than by ``tilt``.
    """
    up = up / np.linalg.norm(up)
    level = np.eye(3)[np.argsort(np.abs(up), kind="stable")[:2]]
    level = level - np.outer(level @ up, up)
    one = level[0] / np.linalg.norm(level[0])
    extents = np.array([np.ptp(points @ direction) for direction in (one, np.cross(up, one))])
    right = one if extents[0] * SAME_EXTENT >= extents[1] else np.cross(up, one)
    if right[np.argmax(np.abs(right))] < 0:
        right = -right
    front = np.array([right, up, np.cross(right, up)])
    height = float(np.ptp(points @ up))
    turn, rise = np.radians(tilt if extents.min() < FLAT * max(extents.max(), height) else IN_SPACE)
    c, s = np.cos(rise), np.sin(rise)
    above = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    for back, side in product((1, -1), (1, -1)):
        c, s = np.cos(turn), side * np.sin(turn)
        aside = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        yield above @ aside @ (front * [[back], [1], [back]])


def is_visible(axes: Array, points: Array, triangles: IntArray, number: int) -> bool:
    """Return whether no triangle of points (n_points, 3) lies between point ``number`` and the viewer.

    Axes (3, 3) are to the right, up, towards the viewer; triangles (n_triangles, 3) are positions among the points.
    """
    seen = points @ axes.T - axes @ points[number]
    a, b, c = np.moveaxis(seen[triangles[np.all(triangles != number, axis=1)]], 1, 0)

    def doubled_area(p: Array, q: Array) -> Array:
        return np.asarray(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])

    weights = np.stack([doubled_area(b, c), doubled_area(c, a), doubled_area(a, b)], axis=1)
    over = np.all(weights >= 0, axis=1) | np.all(weights <= 0, axis=1)
    depth = np.einsum("tk,tk->t", weights, np.stack([a, b, c], axis=1)[:, :, 2])
    return not np.any(over & (depth * weights.sum(axis=1) > 0))


def choose_axes(candidates: list[Array], points: Array, triangles: IntArray, values: Array) -> tuple[Array, int, bool]:
    """Choose the first camera axes that show a point of the largest value, to a thousandth.

    Returns the axes (3, 3), the point's number, and whether it is seen; if no candidate shows it, the first axes.
    """
    largest = np.flatnonzero(values >= (1 - 1e-3) * values.max())[:MOST_CANDIDATES]
    for axes, number in product(candidates, largest.tolist()):
        if is_visible(axes, points, triangles, number):
            return axes, number, True
    return candidates[0], int(np.argmax(values)), False

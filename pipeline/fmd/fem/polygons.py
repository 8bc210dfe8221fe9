"""Convex polygons in planes: what two of them share, cut into triangles, many pairs at once."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.newton import LOCATING_CORRECTIONS


def common_triangles(one: Array, other: Array) -> tuple[Array, IntArray]:
    """Return triangles (n, 3, 2) that cover what convex polygons have in common, and the number of each one's pair.

    Sutherland and Hodgman's algorithm: the first polygon is cut along each side of the second. Corners, (n_pairs, 3 or
    4, 2), are counter-clockwise; one may be there twice.
    """
    polygon = one
    for a, b in zip(other.swapaxes(0, 1), np.roll(other, -1, axis=1).swapaxes(0, 1), strict=True):
        polygon = _cut(polygon, a, b - a)
    n_pairs, n_corners = polygon.shape[:2]
    fan = np.array([(0, k, k + 1) for k in range(1, n_corners - 1)])
    triangles = polygon[:, fan].reshape(-1, 3, 2)
    sides = triangles[:, 1:] - triangles[:, :1]
    double = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    real = np.flatnonzero(double > 0.0)
    return triangles[real], np.repeat(np.arange(n_pairs), len(fan))[real]


def _cut(polygon: Array, start: Array, along: Array) -> Array:
    """Return what of polygons (n, k, 2) is to the left of a line each, with k + 1 corners, the last repeated."""
    off = polygon - start[:, None]
    left = along[:, None, 0] * off[..., 1] - along[:, None, 1] * off[..., 0]
    after, left_after = np.roll(polygon, -1, axis=1), np.roll(left, -1, axis=1)
    crosses = (left < 0.0) != (left_after < 0.0)
    share = np.where(crosses, left, 0.0) / np.where(crosses, left - left_after, 1.0)
    corners = np.stack([polygon, polygon + share[..., None] * (after - polygon)], axis=2)
    kept = np.stack([left >= 0.0, crosses], axis=2).reshape(len(polygon), -1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : polygon.shape[1] + 1]
    count = np.asarray(kept.sum(axis=1))
    last = np.maximum(count - 1, 0)[:, None]
    place = np.take_along_axis(order, np.minimum(np.arange(order.shape[1]), last), axis=1)
    found = np.take_along_axis(corners.reshape(len(polygon), -1, 2), place[..., None], axis=1)
    return np.asarray(np.where((count > 0)[:, None, None], found, start[:, None]))


def bilinear_places(corners: Array, points: Array) -> Array:
    """Return coordinates (n, 2), 0 to 1, of points (n, 2) in quadrilaterals (n, 4, 2); in triangles (n, 3, 2) too."""
    origin, a = corners[:, 0], corners[:, 1] - corners[:, 0]
    b = corners[:, -1] - origin
    twist = corners[:, 2] - corners[:, 1] - b if corners.shape[1] == 4 else np.zeros_like(a)
    place = np.full_like(points, 0.5)
    for _ in range(LOCATING_CORRECTIONS if corners.shape[1] == 4 else 1):
        s, t = place[:, :1], place[:, 1:]
        off = points - (origin + s * a + t * b + s * t * twist)
        by_s, by_t = a + t * twist, b + s * twist
        det = by_s[:, 0] * by_t[:, 1] - by_s[:, 1] * by_t[:, 0]
        step = [off[:, 0] * by_t[:, 1] - off[:, 1] * by_t[:, 0], by_s[:, 0] * off[:, 1] - by_s[:, 1] * off[:, 0]]
        place = place + np.stack(step, axis=1) / det[:, None]
    return place

"""Normals where triangles of a curved face meet, on the side on which the nearest place jumps over that edge.

Within of a convex face, and before a hollow one, a point that is before an edge is as far from both triangles, and
round-off would choose one of two normals. There the normal is the mean of the triangles around, and the nearest place
is on the edge, or on the corner; beside it both go over to the triangle's own.
"""

from __future__ import annotations

import math

from fmd.contact.tables import ContactTable
from fmd.core.limits.contact import LEAST_RIDGE, RIDGE_BEGIN, RIDGE_END, SHARP_EDGE
from fmd.kernels.kernel import inner

SHARP = math.cos(math.radians(SHARP_EDGE))


@inner
def round_ridge(c: ContactTable, f: int, i: int, height: float, on_rim: bool) -> bool:
    """Turn a point's normal, and move its nearest place on a triangle, if that is by a ridge; return false elsewhere.

    On a rim, which has no lines from corners to points, all bends are ridges. How near a corner is depends on the point
    and the corner alone, so that it is the same for all triangles around.
    """
    if min(c.weights[i, 0], c.weights[i, 1], c.weights[i, 2]) >= RIDGE_END:
        return False
    _mean_normals(c, f, i)
    corners, sides = 0.0, 0.0
    for e in range(3):
        c.ridge[7, e] = 0.0
        if _is_ridge(c, f, i, 3 + e, height, on_rim):
            c.ridge[7, e] = _nearness(_beside_corner(c, f, i, e) / c.ridge[8, e])
        corners += c.ridge[7, e]
    for e in range(3):
        c.ridge[6, e] = _nearness(c.weights[i, e]) if _is_ridge(c, f, i, e, height, on_rim) else 0.0
        sides += c.ridge[6, e]
    if corners + sides == 0.0:
        return False
    for e in range(3):
        c.ridge[6, e] *= (1.0 - corners) / max(1.0, sides)
    left = (1.0 - corners) * (1.0 - min(1.0, sides))
    size = 0.0
    for a in range(3):
        c.ridge[8, a] = left * c.weights[i, a] + c.ridge[7, a]
        c.axes[i, 0, a] *= left
        for k in range(3):
            c.axes[i, 0, a] += c.ridge[6, k] * c.ridge[k, a] + c.ridge[7, k] * c.ridge[3 + k, a]
        size += c.axes[i, 0, a] ** 2
    for e in range(3):
        one, other = (e + 1) % 3, (e + 2) % 3
        along = _along(c, f, i, one, other)
        c.ridge[8, one] += c.ridge[6, e] * (1.0 - along)
        c.ridge[8, other] += c.ridge[6, e] * along
    for a in range(3):
        c.weights[i, a] = c.ridge[8, a]
        c.axes[i, 0, a] /= math.sqrt(size)
    return True


@inner
def _nearness(distance: float) -> float:
    """Return 1 at a ridge and 0 away from it, by a distance over the triangles' size."""
    return min(1.0, max(0.0, (RIDGE_END - distance) / (RIDGE_END - RIDGE_BEGIN)))


@inner
def _beside_corner(c: ContactTable, f: int, i: int, e: int) -> float:
    """Return how far a point is from the line through a corner along the mean normal there."""
    square, along = 0.0, 0.0
    for a in range(3):
        off = c.place[c.node[i], a] - c.place[c.corner[f, e], a]
        square += off * off
        along += off * c.ridge[3 + e, a]
    return math.sqrt(max(0.0, square - along * along))


@inner
def _mean_normals(c: ContactTable, f: int, i: int) -> None:
    """Find mean normals and sizes at a triangle's corners, and mean normals at its sides, each opposite a corner.

    At corners, normals count by angles. Triangles are added in the order of the list, whichever of them is the nearest.
    """
    for e in range(3):
        c.ridge[8, e] = math.inf
    for k in range(6):
        for a in range(3):
            c.ridge[k, a] = 0.0
    for k in range(c.n_near[i]):
        g, count, apart = c.near[i, k], 0, 0
        for e in range(3):
            shared = c.corner[g, 0] == c.corner[f, e] or c.corner[g, 1] == c.corner[f, e]
            if shared or c.corner[g, 2] == c.corner[f, e]:
                count += 1
            else:
                apart = e
        if count == 0:
            continue
        n0, n1, n2 = unit_normal(c, g)
        if n0 * c.axes[i, 0, 0] + n1 * c.axes[i, 0, 1] + n2 * c.axes[i, 0, 2] < SHARP:
            continue
        for e in range(3):
            if count == 3 or (count == 2 and e == apart):
                c.ridge[e, 0], c.ridge[e, 1], c.ridge[e, 2] = c.ridge[e, 0] + n0, c.ridge[e, 1] + n1, c.ridge[e, 2] + n2
            for j in range(3):
                if c.corner[g, j] == c.corner[f, e]:
                    angle, height = _angle_and_height(c, g, j)
                    c.ridge[8, e] = min(c.ridge[8, e], height)
                    c.ridge[3 + e, 0] += angle * n0
                    c.ridge[3 + e, 1] += angle * n1
                    c.ridge[3 + e, 2] += angle * n2
    for k in range(6):
        size = math.sqrt(c.ridge[k, 0] ** 2 + c.ridge[k, 1] ** 2 + c.ridge[k, 2] ** 2)
        for a in range(3):
            c.ridge[k, a] /= size


@inner
def unit_normal(c: ContactTable, f: int) -> tuple[float, float, float]:
    """Return the unit normal of a triangle in space."""
    a, b, d = c.corner[f, 0], c.corner[f, 1], c.corner[f, 2]
    u0, u1, u2 = c.place[b, 0] - c.place[a, 0], c.place[b, 1] - c.place[a, 1], c.place[b, 2] - c.place[a, 2]
    v0, v1, v2 = c.place[d, 0] - c.place[a, 0], c.place[d, 1] - c.place[a, 1], c.place[d, 2] - c.place[a, 2]
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    size = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    return n0 / size, n1 / size, n2 / size


@inner
def _angle_and_height(c: ContactTable, f: int, e: int) -> tuple[float, float]:
    """Return the angle of a triangle at one of its corners, and the lesser height on the sides there."""
    at, one, other = c.corner[f, e], c.corner[f, (e + 1) % 3], c.corner[f, (e + 2) % 3]
    u, v, product = 0.0, 0.0, 0.0
    for a in range(3):
        way, back = c.place[one, a] - c.place[at, a], c.place[other, a] - c.place[at, a]
        u += way * way
        v += back * back
        product += way * back
    angle = math.acos(min(1.0, max(-1.0, product / math.sqrt(u * v))))
    return angle, math.sqrt(min(u, v)) * math.sin(angle)


@inner
def _is_ridge(c: ContactTable, f: int, i: int, k: int, height: float, on_rim: bool) -> bool:
    """Return true if the face bends at a side or a corner, and the point is where both sides of that are as near."""
    e, turned, outward = k % 3, 0.0, 0.0
    for a in range(3):
        turn = c.ridge[k, a] - c.axes[i, 0, a]
        middle = 0.5 * (c.place[c.corner[f, (e + 1) % 3], a] + c.place[c.corner[f, (e + 2) % 3], a])
        turned += turn * turn
        outward += turn * (middle - c.place[c.corner[f, e], a])
    jumps = on_rim or (outward if k < 3 else -outward) * height < 0.0
    return jumps and turned > LEAST_RIDGE * LEAST_RIDGE


@inner
def _along(c: ContactTable, f: int, i: int, one: int, other: int) -> float:
    """Return where along a side, from 0 to 1, the point is."""
    along, length = 0.0, 0.0
    for a in range(3):
        start = c.place[c.corner[f, one], a]
        way = c.place[c.corner[f, other], a] - start
        along += way * (c.place[c.node[i], a] - start)
        length += way * way
    return min(1.0, max(0.0, along / length))

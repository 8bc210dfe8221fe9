"""Triangles near points of another body, found again when the two have moved far enough to miss one."""

from __future__ import annotations

import math

from fmd.contact.nodes import place_node
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.contact import MOVED_PART, NEAR_TRIANGLES, SMALLEST_RADIUS
from fmd.kernels.kernel import inner


@inner
def keep_near_triangles(c: ContactTable, s: int, q: Array, origins: Array, rotations: Array) -> bool:
    """Find triangles near a surface's points again if that is due; false if points have too many.

    What isn't in a list was as far away as the list's room, and no two places can have come closer than the corners of
    a box around the points have moved in the other body's frame, and both bodies' modes beside.
    """
    if c.room[s] >= 0.0 and moved_since_listed(c, s, q, origins, rotations) <= MOVED_PART * c.room[s]:
        return True
    note_places(c, s, q, origins, rotations)
    radius = c.radius[s]
    while radius > SMALLEST_RADIUS * c.radius[s]:
        least = _list_triangles(c, s, radius)
        if least >= 0.0:
            c.room[s] = max(radius, least)
            return True
        radius *= 0.5
    return False


@inner
def corner_beside(c: ContactTable, s: int, k: int, a: int, origins: Array, rotations: Array) -> float:
    """Return a coordinate of a corner of a surface's box in the frame of the other body, before a plane in space."""
    own, total = c.link[c.slave[s]], 0.0
    if c.master[s] < 0:
        total = origins[own, a]
        for d in range(3):
            total += rotations[own, a, d] * c.box[s, k, d]
        return float(total)
    other = c.link[c.master[s]]
    for b in range(3):
        place = origins[own, b] - origins[other, b]
        for d in range(3):
            place += rotations[own, b, d] * c.box[s, k, d]
        total += rotations[other, b, a] * place
    return float(total)


@inner
def moved_since_listed(c: ContactTable, s: int, q: Array, origins: Array, rotations: Array) -> float:
    """Return a bound of how far points have moved against triangles since these were found."""
    farthest = 0.0
    for k in range(8):
        size = 0.0
        for a in range(3):
            size += (corner_beside(c, s, k, a, origins, rotations) - c.corners[s, k, a]) ** 2
        farthest = max(farthest, size)
    total = math.sqrt(farthest)
    for side in range(2):
        body, size = c.slave[s] if side == 0 else c.master[s], 0.0
        for m in range(c.n_modes[body]):
            size += (q[c.mode[body, m] + c.shift] - c.modal_then[s, side, m]) ** 2
        total += c.reach[s, side] * math.sqrt(size)
        for j in range(c.felt.shape[1]):
            total += c.felt_reach[s, side, j] * abs(c.felt[body, j] - c.felt_then[s, side, j])
    return float(total)


@inner
def note_places(c: ContactTable, s: int, q: Array, origins: Array, rotations: Array) -> None:
    """Note where both bodies are, and place the points and the balls around all triangles."""
    for k in range(8):
        for a in range(3):
            c.corners[s, k, a] = corner_beside(c, s, k, a, origins, rotations)
    for side in range(2):
        body = c.slave[s] if side == 0 else c.master[s]
        for m in range(c.n_modes[body]):
            c.modal_then[s, side, m] = q[c.mode[body, m] + c.shift]
        for j in range(c.felt.shape[1]):
            c.felt_then[s, side, j] = c.felt[body, j]
    for i in range(c.point[s], c.point[s + 1]):
        place_node(c, c.node[i], c.slave[s], q, origins, rotations)
    for f in range(c.triangle[s], c.triangle[s + 1]):
        for a in range(3):
            c.ball[f, a] = 0.0
        for e in range(3):
            place_node(c, c.corner[f, e], c.master[s], q, origins, rotations)
            for a in range(3):
                c.ball[f, a] += c.place[c.corner[f, e], a] / 3.0
        size = 0.0
        for e in range(3):
            own = 0.0
            for a in range(3):
                own += (c.place[c.corner[f, e], a] - c.ball[f, a]) ** 2
            size = max(size, own)
        c.ball[f, 3] = math.sqrt(size)


@inner
def _list_triangles(c: ContactTable, s: int, radius: float) -> float:
    """List triangles within a radius of each point, and return the least distance; −1 if a list is full.

    Distances are to the balls around triangles: no triangle is nearer.
    """
    nearest = math.inf
    for i in range(c.point[s], c.point[s + 1]):
        k, count = c.node[i], 0
        x0, x1, x2 = c.place[k, 0], c.place[k, 1], c.place[k, 2]
        for f in range(c.triangle[s], c.triangle[s + 1]):
            d0, d1, d2, within = x0 - c.ball[f, 0], x1 - c.ball[f, 1], x2 - c.ball[f, 2], radius + c.ball[f, 3]
            square = d0 * d0 + d1 * d1 + d2 * d2
            if square < within * within:
                if count == NEAR_TRIANGLES:
                    return -1.0
                c.near[i, count] = f
                count += 1
                nearest = 0.0
            elif nearest > 0.0:
                nearest = min(nearest, math.sqrt(square) - c.ball[f, 3])
        c.n_near[i], c.below[i] = count, -1
    return float(nearest)

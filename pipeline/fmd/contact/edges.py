"""Edges of boxes that cross: where two pass one another, and how far apart they are."""

from __future__ import annotations

import math

from fmd.contact.tables import ContactTable
from fmd.contact.triangles import set_axes
from fmd.core.arrays import Array
from fmd.core.limits.contact import BESIDE_EDGE, PARALLEL_EDGES
from fmd.kernels.kernel import inner


@inner
def stand_on_edge(c: ContactTable, s: int, i: int, origins: Array, rotations: Array) -> bool:
    """Find where an edge of a box passes one of another, from outside of both; false if they don't between their ends.

    Each pair of edges is a point of its own. Where two faces lie on one another, their edges cross at corners of what
    they share. Towards an edge's end, where a corner takes over, the force fades over the rounding.
    """
    own, other, number = c.link[c.slave[s]], c.link[c.master[s]], i - c.point[s]
    half_a = _place_edge(c, 0, c.edges[s], number // 12, origins[own], rotations[own])
    half_b = _place_edge(c, 1, c.primitive[s], number % 12, origins[other], rotations[other])
    across, by_a, by_b = 0.0, 0.0, 0.0
    for a in range(3):
        apart = c.edge[0, 0, a] - c.edge[1, 0, a]
        across += c.edge[0, 1, a] * c.edge[1, 1, a]
        by_a += apart * c.edge[0, 1, a]
        by_b += apart * c.edge[1, 1, a]
    square = 1.0 - across * across
    if square < PARALLEL_EDGES:
        return False
    on_a, on_b = (across * by_b - by_a) / square, (by_b - across * by_a) / square
    left = min(half_a - abs(on_a), half_b - abs(on_b))
    if not left > 0.0:
        return False
    distance = 0.0
    for a in range(3):
        c.way[0, a] = c.edge[0, 0, a] + on_a * c.edge[0, 1, a]
        c.way[1, a] = c.way[0, a] - c.edge[1, 0, a] - on_b * c.edge[1, 1, a]
        distance += c.way[1, a] ** 2
    distance = math.sqrt(distance)
    if distance == 0.0:
        return False
    for side in range(2):
        sign = -1.0 if side == 0 else 1.0
        for k in range(2, 4):
            out = 0.0
            for a in range(3):
                out += sign * c.edge[side, k, a] * c.way[1, a]
            if out < -BESIDE_EDGE * distance:
                return False
    radius, k = c.radii[c.node[i]], c.node[i]
    set_axes(c, i, c.way[1, 0] / distance, c.way[1, 1] / distance, c.way[1, 2] / distance)
    for a in range(3):
        c.place[k, a] = c.way[0, a]
        c.at[i, a] = c.way[0, a] - radius * c.axes[i, 0, a]
        c.spot[i, a] = 0.0
        for b in range(3):
            c.spot[i, a] += rotations[other, b, a] * (c.way[0, b] - origins[other, b])
    c.shares[i] = min(1.0, left / radius)
    c.free[i, 0] = distance - c.primitive[s, 16] - radius + c.clearance[s]
    c.seen[i, 0] = 1
    return True


@inner
def _place_edge(c: ContactTable, side: int, box: Array, number: int, origin: Array, R: Array) -> float:
    """Find an edge's middle, its direction and those out of its two faces in space; return half its length."""
    along = number // 4
    for a in range(3):
        c.edge[side, 0, a] = origin[a]
        for k in range(3):
            c.edge[side, 1 + k, a] = 0.0
        for b in range(3):
            c.edge[side, 0, a] += R[a, b] * box[1 + b]
            c.edge[side, 1, a] += R[a, b] * box[4 + 3 * along + b]
    for step in range(1, 3):
        axis = (along + step) % 3
        sign = 1.0 if (number // step) % 2 == 1 else -1.0
        for a in range(3):
            for b in range(3):
                c.edge[side, 1 + step, a] += sign * R[a, b] * box[4 + 3 * axis + b]
            c.edge[side, 0, a] += box[13 + axis] * c.edge[side, 1 + step, a]
    return float(box[13 + along])

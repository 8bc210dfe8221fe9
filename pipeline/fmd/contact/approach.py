"""Bound of how soon surfaces may touch: by their gaps, and by how fast bodies move and deform."""

from __future__ import annotations

import math

from fmd.contact.near_triangles import corner_beside, moved_since_listed
from fmd.contact.nodes import farthest_deflected, modal_size
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.contact import CYCLES_ABOVE
from fmd.kernels.kernel import inner


@inner
def note_corners(c: ContactTable, origins: Array, rotations: Array) -> None:
    """Note where the boxes around all surfaces' points would be with the bodies' frames at some places."""
    for s in range(c.slave.size):
        for k in range(8):
            for a in range(3):
                c.ahead[s, k, a] = corner_beside(c, s, k, a, origins, rotations)


@inner
def may_close(c: ContactTable, time: float, q: Array, v: Array, origins: Array, rotations: Array) -> bool:
    """Return true if surfaces touch at the state that `touch` has seen, or may within a time [s].

    `note_corners` has noted boxes where rates v would bring frames in that time. Modal coordinates q that oscillate
    don't get longer than |q| + |v| times the time, whatever their frequencies.
    """
    for s in range(c.slave.size):
        way = 0.0
        for k in range(8):
            size = 0.0
            for a in range(3):
                size += (corner_beside(c, s, k, a, origins, rotations) - c.ahead[s, k, a]) ** 2
            way = max(way, math.sqrt(size))
        way *= CYCLES_ABOVE
        for side in range(1 if c.master[s] < 0 else 2):
            body = c.slave[s] if side == 0 else c.master[s]
            back = 1.0 if _is_of_box(c, s) else 2.0  # gaps of points are those of deformed bodies
            way += back * farthest_deflected(c, s, side, body, q)
            way += time * c.reach[s, side] * modal_size(c, body, v, 0)
        if not _least_gap(c, s, q, origins, rotations) > way:
            return True
    return False


@inner
def _is_of_box(c: ContactTable, s: int) -> bool:
    """Return true if a surface's gap above its plane is found by the box around its points."""
    return bool(c.master[s] < 0 and c.rounded[s] == 0)


@inner
def _least_gap(c: ContactTable, s: int, q: Array, origins: Array, rotations: Array) -> float:
    """Return a lower bound of the gaps of a surface's points, of undeformed bodies before a plane."""
    if _is_of_box(c, s):
        return float(c.height[s, 0] + farthest_deflected(c, s, 0, c.slave[s], q))
    least = math.inf
    if c.rounded[s] == 1 or c.primitive[s, 0] > 0.0:
        for i in range(c.point[s], c.point[s + 1]):
            if c.seen[i, 0] == 1:
                least = min(least, c.free[i, 0])
            elif c.listed[i] > -math.inf:
                least = min(least, c.listed[i] - c.height[s, 0])
        return float(least)
    for i in range(c.point[s], c.point[s + 1]):
        if c.n_near[i] > 0:
            return 0.0
    return float(c.room[s] - moved_since_listed(c, s, q, origins, rotations))


@inner
def any_force(c: ContactTable) -> bool:
    """Return true if a point is pressed in the state that `touch` has seen, or if no forces were found there."""
    found = c.clock[1] != 0.0
    for i in range(c.force.shape[0]):
        found = found or c.force[i, 0] != 0.0
    return bool(found)

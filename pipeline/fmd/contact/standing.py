"""Where points stand before surfaces of rigid bodies: how far from a box, a ball, a pin or a bore, or from a plane."""

from __future__ import annotations

import math

from fmd.contact.primitives import BORE, BOX, PIN
from fmd.contact.tables import ContactTable
from fmd.contact.triangles import set_axes
from fmd.core.arrays import Array
from fmd.kernels.kernel import inner


@inner
def stand_on_plane(c: ContactTable, s: int, i: int) -> None:
    """Find a point's gap above a plane of the ground, and its axes there."""
    gap, radius = c.clearance[s], c.radii[c.node[i]]
    for a in range(3):
        c.spot[i, a] = c.place[c.node[i], a]
        gap += c.plane[s, 0, a] * (c.spot[i, a] - c.position[s, a])
        c.at[i, a] = c.place[c.node[i], a] - radius * c.plane[s, 0, a]
        for b in range(3):
            c.axes[i, a, b] = c.plane[s, a, b]
    c.free[i, 0] = gap - radius
    c.seen[i, 0] = 1


@inner
def stand_on_primitive(c: ContactTable, s: int, i: int, origins: Array, rotations: Array) -> bool:
    """Find a point's gap above a rigid body's surface, and its axes there; false beyond the ends of a pin or a bore.

    All that is as far from a box, a ball's centre or an axis as the surface's radius is on it.
    """
    other, k, d = c.link[c.master[s]], c.node[i], c.way
    kind = int(c.primitive[s, 0])
    for a in range(3):
        d[1, a] = 0.0
        for b in range(3):
            d[1, a] += rotations[other, b, a] * (c.place[k, b] - origins[other, b])
        c.spot[i, a] = d[1, a]
    inside, nearest = -math.inf, 0
    for a in range(3):
        along, half = 0.0, c.primitive[s, 13 + a]
        for b in range(3):
            along += c.primitive[s, 4 + 3 * a + b] * (d[1, b] - c.primitive[s, 1 + b])
        d[0, a] = along - min(half, max(-half, along))
        d[2, a] = along
        if abs(along) - half > inside:
            inside, nearest = abs(along) - half, a
    distance = math.sqrt(d[0, 0] ** 2 + d[0, 1] ** 2 + d[0, 2] ** 2)
    if kind >= PIN:
        if d[0, 2] != 0.0:
            return False
    elif kind == BOX and distance == 0.0:  # the point is in the box
        d[0, nearest] = math.copysign(1.0, d[2, nearest])
        distance = inside
    if distance == 0.0:
        d[0, 0] = 1.0
    size, out = math.sqrt(d[0, 0] ** 2 + d[0, 1] ** 2 + d[0, 2] ** 2), -1.0 if kind == BORE else 1.0
    for a in range(3):
        d[1, a] = 0.0
        for b in range(3):
            d[1, a] += c.primitive[s, 4 + 3 * b + a] * out * d[0, b] / size
    for a in range(3):
        d[0, a], d[2, a] = 0.0, 0.0
        for b in range(3):
            d[0, a] += rotations[other, a, b] * d[1, b]
            d[2, a] += rotations[other, a, b] * c.primitive[s, 10 + b]
    set_axes(c, i, d[0, 0], d[0, 1], d[0, 2])
    if kind >= PIN:
        for a in range(3):
            c.axes[i, 1, a] = d[2, a]
        for a in range(3):
            c.axes[i, 2, a] = d[0, (a + 1) % 3] * d[2, (a + 2) % 3] - d[0, (a + 2) % 3] * d[2, (a + 1) % 3]
    radius = c.radii[k]
    for a in range(3):
        c.at[i, a] = c.place[k, a] - radius * d[0, a]
    c.free[i, 0] = out * (distance - c.primitive[s, 16]) - radius + c.clearance[s]
    c.seen[i, 0] = 1
    return True

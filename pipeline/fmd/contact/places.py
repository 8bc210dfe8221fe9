"""Where points of contact stand at a state, and how far above a plane or a triangle."""

from __future__ import annotations

import math

from fmd.contact.edges import stand_on_edge
from fmd.contact.near_triangles import keep_near_triangles, moved_since_listed, note_places
from fmd.contact.nodes import farthest_deflected, place_node
from fmd.contact.round_points import follow_material
from fmd.contact.standing import stand_on_plane, stand_on_primitive
from fmd.contact.tables import ContactTable
from fmd.contact.triangles import stand_on_triangles
from fmd.core.arrays import Array
from fmd.core.limits.contact import STEPS_ABOVE, WIDER_BAND
from fmd.kernels.kernel import inner


@inner
def place_surface(c: ContactTable, s: int, q: Array, origins: Array, rotations: Array) -> None:
    """Find where a surface's points stand without forces, those that have something below them."""
    link = c.link[c.slave[s]]
    for i in range(c.point[s], c.point[s + 1]):
        c.seen[i, 0] = 0
    if c.rounded[s] == 1:
        _place_round_points(c, s, q, origins, rotations)
        return
    if c.master[s] < 0:
        if not _may_touch_plane(c, s, q, origins[link], rotations[link]):
            return
        for i in range(c.point[s], c.point[s + 1]):
            place_node(c, c.node[i], c.slave[s], q, origins, rotations)
            stand_on_plane(c, s, i)
            _turn(c, s, i, rotations)
            _find_slip(c, i)
        return
    if c.primitive[s, 0] > 0.0:
        _place_before_rigid(c, s, q, origins, rotations)
        return
    if not keep_near_triangles(c, s, q, origins, rotations):
        c.clock[1] = 1.0
        return
    master = c.link[c.master[s]]
    for i in range(c.point[s], c.point[s + 1]):
        if c.n_near[i] == 0:
            continue
        place_node(c, c.node[i], c.slave[s], q, origins, rotations)
        for k in range(c.n_near[i]):
            for e in range(3):
                place_node(c, c.corner[c.near[i, k], e], c.master[s], q, origins, rotations)
        if stand_on_triangles(c, s, i, rotations[link], rotations[master]):
            _turn(c, s, i, rotations)
            _find_slip(c, i)


@inner
def _place_before_rigid(c: ContactTable, s: int, q: Array, origins: Array, rotations: Array) -> None:
    """Find where points stand before a rigid surface that may come near it within some steps.

    No gap is less by more than bodies have moved since gaps were listed. They are again when as many have been found.
    """
    anew = c.room[s] < 0.0 or (c.room[s] >= c.point[s + 1] - c.point[s] and c.pace[s] < math.inf)
    if anew:
        c.pace[s] = c.pace[s] if c.room[s] >= 0.0 else math.inf
        note_places(c, s, q, origins, rotations)
        c.room[s], c.height[s, 1] = 0.0, math.nan
    c.height[s, 0] = moved_since_listed(c, s, q, origins, rotations)
    near = c.height[s, 0] + STEPS_ABOVE * c.pace[s]
    for g in range(c.noise.size):
        if c.group[g] <= c.point[s] < c.group[g + 1]:
            near += math.inf if c.damping[g] > 0.0 else WIDER_BAND * c.band[g]
    for i in range(c.point[s], c.point[s + 1]):
        if not anew and c.slot[i] < 0 and c.listed[i] > near:
            continue
        place_node(c, c.node[i], c.slave[s], q, origins, rotations)
        stands = stand_on_primitive(c, s, i, origins, rotations)
        if anew:
            c.listed[i] = c.free[i, 0] if stands else -math.inf
        else:
            c.room[s] += 1.0
        if stands:
            _turn(c, s, i, rotations)
            _find_slip(c, i)


@inner
def _place_round_points(c: ContactTable, s: int, q: Array, origins: Array, rotations: Array) -> None:
    """Find where the points of a rigid body stand before a plane, or before another rigid body."""
    for i in range(c.point[s], c.point[s + 1]):
        place_node(c, c.node[i], c.slave[s], q, origins, rotations)
        if c.master[s] < 0:
            stand_on_plane(c, s, i)
        elif c.edges[s, 0] > 0.0:
            if not stand_on_edge(c, s, i, origins, rotations):
                continue
        elif not stand_on_primitive(c, s, i, origins, rotations):
            continue
        _turn(c, s, i, rotations)
        follow_material(c, s, i, origins, rotations)
        _find_slip(c, i)


@inner
def _may_touch_plane(c: ContactTable, s: int, q: Array, origin: Array, R: Array) -> bool:
    """Return false if all points stay above their plane for some steps, as fast as they now come down."""
    deformed, low = farthest_deflected(c, s, 0, c.slave[s], q), math.inf
    for k in range(8):
        gap = c.clearance[s] - deformed
        for a in range(3):
            place = origin[a] - c.position[s, a]
            for b in range(3):
                place += R[a, b] * c.box[s, k, b]
            gap += c.plane[s, 0, a] * place
        low = min(low, gap)
    c.height[s, 0] = low
    down = c.height[s, 1] - low
    if not (low > 0.0 and math.isfinite(down) and low > STEPS_ABOVE * down):
        return True
    for i in range(c.point[s], c.point[s + 1]):
        if c.seen[i, 1] == 1 and c.known[i, 0] ** 2 + c.known[i, 1] ** 2 + c.known[i, 2] ** 2 > 0.0:
            return True
    return False


@inner
def _turn(c: ContactTable, s: int, i: int, rotations: Array) -> None:
    """Turn a point's axes into those of its body."""
    link, first = c.link[c.slave[s]], c.point[s]
    if i > first and c.master[s] < 0:  # the axes of one point are those of all
        for a in range(3):
            for b in range(3):
                c.turned[i, a, b], c.Q[i, a, b] = c.turned[first, a, b], c.Q[first, a, b]
    else:
        for a in range(3):
            for b in range(3):
                c.turned[i, a, b], c.Q[i, a, b] = 0.0, rotations[link, b, a]
                for k in range(3):
                    c.turned[i, a, b] += c.axes[i, a, k] * rotations[link, k, b]
                if c.master[s] >= 0:
                    c.Q[i, a, b] = 0.0
                    for k in range(3):
                        c.Q[i, a, b] += rotations[link, k, a] * rotations[c.link[c.master[s]], k, b]


@inner
def _find_slip(c: ContactTable, i: int) -> None:
    """Find a point's slip since the last step; of one that is new there is none."""
    if c.seen[i, 1] == 0:
        for a in range(3):
            c.tip[i, a], c.before[i, a], c.known[i, a] = c.spot[i, a], c.spot[i, a], 0.0
    d0, d1, d2 = c.spot[i, 0] - c.tip[i, 0], c.spot[i, 1] - c.tip[i, 1], c.spot[i, 2] - c.tip[i, 2]
    c.free[i, 1], c.free[i, 2] = 0.0, 0.0
    for k in range(3):
        slip = c.Q[i, k, 0] * d0 + c.Q[i, k, 1] * d1 + c.Q[i, k, 2] * d2
        c.free[i, 1] += c.turned[i, 1, k] * slip
        c.free[i, 2] += c.turned[i, 2, k] * slip

"""The nearest place to a point on the triangles near it, and the gap to there.

Inside of a triangle the gap is along its normal; at a side or a corner that triangles share, along the line to the
point: a distance with a sign, which has no jumps as the point goes from one triangle to the next. Its derivative is the
normal, with the weights of the nearest place for the triangle's corners.
"""

from __future__ import annotations

import math

from fmd.contact.ridges import round_ridge
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.contact import BEYOND_RIM, DEEP_ENTRY, FACING
from fmd.core.limits.round_off import SUMMED
from fmd.kernels.kernel import inlined, inner


@inner
def stand_on_triangles(c: ContactTable, s: int, i: int, R: Array, R_other: Array) -> bool:
    """Find what is below a point of a surface, its axes there and its gap; false if there is nothing.

    R and R_other turn the point's body and the triangles' into space.
    """
    nearest, high, best, last = math.inf, 0.0, -1, c.below[i]
    within = math.sqrt(_measure(c, last, i)[0]) if last >= 0 else math.inf
    for k in range(c.n_near[i]):
        f = c.near[i, k]
        if _is_beyond(c, f, c.node[i], within):
            continue
        square, height = _measure(c, f, i)
        closer, last = square < (1.0 - SUMMED) * nearest, f
        if closer or (square <= (1.0 + SUMMED) * nearest and abs(height) > abs(high)):
            nearest, high, best = square, height, f
            within = min(within, math.sqrt(square))
    c.below[i] = best
    if best < 0:
        return False
    if last != best:
        _measure(c, best, i)  # which leaves its weights
    size = _set_normal(c, best, i, nearest, high)
    facing = 0.0
    for a in range(3):
        for b in range(3):
            facing += c.axes[i, 0, a] * R[a, b] * c.outward[i, b]
    if size < 0.0 or facing > FACING:
        return False
    gap = 0.0
    for a in range(3):
        off = c.place[c.node[i], a]
        c.spot[i, a] = 0.0
        for e in range(3):
            off -= c.weights[i, e] * c.place[c.corner[best, e], a]
        gap += c.axes[i, 0, a] * off
        c.at[i, a] = off
    if c.seen[i, 1] == 0 and gap < -DEEP_ENTRY * size:
        c.clock[1] = 2.0
        return False
    for e in range(3):
        c.foot[i, e] = c.corner[best, e]
        for b in range(3):
            c.spot[i, b] += c.weights[i, e] * c.x[c.corner[best, e], b]
    for a in range(3):
        for b in range(3):
            c.spot[i, b] += R_other[a, b] * c.at[i, a]
    c.free[i, 0] = gap + c.clearance[s]
    c.seen[i, 0] = 1
    return True


@inlined
def _is_beyond(c: ContactTable, f: int, p: int, within: float) -> bool:
    """Return true if a triangle is farther from a node than a distance, by the ball around its corners."""
    a, b, d = c.corner[f, 0], c.corner[f, 1], c.corner[f, 2]
    one, two, three, far = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        middle = (c.place[a, k] + c.place[b, k] + c.place[d, k]) / 3.0
        one, two = one + (c.place[a, k] - middle) ** 2, two + (c.place[b, k] - middle) ** 2
        three, far = three + (c.place[d, k] - middle) ** 2, far + (c.place[p, k] - middle) ** 2
    return far > (1.0 + SUMMED) * (within + math.sqrt(max(one, two, three))) ** 2


@inner
def _measure(c: ContactTable, f: int, i: int) -> tuple[float, float]:
    """Return the square of a point's distance from a triangle and its height above the plane of that.

    The weights of the nearest place are left in the table.
    """
    p, a, b, d = c.node[i], c.corner[f, 0], c.corner[f, 1], c.corner[f, 2]
    u0, u1, u2 = c.place[b, 0] - c.place[a, 0], c.place[b, 1] - c.place[a, 1], c.place[b, 2] - c.place[a, 2]
    v0, v1, v2 = c.place[d, 0] - c.place[a, 0], c.place[d, 1] - c.place[a, 1], c.place[d, 2] - c.place[a, 2]
    r0, r1, r2 = c.place[p, 0] - c.place[a, 0], c.place[p, 1] - c.place[a, 1], c.place[p, 2] - c.place[a, 2]
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    area2 = n0 * n0 + n1 * n1 + n2 * n2
    height = (r0 * n0 + r1 * n1 + r2 * n2) / math.sqrt(area2)
    m0, m1, m2 = r1 * v2 - r2 * v1, r2 * v0 - r0 * v2, r0 * v1 - r1 * v0
    second = (m0 * n0 + m1 * n1 + m2 * n2) / area2
    m0, m1, m2 = u1 * r2 - u2 * r1, u2 * r0 - u0 * r2, u0 * r1 - u1 * r0
    third = (m0 * n0 + m1 * n1 + m2 * n2) / area2
    if second >= 0.0 and third >= 0.0 and second + third <= 1.0:
        c.weights[i, 0], c.weights[i, 1], c.weights[i, 2] = 1.0 - second - third, second, third
        return height * height, height
    nearest = math.inf
    for side in range(3):
        one, other = c.corner[f, side], c.corner[f, (side + 1) % 3]
        along, length, square = 0.0, 0.0, 0.0
        for k in range(3):
            way = c.place[other, k] - c.place[one, k]
            along += way * (c.place[p, k] - c.place[one, k])
            length += way * way
        along = min(1.0, max(0.0, along / length))
        for k in range(3):
            square += (c.place[p, k] - c.place[one, k] - along * (c.place[other, k] - c.place[one, k])) ** 2
        if square < nearest:
            nearest = square
            c.weights[i, side], c.weights[i, (side + 1) % 3] = 1.0 - along, along
            c.weights[i, (side + 2) % 3] = 0.0
    return nearest, height


@inner
def _set_normal(c: ContactTable, f: int, i: int, square: float, height: float) -> float:
    """Set a point's axes above its nearest place, and return the triangle's size; −1 if that place is beyond a rim."""
    p, a, b, d = c.node[i], c.corner[f, 0], c.corner[f, 1], c.corner[f, 2]
    u0, u1, u2 = c.place[b, 0] - c.place[a, 0], c.place[b, 1] - c.place[a, 1], c.place[b, 2] - c.place[a, 2]
    v0, v1, v2 = c.place[d, 0] - c.place[a, 0], c.place[d, 1] - c.place[a, 1], c.place[d, 2] - c.place[a, 2]
    n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
    area = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    size, beside = math.sqrt(area), math.sqrt(max(0.0, square - height * height))
    n0, n1, n2 = n0 / area, n1 / area, n2 / area
    on_rim = beside > SUMMED * size and _on_rim(c, f, i)
    if on_rim and beside > BEYOND_RIM * size:
        return -1.0
    if beside > SUMMED * size and not on_rim:
        distance = math.copysign(math.sqrt(square), height)
        w0, w1, w2 = c.weights[i, 0], c.weights[i, 1], c.weights[i, 2]
        n0 = (c.place[p, 0] - w0 * c.place[a, 0] - w1 * c.place[b, 0] - w2 * c.place[d, 0]) / distance
        n1 = (c.place[p, 1] - w0 * c.place[a, 1] - w1 * c.place[b, 1] - w2 * c.place[d, 1]) / distance
        n2 = (c.place[p, 2] - w0 * c.place[a, 2] - w1 * c.place[b, 2] - w2 * c.place[d, 2]) / distance
    set_axes(c, i, n0, n1, n2)
    if round_ridge(c, f, i, height, on_rim):
        set_axes(c, i, c.axes[i, 0, 0], c.axes[i, 0, 1], c.axes[i, 0, 2])
    return float(size)


@inner
def _on_rim(c: ContactTable, f: int, i: int) -> bool:
    """Return true if the nearest place, which isn't inside of the triangle, is on a rim."""
    for e in range(3):
        if c.weights[i, e] == 1.0:
            return bool(c.rim[f, 3 + e] == 1)
    for side in range(3):
        if c.weights[i, (side + 2) % 3] == 0.0:
            return bool(c.rim[f, side] == 1)
    return False


@inner
def set_axes(c: ContactTable, i: int, n0: float, n1: float, n2: float) -> None:
    """Set a point's normal, and tangents that are across it."""
    c.axes[i, 0, 0], c.axes[i, 0, 1], c.axes[i, 0, 2] = n0, n1, n2
    if abs(n0) <= abs(n1) and abs(n0) <= abs(n2):
        t0, t1, t2 = 0.0, n2, -n1
    elif abs(n1) <= abs(n2):
        t0, t1, t2 = -n2, 0.0, n0
    else:
        t0, t1, t2 = n1, -n0, 0.0
    size = math.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
    t0, t1, t2 = t0 / size, t1 / size, t2 / size
    c.axes[i, 1, 0], c.axes[i, 1, 1], c.axes[i, 1, 2] = t0, t1, t2
    c.axes[i, 2, 0], c.axes[i, 2, 1], c.axes[i, 2, 2] = n1 * t2 - n2 * t1, n2 * t0 - n0 * t2, n0 * t1 - n1 * t0

"""Forces between a mechanism's bodies and planes at a state, and what of them adds up over steps.

At a state, points stand at ``y = Q (r + R (x + Φ q)) − Q x₀`` along a plane's normal and tangents. Forces λ move them
by ``D λ``, ``D = Q R G Rᵀ Qᵀ``, without any inertia, so that λ follows from positions:
``y_n + (D λ)_n ≥ 0``, ``λ_n ≥ 0``, their product 0. That is a spring law with a potential, ``½ λᵀ D λ``.
"""

from __future__ import annotations

import math

from fmd.contact.friction_forces import find_friction_forces
from fmd.contact.histories import (
    AREA,
    BEGIN,
    END,
    ENERGY,
    ERROR,
    FORCE,
    FRICTION,
    IMPULSE,
    MOMENT,
    N_VALUES,
    PRESSURE,
)
from fmd.contact.normal_forces import find_normal_forces, place_now, spread_forces
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.contact import ROUNDED_PLACE, STEPS_ABOVE
from fmd.kernels.kernel import inner


@inner
def touch(c: ContactTable, q: Array, origins: Array, rotations: Array) -> None:
    """Find the forces on all points at positions q, with the bodies' frames in space; nothing is remembered."""
    c.clock[1] = 0.0
    for k in range(c.modal.size):
        c.modal[k] = 0.0
    for body in range(c.link.size):
        link = c.link[body]
        for k in range(6):
            c.push[link, k] = 0.0
        for i in range(c.first[body], c.first[body + 1]):
            for a in range(3):
                c.force[i, a] = 0.0
        c.near[body, 0] = 1.0 if _may_touch(c, body, q, origins[link], rotations[link]) else 0.0
        if c.near[body, 0] == 0.0:
            continue
        lowest = _place_points(c, body, q, origins[link], rotations[link])
        if c.near[body, 1] == 0.0:  # so there is no slip yet
            for i in range(c.first[body], c.first[body + 1]):
                for a in range(3):
                    c.tip[i, a], c.before[i, a], c.moved[i, a] = c.free[i, a], c.free[i, a], 0.0
        if lowest < 0.0 and not _find_forces(c, body):
            c.clock[1] = 1.0
        _push_body(c, body, q)


@inner
def _may_touch(c: ContactTable, body: int, q: Array, origin: Array, R: Array) -> bool:
    """Return false if all points of a body stay above their planes for some steps, as fast as it now comes down."""
    size, low = 0.0, math.inf
    for k in range(c.n_modes[body]):
        size += q[c.mode[body, k] + c.shift] ** 2
    size = math.sqrt(size)
    for i in range(c.first[body], c.first[body + 1]):
        gap = -c.offset[i, 0] - c.reach[i] * size
        for a in range(3):
            place = origin[a] + R[a, 0] * c.x[i, 0] + R[a, 1] * c.x[i, 1] + R[a, 2] * c.x[i, 2]
            gap += c.axes[i, 0, a] * place
        low = min(low, gap)
        if c.known[i, 0] > 0.0:
            low = -math.inf
    c.height[body, 0] = low
    down = c.height[body, 1] - low
    return not (low > 0.0 and math.isfinite(down) and low > STEPS_ABOVE * down)


@inner
def _place_points(c: ContactTable, body: int, q: Array, origin: Array, R: Array) -> float:
    """Find where a body's points stand without forces, and return the lowest place above a plane."""
    lowest, largest = math.inf, 0.0
    for i in range(c.first[body], c.first[body + 1]):
        for k in range(3):
            place = c.x[i, k]
            for m in range(c.n_modes[body]):
                place += c.shapes[i, k, m] * q[c.mode[body, m] + c.shift]
            c.own[i, k] = place
        for a in range(3):
            for k in range(3):
                c.turned[i, a, k] = c.axes[i, a, 0] * R[0, k] + c.axes[i, a, 1] * R[1, k] + c.axes[i, a, 2] * R[2, k]
            place, size = -c.offset[i, a], abs(c.offset[i, a])
            for k in range(3):
                at, beside = c.axes[i, a, k] * origin[k], c.turned[i, a, k] * c.own[i, k]
                place += at + beside
                size += abs(at) + abs(beside)
            c.free[i, a] = place
            largest = max(largest, size)
        lowest = min(lowest, c.free[i, 0])
    c.noise[body] = ROUNDED_PLACE * largest
    return float(lowest)


@inner
def _find_forces(c: ContactTable, body: int) -> bool:
    """Find the forces on a body's points from those of the last step; false if they don't settle."""
    rubs = False
    for i in range(c.first[body], c.first[body + 1]):
        rubs = rubs or c.friction[i] > 0.0
        c.active[i] = 1 if c.known[i, 0] > 0.0 else 0
    if not rubs:
        return find_normal_forces(c, body)
    for i in range(c.first[body], c.first[body + 1]):
        for a in range(3):
            c.force[i, a] = c.known[i, a]
    return find_friction_forces(c, body)


@inner
def _push_body(c: ContactTable, body: int, q: Array) -> None:
    """Gather what the forces on a body's points do to its frame and to its modes.

    They act on the points where they are with their displacement by the forces, as the potential's derivative says.
    """
    link = c.link[body]
    spread_forces(c, body)
    for i in range(c.first[body], c.first[body + 1]):
        if c.force[i, 0] == 0.0:
            continue
        for k in range(3):
            c.push[link, k] += c.own[i, k]
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            arm1, arm2 = c.x[i, k1] + c.moved[i, k1], c.x[i, k2] + c.moved[i, k2]
            for m in range(c.n_modes[body]):
                position = q[c.mode[body, m] + c.shift]
                arm1 += c.shapes[i, k1, m] * position
                arm2 += c.shapes[i, k2, m] * position
            c.push[link, 3 + k] += arm1 * c.own[i, k2] - arm2 * c.own[i, k1]
        for m in range(c.n_modes[body]):
            for k in range(3):
                c.modal[c.mode[body, m]] += c.shapes[i, k, m] * c.own[i, k]


@inner
def evaluate_contacts(c: ContactTable, t: float) -> None:
    """Fill the values of all contacts at the state that `touch` has seen, a time t after the last step's or its own."""
    later = 0.0 if math.isnan(c.clock[0]) else t - c.clock[0]
    for k in range(c.now.shape[0]):
        for j in range(c.now.shape[1]):
            c.now[k, j] = 0.0
        for j in range(FRICTION, N_VALUES):
            c.now[k, j] = c.sums[k, j]
        for a in range(3):
            c.now[k, IMPULSE + a] = c.sums[k, IMPULSE + a] + later * c.sums[k, FORCE + a]
    for i in range(c.force.shape[0]):
        n, t1, t2, k = c.force[i, 0], c.force[i, 1], c.force[i, 2], c.contact[i]
        if n == 0.0:
            continue
        v = c.now[k]
        f0 = c.axes[i, 0, 0] * n + c.axes[i, 1, 0] * t1 + c.axes[i, 2, 0] * t2
        f1 = c.axes[i, 0, 1] * n + c.axes[i, 1, 1] * t1 + c.axes[i, 2, 1] * t2
        f2 = c.axes[i, 0, 2] * n + c.axes[i, 1, 2] * t1 + c.axes[i, 2, 2] * t2
        y0, y1, y2 = place_now(c, i, 0), place_now(c, i, 1), place_now(c, i, 2)
        o0, o1, o2 = c.offset[i, 0], c.offset[i, 1], c.offset[i, 2]
        x0 = c.axes[i, 0, 0] * (y0 + o0) + c.axes[i, 1, 0] * (y1 + o1) + c.axes[i, 2, 0] * (y2 + o2)
        x1 = c.axes[i, 0, 1] * (y0 + o0) + c.axes[i, 1, 1] * (y1 + o1) + c.axes[i, 2, 1] * (y2 + o2)
        x2 = c.axes[i, 0, 2] * (y0 + o0) + c.axes[i, 1, 2] * (y1 + o1) + c.axes[i, 2, 2] * (y2 + o2)
        x0 -= c.positions[k, 0]
        x1 -= c.positions[k, 1]
        x2 -= c.positions[k, 2]
        v[FORCE] += f0
        v[FORCE + 1] += f1
        v[FORCE + 2] += f2
        v[MOMENT] += x1 * f2 - x2 * f1
        v[MOMENT + 1] += x2 * f0 - x0 * f2
        v[MOMENT + 2] += x0 * f1 - x1 * f0
        v[AREA] += c.areas[i]
        v[PRESSURE] = max(v[PRESSURE], n / c.areas[i])
        for a in range(3):
            v[ENERGY] += 0.5 * c.own[i, a] * c.moved[i, a]


@inner
def remember(c: ContactTable, t: float) -> None:
    """Take the forces that `touch` has found as those of a step at time t, and add up what they did since the last.

    A leapfrog step changes the kinetic energy by the trapezoids of ``λ`` over ``y``, exactly; that and the changes of
    the potential and of friction's heat should cancel. What is left is energy that the steps have made.
    """
    begins = math.isnan(c.clock[0])
    later = 0.0 if begins else t - c.clock[0]
    for k in range(c.now.shape[0]):
        c.sums[k, ERROR] -= c.sums[k, ENERGY]
    evaluate_contacts(c, t)
    for k in range(c.now.shape[0]):
        v, s = c.now[k], c.sums[k]
        for a in range(3):
            s[IMPULSE + a] += 0.5 * later * (s[FORCE + a] + v[FORCE + a])
            s[FORCE + a] = v[FORCE + a]
        if v[AREA] > 0.0:
            s[BEGIN] = t if math.isnan(s[BEGIN]) else s[BEGIN]
            s[END] = t
        s[ENERGY] = v[ENERGY]
        s[ERROR] = 0.0 if begins else s[ERROR] + v[ENERGY]
    for body in range(c.link.size):
        c.height[body, 1] = c.height[body, 0]
        c.near[body, 1] = c.near[body, 0]
        if c.near[body, 0] != 0.0:
            _add_work(c, body, begins)
    c.clock[0] = t


@inner
def _add_work(c: ContactTable, body: int, begins: bool) -> None:
    """Add the work of the forces on a body's points since the last step, and remember them."""
    for i in range(c.first[body], c.first[body + 1]):
        s = c.sums[c.contact[i]]
        for a in range(3):
            tip = place_now(c, i, a)
            if not begins:
                work = 0.5 * (c.force[i, a] + c.known[i, a]) * (c.free[i, a] - c.before[i, a])
                heat = -c.force[i, a] * (tip - c.tip[i, a]) if a > 0 else 0.0
                s[FRICTION] += heat
                s[ERROR] += work + heat
            c.tip[i, a], c.before[i, a], c.known[i, a] = tip, c.free[i, a], c.force[i, a]

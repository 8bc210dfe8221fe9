"""Forces on a mechanism's bodies that touch at a state, and what of them adds up over steps.

At a state, points stand at y above a plane or another body by joints and modes alone. Forces λ move them by ``D λ``
without any inertia, so that λ follows from positions: ``y_n + (D λ)_n ≥ 0``, ``λ_n ≥ 0``, their product 0. That is a
spring law with a potential, ``½ λᵀ D λ``.
"""

from __future__ import annotations

import math

from fmd.contact.compliances import choose_points
from fmd.contact.damping import relax_points, repeats_step, soften_gaps
from fmd.contact.friction_forces import find_friction_forces
from fmd.contact.normal_forces import find_normal_forces
from fmd.contact.places import place_surface
from fmd.contact.pushes import place_force, push_at_point, push_bodies
from fmd.contact.round_points import press_round_points
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.contact import BANDS, ROUNDED_PLACE
from fmd.kernels.arrays import clear
from fmd.kernels.kernel import inner


@inner
def touch(c: ContactTable, t: float, q: Array, origins: Array, rotations: Array) -> None:
    """Find the forces on all points at a time t and positions q, with the bodies' frames; nothing is remembered."""
    c.clock[1] = 0.0
    _place_all(c, q, origins, rotations)
    for g in range(c.noise.size):
        for i in range(c.group[g], c.group[g + 1]):
            for a in range(3):
                c.force[i, a], c.own[i, a], c.moved[i, a] = 0.0, 0.0, 0.0
        if c.rounded[c.surface[c.group[g]]] == 1:
            if press_round_points(c, g, t):
                push_bodies(c, g, q, origins, rotations)
            continue
        damped = c.damping[g] > 0.0
        if damped:
            soften_gaps(c, g, t)
        if damped and repeats_step(c, g):
            push_bodies(c, g, q, origins, rotations)
            continue
        touches = _measure_gaps(c, g, origins) < 0.0
        if touches and not _find_forces(c, g, q, origins, rotations):
            c.clock[1] = max(c.clock[1], 1.0)
        if damped:
            relax_points(c, g)
        if touches:
            push_bodies(c, g, q, origins, rotations)


@inner
def _place_all(c: ContactTable, q: Array, origins: Array, rotations: Array) -> None:
    """Begin a state: find where all points stand at positions q, and let nothing push bodies."""
    c.state[0] += 1
    clear(c.modal)
    for link in range(c.push.shape[0]):
        clear(c.push[link])
    for s in range(c.slave.size):
        place_surface(c, s, q, origins, rotations)


@inner
def press_with(c: ContactTable, found: ContactTable, moves: Array, q: Array, origins: Array, rotations: Array) -> None:
    """Press points before planes with forces found by a table whose points gave way by moves of modes (n,), too.

    By these the points stand elsewhere at positions q: what is left of their displacements is beside the modes.
    """
    _place_all(c, q, origins, rotations)
    for i in range(c.node.size):
        body, k = c.slave[c.surface[i]], c.node[i]
        for a in range(3):
            c.force[i, a], c.viscous[i, a], c.moved[i, a] = found.force[i, a], found.viscous[i, a], 0.0
            if found.slot[i] >= 0:
                c.moved[i, a] = found.moved[i, a]
                for m in range(c.n_modes[body]):
                    c.moved[i, a] -= c.shapes[k, a, m] * moves[c.mode[body, m]]
        _set_own(c, i)
        if c.force[i, 0] != 0.0:
            place_force(c, i, 1.0, rotations[c.link[body]])
            push_at_point(c, i, origins, rotations)


@inner
def _measure_gaps(c: ContactTable, g: int, origins: Array) -> float:
    """Return the smallest gap in a group without forces, and note the round-off of its places."""
    lowest, largest = math.inf, 0.0
    for i in range(c.group[g], c.group[g + 1]):
        if c.seen[i, 0] == 1:
            lowest, size = min(lowest, c.free[i, 0]), 0.0
            link, k = c.link[c.slave[c.surface[i]]], c.node[i]
            for a in range(3):
                size += 2.0 * abs(origins[link, a]) + abs(c.place[k, a])
            largest = max(largest, size)
    c.noise[g] = ROUNDED_PLACE * largest / c.share[g]
    return float(lowest)


@inner
def _find_forces(c: ContactTable, g: int, q: Array, origins: Array, rotations: Array) -> bool:
    """Find the forces on a group's points from those of the last step; false if they don't settle.

    Points that are left out are open for certain: no displacement is larger than ``√(D_ii λᵀ D λ)``. Of surfaces with
    points that aren't placed and may be reached so, all are.
    """
    first, rubs = c.group[g], False
    for i in range(first, c.group[g + 1]):
        rubs = rubs or (c.seen[i, 0] == 1 and c.friction[c.surface[i]] > 0.0)
    for _ in range(BANDS):
        if not choose_points(c, g):
            c.clock[1] = max(c.clock[1], 3.0)
            return False
        _begin(c, g, rubs)
        if not (find_friction_forces(c, g) if rubs else find_normal_forces(c, g)):
            return False
        twice = _spread(c, g)
        band, missed = 0.0, False
        for i in range(first, c.group[g + 1]):
            own = math.sqrt(max(0.0, twice * c.supple[i]))
            band = max(band, own)
            s = c.surface[i]
            if c.seen[i, 0] == 0 and -math.inf < c.listed[i] < c.height[s, 0] + own:
                c.pace[s] = math.inf
                place_surface(c, s, q, origins, rotations)
            missed = missed or (c.seen[i, 0] == 1 and c.slot[i] < 0 and c.free[i, 0] < own)
        c.band[g] = band
        if not missed:
            return True
    return False


@inner
def _begin(c: ContactTable, g: int, rubs: bool) -> None:
    """Begin with the last step's forces, or with the points that had some."""
    first, count = c.group[g], c.n_chosen[g]
    for own in range(count):
        i = c.chosen[first + own]
        normal = 0.0
        for a in range(3):
            c.force[i, a] = 0.0
            for k in range(3):
                turned = 0.0
                for b in range(3):
                    turned += c.Q[i, k, b] * c.known[i, b]
                c.force[i, a] += c.turned[i, a, k] * turned
            normal = c.force[i, 0] if a == 0 else normal
        c.active[i] = 1 if normal > 0.0 else 0
        if c.active[i] == 0:
            c.force[i, 0] = 0.0
        if c.active[i] == 0 or not rubs:
            c.force[i, 1], c.force[i, 2] = 0.0, 0.0


@inner
def _set_own(c: ContactTable, i: int) -> None:
    for k in range(3):
        c.own[i, k] = 0.0
        for a in range(3):
            c.own[i, k] += c.force[i, a] * c.turned[i, a, k]


@inner
def _spread(c: ContactTable, g: int) -> float:
    """Turn the forces on chosen points into own axes, take the displacements found, and return ``λᵀ D λ``."""
    twice = 0.0
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        _set_own(c, i)
        for k in range(3):
            c.moved[i, k] = c.answer[3 * own + k]
            twice += c.own[i, k] * c.moved[i, k]
    return float(twice)

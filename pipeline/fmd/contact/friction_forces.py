"""Forces with Coulomb's friction by block Gauss–Seidel: ``|λ_t| ≤ μ λ_n``, against the slip where that is reached."""

from __future__ import annotations

import math

from fmd.contact.compliances import move_points
from fmd.contact.tables import ContactTable
from fmd.core.limits.contact import SMALL_FORCE, SWEEPS
from fmd.kernels.kernel import inlined, inner


@inner
def find_friction_forces(c: ContactTable, g: int) -> bool:
    """Find normal and friction forces on a group's chosen points, from the forces at hand; false if they don't settle.

    One point after the other is brought to rest by itself and then into its cone (Jourdan, Alart & Jean, Comput Methods
    Appl Mech Eng 155, 1998). Displacements by the forces at hand are known.
    """
    first = c.group[g]
    for _ in range(SWEEPS):
        largest, change, least = 0.0, 0.0, math.inf
        for own in range(c.n_chosen[g]):
            i = c.chosen[first + own]
            gap = _place(c, i, own, 0)
            if c.force[i, 0] == 0.0 and gap >= 0.0:
                continue
            soft = _own_compliance(c, g, i, own, 0, 0)
            n = max(0.0, c.force[i, 0] - gap / soft)
            t1, t2, bound = 0.0, 0.0, c.friction[c.surface[i]] * n
            if bound > 0.0:
                d = n - c.force[i, 0]
                across = max(_own_compliance(c, g, i, own, 1, 1), _own_compliance(c, g, i, own, 2, 2))
                slip1 = _place(c, i, own, 1) + _own_compliance(c, g, i, own, 1, 0) * d
                slip2 = _place(c, i, own, 2) + _own_compliance(c, g, i, own, 2, 0) * d
                t1, t2 = c.force[i, 1] - slip1 / across, c.force[i, 2] - slip2 / across
                size = math.sqrt(t1 * t1 + t2 * t2)
                if size > bound:
                    t1, t2 = t1 * bound / size, t2 * bound / size
            largest, least = max(largest, n), min(least, soft)
            change = max(change, _apply(c, g, i, own, n, t1, t2))
        if change <= SMALL_FORCE * largest + c.noise[g] / least:
            return True
    return False


@inlined
def _place(c: ContactTable, i: int, own: int, a: int) -> float:
    """Return a chosen point's gap or slip with the displacement by forces."""
    moved = c.turned[i, a, 0] * c.answer[3 * own] + c.turned[i, a, 1] * c.answer[3 * own + 1]
    return float(c.free[i, a] + moved + c.turned[i, a, 2] * c.answer[3 * own + 2])


@inlined
def _own_compliance(c: ContactTable, g: int, i: int, own: int, a: int, b: int) -> float:
    """Return how far a chosen point moves along one of its axes by a unit force on it along another."""
    at, total = c.first_entry[g, 0] + 3 * own * (c.stride[g] + 1), 0.0
    for k in range(3):
        for m in range(3):
            total += c.turned[i, a, k] * c.D[at + k * c.stride[g] + m] * c.turned[i, b, m]
    return float(total)


@inner
def _apply(c: ContactTable, g: int, i: int, own: int, n: float, t1: float, t2: float) -> float:
    """Give a point other forces, move all points by the difference, and return its largest component."""
    d0, d1, d2 = n - c.force[i, 0], t1 - c.force[i, 1], t2 - c.force[i, 2]
    c.force[i, 0], c.force[i, 1], c.force[i, 2] = n, t1, t2
    size = max(abs(d0), abs(d1), abs(d2))
    if size > 0.0:
        f0 = d0 * c.turned[i, 0, 0] + d1 * c.turned[i, 1, 0] + d2 * c.turned[i, 2, 0]
        f1 = d0 * c.turned[i, 0, 1] + d1 * c.turned[i, 1, 1] + d2 * c.turned[i, 2, 1]
        f2 = d0 * c.turned[i, 0, 2] + d1 * c.turned[i, 1, 2] + d2 * c.turned[i, 2, 2]
        move_points(c, g, own, f0, f1, f2)
    return float(size)

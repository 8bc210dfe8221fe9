"""Forces with Coulomb's friction by block Gauss–Seidel: ``|λ_t| ≤ μ λ_n``, against the slip where that is reached."""

from __future__ import annotations

import math

from fmd.contact.normal_forces import compliance, place_now, spread_forces
from fmd.contact.tables import ContactTable
from fmd.core.limits.contact import SMALL_FORCE, SWEEPS
from fmd.kernels.kernel import inner


@inner
def find_friction_forces(c: ContactTable, body: int) -> bool:
    """Find normal and friction forces on a body's points, from the forces at hand; false if they don't settle.

    A point's slip is counted from where its tip was at the last step. One point after the other is brought to rest
    by itself and then into its cone (Jourdan, Alart & Jean, Comput Methods Appl Mech Eng 155, 1998).
    """
    first, last = c.first[body], c.first[body + 1]
    spread_forces(c, body)
    for _ in range(SWEEPS):
        largest, change, least = 0.0, 0.0, math.inf
        for i in range(first, last):
            gap = place_now(c, i, 0)
            if c.force[i, 0] == 0.0 and gap >= 0.0:
                continue
            own = compliance(c, first, i, i, 0, 0)
            n = max(0.0, c.force[i, 0] - gap / own)
            t1, t2, bound = 0.0, 0.0, c.friction[i] * n
            if bound > 0.0:
                d = n - c.force[i, 0]
                soft = max(compliance(c, first, i, i, 1, 1), compliance(c, first, i, i, 2, 2))
                slip1 = place_now(c, i, 1) - c.tip[i, 1] + compliance(c, first, i, i, 1, 0) * d
                slip2 = place_now(c, i, 2) - c.tip[i, 2] + compliance(c, first, i, i, 2, 0) * d
                t1, t2 = c.force[i, 1] - slip1 / soft, c.force[i, 2] - slip2 / soft
                size = math.sqrt(t1 * t1 + t2 * t2)
                if size > bound:
                    t1, t2 = t1 * bound / size, t2 * bound / size
            largest, least = max(largest, n), min(least, own)
            change = max(change, _apply(c, first, last, i, n, t1, t2))
        if change <= SMALL_FORCE * largest + c.noise[body] / least:
            return True
    return False


@inner
def _apply(c: ContactTable, first: int, last: int, i: int, n: float, t1: float, t2: float) -> float:
    """Give a point other forces, move all points of its body by the difference, and return its largest component."""
    d0, d1, d2 = n - c.force[i, 0], t1 - c.force[i, 1], t2 - c.force[i, 2]
    c.force[i, 0], c.force[i, 1], c.force[i, 2] = n, t1, t2
    size = max(abs(d0), abs(d1), abs(d2))
    if size > 0.0:
        f0 = d0 * c.turned[i, 0, 0] + d1 * c.turned[i, 1, 0] + d2 * c.turned[i, 2, 0]
        f1 = d0 * c.turned[i, 0, 1] + d1 * c.turned[i, 1, 1] + d2 * c.turned[i, 2, 1]
        f2 = d0 * c.turned[i, 0, 2] + d1 * c.turned[i, 1, 2] + d2 * c.turned[i, 2, 2]
        c.own[i, 0] += f0
        c.own[i, 1] += f1
        c.own[i, 2] += f2
        for j in range(first, last):
            for k in range(3):
                c.moved[j, k] += c.G[j, i - first, k, 0] * f0 + c.G[j, i - first, k, 1] * f1
                c.moved[j, k] += c.G[j, i - first, k, 2] * f2
    return float(size)

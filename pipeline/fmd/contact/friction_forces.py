"""Forces with Coulomb's friction, ``|λ_t| ≤ μ λ_n``, against the slip where that is reached.

Newton's method finds them where few points are closed. Else block Gauss–Seidel does, until the same points have stayed
for as many sweeps as their stiffness costs, with which Newton's method takes over.
"""

from __future__ import annotations

import math

from fmd.contact.dense import add_rows, invert_flexibility
from fmd.contact.friction_newton import find_forces_by_newton
from fmd.contact.tables import ContactTable
from fmd.core.limits.contact import LATE_SWEEPS, SMALL_FORCE, SWEEPS, SWEEPS_PER_POINT
from fmd.kernels.kernel import inlined, inner


@inner
def find_friction_forces(c: ContactTable, g: int) -> bool:
    """Find forces and displacements of a group's chosen points; false if they settle neither from those at hand nor 0.

    Some starts lead round in circles.
    """
    count, least = c.n_chosen[g], math.inf
    for own in range(count):
        least = min(least, _own_compliance(c, g, c.chosen[c.group[g] + own], own, 0, 0))
    if _settles(c, g, least):
        return True
    for own in range(count):
        for a in range(3):
            c.force[c.chosen[c.group[g] + own], a] = 0.0
    return _settles(c, g, least)


@inner
def _settles(c: ContactTable, g: int, least: float) -> bool:
    """Find forces from those at hand; false if they don't settle."""
    late = LATE_SWEEPS
    _settle(c, g)
    if find_forces_by_newton(c, g, least):
        return True
    _go_back(c, g)
    for sweep in range(SWEEPS):
        if _sweep(c, g, least):
            return True
        c.swept[g] += 1
        inverts = c.inverted[g] == 0 and c.swept[g] > SWEEPS_PER_POINT * c.n_chosen[g]
        if inverts:
            c.inverted[g] = 1 if invert_flexibility(c, g) else -1
        if c.inverted[g] == 1 and (inverts or sweep == late):
            late = max(late, 2 * sweep)
            _settle(c, g)
            if find_forces_by_newton(c, g, least):
                return True
            _go_back(c, g)
    return False


@inner
def _settle(c: ContactTable, g: int) -> None:
    """Keep the forces at hand as those that have settled."""
    for own in range(c.n_chosen[g]):
        for a in range(3):
            c.settled[own, a] = c.force[c.chosen[c.group[g] + own], a]


@inner
def _go_back(c: ContactTable, g: int) -> None:
    """Take the last forces that have settled, with their displacements."""
    for own in range(c.n_chosen[g]):
        for a in range(3):
            c.force[c.chosen[c.group[g] + own], a] = c.settled[own, a]
    c.kept[0] = -1
    _displace(c, g)


@inner
def _displace(c: ContactTable, g: int) -> None:
    """Find the displacements by the forces at hand."""
    for k in range(c.stride[g]):
        c.answer[k] = 0.0
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        n, t1, t2 = c.force[i, 0], c.force[i, 1], c.force[i, 2]
        if n != 0.0:
            c.force[i, 0], c.force[i, 1], c.force[i, 2] = 0.0, 0.0, 0.0
            _apply(c, g, i, own, n, t1, t2)


@inner
def _sweep(c: ContactTable, g: int, least: float) -> bool:
    """Bring one point after the other to rest by itself and then into its cone; true where hardly any force changes.

    Jourdan, Alart & Jean, Comput Methods Appl Mech Eng 155, 1998.
    """
    first, largest, change = c.group[g], 0.0, 0.0
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
        largest = max(largest, n)
        change = max(change, _apply(c, g, i, own, n, t1, t2))
    return bool(change <= SMALL_FORCE * largest + c.noise[g] / least)


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
        add_rows(c, c.D, g, own, f0, f1, f2, c.answer)
    return float(size)

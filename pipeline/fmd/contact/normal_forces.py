"""Normal forces on points by active sets: ``g = y + N λ ≥ 0``, ``λ ≥ 0``, ``gᵀ λ = 0``, N positive definite."""

from __future__ import annotations

import math

from fmd.contact.compliances import keep_along_normals
from fmd.contact.dense import dot
from fmd.contact.known_responses import respond_to_gaps
from fmd.contact.tables import ContactTable
from fmd.core.limits.contact import BLOCK_CHANGES, SET_CHANGES, SMALL_FORCE
from fmd.kernels.kernel import inner


@inner
def find_normal_forces(c: ContactTable, g: int) -> bool:
    """Find a group's normal forces and displacements from the points active before; false if that has no end.

    All points that are wrong change sides at once (Kunisch & Rendl, SIAM J Optim 14, 2003); if they go on doing so,
    the worst alone. The factor of the active points stays as long as these and N do.
    """
    keep_along_normals(c, g)
    first, count = c.group[g], c.n_chosen[g]
    size, n = c.width[g], c.first_entry[g, 1]
    for change in range(SET_CHANGES):
        if not _factor_active(c, g):
            return False
        active = c.n_factored[g]
        respond_to_gaps(c, g)
        largest = 0.0
        for own in range(count):
            c.force[c.chosen[first + own], 0] = 0.0
        for k in range(active):
            c.force[c.chosen[first + c.factored[first + k]], 0] = c.b[k]
            largest = max(largest, abs(c.b[k]))
        worst, at, wrong = 0.0, -1, 0
        for own in range(count):
            i = c.chosen[first + own]
            soft = c.N[n + own * (size + 1)]
            fault = -c.force[i, 0] * soft
            if c.active[i] == 0:
                fault = -c.free[i, 0]
                for k in range(3):
                    fault -= c.normal_then[i, k] * c.answer[3 * own + k]
            if fault > SMALL_FORCE * largest * soft + c.noise[g]:
                wrong += 1
                if fault > worst:
                    worst, at = fault, i
                if change < BLOCK_CHANGES:
                    c.active[i] = 1 - c.active[i]
        if wrong == 0:
            return True
        if change >= BLOCK_CHANGES:
            c.active[at] = 1 - c.active[at]
    return False


@inner
def _factor_active(c: ContactTable, g: int) -> bool:
    """Factor N's rows and columns of active points by Cholesky's method, from the first that isn't; false if it can't.

    Points that have come to be active follow those that were, whose rows stay up to the first that is so no more.
    """
    first, same, active = c.group[g], 0, 0
    for own in range(c.n_chosen[g]):
        active += c.active[c.chosen[first + own]]
    while same < c.n_factored[g] and c.active[c.chosen[first + c.factored[first + same]]] == 1:
        same += 1
    if same == active and same == c.n_factored[g]:
        return True
    for k in range(same):
        c.active[c.chosen[first + c.factored[first + k]]] = 2
    active = same
    for own in range(c.n_chosen[g]):
        i = c.chosen[first + own]
        if c.active[i] == 1:
            c.factored[first + active] = own
            active += 1
        c.active[i] = min(c.active[i], 1)
    c.n_factored[g], c.n_pressed[g] = -1, 0
    size, n = c.width[g], c.first_entry[g, 1]
    for i in range(same, active):
        row = n + c.factored[first + i] * size
        own = n + i * size
        for j in range(i + 1):
            other = n + j * size
            entry = c.N[row + c.factored[first + j]] - dot(c.L, own, c.L, other, j)
            if j < i:
                c.L[own + j] = entry / c.L[other + j]
            elif entry > 0.0:
                c.L[own + j] = math.sqrt(entry)
            else:
                return False
    c.n_factored[g] = active
    return True

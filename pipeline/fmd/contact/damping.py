"""Damped flexibility of points: a displacement w takes the force of ``w + β ẇ`` (Kelvin–Voigt).

By Euler's implicit method over a step h the elastic part of the forces is ``e = s λ + (1 − s) e₀`` with
``s = h/(h + β)`` and e₀ that of the last step, and ``w = s D λ + (1 − s) w₀``. So ``y + w ≥ 0`` is the condition of an
undamped contact with ``(y + (1 − s) w₀)/s`` in place of y, for slips as for gaps: forces are found as without damping.
"""

from __future__ import annotations

import math

from fmd.contact.histories import BORDER, DAMPED, ERROR
from fmd.contact.tables import ContactTable
from fmd.core.limits.contact import SAME_STEP
from fmd.kernels.kernel import inner


@inner
def soften_gaps(c: ContactTable, g: int, t: float) -> None:
    """Put the gaps and slips in a group's place that make its forces those of an undamped one."""
    later = t - c.clock[0]
    c.share[g] = 1.0 if math.isnan(later) else later / (later + c.damping[g])
    for i in range(c.group[g], c.group[g + 1]):
        for a in range(3):
            c.undamped[i, a], c.viscous[i, a] = c.free[i, a], 0.0
            if c.seen[i, 1] == 0:
                c.moved_then[i, a], c.elastic_then[i, a], c.viscous_then[i, a] = 0.0, 0.0, 0.0
        if c.seen[i, 0] == 1 and c.share[g] > SAME_STEP:
            for a in range(3):
                left = 0.0
                for k in range(3):
                    left += c.turned[i, a, k] * c.moved_then[i, k]
                c.free[i, a] = (c.free[i, a] + (1.0 - c.share[g]) * left) / c.share[g]


@inner
def repeats_step(c: ContactTable, g: int) -> bool:
    """Return true at the last step's own state, with its forces."""
    if c.share[g] > SAME_STEP:
        return False
    for i in range(c.group[g], c.group[g + 1]):
        if c.seen[i, 0] == 1:
            for k in range(3):
                for b in range(3):
                    c.own[i, k] += c.Q[i, k, b] * c.known[i, b]
                c.moved[i, k], c.viscous[i, k] = c.moved_then[i, k], c.viscous_then[i, k]
            for a in range(3):
                for k in range(3):
                    c.force[i, a] += c.turned[i, a, k] * c.own[i, k]
    return True


@inner
def relax_points(c: ContactTable, g: int) -> None:
    """Find a group's displacements and the damper's part of its forces, and put its gaps and slips back."""
    share = c.share[g]
    for i in range(c.group[g], c.group[g + 1]):
        for a in range(3):
            c.free[i, a] = c.undamped[i, a]
            if c.seen[i, 0] == 1:
                c.moved[i, a] = share * c.moved[i, a] + (1.0 - share) * c.moved_then[i, a]
                c.viscous[i, a] = (1.0 - share) * (c.own[i, a] - c.elastic_then[i, a])


@inner
def keep_damping(c: ContactTable, g: int, begins: bool) -> None:
    """Add the damper's work of a group since the last step, and remember what the next needs."""
    for i in range(c.group[g], c.group[g + 1]):
        s, heat = c.sums[c.contact[c.surface[i]]], 0.0
        for a in range(3):
            if c.seen[i, 0] == 1:
                heat += 0.5 * (c.viscous[i, a] + c.viscous_then[i, a]) * (c.moved[i, a] - c.moved_then[i, a])
            else:  # what is left of its deflection relaxes
                heat += 0.5 * c.elastic_then[i, a] * c.moved_then[i, a]
            c.moved_then[i, a], c.viscous_then[i, a] = c.moved[i, a], c.viscous[i, a]
            c.elastic_then[i, a] = c.own[i, a] - c.viscous[i, a]
        if c.seen[i, 1] == 1 and not begins:
            s[DAMPED] += heat
            s[ERROR] += heat


@inner
def mark_border(c: ContactTable, i: int) -> None:
    """Mark a contact that presses a point at the border of its grid."""
    if c.border[c.node[i]] == 1 and c.force[i, 0] > 0.0:
        c.sums[c.contact[c.surface[i]], BORDER] = 1.0

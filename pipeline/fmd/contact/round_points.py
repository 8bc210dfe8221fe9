"""Points of rigid bodies, centres of balls or pieces of pins: their slip, their forces, and what they remember.

Each has a law of its own, so that its force follows from its depth, from friction's memory and, with a loss, from how
fast it goes deeper. What it deflects is its **dent**, along the contact's axes: of the normal as the law says, aside by
Mindlin's share of the normal's secant.
"""

from __future__ import annotations

import math

from fmd.contact.histories import DAMPED, ERROR, FRICTION
from fmd.contact.round_laws import DEPTH, GROWTH, LOAD, PEAK, POWER, SIZE, STORED
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.contact import SAME_TIME
from fmd.kernels.kernel import inner


@inner
def follow_material(c: ContactTable, s: int, i: int, origins: Array, rotations: Array) -> None:
    """Put a place that moves as the material does where a round point touches, which rolls on over its surface.

    The material's displacement against the other body since the last step is that of its frame and of its turn by the
    mean arm, so that along the normal it is the change of the gap. Places are in the other body's frame.
    """
    _note_frame(c, s, i, origins, rotations)
    _turn_memory(c, i)
    for a in range(3):
        c.spot[i, a] = c.touched[i, a]
    if c.seen[i, 1] == 0:
        return
    for a in range(3):  # half the sum of R Rᵀ of the last step and of its transpose's difference is the small turn
        one, other, turn = (a + 1) % 3, (a + 2) % 3, 0.0
        for k in range(3):
            turn += c.frame[s, 3 + 3 * other + k] * c.frame_then[s, 3 + 3 * one + k]
            turn -= c.frame[s, 3 + 3 * one + k] * c.frame_then[s, 3 + 3 * other + k]
        c.way[0, a] = 0.5 * turn
        c.way[1, a] = c.frame[s, a] - c.frame_then[s, a]
        c.way[2, a] = 0.5 * (c.touched[i, a] - c.frame[s, a] + c.touched_then[i, a] - c.frame_then[s, a])
    for a in range(3):
        one, other = (a + 1) % 3, (a + 2) % 3
        turned = c.way[0, one] * c.way[2, other] - c.way[0, other] * c.way[2, one]
        c.spot[i, a] = c.before[i, a] + c.way[1, a] + turned


@inner
def _turn_memory(c: ContactTable, i: int) -> None:
    """Put what a point remembers aside along its tangents of now, which jump where the normal's least part is another.

    Tangents are chosen afresh for each normal; a deflection that stayed along the old ones would look like a slip.
    """
    along, across = 0.0, 0.0
    for b in range(3):
        t1, t2 = 0.0, 0.0
        for k in range(3):
            t1 += c.turned[i, 1, k] * c.Q[i, k, b]
            t2 += c.turned[i, 2, k] * c.Q[i, k, b]
        along += t1 * c.tangent_then[i, b]
        across += t2 * c.tangent_then[i, b]
        c.way[0, b] = t1
    for b in range(3):
        c.tangent_then[i, b] = c.way[0, b]
    size = math.sqrt(along * along + across * across)
    if size == 0.0:
        return
    along, across = along / size, across / size
    d1, d2, f1, f2 = c.dent_then[i, 1], c.dent_then[i, 2], c.drag_then[i, 1], c.drag_then[i, 2]
    # the old second tangent is the first, turned by a right angle about the normal
    c.dent_then[i, 1], c.dent_then[i, 2] = along * d1 - across * d2, across * d1 + along * d2
    c.drag_then[i, 1], c.drag_then[i, 2] = along * f1 - across * f2, across * f1 + along * f2


@inner
def _note_frame(c: ContactTable, s: int, i: int, origins: Array, rotations: Array) -> None:
    """Note the frame of a point's body and where the point touches, in the other body's frame."""
    own, master = c.link[c.slave[s]], c.master[s]
    for a in range(3):
        if master < 0:
            c.touched[i, a], c.frame[s, a] = c.at[i, a], origins[own, a]
        else:
            other = c.link[master]
            c.touched[i, a], c.frame[s, a] = 0.0, 0.0
            for b in range(3):
                c.touched[i, a] += rotations[other, b, a] * (c.at[i, b] - origins[other, b])
                c.frame[s, a] += rotations[other, b, a] * (origins[own, b] - origins[other, b])
        for b in range(3):
            c.frame[s, 3 + 3 * a + b] = c.Q[i, b, a]


@inner
def press_round_points(c: ContactTable, g: int, t: float) -> bool:
    """Find the forces on a group's points, each by its own law; false if none touches."""
    first, count, clock = c.group[g], 0, c.clock[0]
    later = 0.0 if math.isnan(clock) else t - clock
    again = not math.isnan(clock) and later <= SAME_TIME * abs(t)
    for i in range(first, c.group[g + 1]):
        c.stored[i], c.speed[i], c.soft[i], c.shed[i] = 0.0, 0.0, 0.0, 0.0
        for a in range(3):
            c.dent[i, a], c.drag[i, a], c.viscous[i, a] = 0.0, 0.0, 0.0
        if c.seen[i, 0] == 0 or c.free[i, 0] >= 0.0:
            continue
        c.chosen[first + count] = i
        count += 1
        _press(c, g, i, later, again)
        for k in range(3):
            for a in range(3):
                c.own[i, k] += c.force[i, a] * c.turned[i, a, k]
                c.moved[i, k] += c.dent[i, a] * c.turned[i, a, k]
                c.viscous[i, k] += c.drag[i, a] * c.turned[i, a, k]
    c.n_chosen[g] = count
    return count > 0


@inner
def _press(c: ContactTable, g: int, i: int, later: float, again: bool) -> None:
    """Find a point's force and its dent; at the last step's own state they are those of the step."""
    s, depth, r = c.surface[i], -c.free[i, 0], 0
    while r + 1 < c.law.shape[1] and c.law[s, r + 1, DEPTH] <= depth:
        r += 1
    ratio, power, share = depth / c.law[s, r, DEPTH], c.law[s, r, POWER], c.shares[i]
    elastic = share * c.law[s, r, LOAD] * ratio**power
    whole = c.law[s, r, LOAD] * c.law[s, r, DEPTH] / (power + 1.0)
    energy = c.law[s, r, STORED] + whole * ratio ** (power + 1.0)
    c.stored[i] = share * energy - 0.5 * elastic * depth
    c.areas[i], c.peak[i] = share * c.law[s, r, SIZE] * ratio ** c.law[s, r, GROWTH], c.law[s, r, PEAK]
    c.border[c.node[i]] = 1 if depth > c.ends[s] else 0
    soft, rate, lag, kept = c.slide[s] * depth / elastic, 0.0, 0.0, 1.0
    c.soft[i] = soft
    if again:
        c.speed[i] = c.speed_then[i]
        for a in range(3):
            c.dent[i, a], c.drag[i, a] = c.dent_then[i, a], c.drag_then[i, a]
    else:
        if later > 0.0 and c.seen[i, 1] == 1:
            rate, lag = (c.gap_then[i] + depth) / later, c.damping[g] / later
        c.speed[i] = max(c.speed_then[i], rate, 0.0)
        lost = c.damping[g] * rate / depth
        if c.speed[i] > 0.0:
            lost += c.loss[s] * rate / c.speed[i]
        c.dent[i, 0], c.drag[i, 0] = depth, elastic * max(-1.0, lost)
        kept = _keep_aside(c, i)
    c.force[i, 0] = c.drag[i, 0] + elastic
    bound, size = c.friction[s] * c.force[i, 0], 0.0
    for a in range(1, 3):
        if not again:
            c.dent[i, a] = -c.free[i, a] - (1.0 - kept) * c.dent_then[i, a]
            c.drag[i, a] = lag * (c.dent[i, a] - c.dent_then[i, a]) / soft
        c.force[i, a] = c.dent[i, a] / soft + c.drag[i, a]
        size += c.force[i, a] ** 2
    size = math.sqrt(size)
    if size > bound:
        for a in range(1, 3):
            c.force[i, a] *= bound / size
            c.dent[i, a] = (c.force[i, a] * soft + lag * c.dent_then[i, a]) / (1.0 + lag)
            c.drag[i, a] = c.force[i, a] - c.dent[i, a] / soft


@inner
def _keep_aside(c: ContactTable, i: int) -> float:
    """Return what is left of a point's deflection aside as it gets stiffer or softer, and note the energy that takes.

    A spring that gets stiffer keeps its force, one that gets softer its deflection: other ways round, energy would come
    out of nothing as bodies that rub are pressed together and let go (Mindlin & Deresiewicz 1953).
    """
    if c.soft_then[i] == 0.0:
        return 1.0
    square = c.dent_then[i, 1] ** 2 + c.dent_then[i, 2] ** 2
    kept = min(1.0, c.soft[i] / c.soft_then[i])
    if kept < 1.0:
        c.shed[i] = -0.5 * (1.0 - kept) * square / c.soft_then[i]  # of twice as much that is counted as slip
    else:
        c.shed[i] = 0.5 * square * (1.0 / c.soft_then[i] - 1.0 / c.soft[i])
    return float(kept)


@inner
def keep_round_points(c: ContactTable, g: int, begins: bool) -> None:
    """Add what a group's points have lost since the last step, and remember what the next one needs."""
    for i in range(c.group[g], c.group[g + 1]):
        v, heat = c.sums[c.contact[c.surface[i]]], 0.0
        for a in range(3):
            heat += 0.5 * (c.drag[i, a] + c.drag_then[i, a]) * (c.dent[i, a] - c.dent_then[i, a])
            c.dent_then[i, a], c.drag_then[i, a] = c.dent[i, a], c.drag[i, a]
            c.touched_then[i, a] = c.touched[i, a]
        if c.seen[i, 1] == 1 and not begins:
            v[DAMPED] += heat
            v[FRICTION] += c.shed[i]
            v[ERROR] += heat + c.shed[i]
        c.gap_then[i], c.speed_then[i] = c.free[i, 0], c.speed[i]
        c.soft_then[i] = c.soft[i]
    s = c.surface[c.group[g]]
    for k in range(12):
        c.frame_then[s, k] = c.frame[s, k]

"""Flexibility between the points of a group that may close: ``D = Σ ± w w' Q G Qᵀ`` over the nodes they move.

A force on a point moves its node, and the nodes below it the other way by their weights. Blocks stay as long as points
stay over their triangles and bodies keep their attitude to each other; those of planes are G's own.
"""

from __future__ import annotations

import math

from fmd.contact.dense import add_rows
from fmd.contact.nodes import n_nodes_below
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.core.limits.contact import STIFF_BELOW, TURNED_BLOCKS, TURNED_NORMALS, WIDER_BAND
from fmd.kernels.kernel import inner
from fmd.kernels.vectors import call_native


@inner
def choose_points(c: ContactTable, g: int) -> bool:
    """Choose the points of a group that may close, and bring the flexibilities between them up to date.

    Returns false if they are more than there is room for.

    All points of a damped group are chosen: one that comes to touch has to begin with the displacement by what presses
    others, or energy would come out of nothing.
    """
    first, last, changed = c.group[g], c.group[g + 1], False
    band = math.inf if c.damping[g] > 0.0 else c.band[g]
    for i in range(first, last):
        if c.seen[i, 0] == 0:
            changed = changed or c.slot[i] >= 0
        elif c.slot[i] < 0:
            changed = changed or c.free[i, 0] < band or was_pressed(c, i)
    count = c.n_chosen[g]
    if changed:
        count = _choose(c, g, WIDER_BAND * band)
        if count > c.width[g]:
            count = _choose(c, g, band)
        if not _has_columns(c, g, count):
            for i in range(first, last):
                c.slot[i] = -1
            c.n_chosen[g] = 0
            return False
        c.n_chosen[g], c.inverted[g], c.swept[g], c.kept[0] = count, 0, 0, -1
        for own in range(count):
            _note_pose(c, c.chosen[first + own])
            for other in range(own + 1):
                _set_block(c, g, own, other)
    elif not _has_columns(c, g, count):
        return False
    else:
        for own in range(count):
            i = c.chosen[first + own]
            if _is_stale(c, i):
                _note_pose(c, i)
                changed = True
                c.inverted[g], c.swept[g], c.kept[0] = 0, 0, -1
                for other in range(count):
                    if other <= own or not _is_stale(c, c.chosen[first + other]):  # whose turn comes
                        _set_block(c, g, own, other)
    if changed:
        c.n_factored[g] = -2
    return True


@inner
def _choose(c: ContactTable, g: int, band: float) -> int:
    """Choose the points of a group with gaps below a band, or with a force at the last step, and return how many."""
    count = 0
    for i in range(c.group[g], c.group[g + 1]):
        c.slot[i] = -1
        if c.seen[i, 0] == 1 and (c.free[i, 0] < band or was_pressed(c, i)):
            c.chosen[c.group[g] + count], c.slot[i] = i, count
            count += 1
    return count


@inner
def _has_columns(c: ContactTable, g: int, count: int) -> bool:
    """Return true if flexibilities of all nodes that chosen points move are at hand, after those new were found."""
    if c.grow == 0:
        return True
    missing = False
    for own in range(count):
        i = c.chosen[c.group[g] + own]
        missing = missing or c.column[c.node[i]] < 0
        for e in range(n_nodes_below(c, i)):
            missing = missing or c.column[c.foot[i, e]] < 0
    if count > c.width[g] or not missing:
        return bool(count <= c.width[g])
    for k in range(c.wanted.size):
        c.wanted[k] = 0
    for own in range(count):
        i = c.chosen[c.group[g] + own]
        c.wanted[c.node[i]] = 1
        for e in range(n_nodes_below(c, i)):
            c.wanted[c.foot[i, e]] = 1
    call_native(c.grow, (c.wanted, c.row, c.column, c.G))
    c.clock[1] = 4.0 if c.wanted[0] == 0 else c.clock[1]
    return bool(c.wanted[0] > 0)


@inner
def keep_along_normals(c: ContactTable, g: int) -> None:
    """Fill E and N, for forces along normals, where D or these have changed; N's factor is no more to be used then."""
    changed = c.n_factored[g] == -2
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        for k in range(3):
            changed = changed or abs(c.turned[i, 0, k] - c.normal_then[i, k]) > TURNED_NORMALS
    if changed:
        _set_along_normals(c, g)


@inner
def was_pressed(c: ContactTable, i: int) -> bool:
    """Return true if a point had a force at the last step."""
    return bool(c.known[i, 0] != 0.0 or c.known[i, 1] != 0.0 or c.known[i, 2] != 0.0)


@inner
def _is_stale(c: ContactTable, i: int) -> bool:
    """Return true if a point has gone on over the other body, or turned against it, since its blocks were found."""
    if c.master[c.surface[i]] < 0 or c.primitive[c.surface[i], 0] > 0.0 or _is_stiff_below(c, i):
        return False
    for a in range(3):
        if c.foot[i, a] != c.foot_then[i, a] or abs(c.weights[i, a] - c.weights_then[i, a]) > TURNED_BLOCKS:
            return True
        for b in range(3):
            if abs(c.Q[i, a, b] - c.Q_then[i, a, b]) > TURNED_BLOCKS:
                return True
    return False


@inner
def _is_stiff_below(c: ContactTable, i: int) -> bool:
    """Return true if nodes below a point, now and when its blocks were found, give way too little to change these."""
    own, below, at = 0.0, 0.0, c.node[i]
    for a in range(3):
        own += c.G[c.row[at], c.column[at], a, a]
    for e in range(n_nodes_below(c, i)):
        now, then = c.foot[i, e], c.foot_then[i, e]
        if then < 0 or c.column[then] < 0 or c.column[now] < 0:
            return False
        for a in range(3):
            below = max(below, c.G[c.row[now], c.column[now], a, a], c.G[c.row[then], c.column[then], a, a])
    return 3.0 * below < STIFF_BELOW * own


@inner
def _note_pose(c: ContactTable, i: int) -> None:
    for a in range(3):
        c.foot_then[i, a], c.weights_then[i, a] = c.foot[i, a], c.weights[i, a]
        for b in range(3):
            c.Q_then[i, a, b] = c.Q[i, a, b]


@inner
def _set_block(c: ContactTable, g: int, own: int, other: int) -> None:
    """Fill the block of D by which a force on one chosen point moves another, and its transpose."""
    first = c.group[g]
    i, j = c.chosen[first + own], c.chosen[first + other]
    s, r = c.surface[i], c.surface[j]
    _clear(c)
    if c.slave[s] == c.slave[r]:
        for a in range(3):
            for b in range(3):
                c.block[a, b] = c.G[c.row[c.node[i]], c.column[c.node[j]], a, b]
    if c.master[r] == c.slave[s]:
        for e in range(3):
            _add_product(c, c.node[i], c.foot_then[j, e], c.weights_then[j, e])
        _add_turned(c, i, j, False, True, -1.0)
    if c.master[s] == c.slave[r]:
        for e in range(3):
            _add_product(c, c.foot_then[i, e], c.node[j], c.weights_then[i, e])
        _add_turned(c, i, j, True, False, -1.0)
    if c.master[s] == c.master[r] and c.master[s] >= 0:
        for e in range(3):
            for d in range(3):
                _add_product(c, c.foot_then[i, e], c.foot_then[j, d], c.weights_then[i, e] * c.weights_then[j, d])
        _add_turned(c, i, j, True, True, 1.0)
    more = 1.0 + c.softness[s] if own == other else 1.0
    stride = c.stride[g]
    row, column = c.first_entry[g, 0] + 3 * own * stride + 3 * other, c.first_entry[g, 0] + 3 * other * stride + 3 * own
    for a in range(3):
        for b in range(3):
            c.D[row + a * stride + b] = more * c.block[a, b]
            c.D[column + b * stride + a] = more * c.block[a, b]


@inner
def _clear(c: ContactTable) -> None:
    for a in range(3):
        for b in range(3):
            c.block[a, b], c.product[a, b] = 0.0, 0.0


@inner
def _add_product(c: ContactTable, k: int, m: int, weight: float) -> None:
    """Add a weighted block of G, of two nodes of a body, to what is to be turned."""
    if weight != 0.0:
        for a in range(3):
            for b in range(3):
                c.product[a, b] += weight * c.G[c.row[k], c.column[m], a, b]


@inner
def _add_turned(c: ContactTable, i: int, j: int, left: bool, right: bool, sign: float) -> None:
    """Add ``sign Q_i product Q_jᵀ`` to the block, Q_i or Q_j where it is asked for, and clear the product."""
    for a in range(3):
        p0, p1, p2 = c.product[a, 0], c.product[a, 1], c.product[a, 2]
        if right:
            for b in range(3):
                c.product[a, b] = p0 * c.Q_then[j, b, 0] + p1 * c.Q_then[j, b, 1] + p2 * c.Q_then[j, b, 2]
    for b in range(3):
        p0, p1, p2 = c.product[0, b], c.product[1, b], c.product[2, b]
        for a in range(3):
            if left:
                c.block[a, b] += sign * (c.Q_then[i, a, 0] * p0 + c.Q_then[i, a, 1] * p1 + c.Q_then[i, a, 2] * p2)
            else:
                c.block[a, b] += sign * c.product[a, b]
    for a in range(3):
        for b in range(3):
            c.product[a, b] = 0.0


@inner
def _set_along_normals(c: ContactTable, g: int) -> None:
    first, count, stride = c.group[g], c.n_chosen[g], c.stride[g]
    size, n, e = c.width[g], c.first_entry[g, 1], c.first_entry[g, 0] // 3
    c.n_factored[g] = -1
    for own in range(count):
        i = c.chosen[first + own]
        for k in range(3):
            c.normal_then[i, k] = c.turned[i, 0, k]
    for own in range(count):
        i = c.chosen[first + own]
        row = e + own * stride
        for k in range(stride):
            c.E[row + k] = 0.0
        along_normal: Array = c.E[row:]
        add_rows(c, c.D, g, own, c.normal_then[i, 0], c.normal_then[i, 1], c.normal_then[i, 2], along_normal)
        for other in range(own + 1):
            j, at = c.chosen[first + other], row + 3 * other
            along = c.E[at] * c.normal_then[j, 0] + c.E[at + 1] * c.normal_then[j, 1]
            along += c.E[at + 2] * c.normal_then[j, 2]
            c.N[n + own * size + other] = along
            c.N[n + other * size + own] = along

"""Loads on frames and modes of bodies by forces on points: equal and opposite, at one place in space."""

from __future__ import annotations

from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array
from fmd.kernels.kernel import inner


@inner
def push_bodies(c: ContactTable, g: int, q: Array, origins: Array, rotations: Array) -> None:
    """Gather what the forces on a group's points do to the frames and modes of the bodies.

    They act on points where these are with their displacement by the forces, as the potential's derivative says, and at
    the same places on the other body, so that the momentum of both doesn't change.
    """
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        if c.force[i, 0] != 0.0:
            if c.rounded[c.surface[i]] == 0:
                place_force(c, i, _moving_share(c, g, own), rotations[c.link[c.slave[c.surface[i]]]])
            push_at_point(c, i, origins, rotations)


@inner
def push_at_point(c: ContactTable, i: int, origins: Array, rotations: Array) -> None:
    """Add what the force on a point, where it acts, does to the frames and modes of both bodies."""
    s = c.surface[i]
    body, other = c.slave[s], c.master[s]
    _push_frame(c, i, c.link[body], c.own[i, 0], c.own[i, 1], c.own[i, 2], origins, rotations)
    _push_modes(c, c.node[i], body, c.own[i, 0], c.own[i, 1], c.own[i, 2])
    if other >= 0:
        f0 = -(c.Q[i, 0, 0] * c.own[i, 0] + c.Q[i, 1, 0] * c.own[i, 1] + c.Q[i, 2, 0] * c.own[i, 2])
        f1 = -(c.Q[i, 0, 1] * c.own[i, 0] + c.Q[i, 1, 1] * c.own[i, 1] + c.Q[i, 2, 1] * c.own[i, 2])
        f2 = -(c.Q[i, 0, 2] * c.own[i, 0] + c.Q[i, 1, 2] * c.own[i, 1] + c.Q[i, 2, 2] * c.own[i, 2])
        _push_frame(c, i, c.link[other], f0, f1, f2, origins, rotations)
        for e in range(3 if c.primitive[s, 0] == 0.0 else 0):
            w = c.weights[i, e]
            _push_modes(c, c.foot[i, e], other, w * f0, w * f1, w * f2)


@inner
def _moving_share(c: ContactTable, g: int, own: int) -> float:
    """Return the part of the displacement against what a chosen point touches that is its own."""
    i = c.chosen[c.group[g] + own]
    if c.master[c.surface[i]] < 0:
        return 1.0
    k, at = c.node[i], c.first_entry[g, 0] + 3 * own * (c.stride[g] + 1)
    r, m = c.row[k], c.column[k]
    whole = c.D[at] + c.D[at + c.stride[g] + 1] + c.D[at + 2 * c.stride[g] + 2]
    return float((c.G[r, m, 0, 0] + c.G[r, m, 1, 1] + c.G[r, m, 2, 2]) / whole)


@inner
def place_force(c: ContactTable, i: int, moving: float, R: Array) -> None:
    """Find where the force on a point acts, of whose displacement a part is its own; R turns its body into space."""
    for a in range(3):
        c.at[i, a] = c.place[c.node[i], a]
        for b in range(3):
            c.at[i, a] += moving * R[a, b] * c.moved[i, b]


@inner
def _push_frame(
    c: ContactTable, i: int, link: int, f0: float, f1: float, f2: float, origins: Array, rotations: Array
) -> None:
    """Add a force in a body's axes, at the place of a point, to what acts on the body's frame."""
    d0, d1, d2 = c.at[i, 0] - origins[link, 0], c.at[i, 1] - origins[link, 1], c.at[i, 2] - origins[link, 2]
    x0 = rotations[link, 0, 0] * d0 + rotations[link, 1, 0] * d1 + rotations[link, 2, 0] * d2
    x1 = rotations[link, 0, 1] * d0 + rotations[link, 1, 1] * d1 + rotations[link, 2, 1] * d2
    x2 = rotations[link, 0, 2] * d0 + rotations[link, 1, 2] * d1 + rotations[link, 2, 2] * d2
    c.push[link, 0] += f0
    c.push[link, 1] += f1
    c.push[link, 2] += f2
    c.push[link, 3] += x1 * f2 - x2 * f1
    c.push[link, 4] += x2 * f0 - x0 * f2
    c.push[link, 5] += x0 * f1 - x1 * f0


@inner
def _push_modes(c: ContactTable, k: int, body: int, f0: float, f1: float, f2: float) -> None:
    """Add a force on a node, in its body's axes, to what acts on the body's modes."""
    for m in range(c.n_modes[body]):
        work = c.shapes[k, 0, m] * f0 + c.shapes[k, 1, m] * f1 + c.shapes[k, 2, m] * f2
        c.modal[c.mode[body, m]] += work

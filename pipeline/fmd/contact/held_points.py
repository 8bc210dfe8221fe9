"""Forces on points beside a state whose forces are known, with those points closed that are closed there.

With the closed set held, gaps ``g_c = y_c + N_cc λ_c = 0`` give ``δλ_c = −N_cc⁻¹ (δy_c + δN_cc λ_c)``, by the factor of
N_cc that has found λ. Half the difference of forces at two states on either side of it is the derivative: forces are
linear in gaps and in flexibilities here, so that only turns and places leave an error, of the third power of the way.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fmd.contact.dense import solve_active
from fmd.contact.nodes import n_nodes_below
from fmd.contact.places import place_surface
from fmd.contact.pushes import push_at_point
from fmd.contact.round_laws import DEPTH, LOAD, POWER
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.kernels.kernel import inner
from fmd.kernels.table import Table


@dataclass(frozen=True)
class HeldRoom(Table):
    """How the pose that flexibilities were found with changes along eight directions, and room for displacements.

    They are kept while bodies turn and move little, so that their tangents are those of the step that found them.
    """

    dnormal: Array  # (8, n, 3): tangents of points' normals then
    dQ: Array  # (8, n, 3, 3): of turns from the other body's axes
    dweights: Array  # (8, n, 3): of nodes below
    normal_last: Array  # (n, 3): these three when tangents were last found
    Q_last: Array  # (n, 3, 3)
    weights_last: Array  # (n, 3)
    fresh: IntArray  # (n, 2): 1 if the normal, or the rest, has been found anew since
    normal: Array  # (n, 3): the three, along a direction
    Q: Array  # (n, 3, 3)
    weights: Array  # (n, 3)
    pushes: Array  # (n, 3): forces on points, in own axes
    forces: Array  # (n_nodes, 3): on nodes, in their bodies' axes
    moved: Array  # (n, 3): displacements of points, in own axes
    known: Array  # (n,): by the known forces, along the normal
    way: Array  # (3,)


def held_room(c: ContactTable, lanes: int) -> HeldRoom:
    """Return room for the points of a table, and so many directions."""
    n, shapes = len(c.node), {"normal": (3,), "Q": (3, 3), "weights": (3,)}
    room: dict[str, Any] = {name: np.zeros((n, *shape)) for name, shape in shapes.items()}
    room |= {f"d{name}": np.zeros((lanes, n, *shape)) for name, shape in shapes.items()}
    room |= {f"{name}_last": np.full((n, *shape), np.nan) for name, shape in shapes.items()}
    room |= {"fresh": np.zeros((n, 2), dtype=np.int64), "forces": np.zeros((len(c.x), 3)), "known": np.zeros(n)}
    return HeldRoom(**room, pushes=np.zeros((n, 3)), moved=np.zeros((n, 3)), way=np.zeros(3))


@inner
def place_beside(near: ContactTable, q: Array, origins: Array, rotations: Array) -> None:
    """Find where points stand at positions q, with the bodies' frames."""
    near.state[0] += 1
    for s in range(near.slave.size):
        place_surface(near, s, q, origins, rotations)


@inner
def press_held(
    c: ContactTable,
    near: ContactTable,
    way: float,
    lane: int,
    along: int,
    dG: Array,
    soft: int,
    m: HeldRoom,
    origins: Array,
    rotations: Array,
) -> None:
    """Find what pushes the bodies at the state beside that of c that `place_beside` has seen, with its points closed.

    That is along the tangent of positions if ``along`` is 1; nodes are more flexible there by ``way`` times dG if
    ``soft`` is 1.
    """
    for g in range(c.noise.size):
        if not is_pressed(c, g):
            continue
        if c.rounded[c.surface[c.group[g]]] == 1:
            _press_round_points(c, near, g)
        else:
            _find_pose(c, near, g, way, lane, along, m)
            _press_points(c, near, g, way, dG, soft, m)
        for own in range(c.n_chosen[g]):
            i = c.chosen[c.group[g] + own]
            if c.force[i, 0] != 0.0:
                if c.rounded[c.surface[i]] == 0:
                    _place_force(c, near, i, way, dG, soft, m, rotations)
                push_at_point(near, i, origins, rotations)


@inner
def is_pressed(c: ContactTable, g: int) -> bool:
    """Return true if a point of a group has a force."""
    pressed = False
    for own in range(c.n_chosen[g]):
        pressed = pressed or c.force[c.chosen[c.group[g] + own], 0] != 0.0
    return bool(pressed)


@inner
def displace_held(c: ContactTable, m: HeldRoom) -> None:
    """Find how far the known forces move points along their normals, as flexibilities were found."""
    for g in range(c.noise.size):
        if is_pressed(c, g) and c.rounded[c.surface[c.group[g]]] == 0:
            for own in range(c.n_chosen[g]):
                i = c.chosen[c.group[g] + own]
                _note_fresh(c, i, m)
                for k in range(3):
                    m.normal[i, k], m.weights[i, k] = c.normal_then[i, k], c.weights_then[i, k]
                    m.pushes[i, k] = c.force[i, 0] * c.normal_then[i, k]
                    for b in range(3):
                        m.Q[i, k, b] = c.Q_then[i, k, b]
            _displace(c, g, 0.0, c.G, 0, m)
            for own in range(c.n_chosen[g]):
                i = c.chosen[c.group[g] + own]
                m.known[i] = _along_normal(i, m)


@inner
def _note_fresh(c: ContactTable, i: int, m: HeldRoom) -> None:
    """Note whether a point's normal, or the rest of its pose, is another one than when tangents were last found."""
    m.fresh[i, 0], m.fresh[i, 1] = 0, 0
    for k in range(3):
        if m.normal_last[i, k] != c.normal_then[i, k]:
            m.fresh[i, 0], m.normal_last[i, k] = 1, c.normal_then[i, k]
        if m.weights_last[i, k] != c.weights_then[i, k]:
            m.fresh[i, 1], m.weights_last[i, k] = 1, c.weights_then[i, k]
        for b in range(3):
            if m.Q_last[i, k, b] != c.Q_then[i, k, b]:
                m.fresh[i, 1], m.Q_last[i, k, b] = 1, c.Q_then[i, k, b]
    for lane in range(m.dnormal.shape[0]):
        for k in range(3):
            m.dnormal[lane, i, k] *= 1.0 - m.fresh[i, 0]
            m.dweights[lane, i, k] *= 1.0 - m.fresh[i, 1]
            for b in range(3):
                m.dQ[lane, i, k, b] *= 1.0 - m.fresh[i, 1]


@inner
def _along_normal(i: int, m: HeldRoom) -> float:
    return float(m.normal[i, 0] * m.moved[i, 0] + m.normal[i, 1] * m.moved[i, 1] + m.normal[i, 2] * m.moved[i, 2])


@inner
def _find_pose(c: ContactTable, near: ContactTable, g: int, way: float, lane: int, along: int, m: HeldRoom) -> None:
    """Find the pose that flexibilities would have been found with, and its tangents where that is now."""
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        seen = 1.0 if near.seen[i, 0] == 1 else 0.0
        same = seen
        for k in range(3):
            same = same if near.foot[i, k] == c.foot[i, k] else 0.0
        for k in range(3):
            turned, weight = (
                seen * (near.turned[i, 0, k] - c.turned[i, 0, k]),
                same * (near.weights[i, k] - c.weights[i, k]),
            )
            if m.fresh[i, 0] == 1:
                m.dnormal[lane, i, k] += 0.5 * turned / way
            else:
                turned = along * way * m.dnormal[lane, i, k]
            if m.fresh[i, 1] == 1:
                m.dweights[lane, i, k] += 0.5 * weight / way
            else:
                weight = along * way * m.dweights[lane, i, k]
            m.normal[i, k], m.weights[i, k] = c.normal_then[i, k] + turned, c.weights_then[i, k] + weight
            m.pushes[i, k] = c.force[i, 0] * m.normal[i, k]
            for b in range(3):
                turn = same * (near.Q[i, k, b] - c.Q[i, k, b])
                if m.fresh[i, 1] == 1:
                    m.dQ[lane, i, k, b] += 0.5 * turn / way
                else:
                    turn = along * way * m.dQ[lane, i, k, b]
                m.Q[i, k, b] = c.Q_then[i, k, b] + turn


@inner
def _gap_beside(c: ContactTable, near: ContactTable, i: int) -> float:
    return float(near.free[i, 0] if near.seen[i, 0] == 1 else c.free[i, 0])


@inner
def _turn_force(near: ContactTable, i: int, force: float) -> None:
    near.force[i, 0] = force
    for k in range(3):
        near.own[i, k] = force * near.turned[i, 0, k]


@inner
def _press_round_points(c: ContactTable, near: ContactTable, g: int) -> None:
    """Find forces that are linear in depths and in the numbers of laws."""
    for own in range(c.n_chosen[g]):
        i = c.chosen[c.group[g] + own]
        s, depth, r = c.surface[i], -c.free[i, 0], 0
        while r + 1 < c.law.shape[1] and c.law[s, r + 1, DEPTH] <= depth:
            r += 1
        deeper = (-_gap_beside(c, near, i) - depth) / depth
        deeper -= (near.law[s, r, DEPTH] - c.law[s, r, DEPTH]) / c.law[s, r, DEPTH]
        more = c.law[s, r, POWER] * deeper + (near.law[s, r, LOAD] - c.law[s, r, LOAD]) / c.law[s, r, LOAD]
        more += (near.law[s, r, POWER] - c.law[s, r, POWER]) * math.log(depth / c.law[s, r, DEPTH])
        more += (near.shares[i] - c.shares[i]) / c.shares[i]
        _turn_force(near, i, (1.0 + more) * c.force[i, 0])


@inner
def _press_points(c: ContactTable, near: ContactTable, g: int, way: float, dG: Array, soft: int, m: HeldRoom) -> None:
    """Find the forces on the closed points of a group, and its points' displacements."""
    first = c.group[g]
    _displace(c, g, way, dG, soft, m)
    for k in range(c.n_factored[g]):
        i = c.chosen[first + c.factored[first + k]]
        c.b[k] = m.known[i] - _along_normal(i, m) - (_gap_beside(c, near, i) - c.free[i, 0])
    solve_active(c, g)
    for own in range(c.n_chosen[g]):
        _turn_force(near, c.chosen[first + own], 0.0)
    for k in range(c.n_factored[g]):
        i = c.chosen[first + c.factored[first + k]]
        _turn_force(near, i, c.force[i, 0] + c.b[k])
    for own in range(c.n_chosen[g]):
        i = c.chosen[first + own]
        for k in range(3):
            m.pushes[i, k] = near.force[i, 0] * m.normal[i, k]
    _displace(c, g, way, dG, soft, m)
    for own in range(c.n_chosen[g]):
        i = c.chosen[first + own]
        for k in range(3):
            near.moved[i, k] = m.moved[i, k]


@inner
def _place_force(
    c: ContactTable, near: ContactTable, i: int, way: float, dG: Array, soft: int, m: HeldRoom, rotations: Array
) -> None:
    """Find where the force on a point acts: at the place that its own body's part of the flexibility gives it."""
    s, k, moving = c.surface[i], c.node[i], 1.0
    if c.master[s] >= 0:
        own = _trace(c, k, k, way, dG, soft)
        whole = own
        for e in range(3 if c.primitive[s, 0] == 0.0 else 0):
            for d in range(3):
                both = _trace(c, c.foot_then[i, e], c.foot_then[i, d], way, dG, soft)
                whole += m.weights[i, e] * m.weights[i, d] * both
        moving = own / ((1.0 + c.softness[s]) * whole)
    link = c.link[c.slave[s]]
    for a in range(3):
        near.at[i, a] = near.place[k, a]
        for b in range(3):
            near.at[i, a] += moving * rotations[link, a, b] * near.moved[i, b]


@inner
def _trace(c: ContactTable, k: int, other: int, way: float, dG: Array, soft: int) -> float:
    total = 0.0
    for a in range(3):
        total += _entry(c, k, other, a, a, way, dG, soft)
    return float(total)


@inner
def _displace(c: ContactTable, g: int, way: float, dG: Array, soft: int, m: HeldRoom) -> None:
    """Find displacements of a group's points by forces on them."""
    first = c.group[g]
    for k in range(m.forces.shape[0]):
        for a in range(3):
            m.forces[k, a] = 0.0
    for own in range(c.n_chosen[g]):
        i = c.chosen[first + own]
        if c.force[i, 0] != 0.0:
            _add_forces(c, i, m)
    for own in range(c.n_chosen[g]):
        i = c.chosen[first + own]
        s, k = c.surface[i], c.node[i]
        _move_node(c, k, c.slave[s], way, dG, soft, m)
        for a in range(3):
            m.moved[i, a] = m.way[a]
        if c.softness[s] > 0.0 and c.force[i, 0] != 0.0:
            _move_softly(c, i, way, dG, soft, m)
        for e in range(n_nodes_below(c, i)):
            _move_node(c, c.foot_then[i, e], c.master[s], way, dG, soft, m)
            for a in range(3):
                for b in range(3):
                    m.moved[i, a] -= m.weights[i, e] * m.Q[i, a, b] * m.way[b]


@inner
def _add_forces(c: ContactTable, i: int, m: HeldRoom) -> None:
    """Add the force on a point to those of its node, and the opposite one to the nodes below."""
    for b in range(3):
        m.forces[c.node[i], b] += m.pushes[i, b]
    for e in range(n_nodes_below(c, i)):
        for b in range(3):
            for k in range(3):
                m.forces[c.foot_then[i, e], b] -= m.weights[i, e] * m.Q[i, k, b] * m.pushes[i, k]


@inner
def _move_node(c: ContactTable, k: int, body: int, way: float, dG: Array, soft: int, m: HeldRoom) -> None:
    """Find a node's displacement by the forces on all nodes of its body."""
    for a in range(3):
        m.way[a] = 0.0
    for j in range(c.first[body], c.first[body + 1]):
        if m.forces[j, 0] != 0.0 or m.forces[j, 1] != 0.0 or m.forces[j, 2] != 0.0:
            for a in range(3):
                for b in range(3):
                    m.way[a] += c.G[c.row[k], c.column[j], a, b] * m.forces[j, b]
                    if soft == 1:
                        m.way[a] += way * dG[c.row[k], c.column[j], a, b] * m.forces[j, b]


@inner
def _move_softly(c: ContactTable, i: int, way: float, dG: Array, soft: int, m: HeldRoom) -> None:
    """Add what a point on an edge moves more by its own force."""
    s, k = c.surface[i], c.node[i]
    for a in range(3):
        for b in range(3):
            m.moved[i, a] += c.softness[s] * _entry(c, k, k, a, b, way, dG, soft) * m.pushes[i, b]
            below = 0.0
            for e in range(3):
                for d in range(3):
                    own = _entry(c, c.foot_then[i, e], c.foot_then[i, d], a, b, way, dG, soft)
                    below += c.softness[s] * m.weights[i, e] * m.weights[i, d] * own
            for o in range(3):
                for r in range(3):
                    m.moved[i, o] += m.Q[i, o, a] * below * m.Q[i, r, b] * m.pushes[i, r]


@inner
def _entry(c: ContactTable, k: int, other: int, a: int, b: int, way: float, dG: Array, soft: int) -> float:
    row, at = c.row[k], c.column[other]
    return float(c.G[row, at, a, b] + (way * dG[row, at, a, b] if soft == 1 else 0.0))

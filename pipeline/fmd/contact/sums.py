"""Values of contacts at a state, and what of them adds up from step to step."""

from __future__ import annotations

import math

from fmd.contact.compliances import was_pressed
from fmd.contact.damping import keep_damping, mark_border
from fmd.contact.histories import (
    AREA,
    BEGIN,
    END,
    ENERGY,
    ERROR,
    FORCE,
    FORCE_AT,
    FRICTION,
    IMPULSE,
    MEAN_SLIP,
    MOMENT,
    MOST_AREA,
    MOST_FORCE,
    MOST_PRESSURE,
    MOST_WORN,
    N_VALUES,
    PRESSURE,
    PRESSURE_AT,
    SLIP,
    WORN,
)
from fmd.contact.nodes import n_nodes_below
from fmd.contact.round_points import keep_round_points
from fmd.contact.tables import ContactTable
from fmd.contact.travel import travel
from fmd.core.arrays import Array
from fmd.kernels.kernel import inner


@inner
def evaluate_contacts(c: ContactTable, t: float, origins: Array, rotations: Array) -> None:
    """Fill the values of all contacts at the state that `touch` has seen, a time t after the last step's or its own."""
    later = 0.0 if math.isnan(c.clock[0]) else t - c.clock[0]
    for k in range(c.now.shape[0]):
        for j in range(c.now.shape[1]):
            c.now[k, j] = 0.0
        for j in range(FRICTION, N_VALUES):
            c.now[k, j] = c.sums[k, j]
        for a in range(3):
            c.now[k, IMPULSE + a] = c.sums[k, IMPULSE + a] + later * c.sums[k, FORCE + a]
    for i in range(c.force.shape[0]):
        if c.force[i, 0] != 0.0:
            _add_values(c, i, origins, rotations)
        if c.seen[i, 0] == 1:
            for a in range(3):
                c.now[c.contact[c.surface[i]], ENERGY] += 0.5 * (c.own[i, a] - c.viscous[i, a]) * c.moved[i, a]
            c.now[c.contact[c.surface[i]], ENERGY] += c.stored[i]
    for k in range(c.now.shape[0]):
        v = c.now[k]
        force = math.sqrt(v[FORCE] ** 2 + v[FORCE + 1] ** 2 + v[FORCE + 2] ** 2)
        if force > v[MOST_FORCE]:
            v[MOST_FORCE], v[FORCE_AT] = force, t
        if v[PRESSURE] > v[MOST_PRESSURE]:
            v[MOST_PRESSURE], v[PRESSURE_AT] = v[PRESSURE], t
        v[MOST_AREA] = max(v[MOST_AREA], v[AREA])


@inner
def _add_values(c: ContactTable, i: int, origins: Array, rotations: Array) -> None:
    """Add what the force on a point has in the values of its contact."""
    s = c.surface[i]
    k = c.contact[s]
    v, link = c.now[k], c.carrier[k]
    n, t1, t2 = c.sign[s] * c.force[i, 0], c.sign[s] * c.force[i, 1], c.sign[s] * c.force[i, 2]
    f0 = c.axes[i, 0, 0] * n + c.axes[i, 1, 0] * t1 + c.axes[i, 2, 0] * t2
    f1 = c.axes[i, 0, 1] * n + c.axes[i, 1, 1] * t1 + c.axes[i, 2, 1] * t2
    f2 = c.axes[i, 0, 2] * n + c.axes[i, 1, 2] * t1 + c.axes[i, 2, 2] * t2
    x0, x1, x2 = c.at[i, 0], c.at[i, 1], c.at[i, 2]
    if link < 0:
        x0, x1, x2 = x0 - c.centre[k, 0], x1 - c.centre[k, 1], x2 - c.centre[k, 2]
    else:
        m0, m1, m2, R = c.centre[k, 0], c.centre[k, 1], c.centre[k, 2], rotations[link]
        x0 -= origins[link, 0] + R[0, 0] * m0 + R[0, 1] * m1 + R[0, 2] * m2
        x1 -= origins[link, 1] + R[1, 0] * m0 + R[1, 1] * m1 + R[1, 2] * m2
        x2 -= origins[link, 2] + R[2, 0] * m0 + R[2, 1] * m1 + R[2, 2] * m2
    v[FORCE] += f0
    v[FORCE + 1] += f1
    v[FORCE + 2] += f2
    v[MOMENT] += x1 * f2 - x2 * f1
    v[MOMENT + 1] += x2 * f0 - x0 * f2
    v[MOMENT + 2] += x0 * f1 - x1 * f0
    if c.areas[i] > 0.0:
        v[AREA] += c.areas[i]
        v[PRESSURE] = max(v[PRESSURE], c.peak[i] * (c.force[i, 0] - c.drag[i, 0]) / c.areas[i])


@inner
def copy_forces(c: ContactTable, forces: Array) -> None:
    """Fill the forces of contacts at the state that `evaluate_contacts` has seen, three each."""
    for k in range(c.now.shape[0]):
        for a in range(3):
            forces[3 * k + a] = c.now[k, FORCE + a]


@inner
def replace_impulses(c: ContactTable, impulses: Array) -> None:
    """Put impulses, three to a contact, in the place of those that were summed up."""
    for k in range(c.now.shape[0]):
        for a in range(3):
            c.sums[k, IMPULSE + a] = impulses[3 * k + a]


@inner
def note_values(c: ContactTable, values: Array) -> None:
    """Write what `fmd.contact.recorded.ContactRecord` reads, of the state that `evaluate_contacts` has seen.

    Where several contacts press a node, its pressure and slip are the largest. Largest values begin anew here.
    """
    n, nodes, n_values = c.now.shape[0], c.x.shape[0], c.now.shape[1]
    for k in range(n):
        for j in range(n_values):
            values[n_values * k + j] = c.now[k, j]
        c.sums[k, MOST_FORCE], c.sums[k, MOST_AREA], c.sums[k, MOST_PRESSURE] = 0.0, 0.0, 0.0
    pressures = n_values * n
    forces = pressures + nodes
    for k in range(pressures, forces + 3 * nodes):
        values[k] = 0.0
    for i in range(c.node.size):
        if c.areas[i] > 0.0:
            at = pressures + c.node[i]
            values[at] = max(values[at], c.peak[i] * (c.force[i, 0] - c.drag[i, 0]) / c.areas[i])
        if c.force[i, 0] != 0.0:
            _note_force(c, i, forces, values)
    at = forces + 3 * nodes
    for body in range(c.link.size):
        for k in range(6):
            values[at + k] = c.push[c.link[body], k]
        at += 6
    for body in range(c.link.size):
        for m in range(c.n_modes[body]):
            values[at + m] = c.modal[c.mode[body, m]]
        at += c.n_modes[body]
    for k in range(nodes):
        values[at + k] = 0.0
    for i in range(c.node.size):
        values[at + c.node[i]] = max(values[at + c.node[i]], c.slid[i])
    at += nodes
    for k in range(c.worn.size):
        values[at + k] = c.worn[k]
    if c.travel != 0:
        at += c.worn.size
        for k in range(nodes):
            for a in range(3):
                values[at + 3 * k + a] = c.x[k, a]


@inner
def _note_force(c: ContactTable, i: int, first: int, values: Array) -> None:
    """Add the force on a point to that of its node, and its opposite to the corners of the triangle below."""
    for b in range(3):
        values[first + 3 * c.node[i] + b] += c.own[i, b]
        back = c.Q[i, 0, b] * c.own[i, 0] + c.Q[i, 1, b] * c.own[i, 1] + c.Q[i, 2, b] * c.own[i, 2]
        for e in range(n_nodes_below(c, i)):
            values[first + 3 * c.foot[i, e] + b] -= c.weights[i, e] * back


@inner
def remember(c: ContactTable, t: float, origins: Array, rotations: Array) -> None:
    """Take the forces that `touch` has found as those of a step at time t, and add up what they did since the last.

    A leapfrog step changes the kinetic energy by the trapezoids of ``λ`` over ``y``, exactly; that and the changes of
    the potential and of friction's and damping's heat should cancel. What is left is energy that the steps have made.
    """
    begins = math.isnan(c.clock[0])
    later = 0.0 if begins else t - c.clock[0]
    for k in range(c.now.shape[0]):
        c.sums[k, ERROR] -= c.sums[k, ENERGY]
    evaluate_contacts(c, t, origins, rotations)
    for k in range(c.now.shape[0]):
        v, s = c.now[k], c.sums[k]
        for a in range(3):
            s[IMPULSE + a] += later * ((1.0 - c.end_share[0]) * s[FORCE + a] + c.end_share[0] * v[FORCE + a])
            s[FORCE + a] = v[FORCE + a]
        if v[FORCE] != 0.0 or v[FORCE + 1] != 0.0 or v[FORCE + 2] != 0.0:
            s[BEGIN] = t if math.isnan(s[BEGIN]) else s[BEGIN]
            s[END] = t
        s[MOST_FORCE], s[MOST_AREA], s[MOST_PRESSURE] = v[MOST_FORCE], v[MOST_AREA], v[MOST_PRESSURE]
        s[FORCE_AT], s[PRESSURE_AT] = v[FORCE_AT], v[PRESSURE_AT]
        s[ENERGY] = v[ENERGY]
        s[ERROR] = 0.0 if begins else s[ERROR] + v[ENERGY]
    for number in range(c.slave.size):
        way = abs(c.height[number, 0] - c.height[number, 1])
        if way < math.inf:
            c.pace[number] = max(way, 0.5 * c.pace[number] if c.pace[number] < math.inf else 0.0)
        c.height[number, 1] = c.height[number, 0]
    for g in range(c.noise.size):
        if c.rounded[c.surface[c.group[g]]] == 1:
            keep_round_points(c, g, begins)
        elif c.damping[g] > 0.0:
            keep_damping(c, g, begins)
    for i in range(c.node.size):
        if c.seen[i, 0] == 1:
            _add_work(c, i, begins)
            mark_border(c, i)
        c.seen[i, 1] = c.seen[i, 0]
    _sum_up_slip(c)
    c.clock[0] = t
    travel(c, rotations)


@inner
def _sum_up_slip(c: ContactTable) -> None:
    """Find the longest way that a point of each contact has slipped, and the mean by areas of those that have."""
    for k in range(c.now.shape[0]):
        c.now[k, AREA] = 0.0
        c.sums[k, MEAN_SLIP] = 0.0  # the longest way may be that of a point which has left a grid
    for i in range(c.node.size):
        if c.slid[i] > 0.0:
            s = c.surface[i]
            k, area = c.contact[s], 1.0 if c.rounded[s] == 1 else c.areas[i]
            c.now[k, AREA] += area
            c.sums[k, SLIP] = max(c.sums[k, SLIP], c.slid[i])
            c.sums[k, MEAN_SLIP] += area * c.slid[i]
    for k in range(c.now.shape[0]):
        if c.now[k, AREA] > 0.0:
            c.sums[k, MEAN_SLIP] /= c.now[k, AREA]


@inner
def _wear(c: ContactTable, i: int, slip: float) -> None:
    """Let a point's force, over a slip, take from both faces (Archard, J Appl Phys 24, 1953)."""
    k, s = c.node[i], c.surface[i]
    v, volume = c.sums[c.contact[s]], c.wear[s] * c.force[i, 0] * slip
    v[WORN] += volume
    c.worn[k] += volume
    if c.rounded[s] == 0 and c.areas[i] > 0.0:
        v[MOST_WORN] = max(v[MOST_WORN], c.worn[k] / c.areas[i])
    for e in range(n_nodes_below(c, i)):
        c.worn[c.foot[i, e]] += c.weights[i, e] * volume


@inner
def _add_work(c: ContactTable, i: int, begins: bool) -> None:
    """Add the work of the force on a point since the last step, and remember it; vectors are in the other's frame."""
    s, work, heat = c.sums[c.contact[c.surface[i]]], 0.0, 0.0
    goes_on = c.seen[i, 1] == 1 and not begins
    rubs, moved, along = goes_on and c.force[i, 0] > 0.0 and was_pressed(c, i), 0.0, 0.0
    moves = c.moved[i, 0] != 0.0 or c.moved[i, 1] != 0.0 or c.moved[i, 2] != 0.0 or c.force[i, 0] != 0.0
    for b in range(3):
        force, across, tip, normal = 0.0, 0.0, c.spot[i, b], 0.0
        for k in range(3 if moves else 0):
            tip += c.Q[i, k, b] * c.moved[i, k]
            force += c.Q[i, k, b] * c.own[i, k]
            across += c.Q[i, k, b] * (c.own[i, k] - c.force[i, 0] * c.turned[i, 0, k])
            normal += c.Q[i, k, b] * c.turned[i, 0, k]
        moved += (tip - c.tip[i, b]) ** 2
        along += (tip - c.tip[i, b]) * normal
        heat -= across * (tip - c.tip[i, b])
        mean = (1.0 - c.end_share[0]) * c.known[i, b] + c.end_share[0] * force
        work += mean * (c.spot[i, b] - c.before[i, b])
        c.tip[i, b], c.before[i, b], c.known[i, b] = tip, c.spot[i, b], force
    if rubs:
        slip = math.sqrt(max(0.0, moved - along * along))
        c.slid[i] += slip
        if c.wear[c.surface[i]] > 0.0:
            _wear(c, i, slip)
    if goes_on:
        s[FRICTION] += heat
        s[ERROR] += work + heat

"""Eight tangents of a mechanism whose bodies touch without losses: points that are closed stay so for each step's own.

How forces of contacts change along a direction is half the difference of those at states to either side of the motion's
own, of places, rotations, loads and the contacts' numbers together, with its closed points.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from fmd.contact.approach import any_force
from fmd.contact.held_points import HeldRoom, displace_held, held_room, place_beside, press_held
from fmd.contact.sums import note_values, remember
from fmd.contact.tables import ContactTable
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import NUMBERS_BESIDE, TOO_LITTLE_BESIDE, WAY_BESIDE
from fmd.dynamics.compiled_system.closed_tangents import ClosedTangentParameters
from fmd.dynamics.compiled_system.tangent_kernels import (
    TangentParameters,
    change_pushes,
    change_residual,
    pulled,
    set_time,
    take_state,
    variant_residual,
)
from fmd.dynamics.compiled_system.touching import CONTACT_NUMBERS, TouchingSystem
from fmd.dynamics.compiler.program import LANES
from fmd.dynamics.system import accelerations, note_contacts, remember_contacts, remember_found
from fmd.kernels.arrays import clear
from fmd.kernels.kernel import inner
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class StatesBeside(Table):
    """States beside a motion's own along its tangents, and how contacts change there."""

    contact: ContactTable  # there, whose numbers are one array
    numbers: Array  # (n_numbers,): that array
    own_numbers: Array  # (n_numbers,): those of the motion's own contacts
    dnumbers: Array  # (8, n_numbers): and their tangents
    used: IntArray  # (8,): 1 for directions that there are
    changes: IntArray  # (8,): 1 for those with numbers of contacts or of the mechanism
    soft: IntArray  # (8,): place in dG, -1 where flexibilities stay
    dG: Array  # (any, n_nodes, most, 3, 3)
    frames: IntArray  # (32,): addresses of the compiled functions of mechanisms beside the own one
    felt: IntArray  # (32,)
    q: Array  # a state
    v: Array
    inputs: Array
    origins: Array  # the bodies' frames there
    rotations: Array
    spins: Array
    moving: Array  # (n_moving,): origins, rotations, and forces on markers that the contact has
    dmoving: Array  # (8 n_moving,): tangents of these by numbers of the mechanism alone, one after the other
    held: HeldRoom
    modal: Array  # (n,): forces of contacts on modes, with a variant's signs
    forces: Array  # (6 n_bodies + n,): what contacts push frames and modes by, there
    dforces: Array  # (8 (6 n_bodies + n),): tangents of that, the two lines below in a row
    dpush: Array  # (6 n_bodies, 8)
    dmodal: Array  # (n, 8)
    row: Array  # (n_values,): what is noted of contacts beside


@dataclass(frozen=True)
class TouchingTangentParameters(TangentParameters):
    """Parameters of a mechanism that touches without losses, and of eight tangents of its motion."""

    own: Any  # the mechanism's, `Touching`
    contact: ContactTable
    by: StatesBeside


@dataclass(frozen=True)
class TouchingClosedTangentParameters(ClosedTangentParameters, TouchingTangentParameters):
    """Parameters of one with loops, which closes them as others do."""


def states_beside(system: TouchingSystem, directions: Sequence[Any]) -> StatesBeside:
    """Return room for states beside a motion along some directions."""
    own: Any = system.parameters
    contact, numbers = own.contact, system.contact_numbers(np.ones(system.n))[0]
    views, whole, at = dict[str, Array](), numbers.copy(), 0
    for name in CONTACT_NUMBERS:
        x = getattr(contact, name)
        views[name], at = whole[at : at + x.size].reshape(x.shape), at + x.size
    views |= {name: np.zeros(1) for name in ("D", "E", "N", "L", "P", "M", "known_response")}  # which only the own have
    n_bodies, n = len(own.origins), system.n
    moving, forces = np.zeros(12 * n_bodies + contact.felt.size), np.zeros(6 * n_bodies + n)
    dforces = np.zeros(LANES * forces.size)
    views |= {"G": np.zeros((1, 1, 3, 3)), "felt": moving[12 * n_bodies :].reshape(contact.felt.shape)}
    views |= {"push": forces[: 6 * n_bodies].reshape(-1, 6), "modal": forces[6 * n_bodies :]}
    arrays = {one.name: getattr(contact, one.name) for one in fields(contact)}
    copies: dict[str, Any] = {name: np.array(x) for name, x in arrays.items() if np.ndim(x)}
    near = replace(contact, **copies | views)
    near.seen[:, 1] = 1
    dnumbers, dG, soft = np.zeros((LANES, numbers.size)), list[Array](), np.full(LANES, -1)
    frames, felt = np.zeros((2, 4 * LANES), dtype=np.int64)
    for lane, each in enumerate(directions):
        if each.contact:
            dnumbers[lane] = each.contact[0]
            if each.contact[1].any():
                soft[lane] = len(dG)
                dG.append(each.contact[1])
        for k, one in enumerate(each.variants):
            frames[4 * lane + k] = one.compiled.address("frames")
            felt[4 * lane + k] = one.compiled.address("felt") if own.felt else 0
    return StatesBeside(
        contact=near,
        numbers=whole,
        own_numbers=numbers,
        dnumbers=dnumbers,
        used=np.array([lane < len(directions) for lane in range(LANES)], dtype=np.int64),
        changes=np.array(
            [bool(dnumbers[lane].any() or soft[lane] >= 0 or frames[4 * lane]) for lane in range(LANES)], dtype=np.int64
        ),
        soft=soft,
        dG=np.array(dG) if dG else np.zeros((1, 1, 1, 3, 3)),
        frames=frames,
        felt=felt,
        q=np.zeros(system.n_positions),
        v=np.zeros(n),
        inputs=np.zeros(own.inputs.size),
        origins=moving[: 3 * n_bodies].reshape(-1, 3),
        rotations=moving[3 * n_bodies : 12 * n_bodies].reshape(-1, 3, 3),
        spins=np.zeros((n_bodies, 3)),
        moving=moving,
        dmoving=np.zeros(LANES * moving.size),
        held=held_room(contact, LANES),
        modal=np.zeros(n),
        forces=forces,
        dforces=dforces,
        dpush=dforces[: 6 * n_bodies * LANES].reshape(-1, LANES),
        dmodal=dforces[6 * n_bodies * LANES :].reshape(-1, LANES),
        row=np.zeros(system.n_contact_values),
    )


@accelerations.register(TouchingTangentParameters)
def _accelerations(p: TouchingTangentParameters, t: float, q: Array, v: Array, a: Array) -> None:
    set_time(p, float(t))
    accelerations(p.own, t, q, v, a)
    change_pushes(p, q, v)
    pulled(p, q, v, p.multiplier, a, a)


@change_pushes.register(TouchingTangentParameters)
def _change_pushes(p: Any, q: Array, v: Array) -> None:
    _change_forces(p, q, v, p.by.row[:0])


@pulled.register(TouchingTangentParameters)
def _pulled(p: Any, q: Array, v: Array, multiplier: Array, known: Array, a: Array) -> None:
    if p.variants.any != 0:
        change_residual(p, q, v, multiplier, known)
    by, push, modal = p.by, p.own.contact.push, p.own.contact.modal
    dq, dv, da = q[p.n_position_lines :], v[p.n_lines :], a[p.n_lines :]
    along = (p.directions, dq, dv, p.dr, by.dpush, by.dmodal)
    call_native(p.accelerations, (p.inputs, q, v, multiplier, push, modal, *along, a, da))
    if p.own.contact.clock[1] != 0.0 or by.contact.clock[1] != 0.0:
        a[0] = math.inf


@variant_residual.register(TouchingTangentParameters)
def _residual(p: Any, k: int, multiplier: Array) -> None:
    m, by = p.variants, p.by
    for i in range(p.n):
        by.modal[i] = m.signs_v[k, i] * p.own.contact.modal[i]
    call_native(m.residual[k], (m.inputs[k], m.q, m.v, multiplier, p.own.contact.push, by.modal, m.a, m.r))


@inner
def _change_frames(p: Any, q: Array, v: Array) -> None:
    """Find by what frames and forces on markers change where more than inputs of equations do."""
    m, by = p.variants, p.by
    clear(by.dmoving)
    for k in range(m.residual.size):
        if m.residual[k] != 0:
            take_state(m, k, q, v, v)
            call_native(by.frames[k], (m.inputs[k], m.q, m.v, by.origins, by.rotations, by.spins))
            if by.felt[k] != 0:
                call_native(by.felt[k], (m.inputs[k], m.q, m.v, by.contact.felt))
            for i in range(by.moving.size):
                by.dmoving[by.moving.size * (k // 4) + i] += m.weights[k] * by.moving[i]


@inner
def _change_forces(p: Any, q: Array, v: Array, rows: Array) -> None:
    """Find how what contacts push by changes along each direction, and what is noted of them if there are rows."""
    c, by = p.own.contact, p.by
    clear(by.dforces)
    if not any_force(c):
        return
    if p.variants.any != 0:
        _change_frames(p, q, v)
    displace_held(c, by.held)
    for lane in range(LANES):
        if by.used[lane] != 0:
            _press_along(p, q, v, lane, rows)


@inner
def _press_along(p: Any, q: Array, v: Array, lane: int, rows: Array) -> None:
    """Find how what contacts push by changes along a direction of the state, and with the numbers of contacts."""
    c, by = p.own.contact, p.by
    near = by.contact
    soft = max(by.soft[lane], 0)
    for numbers in range(1 + by.changes[lane]):
        size = NUMBERS_BESIDE if numbers == 1 else _find_size(p, q, v, lane)
        for side in range(2):
            way = (2.0 * side - 1.0) * size
            _go_beside(p, q, v, lane, (1 - numbers) * way, numbers * way)
            clear(by.forces)
            softer = 1 if numbers == 1 and by.soft[lane] >= 0 else 0
            press_held(c, near, way, lane, 1 - numbers, by.dG[soft], softer, by.held, by.origins, by.rotations)
            for k in range(by.forces.size):
                by.dforces[LANES * k + lane] += by.forces[k] / (2.0 * way)
            if rows.size > 0:
                note_values(near, by.row)
                for k in range(by.row.size):
                    rows[by.row.size * lane + k] += by.row[k] / (2.0 * way)
    for i in range(by.numbers.size if by.changes[lane] != 0 else 0):
        by.numbers[i] = by.own_numbers[i]


@inner
def _find_size(p: Any, q: Array, v: Array, lane: int) -> float:
    """Return how far along a direction places of points move by `WAY_BESIDE`."""
    c, near, largest = p.own.contact, p.by.contact, TOO_LITTLE_BESIDE
    for i in range(p.by.q.size):
        largest = max(largest, abs(q[p.n_position_lines + LANES * i + lane]))
    size, moved = WAY_BESIDE / largest, 0.0
    _go_beside(p, q, v, lane, size, 0.0)
    for i in range(c.node.size):
        if c.force[i, 0] != 0.0:
            moved = max(moved, abs(near.free[i, 0] - c.free[i, 0]))
            for a in range(3):
                moved = max(moved, abs(near.place[near.node[i], a] - c.place[c.node[i], a]))
                moved = max(moved, abs(near.axes[i, 0, a] - c.axes[i, 0, a]))
    return WAY_BESIDE / max(moved / size, TOO_LITTLE_BESIDE)


@inner
def _go_beside(p: Any, q: Array, v: Array, lane: int, along: float, numbers: float) -> None:
    """Find where points stand a way along a direction of the state and of inputs, or with other numbers by a way.

    These are numbers of contacts, and of the mechanism where they move frames and forces on markers by themselves.
    """
    by = p.by
    for i in range(by.q.size):
        by.q[i] = q[i] + along * q[p.n_position_lines + LANES * i + lane]
    for i in range(by.v.size):
        by.v[i] = v[i] + along * v[p.n_lines + LANES * i + lane]
    for i in range(by.inputs.size):
        by.inputs[i] = p.inputs[i] + along * p.directions[i, lane]
    if by.contact.felt.size > 0:
        call_native(p.own.felt, (by.inputs, by.q, by.v, by.contact.felt))
    call_native(p.own.frames, (by.inputs, by.q, by.v, by.origins, by.rotations, by.spins))
    if numbers != 0.0:
        for i in range(by.numbers.size):
            by.numbers[i] = by.own_numbers[i] + numbers * by.dnumbers[lane, i]
        for i in range(by.moving.size):
            by.moving[i] += numbers * by.dmoving[by.moving.size * lane + i]
    place_beside(by.contact, by.q, by.origins, by.rotations)


@remember_found.register(TouchingTangentParameters)
def _remember_found(p: Any, t: float) -> None:
    remember(p.own.contact, t, p.own.origins, p.own.rotations)


@note_contacts.register(TouchingTangentParameters)
def _note_contacts(p: Any, t: float, q: Array, v: Array, values: Array) -> None:
    width = p.by.row.size
    set_time(p, float(t))
    note_contacts(p.own, t, q, v, values[:width])
    for k in range(width, values.size):
        values[k] = 0.0
    _change_forces(p, q, v, values[width:])


@remember_contacts.register(TouchingTangentParameters)
def _remember_contacts(p: Any, t: float, q: Array, v: Array) -> None:
    remember_contacts(p.own, t, q, v)

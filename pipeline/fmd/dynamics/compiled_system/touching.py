"""A mechanism whose bodies touch planes or one another, as a system: contact acts wherever accelerations are evaluated.

The forces follow from positions and, with friction, from where points stood at the last step, so a method that
evaluates them once a step takes them as it takes a spring's. This module is loaded for mechanisms with contacts alone.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from functools import cached_property, singledispatch
from typing import Any

import numpy as np

from fmd.contact.approach import any_force, may_close, note_corners
from fmd.contact.assemble import contact_table
from fmd.contact.patch import press_with, touch
from fmd.contact.recorded import ContactRecord
from fmd.contact.sums import copy_forces, evaluate_contacts, note_values, remember, replace_impulses
from fmd.contact.tables import REMEMBERED, ContactTable
from fmd.contact.touching_body import TouchingBody
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import SHOCK_STEPS
from fmd.dynamics.compiled_system.closed import keep_closed
from fmd.dynamics.compiled_system.kernels import set_inputs
from fmd.dynamics.compiled_system.parameters import ClosedParameters, CompiledParameters, Leapfrog, TreeParameters
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.system import (
    accelerate_answered,
    accelerations,
    advance,
    answer_contacts,
    answer_remembered,
    contact_forces,
    is_pressed,
    may_touch,
    note_contacts,
    remember_answered,
    remember_contacts,
    remember_found,
    set_impulses,
)
from fmd.kernels.arrays import copy
from fmd.kernels.kernel import inner
from fmd.kernels.table import Table
from fmd.kernels.vectors import call_native


@dataclass(frozen=True)
class Touching(CompiledParameters):
    """Parameters of a mechanism whose bodies touch planes or one another."""

    pushed: int  # addresses of the compiled functions
    frames: int
    felt: int
    contact: ContactTable
    origins: Array  # (n_bodies, 3): the bodies' frames
    rotations: Array  # (n_bodies, 3, 3)
    spins: Array  # (n_bodies, 3)
    q_ahead: Array  # (n_positions,)


@dataclass(frozen=True)
class TouchingParameters(Touching, TreeParameters):
    """Parameters of one without loops."""


@dataclass(frozen=True)
class TouchingClosedParameters(Touching, ClosedParameters):
    """Parameters of one with loops."""


@dataclass(frozen=True)
class ContactsAhead(Table):
    """Contacts at a step's end at which their forces have moved no modes yet: points give way by all that these move.

    Coulomb's law may have several forces for the same positions, and none of them for many. With what forces move in a
    step it is one for the step as a whole.
    """

    contact: ContactTable  # whose points remember what the mechanism's do
    moved: Array  # (n, n): accelerations of modes by unit forces on them
    to_position: float  # from there to modal coordinates [s²]
    moves: Array  # (n,): of modes by the forces found last


# What of contacts depends on a scene's numbers, beside flexibilities: places, shapes, gaps and laws.
_PLACES = ("x", "shapes", "yields", "radii", "clearance", "plane", "position", "primitive", "edges")
CONTACT_NUMBERS = (*_PLACES, "outward", "shares", "law")


class TouchingSystem(CompiledSystem):
    """A mechanism with contacts, ready to be integrated by methods that evaluate forces once a step."""

    @property
    def has_tangents(self) -> bool:
        """True if tangents of a motion can be marched beside it: contacts lose nothing, nothing samples."""
        others = any(body.wears or body.travels or len(body.points.soft) for body in self.mechanism.contacts)
        return not (self.is_sampled or others or self.has_lossy_contacts)

    @property
    def has_lossy_contacts(self) -> bool:
        """True if contacts have friction, or lose energy otherwise."""
        return any(body.is_lossy for body in self.mechanism.contacts)

    def contact_numbers(self, signs: Array) -> tuple[Array, ...]:
        """Return `CONTACT_NUMBERS` of all contacts in a row, and nodes' flexibility; modes' shapes have signs (n,)."""
        c = self._parameters.contact
        shapes = c.shapes.copy()
        for body, (first, end) in enumerate(zip(c.first[:-1], c.first[1:], strict=True)):
            shapes[first:end] *= np.asarray(signs)[c.mode[body]]
        found = {name: getattr(c, name) for name in CONTACT_NUMBERS} | {"shapes": shapes}
        found["law"] = np.where(np.isfinite(c.law), c.law, 0.0)  # rows that a law lacks are at an infinite depth
        return np.concatenate([x.ravel() for x in found.values()]), c.G

    @property
    def n_contact_values(self) -> int:
        """How many values `note_contacts` fills."""
        return ContactRecord.width(self.mechanism.contacts)

    @property
    def n_contacts(self) -> int:
        """Number of contacts."""
        return sum(len(body.names) for body in self.mechanism.contacts)

    @property
    def shock_step(self) -> float:
        """2/ω with all points closed, of rigid surfaces a part of it: their forces rise as a power of the depth [s]."""
        round_laws = any(own.law for body in self.mechanism.contacts for own in body.contacts)
        return self.largest_step * (SHOCK_STEPS if round_laws else 1.0)

    @cached_property
    def answers_to_contact(self) -> Array:
        """Largest acceleration of each rate by a unit force on a point of a contact, shape (n,)."""
        q, found = self.mechanism.rest_positions, np.zeros(self.n)
        for body in self.mechanism.contacts:
            number = self.mechanism.number_of(body.body)
            J = self.point_velocities(q, number, body.points.x, body.points.shapes).reshape(-1, self.n)
            found = np.maximum(found, np.abs(np.linalg.solve(self.mass_matrix(q), J.T)).max(axis=1, initial=0.0))
        return found

    def contacts_ahead(self, p: Any, step: float, to_position: float, to_rate: float) -> ContactsAhead | int:
        """Return contacts whose points give way by what their forces move modes in a step, too; 0 without.

        They remember what those of a march's parameters p do. Faces before planes have them, whose places are linear in
        the modes of their body; of so many points that their flexibility isn't whole, or whose grid
        travels, they haven't.
        """
        bodies, (M, K, C), moved = list[TouchingBody](), self.linear_matrices, np.zeros((self.n, self.n))
        for body in self.mechanism.contacts:
            if body.pairs or body.travels or len(body.points.soft) or any(own.law for own in body.planes):
                return 0
            at = self.mechanism.modes_of(self.mechanism.number_of(body.body))
            own, points = np.ix_(at, at), body.points
            moved[own] = np.linalg.inv(M[own] + to_rate * C[own] + to_position * K[own])
            damped = 1.0 + body.damping / step  # a damper's part is of both flexibilities
            more = to_position * damped * np.einsum("iam,mn,jbn->iajb", points.shapes, moved[own], points.shapes)
            bodies.append(replace(body, points=replace(points, G=points.G + more)))
        shared = {name: getattr(p.contact, name) for name in (*REMEMBERED, "felt")}
        found = replace(contact_table(bodies, *self._touching_places), **shared)
        return ContactsAhead(found, moved, to_position, np.zeros(self.n))

    @property
    def _touching_places(self) -> tuple[list[int], list[IntArray], int, int, int]:
        """Bodies that touch among the links, their modes, and how many links and rates there are, as tables ask."""
        mechanism = self.mechanism
        links = [mechanism.number_of(body.body) for body in mechanism.contacts]
        modes = [mechanism.modes_of(k) for k in links]
        return links, modes, len(mechanism.links), mechanism.n, mechanism.position_shift

    @cached_property
    def _parameters(self) -> Touching:
        plain = CompiledSystem(self.mechanism).parameters
        mechanism, n_links = self.mechanism, len(self.mechanism.links)
        closed = isinstance(plain, ClosedParameters)
        kind: Any = TouchingClosedParameters if closed else TouchingParameters
        found: Touching = kind(
            **{own.name: getattr(plain, own.name) for own in fields(plain)},
            pushed=self.compiled.address("pushed_closed" if closed else "pushed"),
            frames=self.compiled.address("frames"),
            felt=self.compiled.address("felt") if any(body.felt for body in mechanism.contacts) else 0,
            contact=contact_table(mechanism.contacts, *self._touching_places),
            origins=np.zeros((n_links, 3)),
            rotations=np.zeros((n_links, 3, 3)),
            spins=np.zeros((n_links, 3)),
            q_ahead=np.zeros(self.n_positions),
        )
        return found

    @cached_property
    def _leapfrog(self) -> Leapfrog:
        return Leapfrog(0, np.zeros(1), np.zeros(self.n))

    @property
    def takes_whole_cycles(self) -> bool:
        """False: fast steps are taken with all coordinates where surfaces may touch."""
        return False

    @property
    def largest_fast_step(self) -> float:
        """Longest stable leapfrog step with all points held [s]: as bodies touch, all coordinates take fast steps."""
        return self.largest_step

    @cached_property
    def largest_slow_step(self) -> float:
        """Longest stable leapfrog step of the slow coordinates apart from all contacts [s]; they take none in them."""
        return CompiledSystem(self.mechanism).largest_slow_step

    @property
    def stiffest_matrices(self) -> tuple[Array, Array, Array]:
        """Mass, stiffness and damping of the undeformed mechanism with all stops touched and all points held."""
        M, K, C = super().stiffest_matrices
        stiffness, damping = self._closed_contacts
        return M, K + stiffness, C + damping

    @cached_property
    def _closed_contacts(self) -> tuple[Array, Array]:
        """Stiffness and damping of all points held, (n, n) each."""
        K, C, q = np.zeros((self.n, self.n)), np.zeros((self.n, self.n)), self.mechanism.rest_positions
        damping = max(body.damping for body in self.mechanism.contacts)
        for body in self.mechanism.contacts:
            number = self.mechanism.number_of(body.body)
            own = body.stiffness(self.point_velocities(q, number, body.points.x, body.points.shapes))
            K += own
            C += damping * own
        return K, C

    def point_velocities(self, q: Array, body: int, x: Array, shapes: Array) -> Array:
        """Return velocities of a body's points for unit rates, in its axes, shape (n_points, 3, n)."""

        def rates(motion: Kinematics) -> Array:
            frame = motion.frames[body]
            R = frame.rotation
            u, w = (np.einsum("tba,tb->ta", R, each) for each in (frame.velocity, frame.spin))
            moved = np.einsum("pam,tm->tpa", shapes, motion.modal_rates(body))
            return np.asarray(u[:, None] + np.cross(w[:, None], x[None]) + moved)

        return np.moveaxis(self._rates_for_units(0.0, q, rates), 0, 2)


@inner
def find_contacts(p: Any, t: float, q: Array, v: Array) -> None:
    """Find the forces of contacts at a state, and their pushes on frames and modes."""
    _find_frames(p, t, q, v)
    touch(p.contact, t, q, p.origins, p.rotations)


@inner
def find_pressed(p: Any, t: float, q: Array, v: Array) -> None:
    """Find the same, with forces on markers as they were felt before."""
    call_native(p.frames, (p.inputs, q, v, p.origins, p.rotations, p.spins))
    touch(p.contact, t, q, p.origins, p.rotations)


@inner
def _find_frames(p: Any, t: float, q: Array, v: Array) -> None:
    """Find the bodies' frames at a state, and forces on markers that points feel."""
    set_inputs(p, float(t))
    if p.contact.felt.size > 0:
        call_native(p.felt, (p.inputs, q, v, p.contact.felt))
    call_native(p.frames, (p.inputs, q, v, p.origins, p.rotations, p.spins))


@answer_contacts.register(ContactsAhead)
def _answer_contacts(ahead: ContactsAhead, p: Any, t: float, q: Array, v: Array, answer: Array) -> bool:
    _find_frames(p, t, q, v)
    touch(ahead.contact, t, q, p.origins, p.rotations)
    _answer(ahead, ahead.contact.modal, answer)
    for i in range(answer.size):
        ahead.moves[i] = ahead.to_position * answer[i]
    return True


@answer_remembered.register(ContactsAhead)
def _answer_remembered(ahead: ContactsAhead, p: Any, answer: Array) -> None:
    _answer(ahead, p.contact.modal, answer)


@inner
def _answer(ahead: ContactsAhead, modal: Array, answer: Array) -> None:
    """Find the accelerations by forces on modes."""
    for i in range(answer.size):
        answer[i] = 0.0
        for j in range(answer.size):
            answer[i] += ahead.moved[i, j] * modal[j]


@accelerate_answered.register(ContactsAhead)
def _accelerate_answered(ahead: ContactsAhead, p: Any, t: float, q: Array, v: Array, a: Array) -> None:
    _find_frames(p, t, q, v)
    press_with(p.contact, ahead.contact, ahead.moves, q, p.origins, p.rotations)
    _find_pushed(p, q, v, a)


@remember_answered.register(ContactsAhead)
def _remember_answered(ahead: ContactsAhead, p: Any, t: float, q: Array, v: Array) -> None:
    _find_frames(p, t, q, v)
    press_with(p.contact, ahead.contact, ahead.moves, q, p.origins, p.rotations)
    remember(p.contact, t, p.origins, p.rotations)


@accelerations.register(Touching)
def _accelerations(p: Any, t: float, q: Array, v: Array, a: Array) -> None:
    find_contacts(p, t, q, v)
    _find_pushed(p, q, v, a)


@singledispatch
def _find_pushed(p: Any, q: Array, v: Array, a: Array) -> None:
    """Find the accelerations with pushes that have been found; the first is infinite where no forces were."""
    raise NotImplementedError


@_find_pushed.register(TouchingParameters)
def _find_pushed_tree(p: TouchingParameters, q: Array, v: Array, a: Array) -> None:
    call_native(p.pushed, (p.inputs, q, v, p.contact.push, p.contact.modal, a))
    _end_if_lost(p, a)


@_find_pushed.register(TouchingClosedParameters)
def _find_pushed_loops(p: TouchingClosedParameters, q: Array, v: Array, a: Array) -> None:
    push, modal = p.contact.push, p.contact.modal
    call_native(p.pushed, (p.inputs, q, v, p.units[0], push, modal, a, p.w, p.whole.x[0], p.whole.s[0]))
    keep_closed(p, q, a)
    _end_if_lost(p, a)


@inner
def _end_if_lost(p: Any, a: Array) -> None:
    """Let a march end where no forces were found."""
    if p.contact.clock[1] != 0.0:
        a[0] = math.inf


@remember_contacts.register(Touching)
def _remember_contacts(p: Any, t: float, q: Array, v: Array) -> None:
    find_contacts(p, t, q, v)
    remember(p.contact, t, p.origins, p.rotations)


@remember_found.register(Touching)
def _remember_found(p: Any, t: float) -> None:
    remember(p.contact, t, p.origins, p.rotations)


@note_contacts.register(Touching)
def _note_contacts(p: Any, t: float, q: Array, v: Array, values: Array) -> None:
    find_contacts(p, t, q, v)
    evaluate_contacts(p.contact, t, p.origins, p.rotations)
    note_values(p.contact, values)


@contact_forces.register(Touching)
def _contact_forces(p: Any, forces: Array) -> None:
    evaluate_contacts(p.contact, p.contact.clock[0], p.origins, p.rotations)
    copy_forces(p.contact, forces)


@set_impulses.register(Touching)
def _set_impulses(p: Any, impulses: Array) -> None:
    replace_impulses(p.contact, impulses)


@may_touch.register(Touching)
def _may_touch(p: Any, t: float, ahead: float, q: Array, v: Array) -> bool:
    copy(q, p.q_ahead)
    advance(p, p.q_ahead, v, ahead, 0, v.size)
    set_inputs(p, float(t + ahead))
    call_native(p.frames, (p.inputs, p.q_ahead, v, p.origins, p.rotations, p.spins))
    note_corners(p.contact, p.origins, p.rotations)
    find_contacts(p, t, q, v)
    if may_close(p.contact, ahead, q, v, p.origins, p.rotations):
        return True
    remember(p.contact, t, p.origins, p.rotations)
    return False


@is_pressed.register(Touching)
def _is_pressed(p: Any, t: float, q: Array, v: Array) -> bool:
    find_contacts(p, t, q, v)
    return any_force(p.contact)

"""Where the bodies of a mechanism are and how they move, at many states at once.

From the ground outwards, each body's frame follows from that of the body that carries it: the joint's place moves and
turns with the parent's modes, by ``R exp(θ̃)`` with the rotation vector ``θ = Ψ q + ½ qᵀ bow q``, and the joint moves
the frame on. Energies and momenta take the inertia Gram tensor of each body, in its own axes, with ``p = (1, q)``::

    momentum            P = m V + ω × c + ċ              c = S p + ½ qᵀ bow q
    angular momentum    L = c × V + J ω + H q̇            J = tr(P₂) 1 − P₂,   P₂ = pᵀ G p
                                                     H = p·(G[b, c] − G[c, b]) + curl q
    kinetic energy      T = ½ (V·P + ω·L + q̇·(q̇ + (∂c/∂q)ᵀ V + Hᵀ ω))

Nothing here is compiled, so that a mechanism whose march needs few kernels reports its motion without any more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import EPSILON, Array
from fmd.core.rotations import BodyFrame, matrix_of_quaternion, moved, rotation_matrix, rotation_rate, turned
from fmd.dynamics.element_motion import States, element_energies
from fmd.dynamics.links import CYLINDRICAL, FREE, PLANAR, REVOLUTE, SCREW, SPHERICAL, UNIVERSAL, Link
from fmd.dynamics.mechanism import Mechanism
from fmd.reduction.inertia import InertiaGram


class Momenta(NamedTuple):
    """A body's inertia in motion, in its own axes and about the origin of its frame."""

    moment: Array  # (n_times, 3): first moment c [kg m]
    linear: Array  # (n_times, 3) [kg m/s]
    angular: Array  # (n_times, 3) [kg m²/s]
    energy: Array  # (n_times,) [J]


@dataclass(frozen=True)
class Kinematics:
    """Positions, velocities, energies and momenta of a mechanism's bodies at given states.

    Parameters
    ----------
    mechanism : Mechanism
        Whose states they are.
    times : ndarray, shape (n_times,)
        At which prescribed motions are taken [s].
    q, v : ndarray, shapes (n_times, n_positions) and (n_times, n)
        Positions and rates.
    """

    mechanism: Mechanism
    times: Array
    q: Array
    v: Array

    def modal_coordinates(self, body: int) -> Array:
        """Modal coordinates of a body by its number [kg^1/2 m], shape (n_times, n_modes)."""
        modes = self.mechanism.modes_of(body)
        return np.asarray(self.q[:, modes + self.mechanism.n_positions - self.mechanism.n])

    def modal_rates(self, body: int) -> Array:
        """Rates of a body's modal coordinates [kg^1/2 m/s], shape (n_times, n_modes)."""
        return np.asarray(self.v[:, self.mechanism.modes_of(body)])

    def joint_coordinates(self, body: int) -> tuple[Array, Array]:
        """Positions (n_times, n_positions) and rates (n_times, n_rates) of the joint that carries a body.

        A prescribed joint has one of each, taken from its motion. The angle of a revolute joint is that of the body's
        frame; the section that the joint grips is at `section_angle`.
        """
        link, layout = self.mechanism.links[body], self.mechanism.layout
        if link.motion is not None:
            values = link.motion.values(self.times)
            return values[:, :1], values[:, 1:2]
        at, first = layout.position[body], layout.rate[body]
        return self.q[:, at : at + link.n_positions], self.v[:, first : first + link.n_rates]

    def along_joint(self, body: int) -> tuple[Array, Array]:
        """Position and rate of a revolute or prismatic joint, (n_times,) each.

        Of a revolute joint they are those of the body's section that the joint grips: what an encoder reads.
        """
        link = self.mechanism.links[body]
        position, rate = (values[:, 0] for values in self.joint_coordinates(body))
        if link.joint == REVOLUTE and len(link.joint_rotation) and link.motion is None:
            q, rates = self.modal_coordinates(body), self.modal_rates(body)
            bow = link.joint_bow[None] if link.joint_bow.size else np.zeros((1, 0, 0))
            angle, turning = moved(link.joint_rotation[None], bow, q, rates)
            position, rate = position + angle[:, 0], rate + turning[:, 0]
        return np.asarray(position), np.asarray(rate)

    @cached_property
    def frames(self) -> tuple[BodyFrame, ...]:
        """Each body's frame."""
        found: list[BodyFrame] = []
        for body, link in enumerate(self.mechanism.links):
            found.append(self._through_joint(body, self._joint_place(link, found)))
        return tuple(found)

    def _joint_place(self, link: Link, found: list[BodyFrame]) -> BodyFrame:
        """BodyFrame of the joint on the body that carries it, or on the ground."""
        n_times = len(self.q)
        if link.parent < 0:
            still, axes = np.zeros((n_times, 3)), np.broadcast_to(np.eye(3), (n_times, 3, 3))
            return BodyFrame(np.broadcast_to(link.place, (n_times, 3)), axes @ link.place_axes, still, still)
        parent, q, rates = found[link.parent], self.modal_coordinates(link.parent), self.modal_rates(link.parent)
        rotation, spin = parent.rotation, parent.spin
        bent, moving = moved(link.place_shapes, link.place_bow[:3], q, rates)
        if link.place_rotations.size or link.place_bow.size:
            angle, turning = moved(link.place_rotations, link.place_bow[3:], q, rates)
            spin = spin + turned(rotation, rotation_rate(angle, turning))
            rotation = rotation @ rotation_matrix(angle)
        arm = turned(parent.rotation, link.place + bent)
        velocity = parent.velocity + np.cross(parent.spin, arm) + turned(parent.rotation, moving)
        return BodyFrame(parent.origin + arm, rotation @ link.place_axes, velocity, spin)

    def _through_joint(self, body: int, place: BodyFrame) -> BodyFrame:
        """BodyFrame of a body from that of its joint's place on the body that carries it."""
        link = self.mechanism.links[body]
        position, rate = self.joint_coordinates(body)
        axis = link.axis / np.linalg.norm(link.axis)
        origin, rotation, velocity, spin = place
        if link.n_slides or link.joint == SCREW:
            along = _slide_directions(link)
            arm, moving = (turned(rotation, values[:, : len(along)] @ along) for values in (position, rate))
            origin, velocity = origin + arm, velocity + np.cross(spin, arm) + moving
        if link.joint in (SPHERICAL, FREE):
            rotation = rotation @ matrix_of_quaternion(position[:, -4:])
            spin = spin + turned(rotation, rate[:, -3:])  # rates about the body's own axes
        elif link.joint == UNIVERSAL:
            other = link.other_axis / np.linalg.norm(link.other_axis)
            for k, one in enumerate((axis, other)):
                spin = spin + rate[:, k : k + 1] * (rotation @ one)
                rotation = rotation @ rotation_matrix(position[:, k : k + 1] * one)
        elif link.joint in (REVOLUTE, CYLINDRICAL, PLANAR, SCREW):
            spin = spin + rate[:, -1:] * (rotation @ axis)
            rotation = rotation @ rotation_matrix(position[:, -1:] * axis)
        return BodyFrame(origin, rotation, velocity, spin)

    def body_spin(self, body: int) -> Array:
        """Angular velocity of a body's frame in its own axes [rad/s], shape (n_times, 3)."""
        frame = self.frames[body]
        return np.asarray(np.einsum("tij,ti->tj", frame.rotation, frame.spin))

    @cached_property
    def momenta(self) -> tuple[Momenta, ...]:
        """Each body's first moment, momenta and kinetic energy."""
        return tuple(self._momenta(body) for body in range(len(self.mechanism.links)))

    def _momenta(self, body: int) -> Momenta:
        gram, frame = self.mechanism.links[body].gram, self.frames[body]
        q, rates, w = self.modal_coordinates(body), self.modal_rates(body), self.body_spin(body)
        modal = (rates**2).sum(axis=1)
        if gram.fields is not None:
            n, W = q.shape[1], gram.fields.W
            q, rates = gram.fields.extend(q, rates)
            gram = InertiaGram(gram.fields.G, gram.fields.S, gram.mass)
            modal += (rates[:, n:] * (rates[:, n:] + 2.0 * rates[:, :n] @ W.T)).sum(axis=1)
        V = np.einsum("tij,ti->tj", frame.rotation, frame.velocity)
        p = np.concatenate([np.ones((len(q), 1)), q], axis=1)
        Gp = np.tensordot(p, gram.G, (1, 3))  # (n_times, 3, 3, 1 + n)
        P = np.einsum("tabi,ti->tab", Gp, p)
        Jw = np.trace(P, axis1=1, axis2=2)[:, None] * w - np.einsum("tab,tb->ta", P + P.swapaxes(1, 2), w) / 2
        # p·(G[b, c] − G[c, b])·q̇ by the axis a across b and c
        h = -np.einsum("abc,tbci,ti->ta", EPSILON, Gp[..., 1:], rates)
        S = np.broadcast_to(gram.S[:, 1:], (len(q), 3, q.shape[1]))
        c = gram.S[:, 0] + q @ gram.S[:, 1:].T
        if gram.bow.size:
            bow = np.einsum("ajk,tk->taj", gram.bow, q)
            S, c = S + bow, c + 0.5 * np.einsum("taj,tj->ta", bow, q)
        if gram.curl.size:
            h = h + np.einsum("ajk,tj,tk->ta", gram.curl, rates, q)
        c_rate = np.einsum("taj,tj->ta", S, rates)
        linear = gram.mass * V + np.cross(w, c) + c_rate
        angular = np.cross(c, V) + Jw + h
        energy = 0.5 * ((V * (linear + c_rate)).sum(axis=1) + (w * (angular + h)).sum(axis=1) + modal)
        if gram.second_order is not None:
            energy = energy + gram.second_order.energy(q, rates)
        return Momenta(c, linear, angular, energy)

    @cached_property
    def states(self) -> States:
        """States of the bodies' frames and modes, for force elements."""
        names = [link.name for link in self.mechanism.links]
        q = {name: self.modal_coordinates(k) for k, name in enumerate(names)}
        rates = {name: self.modal_rates(k) for k, name in enumerate(names)}
        return States(dict(zip(names, self.frames, strict=True)), q, rates, len(self.q))

    @cached_property
    def energies(self) -> tuple[Array, Array]:
        """Kinetic and potential energy (strain, springs, stops, force elements, weight) [J], (n_times,) each."""
        kinetic = np.sum([momenta.energy for momenta in self.momenta], axis=0)
        potential = np.zeros(len(self.q))
        for body, link in enumerate(self.mechanism.links):
            potential += 0.5 * self.modal_coordinates(body) ** 2 @ link.omega**2
            if link.spring:
                potential += 0.5 * link.spring * (self.along_joint(body)[0] - link.rest) ** 2
            for k, law in enumerate(link.laws):
                along = self.along_joint(body)[0] if link.n_rates == 1 else self.joint_coordinates(body)[0][:, k]
                potential += law.energies(along)
        for element in self.mechanism.elements:
            potential += element_energies(self.states, element)
        if np.any(self.mechanism.gravity):
            potential -= self._first_moment @ self.mechanism.gravity
        return np.asarray(kinetic), potential

    @property
    def _first_moment(self) -> Array:
        """First moment of all bodies about the ground's origin [kg m], shape (n_times, 3)."""
        parts = zip(self.mechanism.links, self.frames, self.momenta, strict=True)
        return np.asarray(sum(link.gram.mass * at.origin + turned(at.rotation, of.moment) for link, at, of in parts))

    @property
    def centre_of_mass(self) -> Array:
        """Centre of all bodies' mass in space [m], shape (n_times, 3)."""
        return self._first_moment / self.mechanism.mass

    @cached_property
    def momentum(self) -> Array:
        """Momentum of all bodies in space [kg m/s], shape (n_times, 3)."""
        parts = zip(self.frames, self.momenta, strict=True)
        return np.asarray(sum(turned(at.rotation, of.linear) for at, of in parts))

    @cached_property
    def angular_momentum(self) -> Array:
        """Angular momentum of all bodies about the ground's origin [kg m²/s], shape (n_times, 3).

        Not a number across the axis of a body whose inertia is known about that axis alone.
        """
        total = np.zeros((len(self.q), 3))
        for link, at, of in zip(self.mechanism.links, self.frames, self.momenta, strict=True):
            total += turned(at.rotation, of.angular) + np.cross(at.origin, turned(at.rotation, of.linear))
            if link.gram.normal >= 0:
                total[:, np.arange(3) != link.gram.normal] = np.nan
        return total

    def marker_position(self, body: int, name: str) -> Array:
        """A marker of a body in space [m], shape (n_times, 3)."""
        body = self.mechanism.find_marker(body, name)
        frame, marker = self.frames[body], self.mechanism.links[body].markers[name]
        return frame.origin + turned(frame.rotation, marker.position + self._displacement_in_body(body, name))

    def displacement(self, body: int, name: str) -> Array:
        """Displacement of a marker by deformation in its body's frame and axes [m], shape (n_times, 3).

        Of a piece the frame is that of its part, which is the first piece's.
        """
        body = self.mechanism.find_marker(body, name)
        first = self.mechanism.first_piece(body)
        if first != body:
            away = self.marker_position(body, name) - self.frames[first].origin
            return np.asarray(np.einsum("tij,ti->tj", self.frames[first].rotation, away) - self._undeformed(body, name))
        return self._displacement_in_body(body, name)

    def _displacement_in_body(self, body: int, name: str) -> Array:
        """Displacement of a marker in the frame of its own body or piece [m], shape (n_times, 3)."""
        at, q = self.mechanism.links[body].markers[name], self.modal_coordinates(body)
        return moved(at.translation, at.bow[:3], q, q)[0]

    def _undeformed(self, body: int, name: str) -> Array:
        """Position of a marker in the undeformed part, from the joint at its first piece [m], shape (3,)."""
        position, first = self.mechanism.links[body].markers[name].position, self.mechanism.first_piece(body)
        while body != first:
            position, body = position + self.mechanism.links[body].place, self.mechanism.links[body].parent
        return np.asarray(position)

    def deflection(self, body: int, name: str) -> Array:
        """Displacement of a marker by deformation, seen from the section at the body's joint [m], (n_times, 3).

        In the axes of the body's frame: ``Φ q − Φ₀ q − (Ψ₀ q) × r`` with the displacement Φ₀ and the rotation Ψ₀ of
        the section. How the frame floats in the body doesn't matter to it. Where displacements of second order are
        known, the section's rotation is a finite one, beside which a hinged body's tip comes nearer to its joint. Of a
        part in pieces the joint is that of the part, and so is the frame.
        """
        body = self.mechanism.find_marker(body, name)
        own, arm, first = self.displacement(body, name), self._undeformed(body, name), self.mechanism.first_piece(body)
        link, q = self.mechanism.links[first], self.modal_coordinates(first)
        if not link.section:
            return own
        section = link.markers[link.section]
        if first == body and section.bow.size:
            shift, turn = np.split(moved(np.r_[section.translation, section.rotation], section.bow, q, q)[0], 2, axis=1)
            arm = arm - section.position
            return np.asarray(turned(rotation_matrix(-turn), arm + own - shift) - arm)
        arm = arm if first == body else arm + own
        return np.asarray(own - q @ section.translation.T - np.cross(q @ section.rotation.T, arm))


def _slide_directions(link: Link) -> Array:
    """Directions in which a joint's first coordinates move the body, in the joint's axes, shape (n, 3)."""
    if link.joint == FREE:
        return np.eye(3)
    axis = link.axis / np.linalg.norm(link.axis)
    if link.joint == PLANAR:
        return link.slide_axes
    return np.asarray(axis[None] * (link.lead if link.joint == SCREW else 1.0))

"""Where the bodies of a mechanism are and how they move, at many states at once.

Frames, energies, momenta and forces of elements are those of the mechanism's graph, evaluated by NumPy; see
`fmd.dynamics.compiler.recorded`.
"""

from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.rotations import BodyFrame, displaced, rotation_matrix, turned
from fmd.dynamics.closures import Place
from fmd.dynamics.compiler.coordinates import ExactCoordinates
from fmd.dynamics.compiler.graph import Graph
from fmd.dynamics.compiler.interpret import Evaluation
from fmd.dynamics.compiler.recorded import RecordedMechanism, record_mechanism
from fmd.dynamics.elements import Element
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.state_functions import StateFunction


class Momenta(NamedTuple):
    """A body's inertia in motion, in its own axes and about the origin of its frame."""

    moment: Array  # (n_times, 3): first moment c [kg m]
    linear: Array  # (n_times, 3) [kg m/s]
    angular: Array  # (n_times, 3) [kg m²/s]


class ConstraintValues(NamedTuple):
    """Scalar constraints of a mechanism: those of joints that close loops first, then those of couplers."""

    joints: list[str]  # of each of the first, by name
    residuals: Array  # (n_times, n_rows) [m, or rad]
    rates: Array  # (n_times, n_rows)
    wrenches: Array  # (n_times, n_of_joints, 2, 6): force [N] and moment [N m] of a unit multiplier on both places


@dataclass(frozen=True)
class Kinematics:
    """Positions, velocities, energies and momenta of a mechanism's bodies at given states."""

    mechanism: Mechanism
    times: Array  # (n_times,): at which prescribed motions are taken [s]
    q: Array  # (n_times, n_positions): positions
    v: Array  # (n_times, n): rates

    def modal_coordinates(self, body: int) -> Array:
        """Modal coordinates of a body by its number [kg^1/2 m], shape (n_times, n_modes)."""
        return np.asarray(self.q[:, self.mechanism.modal_positions_of(body)])

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
        """Position and rate of a joint with one coordinate, (n_times,) each.

        Of a hinge they are those of the body's section that the joint grips: what an encoder reads.
        """
        if body not in self._along_joints:
            position, rate = self._over(self._recorded.of_joint(body)).T
            self._along_joints[body] = position, rate
        return self._along_joints[body]

    @cached_property
    def _along_joints(self) -> dict[int, tuple[Array, Array]]:
        return {}

    @property
    def _recorded(self) -> RecordedMechanism:
        return record_mechanism(self.mechanism)

    @cached_property
    def _state(self) -> Mapping[str, Array]:
        return ExactCoordinates(Graph(), self.mechanism).columns(self.times, self.q, self.v)

    def _over(self, quantity: Evaluation, more: Mapping[str, Array] | None = None) -> Array:
        """Return a quantity at all states, shape (n_times, n_values)."""
        return quantity.over({**self._state, **(more or {})}, len(self.q))

    @cached_property
    def frames(self) -> tuple[BodyFrame, ...]:
        """Each body's frame."""
        values = self._over(self._recorded.of_frames)
        return tuple(_frame(values[:, first : first + 18]) for first in range(0, values.shape[1], 18))

    def place_motion(self, place: Place) -> BodyFrame:
        """Motion of the section at a place of a body, or of the ground."""
        return _frame(self._over(self._recorded.of_place(place)))

    def body_spin(self, body: int) -> Array:
        """Angular velocity of a body's frame in its own axes [rad/s], shape (n_times, 3)."""
        frame = self.frames[body]
        return np.asarray(np.einsum("tij,ti->tj", frame.rotation, frame.spin))

    @cached_property
    def momenta(self) -> tuple[Momenta, ...]:
        """Each body's first moment and momenta."""
        values = self._over(self._recorded.of_momenta).reshape(len(self.q), -1, 3, 3)
        return tuple(Momenta(*(values[:, k, part] for part in range(3))) for k in range(values.shape[1]))

    @cached_property
    def energies(self) -> tuple[Array, Array]:
        """Kinetic and potential energy (strain, springs, stops, force elements, weight) [J], (n_times,) each."""
        kinetic, potential = self._over(self._recorded.of_energies).T
        return kinetic, potential

    @property
    def constraints(self) -> ConstraintValues:
        """Scalar constraints, those that hold in every state among them."""
        rows = self._recorded.rows
        joints, n = [row.name for row in rows if row.wrenches], 2 * len(rows)
        values = self._over(self._recorded.of_rows) if rows else np.zeros((len(self.q), 0))
        wrenches = values[:, n:].reshape(len(self.q), len(joints), 2, 6)
        return ConstraintValues(joints, values[:, :n:2], values[:, 1:n:2], wrenches)

    def strain(self, element: Element) -> tuple[Array, Array, Array]:
        """Strain of a force element, its rate, and that of the vector from its first place to its second in space.

        Shapes are (n_times, n), twice, and (n_times, 3): of a spring the strain is its elongation [m], of a bushing
        displacement [m] and, if it counts, rotation [rad] of its second place.
        """
        values = self._over(self._recorded.of_strain(element))
        n = (values.shape[1] - 3) // 2
        return values[:, :n], values[:, n:-3], values[:, -3:]

    def effort(self, effort: StateFunction) -> Array:
        """Force [N] or torque [N m] that a function of the state gives, shape (n_times,)."""
        return self._over(self._recorded.of_effort(effort))[:, 0]

    def wrenches(self, element: Element) -> Array:
        """Force [N] and moment [N m] in space on both places of a force element, shape (n_times, 2, 6)."""
        return self._over(self._recorded.of_wrenches(element)).reshape(-1, 2, 6)

    @property
    def _first_moment(self) -> Array:
        """First moment of all bodies about the ground's origin [kg m], shape (n_times, 3)."""
        parts = zip(self.mechanism.links, self.frames, self.momenta, strict=True)
        return np.asarray(
            sum(link.integrals.mass * at.origin + turned(at.rotation, of.moment) for link, at, of in parts)
        )

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
            if link.integrals.normal >= 0:
                total[:, np.arange(3) != link.integrals.normal] = np.nan
        return total

    def marker_position(self, body: int, name: str) -> Array:
        """A marker of a body in space [m], shape (n_times, 3)."""
        body = self.mechanism.find_marker(body, name)
        origin, rotation = self._placement(body)
        marker = self.mechanism.links[body].markers[name]
        return origin + turned(rotation, marker.position + self._displacement_in_body(body, name))

    def _placement(self, body: int) -> tuple[Array, Array]:
        """Origin and rotation of a body's frame: of the first body that is asked for alone, else with all frames."""
        if "frames" in vars(self) or self._placements.keys() - {body}:
            return self.frames[body].origin, self.frames[body].rotation
        if body not in self._placements:
            values = self._over(self._recorded.of_placement(body))
            origin, rotation = np.ascontiguousarray(values[:, :3]), np.ascontiguousarray(values[:, 3:])
            self._placements[body] = origin, rotation.reshape(-1, 3, 3)
        return self._placements[body]

    @cached_property
    def _placements(self) -> dict[int, tuple[Array, Array]]:
        return {}

    def marker_velocity(self, body: int, name: str) -> Array:
        """Velocity of a marker of a body in space [m/s], shape (n_times, 3)."""
        return self.place_motion(self._place(body, name)).velocity

    def marker_acceleration(self, body: int, name: str, accelerations: Array) -> Array:
        """Acceleration of a marker in space [m/s²], (n_times, 3), for accelerations (n_times, n) of the coordinates."""
        return self._over(self._recorded.of_acceleration(self._place(body, name)), {"a": accelerations.T})

    def _place(self, body: int, name: str) -> Place:
        link = self.mechanism.links[self.mechanism.find_marker(body, name)]
        return Place(link.name, link.markers[name])

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
        return displaced(at.translation, at.displacement2[:3], q)

    def _undeformed(self, body: int, name: str) -> Array:
        """Position of a marker in the undeformed part, from the joint at its first piece [m], shape (3,)."""
        position, first = self.mechanism.links[body].markers[name].position, self.mechanism.first_piece(body)
        while body != first:
            position, body = position + self.mechanism.links[body].place.position, self.mechanism.links[body].parent
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
        if first == body and section.displacement2.size:
            shapes = np.r_[section.translation, section.rotation]
            shift, turn = np.split(displaced(shapes, section.displacement2, q), 2, axis=1)
            arm = arm - section.position
            return np.asarray(turned(rotation_matrix(-turn), arm + own - shift) - arm)
        arm = arm if first == body else arm + own
        return np.asarray(own - q @ section.translation.T - np.cross(q @ section.rotation.T, arm))


def _frame(values: Array) -> BodyFrame:
    """Return the frame whose origin, rotation by rows, velocity and angular velocity are (n_times, 18) in a row."""
    origin, rotation, velocity, spin = (np.ascontiguousarray(part) for part in np.split(values, (3, 12, 15), axis=1))
    return BodyFrame(origin, rotation.reshape(-1, 3, 3), velocity, spin)

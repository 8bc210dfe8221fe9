"""The motion of a mechanism: its joints, bodies, markers, energies and momenta over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from fmd.core.arrays import Array, IntArray, short_repr
from fmd.core.data_classes import dataclass
from fmd.core.html import facts, scaled
from fmd.core.limits.memory import TIMES_AT_ONCE
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.reactions import JointLoads, closing_reactions, constraint_residual, joint_loads
from fmd.dynamics.state_functions import Quantity
from fmd.integrators.protocol import Trajectory

if TYPE_CHECKING:
    from fmd.contact.histories import ContactHistory
    from fmd.contact.recorded import ContactRecord


@dataclass(frozen=True)
class Motion:
    """A trajectory with the mechanism that it belongs to."""

    mechanism: Mechanism  # whose coordinates the trajectory has
    trajectory: Trajectory  # positions and rates at the output times
    tip: str  # ``"body.marker"``, the marker whose motion is reported
    # Gives the mechanism with the whole inertia of each body, which forces of joints take.
    complete: Callable[[Mechanism], Mechanism] | None = None
    # Gives, for an output or a state of a controller, its function of time, and any other quantity as it is.
    known: Callable[[Quantity], Quantity] | None = None

    __repr__ = short_repr

    @property
    def times(self) -> Array:
        """Output times [s], shape (n_times,)."""
        return self.trajectory.times

    def part(self, first: int, stop: int | None = None) -> Motion:
        """Return the motion at some of the output times; nothing that is computed of it stays in the whole one."""
        return self.at(slice(first, stop))

    def at(self, chosen: slice | IntArray) -> Motion:
        """Return the motion at chosen output times, by their numbers."""
        t = self.trajectory
        contacts = t.contacts[chosen] if len(t.contacts) else t.contacts  # not every march without any has rows
        part = replace(t, times=t.times[chosen], q=t.q[chosen], v=t.v[chosen], contacts=contacts)
        return replace(self, trajectory=part)

    def parts(self) -> Iterator[tuple[int, Motion]]:
        """Yield the motion piece by piece, each with the number of its first output time, so that memory holds one."""
        if len(self.times) <= TIMES_AT_ONCE:
            yield 0, self
            return
        for first in range(0, len(self.times), TIMES_AT_ONCE):
            yield first, self.part(first, first + TIMES_AT_ONCE)

    @cached_property
    def kinematics(self) -> Kinematics:
        """Frames, energies and momenta at the output times."""
        return Kinematics(self.mechanism, self.times, self.trajectory.q, self.trajectory.v)

    # Joints ------------------------------------------------------------------------------------------------------

    @cached_property
    def joints(self) -> Mapping[str, int]:
        """Numbers of the bodies that the revolute and prismatic joints carry, by the joints' names."""
        return {link.joint_name: k for k, link in enumerate(self.mechanism.links) if link.unit}

    def joint_unit(self, joint: str) -> str:
        """Unit of a joint's position, ``rad`` or ``m``."""
        return self.mechanism.links[self.joints[joint]].unit

    def joint_position(self, joint: str) -> Array:
        """Angle [rad] of the section at a revolute joint, displacement [m] of a prismatic one, shape (n_times,)."""
        return self.kinematics.along_joint(self.joints[joint])[0]

    def joint_rate(self, joint: str) -> Array:
        """Rate of a revolute or prismatic joint's position [rad/s or m/s], shape (n_times,)."""
        return self.kinematics.along_joint(self.joints[joint])[1]

    # Bodies ------------------------------------------------------------------------------------------------------

    def modal(self, body: str) -> Array:
        """Modal coordinates of a body [kg^1/2 m], shape (n_times, n_modes)."""
        return self.kinematics.modal_coordinates(self.mechanism.number_of(body))

    def spin(self, body: str) -> Array:
        """Size of the angular velocity of a body's frame [rad/s], shape (n_times,)."""
        return np.asarray(np.linalg.norm(self.kinematics.frames[self.mechanism.number_of(body)].spin, axis=1))

    def placed(self, body: str, r: Array, k: int) -> Array:
        """Points r (n, 3) [m] of a body's frame as they are in space at output time k, shape (n, 3)."""
        frame = self.kinematics.frames[self.mechanism.number_of(body)]
        return np.asarray(frame.origin[k] + r @ frame.rotation[k].T)

    def seen_from(self, body: str, points: Array, k: int) -> Array:
        """Points in space (n, 3) [m] at output time k as they are in a body's frame, shape (n, 3)."""
        frame = self.kinematics.frames[self.mechanism.number_of(body)]
        return np.asarray((points - frame.origin[k]) @ frame.rotation[k])

    @cached_property
    def closing_reactions(self) -> Mapping[str, Array]:
        """Force [N] and moment [N m] of each joint that closes a loop on its parent and child, (n_times, 2, 6)."""
        return closing_reactions(self.mechanism, self.times, self.trajectory.q, self.trajectory.v, self._pushes)

    @cached_property
    def joint_loads(self) -> JointLoads:
        """Accelerations, and force and moment of every joint, at the output times."""
        whole = self.mechanism if self.complete is None else self.complete(self.mechanism)
        q, v = self.trajectory.q, self.trajectory.v
        return joint_loads(self.mechanism, whole, self.times, q, v, self._pushes)

    @cached_property
    def touched(self) -> ContactRecord | None:
        """Contacts and their forces at the output times; ``None`` where nothing may touch."""
        if not self.mechanism.contacts:
            return None
        first, *_ = self.mechanism.contacts  # which knows its record, so that no other scene loads it
        return first.record(self.mechanism.contacts, self.trajectory.contacts)

    @property
    def contacts(self) -> Mapping[str, ContactHistory]:
        """Contacts at the output times, by name; none where nothing may touch."""
        return {} if self.touched is None else self.touched.histories

    @property
    def contact_wear(self) -> Mapping[str, Array]:
        """Volumes that points of bodies have lost by wear since the start [m³], (n_times, n_points), by body."""
        return {} if self.touched is None else self.touched.worn

    @property
    def contact_pressures(self) -> Mapping[str, Array]:
        """Pressures at the points of bodies that touch something [Pa], shapes (n_times, n_points), by their names."""
        return {} if self.touched is None else self.touched.pressures

    @property
    def contact_slips(self) -> Mapping[str, Array]:
        """Ways that points of bodies have slipped while pressed [m], shapes (n_times, n_points), by bodies' names."""
        return {} if self.touched is None else self.touched.slips

    @property
    def _pushes(self) -> tuple[Array, ...]:
        """Forces of contacts on the bodies' frames (n_times, n_bodies, 6) and on modes (n_times, n); none without."""
        if self.touched is None:
            return ()
        mechanism, n_times = self.mechanism, len(self.times)
        frames, modes = np.zeros((n_times, len(mechanism.links), 6)), np.zeros((n_times, mechanism.n))
        for name, pushes in self.touched.pushes.items():
            number = mechanism.number_of(name)
            frames[:, number] = pushes
            modes[:, mechanism.modes_of(number)] = self.touched.modal[name]
        return frames, modes

    @property
    def constraint_residual(self) -> float:
        """Largest gap of the loops at the output times [m, or rad]; 0 without loops."""
        return constraint_residual(self.mechanism, self.times, self.trajectory.q, self.trajectory.v)

    # The tip -----------------------------------------------------------------------------------------------------

    @cached_property
    def tip_position(self) -> Array:
        """Tip in space [m], shape (n_times, 3)."""
        return self.kinematics.marker_position(*self._tip)

    @cached_property
    def tip_deflection(self) -> Array:
        """Displacement of the tip by deformation, seen from the section at its body's joint [m], shape (n_times, 3)."""
        return self.kinematics.deflection(*self._tip)

    @property
    def tip_displacement(self) -> Array:
        """Displacement of the tip by deformation in its body's floating frame [m], shape (n_times, 3)."""
        return self.kinematics.displacement(*self._tip)

    @property
    def tip_size(self) -> Array:
        """Size of the tip's deflection [m], shape (n_times,)."""
        return np.asarray(np.linalg.norm(self.tip_deflection, axis=1))

    @property
    def tip_link(self) -> Link:
        """Body that the tip is on, with its joint."""
        return self.mechanism.links[self._tip[0]]

    @property
    def _tip(self) -> tuple[int, str]:
        body, _, marker = self.tip.partition(".")
        return self.mechanism.number_of(body), marker

    # The whole ---------------------------------------------------------------------------------------------------

    @property
    def energies(self) -> tuple[Array, Array]:
        """Kinetic and potential energy [J], each of shape (n_times,)."""
        return self.kinematics.energies

    @property
    def centre_of_mass(self) -> Array:
        """Centre of all bodies' mass in space [m], shape (n_times, 3)."""
        return self.kinematics.centre_of_mass

    @property
    def centre_velocity(self) -> Array:
        """Velocity of the centre of mass [m/s], shape (n_times, 3)."""
        return self.kinematics.momentum / self.mechanism.mass

    @property
    def centre_angular_velocity(self) -> Array:
        """Angular velocity of the centre of mass about the first joint's axis, ``e·(r × v)/|e × r|²`` [rad/s]."""
        joint = self.mechanism.links[0]
        axis = joint.place_axes @ joint.axis / np.linalg.norm(joint.axis)
        arm = np.cross(axis, self.centre_of_mass - joint.place.position)
        moment, square = (arm * self.centre_velocity).sum(axis=1), (arm**2).sum(axis=1)
        return np.asarray(np.divide(moment, square, out=np.zeros(len(square)), where=square > 0.0))

    # Figures -----------------------------------------------------------------------------------------------------

    def differences(self, first: Motion) -> dict[str, Any]:
        """Return the largest differences from another motion over all output times."""
        largest = {"position": 0.0, "deflection": 0.0} | dict.fromkeys((("joint", name) for name in self.joints), 0.0)
        for (_, own), (_, other) in zip(self.parts(), first.parts(), strict=True) if first is not self else ():
            found: dict[Any, float] = {
                "position": _farthest(own.tip_position, other.tip_position),
                "deflection": _farthest(own.tip_deflection, other.tip_deflection),
            }
            for joint in self.joints:
                apart = np.abs(own.joint_position(joint) - other.joint_position(joint))
                found["joint", joint] = float(apart.max())
            largest = {key: max(value, found[key]) for key, value in largest.items()}
        return {
            "tip_difference_m": largest["position"],
            "tip_deflection_difference_m": largest["deflection"],
            "joint_differences": {joint: largest["joint", joint] for joint in self.joints},
        }

    def final(self) -> dict[str, Any]:
        """Return the state at the last output time: joints, energies and the tip."""
        return dict(self._final)

    @cached_property
    def _final(self) -> dict[str, Any]:
        if len(self.times) > TIMES_AT_ONCE:
            return self.part(len(self.times) - TIMES_AT_ONCE).final()
        kinetic, potential = self.part(len(self.times) - 1).energies
        return {
            "time_s": float(self.times[-1]),
            "joint_positions": {joint: float(self.joint_position(joint)[-1]) for joint in self.joints},
            "joint_rates": {joint: float(self.joint_rate(joint)[-1]) for joint in self.joints},
            "kinetic_energy_j": float(kinetic[-1]),
            "potential_energy_j": float(potential[-1]),
            "tip": {"position_m": self.tip_position[-1].tolist(), "deflection_m": self.tip_deflection[-1].tolist()},
        }

    def _repr_html_(self) -> str:
        run = self.trajectory
        ratio = f" {run.substeps}:1" if run.substeps > 1 else ""
        work = f"{run.evaluations} + {run.fast_evaluations} solutions in {scaled(run.seconds, 's')}"
        rows = [("method", run.integrator + ratio), ("step", scaled(run.step, "s")), ("work", work)]
        for name, value in self.final().items():
            inner = value.items() if isinstance(value, Mapping) else [("", value)]
            rows += [(f"{name} {key}".replace("_", " ").rstrip(), _figures(figure)) for key, figure in inner]
        return facts(rows, f"motion, {len(run.times)} output times; where it ends")


def _farthest(some: Array, others: Array) -> float:
    """Largest distance of vectors (n_times, 3)."""
    return float(np.linalg.norm(some - others, axis=1).max())


def _figures(value: float | list[float]) -> str:
    """Write a number, or the numbers of a vector, with six digits."""
    return ", ".join(f"{x:.6g}" for x in value) if isinstance(value, list) else f"{value:.6g}"

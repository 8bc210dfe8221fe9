"""What a body on a fixed axis does in space: its centre of mass, its tip and its energies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.rotor.rotor import PlanarRotor
from pipeline.integrators.protocol import Trajectory
from pipeline.recovery.motion_table import motion_table

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class Motion:
    """A trajectory with the mechanism it belongs to.

    Parameters
    ----------
    rotor : PlanarRotor
        The mechanism.
    trajectory : Trajectory
        Its motion.
    tip : str
        Name of the body's marker whose motion is reported.
    """

    rotor: PlanarRotor
    trajectory: Trajectory
    tip: str

    @property
    def times(self) -> Array:
        """Output times [s], shape (n_times,)."""
        return self.trajectory.times

    @property
    def q(self) -> Array:
        """Modal coordinates [kg^1/2 m], shape (n_times, n_modes)."""
        return self.trajectory.q[:, 1:]

    @property
    def frame_angle(self) -> Array:
        """Angle of the floating frame [rad], shape (n_times,)."""
        return self.trajectory.q[:, 0]

    @property
    def joint_angle(self) -> Array:
        """Angle of the body's section at the joint, what an encoder there reads [rad], shape (n_times,)."""
        return np.asarray(self.frame_angle + self.q @ self.rotor.body.joint_rotation)

    @property
    def joint_rate(self) -> Array:
        """Rate of ``joint_angle`` [rad/s], shape (n_times,)."""
        rates = self.trajectory.v
        return np.asarray(rates[:, 0] + rates[:, 1:] @ self.rotor.body.joint_rotation)

    @property
    def com_position(self) -> Array:
        """Centre of mass relative to the joint [m], shape (n_times, 3)."""
        return self._in_space(self._com_in_frame)

    @property
    def com_velocity(self) -> Array:
        """Velocity of the centre of mass [m/s], shape (n_times, 3)."""
        gram, v = self.rotor.body.gram, self.trajectory.v
        relative = v[:, 1:] @ gram.S[:, 1:].T / gram.mass
        spin = v[:, :1] * np.cross(self.rotor.body.axis, self._com_in_frame)
        return self._in_space(spin + relative)

    @property
    def com_angular_velocity(self) -> Array:
        """Angular velocity of the centre of mass about the joint's axis, ``e·(r × v)/r²`` [rad/s]."""
        e = self.rotor.body.axis
        arm = np.cross(e, self.com_position)
        return np.asarray((arm * self.com_velocity).sum(axis=1) / (arm**2).sum(axis=1))

    @property
    def tip_position(self) -> Array:
        """The tip relative to the joint [m], shape (n_times, 3)."""
        marker = self.rotor.body.markers[self.tip]
        return self._in_space(marker.position + self.q @ marker.translation.T)

    @property
    def tip_deflection(self) -> Array:
        """Displacement of the tip across its arm, seen from the section at the joint [m], shape (n_times,)."""
        body = self.rotor.body
        marker = body.markers[self.tip]
        arm = np.cross(body.axis, marker.position)
        length = np.linalg.norm(arm)
        return np.asarray(self.q @ (arm @ marker.translation / length - length * body.joint_rotation))

    @property
    def tip_size(self) -> Array:
        """Size of the tip's deflection [m], shape (n_times,)."""
        return np.abs(self.tip_deflection)

    @cached_property
    def energies(self) -> tuple[Array, Array]:
        """Kinetic and strain energy [J], each of shape (n_times,)."""
        return self.rotor.energies(self.trajectory.q, self.trajectory.v)

    def differences(self, first: Motion) -> dict[str, Any]:
        """Return the largest differences from another motion over all output times."""
        return {
            "tip_difference_m": float(np.linalg.norm(self.tip_position - first.tip_position, axis=1).max()),
            "tip_deflection_difference_m": float(np.abs(self.tip_deflection - first.tip_deflection).max()),
        }

    def _repr_html_(self) -> str:
        return motion_table(self.trajectory, self.final())

    def final(self) -> dict[str, Any]:
        """Return where the motion ends."""
        kinetic, strain = self.energies
        return {
            "time_s": float(self.times[-1]),
            "joint_angle_rad": float(self.joint_angle[-1]),
            "joint_rate_rad_s": float(self.joint_rate[-1]),
            "tip_deflection_m": float(self.tip_deflection[-1]),
            "kinetic_energy_j": float(kinetic[-1]),
            "strain_energy_j": float(strain[-1]),
        }

    @property
    def _com_in_frame(self) -> Array:
        gram = self.rotor.body.gram
        return np.asarray((gram.S[:, 0] + self.q @ gram.S[:, 1:].T) / gram.mass)

    def modal(self, body: str) -> Array:
        """Modal coordinates of the one body, whatever its name, shape (n_times, n_modes)."""
        return self.q

    def spin(self, body: str) -> Array:
        """Angular rate of the body's frame [rad/s], shape (n_times,)."""
        return np.abs(self.trajectory.v[:, 0])

    def placed(self, body: str, r: Array, k: int) -> Array:
        """Points r (n, 3) [m] of the body's frame as they are in space at output time k, shape (n, 3)."""
        return _turned(r, self.rotor.body.axis, self.frame_angle[k])

    def _in_space(self, r: Array) -> Array:
        """One vector of the frame for each output time, in space, shape (n_times, 3)."""
        return _turned(r, self.rotor.body.axis, self.frame_angle[:, None])


def _turned(r: Array, e: Array, angle: Array) -> Array:
    """Turn vectors r (n, 3) by angles about the unit vector e (Rodrigues' formula)."""
    along = np.outer(r @ e, e)
    return np.asarray(along + np.cos(angle) * (r - along) + np.sin(angle) * np.cross(e, r))


def motion_dataset(motions: dict[str, Motion]) -> xarray.Dataset:
    """Gather several motions with common output times in one labelled data set, units as attributes."""
    import xarray

    labels = list(motions)
    first = motions[labels[0]]

    def stacked(name: str) -> Array:
        return np.stack([getattr(motion, name) for motion in motions.values()])

    per_time, xyz = ("run", "time"), ("run", "time", "axis")
    variables = {
        "joint_angle": (per_time, "rad", "angle of the body's section at the joint"),
        "joint_rate": (per_time, "rad/s", "rate of joint_angle"),
        "frame_angle": (per_time, "rad", "angle of the floating frame"),
        "tip_deflection": (per_time, "m", "tip across its arm, seen from the section at the joint"),
        "tip_position": (xyz, "m", "tip relative to the joint"),
        "com_position": (xyz, "m", "centre of mass relative to the joint"),
        "com_velocity": (xyz, "m/s", "velocity of the centre of mass"),
        "com_angular_velocity": (per_time, "rad/s", "angular velocity of the centre of mass about the joint"),
    }
    data = {
        name: (dims, stacked(name), {"units": unit, "long_name": text})
        for name, (dims, unit, text) in variables.items()
    }
    data["modal_coordinates"] = (
        ("run", "time", "mode"), stacked("q"), {"units": "kg^0.5 m", "long_name": "modal coordinates"},
    )  # fmt: skip
    energies = np.stack([np.stack(motion.energies) for motion in motions.values()])
    for k, name in enumerate(("kinetic_energy", "strain_energy")):
        data[name] = (per_time, energies[:, k], {"units": "J", "long_name": name.replace("_", " ")})
    return xarray.Dataset(
        data,
        coords={
            "run": labels,
            "time": ("time", first.times, {"units": "s"}),
            "mode": (
                "mode",
                first.rotor.body.frequencies_hz,
                {"units": "Hz", "long_name": "modal frequency"},
            ),
            "axis": ["x", "y", "z"],
        },
    )

"""What a chain of bodies does: its joints, its tip and its energies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.kinematics import Kinematics, turned
from pipeline.dynamics.mechanism import Mechanism
from pipeline.integrators.protocol import Trajectory
from pipeline.recovery.motion_table import motion_table
from pipeline.reduction.body import MarkerShapes

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class ChainMotion:
    """A trajectory of a chain.

    Parameters
    ----------
    tree : Mechanism
        The mechanism.
    trajectory : Trajectory
        Its motion.
    tip : tuple of str and MarkerShapes
        The body whose motion is reported, and where on it.
    joints : mapping of str to str
        The body that each revolute or prismatic joint carries, by the joint's name.
    """

    tree: Mechanism
    trajectory: Trajectory
    tip: tuple[str, MarkerShapes]
    joints: Mapping[str, str]

    @property
    def times(self) -> Array:
        """Output times [s], shape (n_times,)."""
        return self.trajectory.times

    def modal(self, body: str) -> Array:
        """Modal coordinates of a body [kg^1/2 m], shape (n_times, n_modes)."""
        modes = self.tree.modes_of(self._number(body))
        return np.asarray(self.trajectory.q[:, modes + self.tree.n_positions - self.tree.n])

    def joint_position(self, joint: str) -> Array:
        """Angle of the section [rad] or displacement [m] at a revolute or prismatic joint, shape (n_times,)."""
        return self._along(joint, 0)

    def joint_rate(self, joint: str) -> Array:
        """Its rate [rad/s or m/s], shape (n_times,)."""
        return self._along(joint, 1)

    @cached_property
    def kinematics(self) -> Kinematics:
        """Frames, energies and momenta at the output times."""
        return Kinematics(self.tree, self.times, self.trajectory.q, self.trajectory.v)

    def spin(self, body: str) -> Array:
        """Angular rate of a body's frame [rad/s], shape (n_times,)."""
        return np.asarray(np.linalg.norm(self.kinematics.body_spin(self._number(body)), axis=1))

    def placed(self, body: str, r: Array, k: int) -> Array:
        """Points r (n, 3) [m] of a body's frame as they are in space at output time k, shape (n, 3)."""
        frame = self.kinematics.frames[self._number(body)]
        return np.asarray(frame.origin[k] + r @ frame.rotation[k].T)

    @property
    def tip_displacement(self) -> Array:
        """Displacement of the tip by deformation, in its body's frame [m], shape (n_times, 3)."""
        body, place = self.tip
        return np.asarray(self.modal(body) @ place.translation.T)

    @property
    def tip_size(self) -> Array:
        """Size of the tip's displacement by deformation [m], shape (n_times,)."""
        return np.asarray(np.linalg.norm(self.tip_displacement, axis=1))

    @cached_property
    def tip_position(self) -> Array:
        """The tip in space [m], shape (n_times, 3)."""
        body, place = self.tip
        frame = self.kinematics.frames[self._number(body)]
        return frame.origin + turned(frame.rotation, place.position + self.tip_displacement)

    @cached_property
    def energies(self) -> tuple[Array, Array]:
        """Kinetic and potential energy [J], each of shape (n_times,)."""
        return self.kinematics.energies

    def differences(self, first: ChainMotion) -> dict[str, Any]:
        """Return the largest differences from another motion over all output times."""
        return {
            "tip_difference_m": float(np.linalg.norm(self.tip_position - first.tip_position, axis=1).max()),
            "joint_differences": {
                joint: float(np.abs(self.joint_position(joint) - first.joint_position(joint)).max())
                for joint in self.joints
            },
        }

    def _repr_html_(self) -> str:
        return motion_table(self.trajectory, self.final())

    def final(self) -> dict[str, Any]:
        """Return where the motion ends."""
        kinetic, potential = self.energies
        return {
            "time_s": float(self.times[-1]),
            "joint_positions": {joint: float(self.joint_position(joint)[-1]) for joint in self.joints},
            "joint_rates": {joint: float(self.joint_rate(joint)[-1]) for joint in self.joints},
            "kinetic_energy_j": float(kinetic[-1]),
            "potential_energy_j": float(potential[-1]),
        }

    def _number(self, body: str) -> int:
        return next(k for k, link in enumerate(self.tree.links) if link.name == body)

    def _along(self, joint: str, derivative: int) -> Array:
        """Position or rate along a joint; on a hinge, of the section that it grips."""
        number = self._number(self.joints[joint])
        link, layout = self.tree.links[number], self.tree.layout
        if link.motion is not None:
            return link.motion.values(self.times)[:, derivative]
        values, at = (self.trajectory.v, layout.rate) if derivative else (self.trajectory.q, layout.position)
        along = values[:, at[number]]
        if len(link.joint_rotation):
            modes = self.tree.modes_of(number) + (0 if derivative else self.tree.n_positions - self.tree.n)
            along = along + values[:, modes] @ link.joint_rotation
        return np.asarray(along)


def chain_dataset(motions: Mapping[str, ChainMotion], units: Mapping[str, str]) -> xarray.Dataset:
    """Gather several motions with common output times in one labelled data set.

    Parameters
    ----------
    units : mapping of str to str
        Unit of each joint's position, ``rad`` or ``m``.
    """
    import xarray

    first = next(iter(motions.values()))
    data: dict[str, Any] = {}
    for joint in first.joints:
        for name, unit, get in (
            ("position", units[joint], ChainMotion.joint_position),
            ("rate", f"{units[joint]}/s", ChainMotion.joint_rate),
        ):
            values = np.stack([get(motion, joint) for motion in motions.values()])
            data[f"{joint}_{name}"] = (
                ("run", "time"),
                values,
                {"units": unit, "long_name": f"{name} of joint {joint}"},
            )
    for link in first.tree.links:
        if len(link.omega):
            data[f"{link.name}_modal_coordinates"] = (
                ("run", "time", f"{link.name}_mode"),
                np.stack([motion.modal(link.name) for motion in motions.values()]),
                {"units": "kg^0.5 m", "long_name": f"modal coordinates of {link.name}"},
            )
    tips = np.stack([motion.tip_position for motion in motions.values()])
    data["tip_position"] = (("run", "time", "axis"), tips, {"units": "m", "long_name": "tip in space"})
    energies = np.stack([np.stack(motion.energies) for motion in motions.values()])
    for k, name in enumerate(("kinetic_energy", "potential_energy")):
        data[name] = (("run", "time"), energies[:, k], {"units": "J", "long_name": name.replace("_", " ")})
    return xarray.Dataset(
        data, coords={"run": list(motions), "time": ("time", first.times, {"units": "s"}), "axis": ["x", "y", "z"]}
    )

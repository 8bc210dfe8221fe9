"""What a chain of bodies does: its joints, its tip and its energies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.checks import Array
from pipeline.dynamics.tree import N_RATES, Tree
from pipeline.integrators.protocol import Trajectory

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class ChainMotion:
    """A trajectory of a chain.

    Parameters
    ----------
    tree : Tree
        The mechanism.
    trajectory : Trajectory
        Its motion.
    tip : tuple of str and ndarray, shape (3,)
        The body whose motion is reported, and where on it [m].
    joints : mapping of str to str
        The body that each revolute or prismatic joint carries, by the joint's name.
    """

    tree: Tree
    trajectory: Trajectory
    tip: tuple[str, Array]
    joints: Mapping[str, str]

    @property
    def times(self) -> Array:
        """Output times [s], shape (n_times,)."""
        return self.trajectory.times

    def joint_position(self, joint: str) -> Array:
        """Angle [rad] or displacement [m] of a revolute or prismatic joint, shape (n_times,)."""
        return np.asarray(self.trajectory.q[:, self._number(joint, self.tree.layout[1])])

    def joint_rate(self, joint: str) -> Array:
        """Its rate [rad/s or m/s], shape (n_times,)."""
        return np.asarray(self.trajectory.v[:, self._number(joint, self.tree.layout[0])])

    @cached_property
    def tip_position(self) -> Array:
        """The tip in space [m], shape (n_times, 3)."""
        body, place = self.tip
        frames = (self.tree.frames(q)[body] for q in self.trajectory.q)
        return np.array([origin + R @ place for origin, R in frames])

    @cached_property
    def energies(self) -> tuple[Array, Array]:
        """Kinetic and potential energy [J], each of shape (n_times,)."""
        return self.tree.energies(self.trajectory.q, self.trajectory.v)

    def differences(self, first: ChainMotion) -> dict[str, Any]:
        """Return the largest differences from another motion over all output times."""
        return {
            "tip_difference_m": float(np.linalg.norm(self.tip_position - first.tip_position, axis=1).max()),
            "joint_differences": {
                joint: float(np.abs(self.joint_position(joint) - first.joint_position(joint)).max())
                for joint in self.joints
            },
        }

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

    def _number(self, joint: str, places: Array | Any) -> int:
        body = self.joints[joint]
        for k, link in enumerate(self.tree.links):
            if link.name == body and N_RATES[link.joint] == 1:
                return int(places[k])
        raise KeyError(joint)


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
    tips = np.stack([motion.tip_position for motion in motions.values()])
    data["tip_position"] = (("run", "time", "axis"), tips, {"units": "m", "long_name": "tip in space"})
    energies = np.stack([np.stack(motion.energies) for motion in motions.values()])
    for k, name in enumerate(("kinetic_energy", "potential_energy")):
        data[name] = (("run", "time"), energies[:, k], {"units": "J", "long_name": name.replace("_", " ")})
    return xarray.Dataset(
        data, coords={"run": list(motions), "time": ("time", first.times, {"units": "s"}), "axis": ["x", "y", "z"]}
    )

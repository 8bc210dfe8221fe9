"""Names, units and descriptions of an FMU's variables, from the names of joints, bodies, markers and elements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fmd.dynamics.compiler.external import ExternalMechanism
from fmd.dynamics.compiler.external_quantities import ExternalQuantity
from fmd.dynamics.links import Link
from fmd.recovery.stress import STRESS_TENSOR

_AXES = ("x", "y", "z")


class Entry(NamedTuple):
    """Name, unit and description of a variable; the unit may be empty."""

    name: str
    unit: str
    description: str


class Names:
    """Names of what a mechanism has."""

    def __init__(self, external: ExternalMechanism) -> None:
        self._external, self._mechanism = external, external.mechanism
        bodies = {link.name for link in self._mechanism.links}
        self._joints = [
            f"joint.{_quote(link.joint_name)}" if link.joint_name in bodies else _quote(link.joint_name)
            for link in self._mechanism.links
        ]
        self._bodies = [_quote(link.name) for link in self._mechanism.links]

    def _place(self, body: int, name: str) -> str:
        """Return the name of a marker or element: of the part whose piece has it, but for markers at cuts."""
        part = self._mechanism.links[body].part
        return f"{self._bodies[body] if not part or ':' in name else _quote(part)}.{_quote(name)}"

    def states(self) -> list[Entry]:
        """Positions, then rates."""
        mechanism = self._mechanism
        positions, rates = [Entry("", "", "")] * mechanism.n_positions, [Entry("", "", "")] * mechanism.n
        shift = mechanism.position_shift
        for body, link in enumerate(mechanism.links):
            joint, first, at = self._joints[body], mechanism.layout.position[body], mechanism.layout.rate[body]
            for k in range(link.n_positions):
                unit = "m" if k < link.n_slides else "rad" if k < link.n_scalars else ""
                scalar = k < link.n_scalars
                what = f"coordinate of joint {link.joint_name}" if scalar else "part of a quaternion, the scalar last"
                positions[first + k] = Entry(f"states.{joint}.coordinate[{k + 1}]", unit, what)
            for k in range(link.n_rates):
                unit = "m/s" if k < link.n_slides else "rad/s"
                what = f"rate of joint {link.joint_name}"
                rates[at + k] = Entry(f"states.{joint}.rate[{k + 1}]", unit, what)
            for k, mode in enumerate(mechanism.modes_of(body)):
                hertz = link.omega[k] / (2 * np.pi)
                own = f"states.{self._bodies[body]}"
                what = f"mode {k + 1} of {link.name}, {hertz:.6g} Hz, unit modal mass"
                positions[mode + shift] = Entry(f"{own}.mode[{k + 1}]", "", f"{what} [kg^1/2 m]")
                rates[mode] = Entry(f"{own}.mode_rate[{k + 1}]", "", f"rate of {what}")
        return [*positions, *rates]

    def own_inputs(self, point_loads: list[str]) -> list[tuple[Entry, int]]:
        """Inputs that are added to the mechanism's own loads and motions, with their places."""
        found = []
        for k, body in enumerate(self._external.driven_links):
            link, joint = self._mechanism.links[body], self._joints[body]
            added = "added to the scene's own"
            if link.motion is None:
                name, unit = ("torque", "N.m") if link.unit == "rad" else ("force", "N")
                found.append((Entry(f"{joint}.{name}", unit, f"{name} along joint {link.joint_name}, {added}"), 3 * k))
                continue
            orders = {"motion": "", "motion_rate": "/s", "motion_acceleration": "/s2"}
            for order, (name, per) in enumerate(orders.items()):
                what = f"{name.replace('_', ' of ')} prescribed at joint {link.joint_name}, {added}"
                found.append((Entry(f"{joint}.{name}", link.unit + per, what), 3 * k + order))
        first = len(self._external.driven_links)
        for k, (name, load) in enumerate(zip(point_loads, self._mechanism.loads, strict=True)):
            kind, unit = ("torque", "N.m") if load.torque else ("force", "N")
            entry = Entry(f"drive.{_quote(name)}.{kind}", unit, f"{kind} of drive {name}, added to the scene's own")
            found.append((entry, 3 * (first + k)))
        return found

    def marker_inputs(self) -> list[tuple[Entry, int]]:
        """Forces and torques on markers, with their places."""
        found, place = [], 3 * len(self._external.signals)
        for body, name in self._external.markers:
            for kind, unit in (("force", "N"), ("torque", "N.m")):
                for k, axis in enumerate(_AXES):
                    what = f"{kind} on marker {name} of {self._mechanism.links[body].name} along {axis} of the ground"
                    found.append((Entry(f"{self._place(body, name)}.{kind}[{k + 1}]", unit, what), place))
                    place += 3
        return found

    def constants(self) -> list[Entry]:
        """Springs and dampers of joints, and damping of modes."""
        found = []
        for body, name in self._external.constants:
            link = self._mechanism.links[body]
            if name == "damping":
                what = f"damping ratio of the modes of {link.name}"
                found.append(Entry(f"{self._bodies[body]}.damping", "", what))
                continue
            turns = link.unit == "rad"
            unit = {
                "spring": "N.m/rad" if turns else "N/m",
                "rest": link.unit,
                "damper": "N.m.s/rad" if turns else "N.s/m",
            }[name]
            found.append(Entry(f"{self._joints[body]}.{name}", unit, f"{name} of joint {link.joint_name}"))
        return found

    def factors(self, point_loads: list[str]) -> list[Entry]:
        """Factors of the mechanism's own loads and motions."""
        found = []
        for body in self._external.driven_links:
            link, joint = self._mechanism.links[body], self._joints[body]
            kind = "motion" if link.motion is not None else "load"
            what = f"factor of the scene's own {kind} of joint {link.joint_name}; 0 leaves the input alone"
            found.append(Entry(f"{joint}.own_{kind}", "", what))
        for name in point_loads:
            what = f"factor of the scene's own drive {name}; 0 leaves the input alone"
            found.append(Entry(f"drive.{_quote(name)}.own_load", "", what))
        return found

    def quantity(self, own: ExternalQuantity) -> Entry:
        """Name an output."""
        link = self._mechanism.links[own.body]
        index = f"[{','.join(map(str, own.indices))}]" if own.indices else ""
        if not own.place:
            unit = {"position": link.unit, "rate": f"{link.unit}/s"}.get(own.kind) or _UNITS[own.kind]
            what = f"{own.kind} of joint {link.joint_name}"
            if own.indices:
                kind, axis = own.kind.removeprefix("reaction_"), _AXES[own.indices[0] - 1]
                what = f"{kind} of joint {link.joint_name} on {link.name} along {axis} of the ground"
            return Entry(f"{self._joints[own.body]}.{own.kind}{index}", unit, what)
        name = f"{self._place(own.body, own.place)}.{own.kind}{index}"
        return Entry(name, _UNITS[own.kind], _describe(link, own))


_UNITS = {
    "reaction_force": "N",
    "reaction_moment": "N.m",
    "position": "m",
    "velocity": "m/s",
    "rotation": "",
    "angular_velocity": "rad/s",
    "displacement": "m",
    "stress": "Pa",
    "von_mises": "Pa",
}


def _describe(link: Link, own: ExternalQuantity) -> str:
    if own.kind == "von_mises":
        return f"von Mises stress of element {own.place} of {link.name}"
    if own.kind == "stress":
        return f"stress {STRESS_TENSOR[own.indices[0] - 1]} of element {own.place} of {link.name}, in its body's axes"
    place = f"marker {own.place} of {link.name}"
    if own.kind == "rotation":
        return f"rotation matrix from the section of {place} into the ground"
    axis = _AXES[own.indices[0] - 1]
    if own.kind == "displacement":
        return f"displacement {axis} of {place} by deformation, in its body's frame"
    return f"{own.kind.replace('_', ' ')} {axis} of {place} in the ground"


def _quote(name: str) -> str:
    """Return a name as FMI's structured names have it."""
    return name if name.isidentifier() else f"'{name}'"

"""Variables of an FMU: names, units and references of states, inputs, parameters and outputs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.compiler.external import ExternalMechanism
from pipeline.dynamics.compiler.external_quantities import Quantity
from pipeline.dynamics.links import FREE, SPHERICAL, Link

_AXES = ("x", "y", "z")
_COMPONENTS = ("xx", "yy", "zz", "yz", "xz", "xy")


class Variable(NamedTuple):
    """A variable of an FMU.

    Attributes
    ----------
    name : str
        With dots between its parts.
    reference : int
        Number by which it is read and set.
    causality, variability, initial : str
        As FMI has them; ``initial`` may be empty.
    start : float, optional
        Value at the start.
    unit, description : str
        The unit may be empty.
    state : int, optional
        Reference of the state whose derivative it is.
    depends : tuple of int, optional
        References of the states and inputs that it depends on; None for those that nothing else determines.
    nominal : float
        Size of a state.
    """

    name: str
    reference: int
    causality: str
    variability: str
    initial: str
    start: float | None
    unit: str
    description: str
    state: int | None = None
    depends: tuple[int, ...] | None = None
    nominal: float = 1.0


@dataclass(frozen=True)
class Interface:
    """What an FMU shows of a mechanism, and where the mechanism's functions have it.

    Attributes
    ----------
    variables : tuple of Variable
        In the order of their references, which are 1, 2, …
    input_places : tuple of int
        Place of each input among the functions' ``inputs``.
    n_own_inputs : int
        How many inputs come before those of markers.
    parameters : tuple of float
        Values of the constants, of the factors of own loads and motions, and the tolerance.
    """

    variables: tuple[Variable, ...]
    input_places: tuple[int, ...]
    n_own_inputs: int
    parameters: tuple[float, ...]

    def of(self, causality: str) -> list[Variable]:
        """Return the variables of a causality."""
        return [variable for variable in self.variables if variable.causality == causality]

    @property
    def derivatives(self) -> list[Variable]:
        """Derivatives of the states."""
        return [variable for variable in self.variables if variable.state is not None]


class _Entry(NamedTuple):
    name: str
    unit: str
    description: str


def make_interface(
    external: ExternalMechanism, point_loads: list[str], q0: Array, v0: Array, nominal: Array, tolerance: float
) -> Interface:
    """Name all variables of a mechanism.

    Parameters
    ----------
    point_loads : list of str
        Names of the drives that make the mechanism's loads at points.
    q0, v0 : ndarray, shapes (n_positions,) and (n,)
        Start.
    nominal : ndarray, shape (n_positions + n,)
        Size of each state.
    tolerance : float
        Of a step of the co-simulation.
    """
    names = _Names(external)
    states = names.states()
    n = len(states)
    inputs = [*names.own_inputs(point_loads), *names.marker_inputs()]
    parameters = [*names.constants(), *names.factors(point_loads)]
    values = [*external.constants.values(), *(1.0 for _ in external.signals), tolerance]
    parameters.append(_Entry("solver.tolerance", "", "co-simulation: largest error of a step, relative"))
    places = tuple(place for _, place in inputs)
    first_input, first_parameter = 1 + 2 * n, 1 + 2 * n + len(inputs)
    first_output = first_parameter + len(parameters)
    starts = np.concatenate([q0, v0])
    local = [
        Variable(own.name, 1 + k, "local", "continuous", "exact", float(starts[k]), own.unit, own.description)
        for k, own in enumerate(states)
    ]
    local = [variable._replace(nominal=float(size)) for variable, size in zip(local, nominal, strict=True)]
    rates = [
        Variable(
            f"der({own.name})", 1 + n + k, "local", "continuous", "calculated", None, _per_second(own.unit), "", 1 + k
        )
        for k, own in enumerate(states)
    ]
    entered = [
        Variable(own.name, first_input + k, "input", "continuous", "", 0.0, own.unit, own.description)
        for k, (own, _) in enumerate(inputs)
    ]
    fixed = [
        Variable(own.name, first_parameter + k, "parameter", "tunable", "exact", value, own.unit, own.description)
        for k, (own, value) in enumerate(zip(parameters, values, strict=True))
    ]
    fixed[-1] = fixed[-1]._replace(variability="fixed")
    by_place = {place: first_input + k for k, place in enumerate(places)}
    given = []
    for k, quantity in enumerate(external.quantities):
        entry = names.quantity(quantity)
        used = external.dependencies(quantity.value)
        found = {1 + place for argument, place in used if argument == "q"}
        found |= {1 + len(q0) + place for argument, place in used if argument == "v"}
        found |= {by_place[place] for argument, place in used if argument == "inputs" and place in by_place}
        depends = tuple(sorted(found))
        given.append(
            Variable(
                entry.name,
                first_output + k,
                "output",
                "continuous",
                "calculated",
                None,
                entry.unit,
                entry.description,
                depends=depends,
            )
        )
    n_own = len(names.own_inputs(point_loads))
    return Interface((*local, *rates, *entered, *fixed, *given), places, n_own, tuple(values))


class _Names:
    """Names of what a mechanism has."""

    def __init__(self, external: ExternalMechanism) -> None:
        self._external, self._mechanism = external, external.mechanism
        bodies = {link.name for link in self._mechanism.links}
        self._joints = [
            f"joint.{_quoted(link.joint_name)}" if link.joint_name in bodies else _quoted(link.joint_name)
            for link in self._mechanism.links
        ]
        self._bodies = [_quoted(link.name) for link in self._mechanism.links]

    def states(self) -> list[_Entry]:
        """Positions, then rates."""
        mechanism = self._mechanism
        positions, rates = [_Entry("", "", "")] * mechanism.n_positions, [_Entry("", "", "")] * mechanism.n
        shift = mechanism.n_positions - mechanism.n
        for body, link in enumerate(mechanism.links):
            joint, first, at = (
                self._joints[body],
                int(mechanism.layout.position[body]),
                int(mechanism.layout.rate[body]),
            )
            turn = link.n_rates if link.joint not in (FREE, SPHERICAL) else link.n_slides
            for k in range(link.n_positions):
                unit = "m" if k < link.n_slides else "rad" if k < turn else ""
                what = f"coordinate of joint {link.joint_name}" if k < turn else "part of a quaternion, the scalar last"
                positions[first + k] = _Entry(f"states.{joint}.coordinate[{k + 1}]", unit, what)
            for k in range(link.n_rates):
                unit = "m/s" if k < link.n_slides else "rad/s"
                what = f"rate of joint {link.joint_name}"
                rates[at + k] = _Entry(f"states.{joint}.rate[{k + 1}]", unit, what)
            for k, mode in enumerate(mechanism.modes_of(body)):
                hertz = link.omega[k] / (2 * np.pi)
                own, what = (
                    f"states.{self._bodies[body]}",
                    f"mode {k + 1} of {link.name}, {hertz:.6g} Hz, unit modal mass",
                )
                positions[mode + shift] = _Entry(f"{own}.mode[{k + 1}]", "", f"{what} [kg^1/2 m]")
                rates[mode] = _Entry(f"{own}.mode_rate[{k + 1}]", "", f"rate of {what}")
        return [*positions, *rates]

    def own_inputs(self, point_loads: list[str]) -> list[tuple[_Entry, int]]:
        """Inputs that are added to the mechanism's own loads and motions, with their places."""
        found = []
        for k, body in enumerate(self._external.driven_links):
            link, joint = self._mechanism.links[body], self._joints[body]
            added = "added to the scene's own"
            if link.motion is None:
                name, unit = ("torque", "N.m") if link.unit == "rad" else ("force", "N")
                found.append((_Entry(f"{joint}.{name}", unit, f"{name} along joint {link.joint_name}, {added}"), 3 * k))
                continue
            for order, (name, per) in enumerate(
                (("motion", ""), ("motion_rate", "/s"), ("motion_acceleration", "/s2"))
            ):
                what = f"{name.replace('_', ' of ')} prescribed at joint {link.joint_name}, {added}"
                found.append((_Entry(f"{joint}.{name}", link.unit + per, what), 3 * k + order))
        first = len(self._external.driven_links)
        for k, (name, load) in enumerate(zip(point_loads, self._mechanism.loads, strict=True)):
            kind, unit = ("torque", "N.m") if load.torque else ("force", "N")
            entry = _Entry(f"drive.{_quoted(name)}.{kind}", unit, f"{kind} of drive {name}, added to the scene's own")
            found.append((entry, 3 * (first + k)))
        return found

    def marker_inputs(self) -> list[tuple[_Entry, int]]:
        """Forces and torques on markers, with their places."""
        found, place = [], 3 * len(self._external.signals)
        for body, name in self._external.markers:
            for kind, unit in (("force", "N"), ("torque", "N.m")):
                for k, axis in enumerate(_AXES):
                    what = f"{kind} on marker {name} of {self._mechanism.links[body].name} along {axis} of the ground"
                    found.append((_Entry(f"{self._bodies[body]}.{_quoted(name)}.{kind}[{k + 1}]", unit, what), place))
                    place += 3
        return found

    def constants(self) -> list[_Entry]:
        """Springs and dampers of joints, and damping of modes."""
        found = []
        for body, name in self._external.constants:
            link = self._mechanism.links[body]
            if name == "damping":
                what = f"damping ratio of the modes of {link.name}"
                found.append(_Entry(f"{self._bodies[body]}.damping", "", what))
                continue
            turns = link.unit == "rad"
            unit = {
                "spring": "N.m/rad" if turns else "N/m",
                "rest": link.unit,
                "damper": "N.m.s/rad" if turns else "N.s/m",
            }[name]
            found.append(_Entry(f"{self._joints[body]}.{name}", unit, f"{name} of joint {link.joint_name}"))
        return found

    def factors(self, point_loads: list[str]) -> list[_Entry]:
        """Factors of the mechanism's own loads and motions."""
        found = []
        for body in self._external.driven_links:
            link, joint = self._mechanism.links[body], self._joints[body]
            kind = "motion" if link.motion is not None else "load"
            what = f"factor of the scene's own {kind} of joint {link.joint_name}; 0 leaves the input alone"
            found.append(_Entry(f"{joint}.own_{kind}", "", what))
        for name in point_loads:
            what = f"factor of the scene's own drive {name}; 0 leaves the input alone"
            found.append(_Entry(f"drive.{_quoted(name)}.own_load", "", what))
        return found

    def quantity(self, own: Quantity) -> _Entry:
        """Name an output."""
        link = self._mechanism.links[own.body]
        index = f"[{','.join(map(str, own.indices))}]" if own.indices else ""
        if not own.place:
            unit = link.unit if own.kind == "position" else f"{link.unit}/s"
            return _Entry(f"{self._joints[own.body]}.{own.kind}", unit, f"{own.kind} of joint {link.joint_name}")
        name = f"{self._bodies[own.body]}.{_quoted(own.place)}.{own.kind}{index}"
        return _Entry(name, _UNITS[own.kind], _describe(link, own))


_UNITS = {
    "position": "m",
    "velocity": "m/s",
    "rotation": "",
    "angular_velocity": "rad/s",
    "displacement": "m",
    "stress": "Pa",
    "von_mises": "Pa",
}


def _describe(link: Link, own: Quantity) -> str:
    if own.kind == "von_mises":
        return f"von Mises stress of element {own.place} of {link.name}"
    if own.kind == "stress":
        return f"stress {_COMPONENTS[own.indices[0] - 1]} of element {own.place} of {link.name}, in its body's axes"
    place = f"marker {own.place} of {link.name}"
    if own.kind == "rotation":
        return f"rotation matrix from the section of {place} into the ground"
    axis = _AXES[own.indices[0] - 1]
    if own.kind == "displacement":
        return f"displacement {axis} of {place} by deformation, in its body's frame"
    return f"{own.kind.replace('_', ' ')} {axis} of {place} in the ground"


def _per_second(unit: str) -> str:
    return {"m": "m/s", "rad": "rad/s", "m/s": "m/s2", "rad/s": "rad/s2"}.get(unit, "")


def _quoted(name: str) -> str:
    """Return a name as FMI's structured names have it."""
    return name if name.isidentifier() else f"'{name}'"


def units_of(variables: tuple[Variable, ...]) -> Iterator[tuple[str, dict[str, int]]]:
    """Return the units that occur, each with its exponents of SI base units."""
    for unit in sorted({variable.unit for variable in variables if variable.unit} | {"s"}):
        yield unit, _EXPONENTS[unit]


_EXPONENTS: dict[str, dict[str, int]] = {
    "s": {"s": 1},
    "m": {"m": 1},
    "rad": {"rad": 1},
    "m/s": {"m": 1, "s": -1},
    "rad/s": {"rad": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad/s2": {"rad": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N/m": {"kg": 1, "s": -2},
    "N.s/m": {"kg": 1, "s": -1},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "Pa": {"kg": 1, "m": -1, "s": -2},
}

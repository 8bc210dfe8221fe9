"""Variables of an FMU: states, inputs, parameters and outputs, by the names of joints, bodies, markers and elements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiler.external import ExternalMechanism
from fmd.dynamics.compiler.external_quantities import ExternalQuantity
from fmd.dynamics.links import Link
from fmd.recovery.stress import STRESS_TENSOR


class FmuVariable(NamedTuple):
    """A variable of an FMU."""

    name: str
    reference: int  # number by which it is read and set
    causality: str  # as FMI has it
    variability: str = "continuous"  # as FMI has it
    initial: str = ""  # as FMI has it; may be empty
    start: float | None = None  # value at the start
    unit: str = ""  # the unit may be empty
    description: str = ""  # the unit may be empty
    state: int | None = None  # reference of the state whose derivative it is
    # References of the states and inputs that it depends on; None for those that nothing else determines.
    depends: tuple[int, ...] | None = None
    nominal: float = 1.0  # size of a state


@dataclass(frozen=True)
class Interface:
    """Variables that an FMU shows of a mechanism, and where the mechanism's functions have them."""

    variables: tuple[FmuVariable, ...]  # in the order of their references, which are 1, 2, …
    input_places: tuple[int, ...]  # place of each input among the functions' ``inputs``
    n_own_inputs: int  # how many inputs come before those of markers
    parameters: tuple[float, ...]  # values of the constants, of the factors of own loads and motions, and the tolerance

    def of(self, causality: str) -> list[FmuVariable]:
        """Return the variables of a causality."""
        return [variable for variable in self.variables if variable.causality == causality]

    @property
    def derivatives(self) -> list[FmuVariable]:
        """Derivatives of the states."""
        return [variable for variable in self.variables if variable.state is not None]


def make_interface(
    external: ExternalMechanism, point_loads: list[str], q0: Array, v0: Array, nominal: Array, tolerance: float
) -> Interface:
    """Name all variables of a mechanism, whose loads at points are made by the drives ``point_loads``.

    It starts at positions q0 (n_positions,) and rates v0 (n,), states have sizes ``nominal`` (n_positions + n,), and a
    step of the co-simulation a relative tolerance.
    """
    names = Names(external)
    own = names.own_inputs(point_loads)
    inputs = [*own, *names.marker_inputs()]
    solver = Entry("solver.tolerance", "", "co-simulation: largest error of a step, relative")
    values = (*external.constants.values(), *(1.0 for _ in external.signals), tolerance)
    states = _name_states(names.states(), np.concatenate([q0, v0]), nominal)
    first_input = 1 + 2 * len(states)
    entered = [
        FmuVariable(entry.name, first_input + k, "input", start=0.0, unit=entry.unit, description=entry.description)
        for k, (entry, _) in enumerate(inputs)
    ]
    first_parameter = first_input + len(inputs)
    parameters = [*names.constants(), *names.factors(point_loads), solver]
    fixed = [
        FmuVariable(entry.name, k, "parameter", "tunable", "exact", value, entry.unit, entry.description)
        for k, (entry, value) in enumerate(zip(parameters, values, strict=True), start=first_parameter)
    ]
    fixed[-1] = fixed[-1]._replace(variability="fixed")
    places = tuple(place for _, place in inputs)
    references = {("q", k): 1 + k for k in range(len(q0))} | {("v", k): 1 + len(q0) + k for k in range(len(v0))}
    references |= {("inputs", place): first_input + k for k, place in enumerate(places)}
    given = _name_outputs(external, names, references, first_parameter + len(fixed))
    return Interface((*states, *_name_derivatives(states), *entered, *fixed, *given), places, len(own), values)


def _name_states(entries: Sequence[Entry], starts: Array, nominal: Array) -> list[FmuVariable]:
    return [
        FmuVariable(entry.name, k, "local", "continuous", "exact", start, entry.unit, entry.description, nominal=size)
        for k, (entry, start, size) in enumerate(zip(entries, starts.tolist(), nominal.tolist(), strict=True), start=1)
    ]


def _name_derivatives(states: Sequence[FmuVariable]) -> list[FmuVariable]:
    return [
        FmuVariable(
            f"der({state.name})",
            len(states) + state.reference,
            "local",
            initial="calculated",
            unit={"m": "m/s", "rad": "rad/s", "m/s": "m/s2", "rad/s": "rad/s2"}.get(state.unit, ""),
            state=state.reference,
        )
        for state in states
    ]


def _name_outputs(
    external: ExternalMechanism, names: Names, references: Mapping[tuple[str, int], int], first: int
) -> Iterator[FmuVariable]:
    """Name the outputs, each with the states and inputs that it depends on."""
    for k, quantity in enumerate(external.quantities):
        entry = names.quantity(quantity)
        used = sorted(references[place] for place in external.dependencies(quantity.value) if place in references)
        named = FmuVariable(entry.name, first + k, "output", unit=entry.unit, description=entry.description)
        yield named._replace(initial="calculated", depends=tuple(used))


def units_of(variables: tuple[FmuVariable, ...]) -> Iterator[tuple[str, dict[str, int]]]:
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

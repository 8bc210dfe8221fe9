"""Variables of an FMU: names, units and references of states, inputs, parameters and outputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.external import ExternalMechanism
from fmd.output.fmu.names import Entry, Names


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

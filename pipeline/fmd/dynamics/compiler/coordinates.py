"""A mechanism's coordinates, rates and signals as inputs of a graph."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array
from fmd.core.joint_kinds import JOINT_CONSTANTS
from fmd.core.limits.round_off import SOLVED
from fmd.dynamics.compiler.algebra import constants
from fmd.dynamics.compiler.cleaning import inertia_forms, rigid_constants
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import ALWAYS, CONSTANT, Signal
from fmd.kernels.table import whole_lines
from fmd.reduction.inertia import InertiaIntegrals


class Coordinates:
    """Inputs of a mechanism's graph: positions, rates, values of its signals, springs and dampers, and held values.

    Each of ``signals`` varies, and comes once: signal k has its value, rate and acceleration at 3 k, 3 k + 1 and 3 k +
    2 of the argument ``inputs``. After these come ``numbers``, so that other ones take no other code: springs, rests
    and dampers of joints by body and name, but for those that are 0, `constants_of_bodies` of a mechanism that is
    lifted, and last held values by body -1 and their number. ``threshold`` is the share of its natural scale below
    which an entry of the mechanism's constants is round-off; see `cleaning`.
    """

    threshold = SOLVED

    def __init__(self, graph: Graph, mechanism: Mechanism) -> None:
        self.graph, self.mechanism = graph, mechanism
        signals = [link.motion or link.load for link in mechanism.links] + [load.size for load in mechanism.loads]
        signals += [signal for effort in mechanism.functions for signal in effort.signals]
        self.signals = tuple(dict.fromkeys(signal for signal in signals if constant_value(signal) is None))
        self.numbers = _joint_numbers(mechanism)
        if mechanism.lifted:
            self.numbers |= {key: value for key, value in constants_of_bodies(mechanism).items() if value}
        self.numbers |= {(-1, f"held {at.number}"): at.initial for at in mechanism.held}
        self._places = {key: 3 * len(self.signals) + k for k, key in enumerate(self.numbers)}

    def joint_positions(self, body: int) -> list[Scalar]:
        """Position coordinates of the joint that carries a body."""
        first = int(self.mechanism.layout.position[body])
        count = self.mechanism.links[body].n_positions
        return [self.graph.scalar_input("q", first + k) for k in range(count)]

    def modal_positions(self, body: int) -> Vector:
        """Modal coordinates of a body."""
        return self.graph.vector_input("q", self.mechanism.modal_positions_of(body))

    def joint_rates(self, body: int) -> list[Scalar]:
        """Rates of the joint that carries a body."""
        return self.inputs_of_joint(body, "v")

    def modal_rates(self, body: int) -> Vector:
        """Modal rates of a body."""
        return self.inputs_of_modes(body, "v")

    def inputs_of_joint(self, body: int, argument: str, begin: int = 0) -> list[Scalar]:
        """A joint's entries of an argument, whose entries from one on are in the order of rates."""
        first = begin + int(self.mechanism.layout.rate[body])
        return [self.graph.scalar_input(argument, first + k) for k in range(self.mechanism.links[body].n_rates)]

    def inputs_of_modes(self, body: int, argument: str, begin: int = 0) -> Vector:
        """Entries of a body's modes of an argument, whose entries from one on are in the order of rates."""
        return self.graph.vector_input(argument, [begin + place for place in self.mechanism.modes_of(body)])

    @property
    def leaping(self) -> Coordinates:
        """Inputs of this mechanism in the leapfrog method."""
        return LeapingCoordinates(self.graph, self.mechanism)

    @property
    def carrying(self) -> Coordinates:
        """Inputs of this mechanism in cycles by carried forces."""
        return CarryingCoordinates(self.graph, self.mechanism)

    @property
    def step(self) -> Scalar:
        """Length of a leapfrog step."""
        return self.graph.scalar_input("step", 0)

    def number(self, body: int, name: str, value: float) -> Scalar:
        """A constant of a body or of its joint, or of the mechanism for body -1."""
        place = self._places.get((body, name))
        return self.graph.number(value) if place is None else self.graph.scalar_input("inputs", place)

    @property
    def fall(self) -> list[Scalar]:
        """Acceleration of the ground that weight is like: that of gravity, upwards."""
        return [self.number(-1, f"gravity {k}", -float(g)) for k, g in enumerate(self.mechanism.gravity)]

    def scaled(self, body: int, name: str, values: Array, vector: Vector) -> Vector:
        """A modal vector, each entry times a constant of a body."""
        keys = [(body, f"{name} {k}") for k in range(len(values))]
        if not any(key in self._places for key in keys):
            return vector.multiplied_by(np.diag(values))
        factors = [self.number(*key, x) * vector.entry(k) for k, (key, x) in enumerate(zip(keys, values, strict=True))]
        units = (self.graph.array(unit) for unit in np.eye(len(values)))
        return combine(list(zip(factors, units, strict=True)))

    def columns(self, times: Array, q: Array, v: Array) -> dict[str, Array]:
        """Arguments at states, (n_times,), (n_times, n_positions) and (n_times, n), with a column for each."""
        values = [row for signal in self.signals for row in signal.values(times).T]
        values += [np.full(len(times), number) for number in self.numbers.values()]
        inputs = np.reshape(values, (len(values), len(times)))
        return {"inputs": inputs, "q": np.ascontiguousarray(q.T), "v": np.ascontiguousarray(v.T)}

    def signal(self, signal: Signal, derivatives: int = 0) -> list[Scalar]:
        """A signal's value and its first derivatives, as inputs if it varies."""
        value = constant_value(signal)
        if value is not None:
            return constants(self.graph, [value, 0.0, 0.0][: 1 + derivatives])
        first = 3 * self.signals.index(signal)
        return [self.graph.scalar_input("inputs", first + k) for k in range(1 + derivatives)]


class ExactCoordinates(Coordinates):
    """Inputs of a mechanism whose constants keep their round-off, as motions are reported."""

    threshold = 0.0


class RestingCoordinates(Coordinates):
    """Inputs of a mechanism at rest: its positions; all rates, and the derivatives of signals, are zero."""

    def joint_rates(self, body: int) -> list[Scalar]:
        """Return zeros."""
        return constants(self.graph, [0.0] * self.mechanism.links[body].n_rates)

    def modal_rates(self, body: int) -> Vector:
        """Return zeros."""
        return self.graph.zeros(len(self.mechanism.links[body].omega))

    def signal(self, signal: Signal, derivatives: int = 0) -> list[Scalar]:
        """A signal's value, and zeros."""
        return [*super().signal(signal), *constants(self.graph, [0.0] * derivatives)]


class LeapingCoordinates(Coordinates):
    """Inputs of a mechanism in the leapfrog method: rates are half a step behind, ``v + ½ h a`` with the last a."""

    def joint_rates(self, body: int) -> list[Scalar]:
        """Return a joint's rates half a step later."""
        pairs = zip(super().joint_rates(body), self.inputs_of_joint(body, "a"), strict=True)
        return [v + a * (self.step * 0.5) for v, a in pairs]

    def modal_rates(self, body: int) -> Vector:
        """Return a body's modal rates half a step later."""
        return combine([(1.0, super().modal_rates(body)), (self.step * 0.5, self.inputs_of_modes(body, "a"))])


class CarryingCoordinates(Coordinates):
    """Inputs of a mechanism in cycles by carried forces: rates are half a step behind, which the last maps hold."""

    @property
    def _halves(self) -> int:
        return 16 * whole_lines(self.mechanism.n)

    def joint_rates(self, body: int) -> list[Scalar]:
        """Return a joint's rates half a step later."""
        halves = self.inputs_of_joint(body, "maps", self._halves)
        rates = zip(super().joint_rates(body), self.inputs_of_joint(body, "a"), halves, strict=True)
        return [v + a * half for v, a, half in rates]

    def modal_rates(self, body: int) -> Vector:
        """Return a body's modal rates half a step later."""
        halves = self.inputs_of_modes(body, "maps", self._halves)
        return super().modal_rates(body) + self.inputs_of_modes(body, "a").times(halves)


def _joint_numbers(mechanism: Mechanism) -> dict[tuple[int, str], float]:
    found: dict[tuple[int, str], float] = {}
    for body, link in enumerate(mechanism.links):
        if link.unit:
            names = JOINT_CONSTANTS if link.spring else ("damper",)
            found |= {(body, name): float(getattr(link, name)) for name in names if getattr(link, name)}
    return found


def constants_of_bodies(mechanism: Mechanism) -> dict[tuple[int, str], float]:
    """Return gravity, modal damping, and inertia of rigid bodies, by their names in `Coordinates.number`."""
    table: dict[tuple[int, str], float] = {(-1, f"gravity {k}"): -float(g) for k, g in enumerate(mechanism.gravity)}
    for body, link in enumerate(mechanism.links):
        if len(link.damping):
            table |= {(body, f"damping {k}"): float(x) for k, x in enumerate(2.0 * link.damping * link.omega)}
        if not len(link.omega):
            mass, S, J = rigid_constants(inertia_forms(link))
            table[body, "mass"] = mass
            table |= {(body, f"S {a}"): float(S[a]) for a in range(3)}
            table |= {(body, f"J {a} {b}"): float(J[a, b]) for a in range(3) for b in range(a + 1)}
    return table


def without_constants(link: Link) -> Link:
    """Return a link without those of its constants that `constants_of_bodies` has."""
    integrals = link.integrals if len(link.omega) else InertiaIntegrals(np.ones((3, 3, 1, 1)), np.ones((3, 1)), 1.0)
    return replace(link, integrals=integrals, damping=np.ones(len(link.damping)))


def constant_value(signal: Signal) -> float | None:
    """Return the value of a signal that doesn't change, else ``None``."""
    if signal.breakpoints or any(term.kind != CONSTANT or term.support != ALWAYS for term in signal.terms):
        return None
    return float(sum(term.numbers[0] for term in signal.terms))

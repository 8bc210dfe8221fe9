"""Mechanisms of one structure with different constants, compiled once: the constants in which they differ are inputs.

These may be springs, rests and dampers of joints, modal damping, mass, first moment and inertia tensor of rigid bodies,
gravity, and all loads and motions. Eight variants take a leapfrog step at once, one in each lane of a vector register.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from fmd.dynamics.compiler.coordinates import (
    JOINT_CONSTANTS,
    Coordinates,
    LeapingCoordinates,
    constant_value,
    constants_of_bodies,
    without_constants,
)
from fmd.dynamics.compiler.digest import digest_mechanism
from fmd.dynamics.compiler.graph import Graph, Scalar
from fmd.dynamics.compiler.program import Program
from fmd.dynamics.compiler.programs import trace_leap
from fmd.dynamics.compiler.signal_code import load_signals
from fmd.dynamics.compiler.store import load_program
from fmd.dynamics.links import Link
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant
from fmd.kernels.machine import LoadedObject

Key = tuple[int, str]
"""A body's number, -1 for the mechanism itself, and the name of one of its constants."""


class CompiledVariants:
    """A leapfrog step of mechanisms that differ in constants and loads alone.

    Parameters
    ----------
    mechanisms : sequence of Mechanism
        One or more, all without rotations in space.

    Attributes
    ----------
    constants : ndarray, shape (n_constants, n_variants)
        Those in which the mechanisms differ.

    Raises
    ------
    ValueError
        They differ in something else too, or have spherical or free joints.
    """

    def __init__(self, mechanisms: Sequence[Mechanism]) -> None:
        self.mechanisms = tuple(mechanisms)
        first = self.mechanisms[0]
        if any(mechanism.closures for mechanism in self.mechanisms):
            raise ValueError("variants with loops can't be marched at once; march each by itself")
        if first.n != first.n_positions:
            raise ValueError("variants with spherical or free joints can't be marched at once; march each by itself")
        if any(mechanism.efforts for mechanism in self.mechanisms):
            raise ValueError("variants with loads by their state can't be marched at once; march each by itself")
        tables = [_constants_of(mechanism) for mechanism in self.mechanisms]
        digests = {_structure(mechanism, tuple(table)) for mechanism, table in zip(mechanisms, tables, strict=True)}
        if len(digests) > 1:
            raise ValueError(
                "the variants differ in more than joints' springs, rests and dampers, modal damping, rigid bodies' "
                "inertia, gravity, loads and motions; march each by itself"
            )
        keys = [key for key in tables[0] if len({table[key] for table in tables}) > 1]
        self.constants = np.array([[table[key] for table in tables] for key in keys]).reshape(len(keys), len(tables))
        self._places = {key: place for place, key in enumerate(keys)}
        (self._structure,) = digests
        loads = zip(*(_loads_of(mechanism) for mechanism in self.mechanisms), strict=True)
        self._acting = tuple(k for k, own in enumerate(loads) if constant_value(own[0]) is None or len(set(own)) > 1)

    @cached_property
    def _leap(self) -> LoadedObject:
        shared = {key: value for key, value in _constants_of(self.mechanisms[0]).items() if key not in self._places}
        digest = f"{self._structure} {sorted(self._places.items())} {shared} {self._acting} {self._still}"
        return load_program("leap", digest, lambda: trace_variants(self.mechanisms[0], self._places, self._acting))

    def leap(self) -> int:
        """Return the address of ``leap(constants, inputs, step, q, v, a)``, with eight lanes in all but the step."""
        return self._leap.address("leap")

    @cached_property
    def signals(self) -> list[LoadedObject]:
        """Each variant's loads and motions, compiled once for variants with the same."""
        return [load_signals(self._acting_on(mechanism)) for mechanism in self.mechanisms]

    @property
    def n_inputs(self) -> int:
        """Number of values, rates and accelerations of loads and motions that aren't the same constant for all."""
        return 3 * len(self._acting)

    def _acting_on(self, mechanism: Mechanism) -> list[Signal]:
        loads = _loads_of(mechanism)
        return [loads[k] for k in self._acting]

    @property
    def _still(self) -> list[float | None]:
        return [constant_value(load) for k, load in enumerate(_loads_of(self.mechanisms[0])) if k not in self._acting]


def trace_variants(mechanism: Mechanism, places: dict[Key, int], acting: Sequence[int]) -> Program:
    """Trace the leapfrog step of mechanisms that differ from one in constants and loads.

    Parameters
    ----------
    places : dict
        Where each constant that differs is in the argument ``constants``.
    acting : sequence of int
        Numbers of the loads and motions that are inputs, bodies' first and then those at points.
    """
    inputs = VariantCoordinates(Graph(), mechanism, places, acting)
    arguments = ("constants", "inputs", "step", "q", "v", "a")
    lanes = tuple(name for name in arguments if name != "step")
    return Program("leap", inputs.graph, arguments, tuple(trace_leap(inputs)), lanes, in_place=True)


class _Lifted(Coordinates):
    """Inputs of a mechanism, some of whose constants, loads and motions are inputs too."""

    def __init__(self, graph: Graph, mechanism: Mechanism, places: dict[Key, int], acting: Sequence[int]) -> None:
        super().__init__(graph, _with_loads_of_their_own(mechanism))
        self._places, self._acting = places, acting
        self._loads = _loads_of(self.mechanism)

    def number(self, body: int, name: str, value: float) -> Scalar:
        """A constant, or where it is among the inputs."""
        place = self._places.get((body, name))
        return self.graph.number(value) if place is None else self.graph.scalar_input("constants", place)

    def signal(self, signal: Signal, derivatives: int = 0) -> list[Scalar]:
        """A signal's value and its first derivatives, as inputs if some variant's vary or differ."""
        number = next(k for k, other in enumerate(self._loads) if other is signal)
        if number not in self._acting:
            return super().signal(signal, derivatives)
        first = 3 * self._acting.index(number)
        return [self.graph.scalar_input("inputs", first + k) for k in range(1 + derivatives)]


class _LeapingLifted(_Lifted, LeapingCoordinates):
    """Inputs of variants in the leapfrog method."""


class VariantCoordinates(_Lifted):
    """Inputs of mechanisms that differ in constants, loads and motions; parameters are those of `trace_variants`."""

    @property
    def leaping(self) -> Coordinates:
        """Inputs of these mechanisms in the leapfrog method."""
        return _LeapingLifted(self.graph, self.mechanism, self._places, self._acting)


def _loads_of(mechanism: Mechanism) -> list[Signal]:
    """Loads and motions in the order of the bodies, then those at points."""
    return [link.motion or link.load for link in mechanism.links] + [load.size for load in mechanism.loads]


def _with_loads_of_their_own(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism in which no two places share one `Signal`, so that each is known by its identity."""
    links = [
        replace(link, load=replace(link.load), motion=None if link.motion is None else replace(link.motion))
        for link in mechanism.links
    ]
    return replace(mechanism, links=links, loads=[replace(load, size=replace(load.size)) for load in mechanism.loads])


def _constants_of(mechanism: Mechanism) -> dict[Key, float]:
    """Return all constants that may differ between variants, by their names in `Coordinates.number`."""
    table = constants_of_bodies(mechanism)
    for body, link in enumerate(mechanism.links):
        table |= {(body, name): float(getattr(link, name)) for name in JOINT_CONSTANTS}
    return table


def _structure(mechanism: Mechanism, names: tuple[Key, ...]) -> str:
    """Return a digest of all that may not differ between variants."""
    links = [_without_constants(link) for link in mechanism.links]
    loads = [replace(load, size=constant(0.0)) for load in mechanism.loads]
    bare = replace(mechanism, links=links, loads=loads, gravity=np.zeros(3))
    return f"{digest_mechanism(Coordinates(Graph(), bare))} {names}"


def _without_constants(link: Link) -> Link:
    motion = None if link.motion is None else constant(0.0)
    return replace(without_constants(link), load=constant(0.0), motion=motion, spring=0.0, rest=0.0, damper=0.0)

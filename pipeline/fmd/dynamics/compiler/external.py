"""Functions of a mechanism that another program drives: loads, motions, springs and damping come from outside.

Beside the arguments of `fmd.dynamics.compiler.programs` they take ``constants``, joints' springs and the bodies'
modal damping, and ``inputs`` holds three places for each load and motion, those on markers after the mechanism's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.joint_kinds import JOINT_CONSTANTS
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.external_quantities import (
    ElementStress,
    ExternalQuantity,
    joint_quantities,
    marker_quantities,
    reaction_quantities,
    stress_quantities,
)
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector
from fmd.dynamics.compiler.program import Output, Program
from fmd.dynamics.compiler.programs import trace_program
from fmd.dynamics.compiler.tangents import direction_inputs
from fmd.dynamics.links import PointLoad
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant

Key = tuple[int, str]
"""A body's number, and the name of one of its constants."""

_STATE = ("constants", "inputs", "q", "v")


@dataclass(frozen=True)
class ExternalMechanism:
    """A mechanism without loops whose loads, motions, springs and damping are arguments.

    Raises
    ------
    ValueError
        It has loops, or loads by its own state.
    """

    mechanism: Mechanism
    # The same with the whole inertia of each body, which what joints transmit takes; see `joint_loads`.
    whole: Mechanism
    stresses: tuple[ElementStress, ...] = ()

    def __post_init__(self) -> None:
        if self.mechanism.closures:
            raise ValueError("the mechanism has loops, whose forces no single function computes")
        if self.mechanism.efforts:
            raise ValueError("the mechanism has loads by its own state, which another program's controller would be")

    @property
    def driven_links(self) -> list[int]:
        """Numbers of the bodies on joints with one axis, whose loads and motions come first among the inputs."""
        return [k for k, link in enumerate(self.mechanism.links) if link.unit]

    @property
    def signals(self) -> list[Signal]:
        """The mechanism's own loads and motions, in the order of the inputs."""
        links = [self.mechanism.links[k] for k in self.driven_links]
        return [link.motion or link.load for link in links] + [load.size for load in self.mechanism.loads]

    @cached_property
    def markers(self) -> list[tuple[int, str]]:
        """Body and name of each marker; forces along x, y, z and torques about them follow the own signals."""
        return [(k, name) for k, link in enumerate(self.mechanism.links) for name in link.markers]

    @cached_property
    def constants(self) -> dict[Key, float]:
        """Place and value of each constant that is an argument: what the joints' springs have, and modal damping."""
        table: dict[Key, float] = {}
        for body, link in enumerate(self.mechanism.links):
            acts = link.unit and link.motion is None
            given = {name: float(getattr(link, name)) for name in JOINT_CONSTANTS}
            if acts and link.spring:
                table |= {(body, "spring"): given["spring"], (body, "rest"): given["rest"]}
            if acts and link.damper:
                table[body, "damper"] = given["damper"]
            if len(set(link.damping)) == 1:
                table[body, "damping"] = float(link.damping[0])
        return table

    @cached_property
    def _graph(self) -> Graph:
        return Graph()

    def _coordinates(self, mechanism: Mechanism) -> _ExternalCoordinates:
        links = len(mechanism.links)
        acting = [*self.driven_links, *range(links, links + len(mechanism.loads))]
        places = {key: place for place, key in enumerate(self.constants)}
        return _ExternalCoordinates(self._graph, mechanism, places, acting)

    @cached_property
    def _plain(self) -> tuple[_ExternalCoordinates, list[MovingFrame]]:
        inputs = self._coordinates(self.mechanism)
        return inputs, trace_frames(inputs)

    @cached_property
    def _loaded(self) -> tuple[_ExternalCoordinates, list[MovingFrame]]:
        inputs = self._coordinates(_with_marker_loads(self.mechanism, self.markers))
        return inputs, trace_frames(inputs)

    @cached_property
    def quantities(self) -> list[ExternalQuantity]:
        """Positions and rates of joints, what they transmit, motion of markers and stress of elements."""
        inputs, frames = self._loaded
        bearing = self._coordinates(_with_marker_loads(self.whole, self.markers))
        return [
            *joint_quantities(inputs, frames),
            *reaction_quantities(bearing, trace_frames(bearing)),
            *marker_quantities(inputs, frames),
            *stress_quantities(frames, self.stresses),
        ]

    @cached_property
    def programs(self) -> dict[str, Program]:
        """Functions by their names.

        ``accelerations`` (constants, inputs, q, v; a) without and ``loaded_accelerations`` with forces on markers;
        ``outputs`` (constants, inputs, q, v, a; y), the values of `quantities`; ``slopes``, the derivatives ``da`` of
        the loaded accelerations along directions ``dconstants``, ``dinputs``, ``dq`` and ``dv``, and
        ``output_slopes``, those ``dy`` of the outputs, ``da`` among the directions.
        """
        loaded = self._accelerations("loaded_accelerations", *self._loaded)
        values = [Output(own.value, ("y", (k,))) for k, own in enumerate(self.quantities)]
        return {
            "accelerations": self._accelerations("accelerations", *self._plain),
            "loaded_accelerations": loaded,
            "outputs": Program("outputs", self._graph, (*_STATE, "a", "y"), tuple(values)),
            "slopes": self._slopes("slopes", loaded.outputs, _STATE, "da"),
            "output_slopes": self._slopes("output_slopes", values, (*_STATE, "a"), "dy"),
        }

    def _slopes(self, name: str, outputs: Sequence[Output], state: tuple[str, ...], filled: str) -> Program:
        seeds = direction_inputs(self._graph, state)
        slopes = differentiate(self._graph, [output.value for output in outputs], seeds)
        along = [Output(slope, (filled, output.place[1])) for slope, output in zip(slopes, outputs, strict=True)]
        directions = tuple(f"d{argument}" for argument in state)
        return Program(name, self._graph, (*state, *directions, filled), tuple(along))

    def _accelerations(self, name: str, inputs: Coordinates, frames: list[MovingFrame]) -> Program:
        traced = trace_program("accelerations", inputs, frames)
        return replace(traced, name=name, arguments=(*_STATE, "a"))

    def dependencies(self, value: Scalar) -> set[tuple[str, int]]:
        """Return the arguments that a value depends on, each with its place; ``a`` is what the accelerations take."""
        found = self._arguments([value])
        if any(argument == "a" for argument, _ in found):
            found |= self._arguments([output.value for output in self.programs["loaded_accelerations"].outputs])
        return {(argument, place) for argument, place in found if argument != "a"}

    def _arguments(self, values: list[Scalar] | list[Scalar | Vector]) -> set[tuple[str, int]]:
        found: set[tuple[str, int]] = set()
        for number in self._graph.live([value.node for value in values]):
            node = self._graph.nodes[number]
            if node.operation in ("input", "vector input"):
                argument, places = node.data  # type: ignore[misc]
                found |= {(argument, place) for place in places}
        return found


class _ExternalCoordinates(Coordinates):
    """Inputs of a mechanism, some of whose constants, loads and motions are inputs too.

    ``places`` has where each constant is in the argument ``constants``; the modal damping ratio is one for a body.
    ``acting`` are the numbers of loads and motions that are inputs, bodies' first and then those at points.
    """

    def __init__(self, graph: Graph, mechanism: Mechanism, places: dict[Key, int], acting: Sequence[int]) -> None:
        super().__init__(graph, _with_loads_of_their_own(mechanism))
        self._places, self._acting = places, acting
        own = self.mechanism
        self._loads = [link.motion or link.load for link in own.links] + [load.size for load in own.loads]

    def number(self, body: int, name: str, value: float) -> Scalar:
        """A constant, or where it is among the inputs."""
        place = self._places.get((body, name))
        return self.graph.number(value) if place is None else self.graph.scalar_input("constants", place)

    def signal(self, signal: Signal, derivatives: int = 0) -> list[Scalar]:
        """A signal's value and its first derivatives, as inputs if it acts."""
        number = next(k for k, other in enumerate(self._loads) if other is signal)
        if number not in self._acting:
            return super().signal(signal, derivatives)
        first = 3 * self._acting.index(number)
        return [self.graph.scalar_input("inputs", first + k) for k in range(1 + derivatives)]

    def scaled(self, body: int, name: str, values: Array, vector: Vector) -> Vector:
        """A modal vector, each entry times a constant of a body."""
        place = self._places.get((body, name))
        if place is None:
            return super().scaled(body, name, values, vector)
        ratio = self.graph.scalar_input("constants", place)
        return vector.multiplied_by(np.diag(2.0 * self.mechanism.links[body].omega)) * ratio


def _with_loads_of_their_own(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism in which no two places share one `Signal`, so that each is known by its identity."""
    links = [
        replace(link, load=replace(link.load), motion=None if link.motion is None else replace(link.motion))
        for link in mechanism.links
    ]
    return replace(mechanism, links=links, loads=[replace(load, size=replace(load.size)) for load in mechanism.loads])


def _with_marker_loads(mechanism: Mechanism, markers: list[tuple[int, str]]) -> Mechanism:
    """Return a mechanism with forces and torques along the ground's axes at its markers, after its own loads."""
    loads = list(mechanism.loads)
    for body, name in markers:
        link = mechanism.links[body]
        at = link.markers[name]
        for torque in (False, True):
            for axis in np.eye(3):
                loads.append(PointLoad(link.name, axis, constant(0.0), torque, marker=at))
    return replace(mechanism, loads=loads)

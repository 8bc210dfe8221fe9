"""Functions of a mechanism that another program drives: loads, motions, springs and damping come from outside.

Beside the arguments of `pipeline.dynamics.compiler.programs` they take ``constants``, joints' springs and the bodies'
modal damping, and ``inputs`` holds three places for each load and motion, those on markers after the mechanism's own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.compiler.algebra import Matrix, Vector3, add, product, times, transpose
from pipeline.dynamics.compiler.cleaning import clean_marker
from pipeline.dynamics.compiler.coordinates import Coordinates
from pipeline.dynamics.compiler.differentiate import differentiate
from pipeline.dynamics.compiler.forces import JOINT_CONSTANTS, section_angle
from pipeline.dynamics.compiler.frames import MovingFrame, trace_frames
from pipeline.dynamics.compiler.graph import Graph, Scalar, Vector, total
from pipeline.dynamics.compiler.marker import trace_marker
from pipeline.dynamics.compiler.program import Output, Program
from pipeline.dynamics.compiler.programs import trace_program
from pipeline.dynamics.compiler.tangents import direction_inputs
from pipeline.dynamics.compiler.variants import Key, VariantCoordinates
from pipeline.dynamics.links import FREE, ONE_AXIS, SPHERICAL, PointLoad
from pipeline.dynamics.mechanism import Mechanism
from pipeline.dynamics.signals.signal import Signal, constant

_TINY = 1e-300  # Pa²: the square of a von Mises stress whose root has a derivative at no stress, too
_STATE = ("constants", "inputs", "q", "v")


class ElementStress(NamedTuple):
    """Stress of a named element by its body's modal coordinates."""

    body: int
    name: str
    modal: Array  # (6, n_modes): xx, yy, zz, yz, xz, xy [Pa] for unit modal coordinates


class Quantity(NamedTuple):
    """A quantity that the functions give: of a joint, a marker or an element.

    Attributes
    ----------
    body : int
        Number of the body, or of the one that the joint carries.
    place : str
        Name of the marker or element, empty for a joint.
    kind : str
        ``position``, ``rate``, ``velocity``, ``rotation``, ``angular_velocity``, ``displacement``, ``stress`` or
        ``von_mises``.
    index : tuple of int
        Which of its numbers, from 1.
    value : Scalar
        How it is computed.
    """

    body: int
    place: str
    kind: str
    index: tuple[int, ...]
    value: Scalar


@dataclass(frozen=True)
class ExternalMechanism:
    """A mechanism without loops whose loads, motions, springs and damping are arguments.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism.
    stresses : tuple of ElementStress
        Stress that it gives.

    Raises
    ------
    ValueError
        It has loops.
    """

    mechanism: Mechanism
    stresses: tuple[ElementStress, ...] = ()

    def __post_init__(self) -> None:
        if self.mechanism.closures:
            raise ValueError("the mechanism has loops, whose forces no single function computes")

    @property
    def driven_links(self) -> list[int]:
        """Numbers of the bodies on joints with one axis, whose loads and motions come first among the inputs."""
        return [k for k, link in enumerate(self.mechanism.links) if link.joint in ONE_AXIS]

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
            acts = link.joint in ONE_AXIS and link.motion is None
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
    def quantities(self) -> list[Quantity]:
        """Positions and rates of joints, motion of markers and stress of elements."""
        inputs, frames = self._plain
        return [
            *_joint_quantities(inputs, frames),
            *_marker_quantities(inputs, frames),
            *_stress_quantities(frames, self.stresses),
        ]

    @cached_property
    def programs(self) -> dict[str, Program]:
        """Functions by their names.

        ``accelerations`` (constants, inputs, q, v; a) without and ``loaded_accelerations`` with forces on markers;
        ``outputs`` (…; y), the values of `quantities`; and ``slopes``, the derivatives ``da`` and ``dy`` of both along
        directions ``dconstants``, ``dinputs``, ``dq`` and ``dv``.
        """
        plain, frames = self._plain
        loaded_inputs = self._coordinates(_with_marker_loads(self.mechanism, self.markers))
        free = self._accelerations("accelerations", plain, frames)
        loaded = self._accelerations("loaded_accelerations", loaded_inputs, trace_frames(loaded_inputs))
        values = [Output(own.value, ("y", (k,))) for k, own in enumerate(self.quantities)]
        both = [*loaded.outputs, *values]
        seeds = direction_inputs(self._graph, _STATE)
        slopes = differentiate(self._graph, [output.value for output in both], seeds)
        along = [
            Output(slope, (f"d{output.place[0]}", output.place[1])) for slope, output in zip(slopes, both, strict=True)
        ]
        directions = tuple(f"d{name}" for name in _STATE)
        return {
            "accelerations": free,
            "loaded_accelerations": loaded,
            "outputs": Program("outputs", self._graph, (*_STATE, "y"), tuple(values)),
            "slopes": Program("slopes", self._graph, (*_STATE, *directions, "da", "dy"), tuple(along)),
        }

    def _accelerations(self, name: str, inputs: Coordinates, frames: list[MovingFrame]) -> Program:
        traced = trace_program("accelerations", inputs, frames)
        return replace(traced, name=name, arguments=(*_STATE, "a"))

    def dependencies(self, value: Scalar) -> set[tuple[str, int]]:
        """Return the arguments that a value depends on, each with its place."""
        found: set[tuple[str, int]] = set()
        for number in self._graph.live([value.node]):
            node = self._graph.nodes[number]
            if node.operation in ("input", "vector input"):
                argument, places = node.data  # type: ignore[misc]
                found |= {(argument, place) for place in places}
        return found


class _ExternalCoordinates(VariantCoordinates):
    """Inputs of a mechanism, some of whose constants are inputs too; the modal damping ratio is one for a body."""

    def scaled(self, body: int, name: str, values: Array, vector: Vector) -> Vector:
        """A modal vector, each entry times a constant of a body."""
        place = self._places.get((body, name))
        if place is None:
            return super().scaled(body, name, values, vector)
        ratio = self.graph.scalar_input("constants", place)
        return vector.multiplied_by(np.diag(2.0 * self.mechanism.links[body].omega)) * ratio


def _with_marker_loads(mechanism: Mechanism, markers: list[tuple[int, str]]) -> Mechanism:
    """Return a mechanism with forces and torques along the ground's axes at its markers, after its own loads."""
    loads = list(mechanism.loads)
    for body, name in markers:
        link = mechanism.links[body]
        at = link.markers[name]
        for torque in (False, True):
            for axis in np.eye(3):
                own = PointLoad(
                    link.name,
                    axis,
                    constant(0.0),
                    torque,
                    place=at.position,
                    shapes=at.translation,
                    rotations=at.rotation,
                    bow=at.bow,
                )
                loads.append(own)
    return replace(mechanism, loads=loads)


def _rates(inputs: Coordinates, values: list[Scalar]) -> list[Scalar]:
    """Return the time derivatives of values that depend on positions and on the values of signals."""
    graph, mechanism = inputs.graph, inputs.mechanism
    rates = _position_rates(inputs)
    shift = mechanism.n_positions - mechanism.n
    seeds: dict[int, Scalar | Vector] = {}
    for number, node in enumerate(list(graph.nodes)):
        if node.operation not in ("input", "vector input"):
            continue
        argument, places = node.data  # type: ignore[misc]
        if argument == "q" and node.operation == "input":
            seeds[number] = rates[places[0]]
        elif argument == "q":
            seeds[number] = graph.vector_input("v", [place - shift for place in places])
        elif argument == "inputs" and places[0] % 3 < 2:
            seeds[number] = graph.scalar_input("inputs", places[0] + 1)
    return [_scalar(slope) for slope in differentiate(graph, list(values), seeds)]


def _position_rates(inputs: Coordinates) -> dict[int, Scalar]:
    """Return how each position of a joint changes: as its rate, or as a quaternion with the rates of a rotation."""
    mechanism, rates = inputs.mechanism, {}
    for body, link in enumerate(mechanism.links):
        first = int(mechanism.layout.position[body])
        q, v = inputs.joint_positions(body), inputs.joint_rates(body)
        slides = link.n_rates if link.joint not in (FREE, SPHERICAL) else 3 if link.joint == FREE else 0
        rates |= {first + k: v[k] for k in range(slides)}
        if link.joint in (FREE, SPHERICAL):
            (x, y, z, w), (a, b, c) = q[slides:], (rate * 0.5 for rate in v[slides:])
            turns = (
                w * a + y * c - z * b,
                w * b - x * c + z * a,
                w * c + x * b - y * a,
                -(x * a) - y * b - z * c,
            )
            rates |= {first + slides + k: turn for k, turn in enumerate(turns)}
    return rates


def _joint_quantities(inputs: Coordinates, frames: list[MovingFrame]) -> list[Quantity]:
    found = []
    for frame in frames:
        link = frame.link
        if link.joint not in ONE_AXIS:
            continue
        (own,) = inputs.joint_positions(frame.number) if link.motion is None else inputs.signal(link.motion)
        found.append(Quantity(frame.number, "", "position", (), own + section_angle(inputs.graph, frame)))
    rates = _rates(inputs, [own.value for own in found])
    return [*found, *(own._replace(kind="rate", value=rate) for own, rate in zip(found, rates, strict=True))]


def _marker_quantities(inputs: Coordinates, frames: list[MovingFrame]) -> list[Quantity]:
    found = []
    for frame in frames:
        origin, R = frame.world
        for name, at in frame.link.markers.items():
            marker = trace_marker(inputs.graph, clean_marker(at, len(frame.link.omega)), frame.q, frame.v)
            position = add(origin, times(R, marker.arm))
            turned = product(R, marker.R)
            found += _motion_of_marker(inputs, frame.number, name, position, turned)
            if len(frame.link.omega):
                moved = [x - float(x0) for x, x0 in zip(marker.arm, at.position, strict=True)]
                found += _vector(frame.number, name, "displacement", moved)
    return found


def _motion_of_marker(inputs: Coordinates, body: int, name: str, position: Vector3, rotation: Matrix) -> list[Quantity]:
    entries = [x for row in rotation for x in row]
    rates = _rates(inputs, [*position, *entries])
    velocity, turning = rates[:3], [rates[3 + 3 * k : 6 + 3 * k] for k in range(3)]
    spin = product(turning, transpose(rotation))
    indices = [(i, j) for i in range(1, 4) for j in range(1, 4)]
    return [
        *_vector(body, name, "position", position),
        *_vector(body, name, "velocity", velocity),
        *(Quantity(body, name, "rotation", at, x) for at, x in zip(indices, entries, strict=True)),
        *_vector(body, name, "angular_velocity", [spin[2][1], spin[0][2], spin[1][0]]),
    ]


def _stress_quantities(frames: list[MovingFrame], stresses: tuple[ElementStress, ...]) -> list[Quantity]:
    found = []
    for own in stresses:
        q = frames[own.body].q
        parts = [q.dot(q.graph.array(row)) for row in own.modal]
        xx, yy, zz, yz, xz, xy = parts
        normal = total([(xx - yy) * (xx - yy), (yy - zz) * (yy - zz), (zz - xx) * (zz - xx)])
        shear = total([yz * yz, xz * xz, xy * xy])
        square = normal * 0.5 + shear * 3.0
        found += _vector(own.body, own.name, "stress", parts)
        found.append(Quantity(own.body, own.name, "von_mises", (), (square + _TINY).apply("sqrt")))
    return found


def _vector(body: int, place: str, kind: str, values: list[Scalar]) -> list[Quantity]:
    return [Quantity(body, place, kind, (k + 1,), value) for k, value in enumerate(values)]


def _scalar(value: Scalar | Vector) -> Scalar:
    assert isinstance(value, Scalar)
    return value

"""Forces that accelerate a mechanism: its own at a state, or any that are given, with coordinates frozen or none."""

from functools import partial
from typing import Protocol

import numpy as np

from fmd.core.arrays import Array
from fmd.core.joint_kinds import JOINT_CONSTANTS
from fmd.core.state_formula import VARIABLE
from fmd.dynamics.compiler.algebra import Vector3, Vector6, constants, cross, subtract, times, transpose
from fmd.dynamics.compiler.bodies import AXES, Inertia, velocity_forces
from fmd.dynamics.compiler.cleaning import clean_direction
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.elements import trace_actions, trace_elongation
from fmd.dynamics.compiler.formulas import trace_periodic_table, trace_program
from fmd.dynamics.compiler.frames import MovingFrame, trace_place_on_body
from fmd.dynamics.compiler.graph import Graph, Scalar, Terms, Vector
from fmd.dynamics.compiler.joint_motion import joint_elongation, joint_grip
from fmd.dynamics.compiler.marker import MarkerMotion
from fmd.dynamics.compiler.places import trace_place
from fmd.dynamics.elements import PointSpring
from fmd.dynamics.law_pieces import find_piecewise_laws
from fmd.dynamics.links import PointLoad
from fmd.dynamics.state_functions import HeldValue, JointValue, Measured, SignalValue, StateFunction


class Forces(Protocol):
    """Forces on a mechanism's bodies and joints, and which of its coordinates they accelerate."""

    @property
    def graph(self) -> Graph:
        """Where they are nodes."""

    @property
    def ground(self) -> Vector6:
        """Acceleration of the ground; upwards it is the weight."""

    def on_body(self, frame: MovingFrame, inertia: Inertia) -> tuple[Vector6, Terms]:
        """Return p of a body, and the terms of −e; see `bodies`."""

    def on_joint(self, frame: MovingFrame) -> list[Scalar]:
        """Return what acts along each of a joint's directions."""

    def free_directions(self, frame: MovingFrame) -> list[Vector6]:
        """Return the directions in which a joint isn't frozen."""

    def free_modes(self, frame: MovingFrame) -> Array:
        """Return 1 for each mode that isn't frozen, else 0."""


class ActingForces:
    """All that acts on a mechanism: inertia of its velocities, weight, springs, dampers, force elements, loads."""

    def __init__(self, inputs: Coordinates, frames: list[MovingFrame]) -> None:
        self._inputs, self._frames, self.graph = inputs, frames, inputs.graph
        self._actions = trace_actions(inputs, frames)
        self.ground: Vector6 = [*inputs.fall, *constants(inputs.graph, [0.0] * 3)]

    def on_body(self, frame: MovingFrame, inertia: Inertia) -> tuple[Vector6, Terms]:
        """Return p of a body, and the terms of −e; see `bodies`."""
        p, terms = velocity_forces(inertia, frame.spin, frame.v)
        terms = terms + modal_load(self._inputs, self._frames, frame)
        for at in self._inputs.mechanism.loads:
            if at.body == frame.link.name:
                force, on_modes = point_load(self._inputs, self._frames, frame, at)
                p, terms = subtract(p, force), terms + on_modes
        for action in self._actions.get(frame.number, []):
            force, on_modes = action.on_body()
            p, terms = subtract(p, force), terms + on_modes
        return p, terms

    def on_joint(self, frame: MovingFrame) -> list[Scalar]:
        """Return what acts along each of a joint's directions."""
        if len(frame.directions) == 1:
            return [joint_load(self._inputs, self._frames, frame)]
        laws = frame.link.laws
        if not laws:
            return constants(self.graph, [0.0] * len(frame.directions))
        positions, rates = self._inputs.joint_positions(frame.number), self._inputs.joint_rates(frame.number)
        return [-law.trace(*at) for law, *at in zip(laws, positions, rates, strict=True)]

    def free_directions(self, frame: MovingFrame) -> list[Vector6]:
        """Return all directions of a joint."""
        return frame.directions

    def free_modes(self, frame: MovingFrame) -> Array:
        """Return 1 for each mode."""
        return np.ones(len(frame.link.omega))


class PushedForces(ActingForces):
    """All that acts on a mechanism, and the forces of its contacts, which are arguments."""

    def on_body(self, frame: MovingFrame, inertia: Inertia) -> tuple[Vector6, Terms]:
        """Return p of a body, and the terms of −e; see `bodies`."""
        p, terms = super().on_body(frame, inertia)
        if all(contact.body != frame.link.name for contact in self._inputs.mechanism.contacts):
            return p, terms
        push = [self.graph.scalar_input("push", 6 * frame.number + k) for k in range(6)]
        on_modes = self._inputs.inputs_of_modes(frame.number, "modal")
        return subtract(p, push), [*terms, (1.0, on_modes)]


class GivenForces:
    """Generalised forces that are read from an argument in the order of rates, on a mechanism at rest without weight.

    Rates accelerate that are ``free``; all others are frozen.
    """

    def __init__(self, inputs: Coordinates, argument: str, free: range) -> None:
        self._inputs, self._argument, self._free, self.graph = inputs, argument, free, inputs.graph
        self.ground: Vector6 = constants(inputs.graph, [0.0] * 6)

    def on_body(self, frame: MovingFrame, inertia: Inertia) -> tuple[Vector6, Terms]:
        """Return no force on the frame, and the forces on free modes."""
        given = self.on_modes(frame)
        return constants(self.graph, [0.0] * 6), [(1.0, given.multiplied_by(np.diag(self.free_modes(frame))))]

    def on_modes(self, frame: MovingFrame) -> Vector:
        """Return the forces on a body's modes."""
        return self._inputs.inputs_of_modes(frame.number, self._argument)

    def on_joint(self, frame: MovingFrame) -> list[Scalar]:
        """Return what acts along each direction that isn't frozen."""
        given = self._inputs.inputs_of_joint(frame.number, self._argument)
        return given[: len(self.free_directions(frame))]

    def free_directions(self, frame: MovingFrame) -> list[Vector6]:
        """Return the directions of a joint that isn't frozen."""
        free = int(self._inputs.mechanism.layout.rate[frame.number]) in self._free
        return frame.directions if free else []

    def free_modes(self, frame: MovingFrame) -> Array:
        """Return 1 for each mode that isn't frozen, else 0."""
        modes = self._inputs.mechanism.modes_of(frame.number)
        return np.array([float(int(mode) in self._free) for mode in modes])


def trace_effort(inputs: Coordinates, frames: list[MovingFrame], effort: StateFunction | None) -> Scalar:
    """Trace the value of a function of a mechanism's state; 0 of none."""
    graph = inputs.graph
    if effort is None:
        return graph.number(0.0)
    variables = [_trace_measured(inputs, frames, variable) for variable in effort.variables]
    curves = [partial(trace_periodic_table, at.knots, at.cubics, at.period) for at in effort.curves]
    found = trace_program(graph, effort.codes, effort.constants, lambda code: variables[code - VARIABLE], curves)
    return found * effort.factor


def _trace_measured(inputs: Coordinates, frames: list[MovingFrame], variable: Measured) -> Scalar:
    if isinstance(variable, StateFunction):
        return trace_effort(inputs, frames, variable)
    if isinstance(variable, HeldValue):
        return inputs.number(-1, f"held {variable.number}", variable.initial)
    if isinstance(variable, SignalValue):
        return inputs.signal(variable.signal, variable.derivative)[-1]
    if isinstance(variable, JointValue):
        return joint_elongation(inputs, frames[inputs.mechanism.number_of(variable.body)])[variable.order]
    place = trace_place(inputs, frames, variable.place)
    return (place.v if variable.order else place.x)[variable.axis]


def joint_load(inputs: Coordinates, frames: list[MovingFrame], frame: MovingFrame) -> Scalar:
    """Return the force or torque along a joint: those of its loads, spring, damper, stops and friction."""
    link, graph = frame.link, inputs.graph
    if not link.unit or link.motion is not None:
        return graph.number(0.0)
    x, rate = joint_elongation(inputs, frame)
    spring, rest, damper = (inputs.number(frame.number, name, getattr(link, name)) for name in JOINT_CONSTANTS)
    load = inputs.signal(link.load)[0] + trace_effort(inputs, frames, link.effort) - (x - rest) * spring - rate * damper
    for law in link.laws:
        load = load - law.trace(x, rate)
    return load


def trace_elongations(inputs: Coordinates, frames: list[MovingFrame]) -> tuple[list[Scalar], list[Scalar], Vector3]:
    """Trace elongations, their rates, and the vectors from place to place in space, three each; zeros for joints."""
    x, rates, vectors = list[Scalar](), list[Scalar](), list[Scalar]()
    for law in find_piecewise_laws(inputs.mechanism):
        if isinstance(law.holder, PointSpring):
            elongation, rate, vector = trace_elongation(inputs, frames, law.holder)
        else:
            elongation, rate = joint_elongation(inputs, frames[law.holder])
            vector = constants(inputs.graph, [0.0] * 3)
        x, rates, vectors = [*x, elongation], [*rates, rate], [*vectors, *vector]
    return x, rates, vectors


def modal_load(inputs: Coordinates, frames: list[MovingFrame], frame: MovingFrame) -> Terms:
    """Return the terms of the forces of a body's modal springs and dampers, and of its joint's load, on its modes."""
    link, graph = frame.link, inputs.graph
    if not len(link.omega):
        return []
    terms: Terms = [(-1.0, frame.q.multiplied_by(np.diag(link.omega**2)))]
    if len(link.damping):
        terms.append((-1.0, inputs.scaled(frame.number, "damping", 2.0 * link.damping * link.omega, frame.v)))
    return [*terms, (joint_load(inputs, frames, frame), joint_grip(graph, frame))]


def point_load(
    inputs: Coordinates, frames: list[MovingFrame], frame: MovingFrame, at: PointLoad
) -> tuple[Vector6, Terms]:
    """Return the force and moment of a load on the body's frame, and the terms of its forces on the modes."""
    marker, direction = load_at_marker(inputs, frames, frame, at)
    if at.torque:
        moments = times(transpose(marker.A), direction)
        return constants(inputs.graph, [0.0] * 3) + direction, [(moments[i], marker.turns[i]) for i in AXES]
    return direction + cross(marker.arm, direction), [(direction[i], marker.slopes[i]) for i in AXES]


def load_at_marker(
    inputs: Coordinates, frames: list[MovingFrame], frame: MovingFrame, at: PointLoad
) -> tuple[MarkerMotion, Vector3]:
    """Return the marker that a load acts at, and its force or moment in the body's axes."""
    marker = trace_place_on_body(inputs, frame, at.marker)
    size = inputs.signal(at.size)[0] + trace_effort(inputs, frames, at.effort)
    direction = [size * float(x) for x in clean_direction(at.direction)]
    return marker, times(marker.R if at.following else transpose(frame.world[1]), direction)

"""Force elements between two places as parts of a graph: what acts on each body, and the energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fmd.core.data_classes import dataclass
from fmd.core.limits.mechanism import SHORTEST_SPRING
from fmd.dynamics.compiler.algebra import (
    Vector3,
    Vector6,
    add,
    constants,
    cross,
    dot,
    product,
    scale,
    subtract,
    times,
    transpose,
)
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.formulas import trace_periodic_table
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Scalar, Terms, total
from fmd.dynamics.compiler.joint_motion import joint_elongation
from fmd.dynamics.compiler.places import PlaceMotion, trace_place
from fmd.dynamics.elements import Attachment, Element, GearTeeth, PointSpring, SixAxisSpring, SpeedDependentBearing
from fmd.dynamics.state_functions import StateCurve

_AXES = range(3)
Matrix = list[list[Scalar | float]]


@dataclass
class Action:
    """Force and moment in space that act at a place of a body."""

    end: PlaceMotion
    force: Vector3
    moment: Vector3

    def on_body(self) -> tuple[Vector6, Terms]:
        """Return force and moment on the body's frame, in its axes, and the terms of the forces on its modes."""
        return self.end.on_body(self.force, self.moment)


def trace_actions(inputs: Coordinates, frames: list[MovingFrame]) -> dict[int, list[Action]]:
    """Trace what a mechanism's force elements do to its bodies, by the bodies' numbers."""
    actions: dict[int, list[Action]] = {}
    for element in inputs.mechanism.elements:
        for action in trace_pair(inputs, frames, element):
            if action.end.frame is not None:
                actions.setdefault(action.end.frame.number, []).append(action)
    return actions


def trace_pair(inputs: Coordinates, frames: list[MovingFrame], element: Element) -> list[Action]:
    """Trace what a force element does at its second place and at its first one."""
    return _trace_motion(inputs, frames, element).actions()


def trace_strain(
    inputs: Coordinates, frames: list[MovingFrame], element: Element
) -> tuple[list[Scalar], list[Scalar], Vector3]:
    """Trace the strain of a force element, its rate, and the rate of the vector from its first place to its second one.

    Of a spring the strain is its elongation [m], of a bushing displacement [m] and, if it counts, rotation [rad], of
    gears how far the flanks of one side are pressed [m].
    """
    motion = _trace_motion(inputs, frames, element)
    return *motion.strains(), subtract(motion.second.v, motion.first.v)


def trace_element_energy(inputs: Coordinates, frames: list[MovingFrame], element: Element) -> Scalar:
    """Trace the elastic energy of a force element."""
    return _trace_motion(inputs, frames, element).energy()


def trace_end(inputs: Coordinates, frames: list[MovingFrame], end: Attachment) -> PlaceMotion:
    """Trace the motion of an element's place, in its own axes."""
    place = trace_place(inputs, frames, end)
    return replace(place, A=product(place.A, [constants(inputs.graph, row) for row in end.axes]))


def trace_elongation(
    inputs: Coordinates, frames: list[MovingFrame], element: PointSpring
) -> tuple[Scalar, Scalar, Vector3]:
    """Trace the elongation of a spring, its rate, and the vector from its first place to its second one in space."""
    motion = _SpringMotion(element, *(trace_end(inputs, frames, end) for end in element.ends))
    return *motion.stretch, motion.apart


def _trace_motion(
    inputs: Coordinates, frames: list[MovingFrame], element: Element
) -> _SpringMotion | _BushingMotion | _GearMotion:
    first, second = (trace_end(inputs, frames, end) for end in element.ends)
    if isinstance(element, GearTeeth):
        numbers = (inputs.mechanism.number_of(end.body) for end in element.ends)
        return _GearMotion(element, first, second, [joint_elongation(inputs, frames[number]) for number in numbers])
    if isinstance(element, PointSpring):
        return _SpringMotion(element, first, second)
    if isinstance(element, SpeedDependentBearing):
        return _BearingMotion(element, first, second)
    return _BushingMotion(element, first, second)


@dataclass
class _SpringMotion:
    """A spring between two places that move."""

    element: PointSpring
    first: PlaceMotion
    second: PlaceMotion

    def __post_init__(self) -> None:
        self.apart = subtract(self.second.x, self.first.x)  # in space, from the first place to the second
        self.length = (dot(self.apart, self.apart) + SHORTEST_SPRING**2).apply("sqrt")

    @property
    def stretch(self) -> tuple[Scalar, Scalar]:
        """Elongation and its rate."""
        rate = dot(self.apart, subtract(self.second.v, self.first.v)) * self.length.inverse()
        return self.length - self.element.rest, rate

    def strains(self) -> tuple[list[Scalar], list[Scalar]]:
        """Return the elongation and its rate, one of each."""
        elongation, rate = self.stretch
        return [elongation], [rate]

    def energy(self) -> Scalar:
        """Return the elastic energy."""
        return self.element.law.trace_energy(self.length - self.element.rest)

    def actions(self) -> list[Action]:
        """Return the pulls on both places."""
        pull = scale(self.element.law.trace(*self.stretch) * self.length.inverse(), self.apart)
        none = scale(0.0, pull)
        return [Action(self.second, scale(-1.0, pull), none), Action(self.first, pull, none)]


@dataclass
class _BushingMotion:
    """A bushing between two places that move."""

    element: SixAxisSpring
    first: PlaceMotion
    second: PlaceMotion

    def __post_init__(self) -> None:
        """Trace displacement and rotation of the second place, along the first one's axes, and their rates."""
        first, second = self.first, self.second
        into = transpose(first.A)
        self.apart = subtract(second.x, first.x)  # in space
        swept = subtract(subtract(second.v, first.v), cross(first.w, self.apart))
        R = product(into, second.A)
        self.y = (3.0 - R[0][0] - R[1][1] - R[2][2]) * 0.25  # sin² of half the angle
        self.s = scale(0.5, [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]])  # its sine, along its axis
        self.w = times(into, subtract(second.w, first.w))
        self.d = subtract(times(into, self.apart), constants(self.y.graph, self.element.position))
        self.d_rate = times(into, swept)

    @property
    def theta(self) -> Vector3:
        """Rotation vector."""
        return scale(self.y.apply("arc0"), self.s)

    def through(self, side: float, x: Vector3) -> Vector3:
        """Return ``A⁻¹ x`` for side -1, ``A⁻ᵀ x`` for side 1; see `arc`."""
        h = self.y.apply("arc1") * 0.5 - self.y.apply("arc0") * (1.0 - self.y).inverse() * 0.25
        return add(x, scale(0.5 * side, cross(self.theta, x)), scale(h, cross(self.s, cross(self.s, x))))

    def strains(self) -> tuple[list[Scalar], list[Scalar]]:
        """Return e and its rate: three of each if rotations don't count, else six."""
        if not self.element.twists:
            return self.d, self.d_rate
        return self.d + self.theta, self.d_rate + self.through(-1.0, self.w)

    def energy(self) -> Scalar:
        """Return the elastic energy."""
        (e, _), (K, _) = self.strains(), self.matrices()
        return total(e[i] * e[j] * K[i][j] for i in range(len(e)) for j in range(len(e))) * 0.5

    def matrices(self) -> tuple[Matrix, Matrix]:
        """Return stiffness and damping."""
        return self.element.K.tolist(), self.element.C.tolist()

    def actions(self) -> list[Action]:
        """Return force and moment on both places."""
        (e, rates), (K, C) = self.strains(), self.matrices()
        n = range(len(e))
        f = [-total([e[j] * K[i][j] + rates[j] * C[i][j] for j in n]) for i in n]
        force = times(self.first.A, f[:3])
        moment = times(self.first.A, self.through(1.0, f[3:])) if f[3:] else scale(0.0, force)
        back = scale(-1.0, add(moment, cross(self.apart, force)))
        return [Action(self.second, force, moment), Action(self.first, scale(-1.0, force), back)]


@dataclass
class _BearingMotion(_BushingMotion):
    """A bearing between two places that move, one of which turns in it."""

    element: SpeedDependentBearing

    def matrices(self) -> tuple[Matrix, Matrix]:
        """Return stiffness and damping at the rate of rotation."""
        K, C = super().matrices()
        rate = self.w[2].select(self.w[2], -self.w[2])
        for A, curve in ((K, self.element.radial), (C, self.element.damper)):
            A[0][0] = A[1][1] = trace_periodic_table(curve.knots, curve.cubics, curve.period, rate)
        return K, C


@dataclass
class _GearMotion:
    """Teeth of two gears that turn on hinges."""

    element: GearTeeth
    first: PlaceMotion
    second: PlaceMotion
    hinges: Sequence[tuple[Scalar, Scalar]]  # angle and rate of each

    def __post_init__(self) -> None:
        """Trace how far the flanks of both sides are pressed, and where they touch."""
        own = self.element
        arms = [sense * radius for sense, radius in zip(own.senses, own.radii, strict=True)]
        along, self.rate = (
            total(part * arm for part, arm in zip(both, arms, strict=True)) for both in zip(*self.hinges, strict=True)
        )
        self.pressed = along - own.rest
        rolled = self.hinges[0][0] * arms[0]
        self.sides = ((self.pressed, rolled + own.places[0]), (-self.pressed - own.backlash, own.places[1] - rolled))

    def strains(self) -> tuple[list[Scalar], list[Scalar]]:
        """Return how far the flanks of one side are pressed, and its rate, one of each."""
        return [self.pressed], [self.rate]

    def energy(self) -> Scalar:
        """Return the elastic energy."""
        curves = self.element.energy.of_approach, self.element.energy.of_place
        return total(_sum_of_products(*curves, *side) for side in self.sides)

    def actions(self) -> list[Action]:
        """Return force and moment on both gears, of the wheel first; forces are along the lines of action."""
        own, energy = self.element, self.element.energy
        slopes = [curve.slope for curve in energy.of_approach]
        turning = [curve.slope for curve in energy.of_place]
        bends = [slope.slope for slope in slopes]
        pushes, torques = list[Scalar](), list[Scalar]()
        for sense, side in zip((1.0, -1.0), self.sides, strict=True):
            push = _sum_of_products(slopes, energy.of_place, *side)
            if own.damping:
                push = push + _sum_of_products(bends, energy.of_place, *side) * self.rate * (sense * own.damping)
                push = push.apply("positive")
            pushes.append(push)
            torques.append(_sum_of_products(energy.of_approach, turning, *side) * sense)
        apart, around = pushes[0] + pushes[1], pushes[0] - pushes[1]
        graph = around.graph
        centres, across, axis = (constants(graph, x) for x in (own.centres, np.cross(own.axis, own.centres), own.axis))
        force = add(scale(apart * np.sin(own.alpha), centres), scale(around * np.cos(own.alpha), across))
        tilting = cross(axis, force)  # of forces in the gears' middles about their hinges' markers
        on_wheel = add(scale(around * -own.radii[1], axis), scale(own.middles[1], tilting))
        on_pinion = add(scale((around + total(torques)) * -own.radii[0], axis), scale(-own.middles[0], tilting))
        return [Action(self.second, force, on_wheel), Action(self.first, scale(-1.0, force), on_pinion)]


def _sum_of_products(one: Sequence[StateCurve], other: Sequence[StateCurve], x: Scalar, s: Scalar) -> Scalar:
    """Return the sum of products of curves of two variables."""
    pairs = zip(one, other, strict=True)
    return total(
        trace_periodic_table(a.knots, a.cubics, a.period, x) * trace_periodic_table(b.knots, b.cubics, b.period, s)
        for a, b in pairs
    )

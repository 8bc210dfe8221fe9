"""Force elements between two places as parts of a graph: what acts on each body, and the energy."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Scalar, Terms, total
from fmd.dynamics.compiler.laws import trace_law, trace_law_energy
from fmd.dynamics.compiler.places import PlaceMotion, trace_place
from fmd.dynamics.elements import Attachment, Element, PointSpring, SixAxisSpring

_AXES = range(3)


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
    first, second = (trace_end(inputs, frames, end) for end in element.ends)
    if isinstance(element, PointSpring):
        return _spring_actions(element, first, second)
    return _bushing_actions(element, first, second)


def trace_strain(
    inputs: Coordinates, frames: list[MovingFrame], element: Element
) -> tuple[list[Scalar], list[Scalar], Vector3]:
    """Trace the strain of a force element, its rate, and the rate of the way from its first place to its second one.

    Of a spring the strain is its elongation [m], of a bushing displacement [m] and, if it counts, rotation [rad].
    """
    first, second = (trace_end(inputs, frames, end) for end in element.ends)
    swing = subtract(second.v, first.v)
    if isinstance(element, PointSpring):
        _, length, rate = _stretching(first, second)
        return [length - element.rest], [rate], swing
    return *_bushing_motion(element, first, second).strains(element), swing


def trace_element_energy(inputs: Coordinates, frames: list[MovingFrame], element: Element) -> Scalar:
    """Trace the elastic energy of a force element."""
    first, second = (trace_end(inputs, frames, end) for end in element.ends)
    if isinstance(element, PointSpring):
        return trace_law_energy(element.law, _length(first, second)[1] - element.rest)
    e, _ = _bushing_motion(element, first, second).strains(element)
    return total(e[i] * e[j] * float(element.K[i, j]) for i in range(len(e)) for j in range(len(e))) * 0.5


def trace_end(inputs: Coordinates, frames: list[MovingFrame], end: Attachment) -> PlaceMotion:
    """Trace the motion of an element's place, in its own axes."""
    place = trace_place(inputs, frames, end)
    return replace(place, A=product(place.A, [constants(inputs.graph, row) for row in end.axes]))


def _length(first: PlaceMotion, second: PlaceMotion) -> tuple[Vector3, Scalar]:
    """Return the way from one place to another, and its length."""
    way = subtract(second.x, first.x)
    return way, (dot(way, way) + SHORTEST_SPRING**2).apply("sqrt")


def trace_elongation(
    inputs: Coordinates, frames: list[MovingFrame], element: PointSpring
) -> tuple[Scalar, Scalar, Vector3]:
    """Trace the elongation of a spring, its rate, and the way from its first place to its second one in space."""
    first, second = (trace_end(inputs, frames, end) for end in element.ends)
    way, length, rate = _stretching(first, second)
    return length - element.rest, rate, way


def _stretching(first: PlaceMotion, second: PlaceMotion) -> tuple[Vector3, Scalar, Scalar]:
    """Return the way from one place to another, its length and the rate of that."""
    way, length = _length(first, second)
    return way, length, dot(way, subtract(second.v, first.v)) * length.inverse()


def _spring_actions(element: PointSpring, first: PlaceMotion, second: PlaceMotion) -> list[Action]:
    way, length, rate = _stretching(first, second)
    pull = scale(trace_law(element.law, length - element.rest, rate) * length.inverse(), way)
    none = scale(0.0, pull)
    return [Action(second, scale(-1.0, pull), none), Action(first, pull, none)]


@dataclass
class _BushingMotion:
    """Displacement and rotation of a bushing's second place, along its first one's axes, and their rates."""

    way: Vector3  # in space, from the first place to the second
    d: Vector3
    d_rate: Vector3
    w: Vector3
    y: Scalar  # sin² of half the angle
    s: Vector3  # sine of the angle, along its axis

    @property
    def theta(self) -> Vector3:
        return scale(self.y.apply("arc0"), self.s)

    def through(self, side: float, x: Vector3) -> Vector3:
        """Return ``A⁻¹ x`` for side -1, ``A⁻ᵀ x`` for side 1; see `arc`."""
        h = self.y.apply("arc1") * 0.5 - self.y.apply("arc0") * (1.0 - self.y).inverse() * 0.25
        return add(x, scale(0.5 * side, cross(self.theta, x)), scale(h, cross(self.s, cross(self.s, x))))

    def strains(self, element: SixAxisSpring) -> tuple[list[Scalar], list[Scalar]]:
        """Return e and its rate: three of each if rotations don't count, else six."""
        if not element.twists:
            return self.d, self.d_rate
        return self.d + self.theta, self.d_rate + self.through(-1.0, self.w)


def _bushing_motion(element: SixAxisSpring, first: PlaceMotion, second: PlaceMotion) -> _BushingMotion:
    into = transpose(first.A)
    way = subtract(second.x, first.x)
    swept = subtract(subtract(second.v, first.v), cross(first.w, way))
    position = constants(way[0].graph, element.position)
    R = product(into, second.A)
    y = (3.0 - R[0][0] - R[1][1] - R[2][2]) * 0.25
    s = scale(0.5, [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]])
    w = times(into, subtract(second.w, first.w))
    return _BushingMotion(way, subtract(times(into, way), position), times(into, swept), w, y, s)


def _bushing_actions(element: SixAxisSpring, first: PlaceMotion, second: PlaceMotion) -> list[Action]:
    motion = _bushing_motion(element, first, second)
    e, rates = motion.strains(element)
    n = range(len(e))
    f = [-total([e[j] * float(element.K[i, j]) + rates[j] * float(element.C[i, j]) for j in n]) for i in n]
    force = times(first.A, f[:3])
    moment = times(first.A, motion.through(1.0, f[3:])) if f[3:] else scale(0.0, force)
    back = scale(-1.0, add(moment, cross(motion.way, force)))
    return [Action(second, force, moment), Action(first, scale(-1.0, force), back)]

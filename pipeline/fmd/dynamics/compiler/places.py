"""Motion of places of a mechanism in space, on bodies or on the ground, and what acts there."""

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.dynamics.closures import GROUND, Place
from fmd.dynamics.compiler.algebra import (
    Matrix,
    Vector3,
    Vector6,
    add,
    constants,
    cross,
    identity,
    product,
    scale,
    times,
    transpose,
)
from fmd.dynamics.compiler.cleaning import clean_direction
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.frames import MovingFrame, marker_bias, trace_place_on_body
from fmd.dynamics.compiler.graph import Terms, Vector
from fmd.dynamics.compiler.marker import MarkerMotion

_AXES = range(3)


@dataclass
class PlaceMotion:
    """Motion of a place in space."""

    x: Vector3
    v: Vector3
    A: Matrix  # from the axes of its section into those of space
    w: Vector3  # angular velocity of the section
    frame: MovingFrame | None = None  # of the body that it is on; none for the ground
    marker: MarkerMotion | None = None

    def turned(self, direction: Array) -> Vector3:
        """Return a direction of the section in space."""
        return times(self.A, constants(self.x[0].graph, clean_direction(direction)))

    def acceleration(self, x: Vector6, eta: Vector) -> tuple[Vector3, Vector3]:
        """Return accelerations of the place and of its section for those of the body's frame and of its modes."""
        assert self.frame is not None
        assert self.marker is not None
        marker = self.marker
        turns = [row.dot(eta) for row in marker.turns]
        of_modes = [row.dot(eta) for row in marker.slopes] + times(marker.A, turns)
        carried = add(x[:3], cross(x[3:], marker.arm)) + x[3:]
        both = add(carried, of_modes, marker_bias(self.frame.spin, marker))
        R = self.frame.world[1]
        return times(R, both[:3]), times(R, both[3:])

    def on_body(self, force: Vector3, moment: Vector3) -> tuple[Vector6, Terms]:
        """Return what a force and a moment in space do to the body's frame, in its axes, and the terms on its modes."""
        assert self.frame is not None
        assert self.marker is not None
        marker, into_body = self.marker, transpose(self.frame.world[1])
        force, moment = times(into_body, force), times(into_body, moment)
        on_section = times(transpose(marker.A), moment)
        terms: Terms = [(force[i], marker.slopes[i]) for i in _AXES]
        terms += [(on_section[i], marker.turns[i]) for i in _AXES]
        return force + add(cross(marker.arm, force), moment), terms


def trace_place(inputs: Coordinates, frames: list[MovingFrame], place: Place) -> PlaceMotion:
    """Trace the motion of a place."""
    graph = inputs.graph
    if place.body == GROUND:
        still = constants(graph, [0.0] * 3)
        return PlaceMotion(constants(graph, place.marker.position), still, identity(graph, 3), still)
    frame = frames[inputs.mechanism.number_of(place.body)]
    marker = trace_place_on_body(inputs, frame, place.marker)
    origin, R = frame.world
    moving = add(frame.velocity, cross(frame.spin, marker.arm), scale(0.5, marker.moving))
    spin = times(R, add(frame.spin, marker.turned))
    return PlaceMotion(add(origin, times(R, marker.arm)), times(R, moving), product(R, marker.R), spin, frame, marker)

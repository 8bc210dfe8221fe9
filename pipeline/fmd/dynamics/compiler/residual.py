"""Residual of a mechanism's equations of motion, ``r = M̂ a − Q̂``, for given accelerations.

The recursive Newton–Euler algorithm (Featherstone 2008, chapter 5) with the bodies' modes: accelerations are carried
outwards, and the forces that they take inwards. No matrix is formed.

A joint's load is the force that moves a body and all that it carries, whatever acts along the joint: what bears,
springs, dampers, drives, friction and gears together.
"""

from fmd.core.data_classes import dataclass
from fmd.dynamics.compiler.algebra import Vector6, add, cross, dot, rotate, scale, subtract, times, transpose
from fmd.dynamics.compiler.bodies import trace_inertia
from fmd.dynamics.compiler.closures import ConstrainedForces, trace_rows
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.forces import ActingForces, Forces, PushedForces
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Terms, Vector, combine
from fmd.dynamics.compiler.recursion import BodyValues


@dataclass
class JointForce:
    """Force that moves a body and all that it carries, in the body's axes."""

    x: Vector6  # acceleration of the body's frame, less that of free fall
    force: Vector6  # force and moment about the body's origin, by its joint
    modes: Vector  # residual of the body's modes

    def at_place(self, frame: MovingFrame) -> Vector6:
        """Return force and moment about the joint's place on the parent, in the body's axes."""
        return self.force[:3] + add(self.force[3:], cross(frame.shift, self.force[:3]))


def trace_residual(inputs: Coordinates, frames: list[MovingFrame], acting: Forces | None = None) -> list[BodyValues]:
    """Trace the residual of each body's joint and modes; accelerations are the argument ``a``.

    Forces other than those that act on the mechanism by itself may be given.
    """
    acting = ActingForces(inputs, frames) if acting is None else acting
    out = []
    for frame, found in zip(frames, trace_joint_forces(inputs, frames, acting), strict=True):
        loads = zip(frame.directions, acting.on_joint(frame), strict=True)
        out.append(BodyValues([dot(direction, found.force) - load for direction, load in loads], found.modes))
    return out


def trace_joint_forces(inputs: Coordinates, frames: list[MovingFrame], acting: Forces) -> list[JointForce]:
    """Trace what each joint transmits to its body for forces on all bodies; accelerations are the argument ``a``."""
    x = trace_motion(inputs, frames, acting)
    carried: dict[int, Vector6] = {}
    found: list[JointForce] = []
    for frame in reversed(frames):
        inputs.graph.mark()
        found.append(JointForce(x[frame.number], *_forces(inputs, acting, frame, x[frame.number], carried)))
        carried[frame.number] = rotate(frame.R, found[-1].at_place(frame))
    return found[::-1]


def trace_motion(inputs: Coordinates, frames: list[MovingFrame], acting: Forces) -> list[Vector6]:
    """Trace the accelerations of the bodies' frames for accelerations of the coordinates, the argument ``a``."""
    x: list[Vector6] = []
    for frame in frames:
        inputs.graph.mark()
        x.append(_accelerate(inputs, acting, frame, x))
    return x


def _accelerate(inputs: Coordinates, acting: Forces, frame: MovingFrame, above: list[Vector6]) -> Vector6:
    """Return the acceleration of a body's frame from that of its parent's."""
    if frame.parent is None:
        x = frame.carry(acting.ground)
    else:
        eta = inputs.inputs_of_modes(frame.parent.number, "a")
        x = frame.carry(above[frame.parent.number], frame.marker_motion(eta))
    return add(x, frame.move(inputs.inputs_of_joint(frame.number, "a")))


def _forces(
    inputs: Coordinates, acting: Forces, frame: MovingFrame, x: Vector6, carried: dict[int, Vector6]
) -> tuple[Vector6, Vector]:
    """Return the force that moves a body's frame and what it carries, and the residual of its modes."""
    graph = inputs.graph
    inertia = trace_inertia(graph, frame)
    eta = inputs.inputs_of_modes(frame.number, "a")
    p, terms = acting.on_body(frame, inertia)
    force = add(times(inertia.M, x), [row.dot(eta) for row in inertia.W], p)
    on_modes: Terms = [(1.0, eta)]
    on_modes += [(-1.0 * factor, vector) for factor, vector in terms]
    on_modes += zip(x, inertia.W, strict=True)
    on_modes += [] if inertia.more is None else inertia.more.times(eta)
    for child in frame.children:
        at_marker = carried[child.number]
        force = add(force, times(transpose(child.B), at_marker))
        turning = times(transpose(child.marker.A), at_marker[3:])
        on_modes += zip(at_marker[:3] + turning, child.marker.slopes + child.marker.turns, strict=True)
    return force, combine(on_modes)


def trace_joint_loads(inputs: Coordinates, frames: list[MovingFrame]) -> list[tuple[Vector6, Vector6, Vector6]]:
    """Trace of each body the acceleration of its frame, and the force and moment of its joint on parent and body.

    All are in space; moments are about the joint's place on the parent, and about the body's origin.
    """
    loops = inputs.mechanism.closures
    acting = ConstrainedForces(inputs, frames, trace_rows(inputs, frames)) if loops else PushedForces(inputs, frames)
    out = []
    for frame, found in zip(frames, trace_joint_forces(inputs, frames, acting), strict=True):
        R = frame.world[1]
        falling = rotate(R, found.x)
        acceleration = subtract(falling[:3], acting.ground[:3]) + falling[3:]
        out.append((acceleration, scale(-1.0, rotate(R, found.at_place(frame))), rotate(R, found.force)))
    return out

"""Energies and momenta of a mechanism, the frames of its bodies in space, and the structure that saves arithmetic."""

import numpy as np

from fmd.dynamics.compiler.algebra import Vector3, add, constants, cross, dot, scale, times
from fmd.dynamics.compiler.bodies import trace_inertia
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.elements import trace_element_energy
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Scalar, total
from fmd.dynamics.compiler.joint_motion import section_angle
from fmd.dynamics.compiler.program import Program


def trace_momenta(inputs: Coordinates, frames: list[MovingFrame]) -> tuple[Vector3, Vector3]:
    """Trace the linear momentum and the angular momentum about the origin, in space."""
    linear, angular = (constants(inputs.graph, [0.0] * 3) for _ in range(2))
    for frame in frames:
        origin, R = frame.world
        push, turn = (times(R, part) for part in body_momenta(inputs, frame)[1:])
        linear, angular = add(linear, push), add(angular, turn, cross(origin, push))
    return linear, angular


def body_momenta(inputs: Coordinates, frame: MovingFrame) -> tuple[Vector3, Vector3, Vector3]:
    """Return a body's first moment, momentum and angular momentum about its origin, in its axes."""
    inertia, w, u = trace_inertia(inputs.graph, frame), frame.spin, frame.velocity
    push = add(scale(inertia.mass, u), cross(w, inertia.c), inertia.c_rate)
    turn = add(cross(inertia.c, u), times(inertia.J, w), scale(-1.0, inertia.h))
    return inertia.c, push, turn


def trace_kinetic_energy(inputs: Coordinates, frames: list[MovingFrame]) -> Scalar:
    """Trace ``½ Σ (v · momentum + ω · angular momentum + q̇ · modal momentum)``."""
    twice: list[Scalar] = []
    for frame in frames:
        inertia = trace_inertia(inputs.graph, frame)
        _, push, turn = body_momenta(inputs, frame)
        modal = frame.v.dot(frame.v) + dot(frame.velocity, inertia.c_rate) - dot(frame.spin, inertia.h)
        modal = modal if inertia.more is None else modal + inertia.more.twice_energy(frame.v)
        twice.append(dot(frame.velocity, push) + dot(frame.spin, turn) + modal)
    return total(twice) * 0.5


def trace_potential_energy(inputs: Coordinates, frames: list[MovingFrame]) -> Scalar:
    """Trace the energy of modes, springs, stops and force elements, and that of the weight, 0 at the origin."""
    energies = [inputs.graph.number(0.0)]
    for frame in frames:
        link = frame.link
        energies.append(frame.q.dot(frame.q.multiplied_by(np.diag(link.omega**2))) * 0.5)
        if link.spring:
            known = inputs.signal(link.motion) if link.motion is not None else inputs.joint_positions(frame.number)
            spring, rest = (inputs.number(frame.number, name, getattr(link, name)) for name in ("spring", "rest"))
            stretch = known[0] - rest + section_angle(inputs.graph, frame)
            energies.append(stretch * stretch * (spring * 0.5))
        for law, position in zip(link.laws, inputs.joint_positions(frame.number), strict=bool(link.laws)):
            energies.append(law.trace_energy(position + section_angle(inputs.graph, frame)))
        if any(not g.is_zero for g in inputs.fall):
            origin, R = frame.world
            inertia = trace_inertia(inputs.graph, frame)
            moment = add(scale(inertia.mass, origin), times(R, inertia.c))
            energies.append(dot(inputs.fall, moment))
    energies += [trace_element_energy(inputs, frames, element) for element in inputs.mechanism.elements]
    return total(energies)


def describe_structure(inputs: Coordinates, frames: list[MovingFrame], accelerations: Program) -> list[str]:
    """Return what saves a mechanism's equations arithmetic: plane motion, cyclic angles, constant inertia."""
    graph, lines = inputs.graph, list[str]()
    for axis, name in enumerate("xyz"):
        if all(x.is_zero for frame in frames for k, x in enumerate(frame.spin) if k != axis):
            lines.append(f"plane motion: every body turns about {name} alone")
            break
    reads = {node.data for node in (graph.nodes[k] for k in accelerations.nodes) if node.operation == "input"}
    for frame in frames:
        link, position = frame.link, int(inputs.mechanism.layout.position[frame.number])
        if link.joint.is_hinge and link.n_rates and ("q", (position,)) not in reads:
            lines.append(f"cyclic angle: accelerations don't depend on that of {link.name}")
        if not link.omega.size:
            continue
        inertia = trace_inertia(graph, frame)
        if all(row.constant is not None for row in inertia.W):
            lines.append(f"constant coupling of the frame of {link.name} with its modes")
        if all(x.constant is not None for row in inertia.J for x in row):
            lines.append(f"constant inertia of {link.name}")
    return lines

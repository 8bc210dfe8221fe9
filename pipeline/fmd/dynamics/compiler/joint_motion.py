"""Motion along a joint with one axis, and what of it the modes of its body make."""

from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine


def joint_elongation(inputs: Coordinates, frame: MovingFrame) -> tuple[Scalar, Scalar]:
    """Return position and rate of a joint with one axis, a hinge's of the section that it grips."""
    if frame.link.motion is not None:
        position, rate = inputs.signal(frame.link.motion, derivatives=1)
        return position, rate
    (s,), (ds,) = inputs.joint_positions(frame.number), inputs.joint_rates(frame.number)
    return s + section_angle(inputs.graph, frame), ds + joint_grip(inputs.graph, frame).dot(frame.v)


def section_angle(graph: Graph, frame: MovingFrame) -> Scalar:
    """Return the angle by which a body's own section has turned in its joint."""
    link = frame.link
    if not link.grips_section:
        return graph.number(0.0)
    return combine([(0.5, graph.array(link.joint_rotation)), (0.5, joint_grip(graph, frame))]).dot(frame.q)


def joint_grip(graph: Graph, frame: MovingFrame) -> Vector:
    """Return how much a body's own section turns in its joint for unit modal coordinates, at its deflection."""
    link = frame.link
    if not link.grips_section:
        return graph.zeros(len(link.omega))
    grip = graph.array(link.joint_rotation)
    return grip + frame.q.multiplied_by(link.joint_displacement2) if link.joint_displacement2.size else grip

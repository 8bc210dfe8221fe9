"""Elongations that force laws with short pieces depend on, as parts of a graph."""

from __future__ import annotations

from pipeline.dynamics.compiler.algebra import Vector3, constants
from pipeline.dynamics.compiler.coordinates import Coordinates
from pipeline.dynamics.compiler.elements import trace_elongation
from pipeline.dynamics.compiler.forces import joint_elongation
from pipeline.dynamics.compiler.frames import MovingFrame
from pipeline.dynamics.compiler.graph import Scalar
from pipeline.dynamics.elements import PointSpring
from pipeline.dynamics.watched_laws import find_watched


def trace_elongations(inputs: Coordinates, frames: list[MovingFrame]) -> tuple[list[Scalar], list[Scalar], Vector3]:
    """Trace elongations, their rates, and the ways from place to place in space, three each; zeros for joints."""
    x, rates, ways = list[Scalar](), list[Scalar](), list[Scalar]()
    for watched in find_watched(inputs.mechanism):
        if isinstance(watched.holder, PointSpring):
            elongation, rate, way = trace_elongation(inputs, frames, watched.holder)
        else:
            elongation, rate = joint_elongation(inputs, frames[watched.holder])
            way = constants(inputs.graph, [0.0] * 3)
        x, rates, ways = [*x, elongation], [*rates, rate], [*ways, *way]
    return x, rates, ways

"""Elongations that force laws with short pieces depend on, as parts of a graph."""

from __future__ import annotations

from fmd.dynamics.compiler.algebra import Vector3, constants
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.elements import trace_elongation
from fmd.dynamics.compiler.forces import joint_elongation
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Scalar
from fmd.dynamics.elements import PointSpring
from fmd.dynamics.watched_laws import find_watched


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

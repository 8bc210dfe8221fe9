"""Elongations that force laws with short pieces depend on, as parts of a graph."""

from __future__ import annotations

from fmd.dynamics.compiler.algebra import Vector3, constants
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.elements import trace_elongation
from fmd.dynamics.compiler.forces import joint_elongation
from fmd.dynamics.compiler.frames import MovingFrame
from fmd.dynamics.compiler.graph import Scalar
from fmd.dynamics.elements import PointSpring
from fmd.dynamics.law_pieces import find_piecewise_laws


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

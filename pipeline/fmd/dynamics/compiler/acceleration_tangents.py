"""Accelerations of a mechanism and their derivatives along a direction, as one part of a graph.

The residual ``r = M̂ a − Q̂`` is 0 along every motion, so ``δa = −M̂⁻¹ δr`` with δr at fixed accelerations (Carpentier &
Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS 2018). That takes half of the operations of
differentiating the recursion itself, and the articulated inertias are those of the accelerations.
"""

from __future__ import annotations

from fmd.dynamics.compiler.coordinates import Coordinates, RestingCoordinates
from fmd.dynamics.compiler.forces import ActingForces, GivenForces
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Scalar, Vector, combine
from fmd.dynamics.compiler.recursion import BodyValues, trace_accelerations
from fmd.dynamics.compiler.residual import trace_residual
from fmd.dynamics.compiler.substitute import substitute
from fmd.dynamics.compiler.tangents import flatten, trace_tangents, unflatten


class TracedForces(GivenForces):
    """Generalised forces that are values of the graph, body by body, on a mechanism at rest without weight."""

    def __init__(self, inputs: RestingCoordinates, values: list[BodyValues], free: range) -> None:
        super().__init__(inputs, "", free)
        self._values = values

    def on_joint(self, frame: MovingFrame) -> list[Scalar]:
        """Return what acts along each direction that isn't frozen."""
        return self._values[frame.number].joint[: len(self.free_directions(frame))]

    def on_modes(self, frame: MovingFrame) -> Vector:
        """Return the forces on a body's modes."""
        return self._values[frame.number].modes


def trace_acceleration_tangents(
    inputs: Coordinates, frames: list[MovingFrame], acting: ActingForces, beside: list[BodyValues]
) -> tuple[list[BodyValues], list[BodyValues]]:
    """Trace accelerations by what acts, and their derivatives along ``dinputs``, ``dq`` and ``dv``.

    ``beside`` is what the residual changes by apart from these, such as by a body's mass; empty if nothing.
    """
    graph, mechanism = inputs.graph, inputs.mechanism
    found = trace_accelerations(frames, acting)
    slopes = trace_tangents(inputs, trace_residual(inputs, frames, acting), ("inputs", "q", "v"))
    replaced: dict[int, Scalar | Vector] = {}
    for number, own in enumerate(found):
        pairs = zip(inputs.inputs_of_joint(number, "a"), own.joint, strict=True)
        replaced |= {given.node: value for given, value in pairs}
        replaced[inputs.inputs_of_modes(number, "a").node] = own.modes
    whole = flatten(slopes)
    if beside:
        whole = [_add(one, other) for one, other in zip(whole, flatten(beside), strict=True)]
    at_motion = substitute(graph, [-x for x in whole], replaced)
    resting = RestingCoordinates(graph, mechanism)
    forces = TracedForces(resting, unflatten(at_motion, slopes), range(mechanism.n))
    return found, trace_accelerations(trace_frames(resting), forces)


def _add(one: Scalar | Vector, other: Scalar | Vector) -> Scalar | Vector:
    if isinstance(one, Scalar):
        assert isinstance(other, Scalar)
        return one + other
    assert isinstance(other, Vector)
    return combine([(1.0, one), (1.0, other)])

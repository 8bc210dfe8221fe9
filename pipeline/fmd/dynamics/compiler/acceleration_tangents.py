"""Accelerations of a mechanism and their derivatives along a direction, as one part of a graph.

The residual ``r = M̂ a − Q̂`` is 0 along every motion, so ``δa = −M̂⁻¹ δr`` with δr at fixed accelerations (Carpentier &
Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS 2018). That takes half of the operations of
differentiating the recursion itself, and the articulated inertias are those of the accelerations.
"""

from __future__ import annotations

from fmd.dynamics.compiler.coordinates import Coordinates, RestingCoordinates
from fmd.dynamics.compiler.forces import ActingForces
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Scalar, Vector
from fmd.dynamics.compiler.reaction import TracedForces
from fmd.dynamics.compiler.recursion import BodyValues, trace_accelerations
from fmd.dynamics.compiler.residual import trace_residual
from fmd.dynamics.compiler.substitute import substitute
from fmd.dynamics.compiler.tangents import flatten, trace_tangents, unflatten


def trace_acceleration_tangents(
    inputs: Coordinates, frames: list[MovingFrame]
) -> tuple[list[BodyValues], list[BodyValues]]:
    """Trace accelerations, and their derivatives along ``dinputs``, ``dq`` and ``dv``."""
    graph, mechanism = inputs.graph, inputs.mechanism
    found = trace_accelerations(frames, ActingForces(inputs, frames))
    slopes = trace_tangents(inputs, trace_residual(inputs, frames), ("inputs", "q", "v"))
    replaced: dict[int, Scalar | Vector] = {}
    for number, own in enumerate(found):
        pairs = zip(inputs.inputs_of_joint(number, "a"), own.joint, strict=True)
        replaced |= {given.node: value for given, value in pairs}
        replaced[inputs.inputs_of_modes(number, "a").node] = own.modes
    at_motion = substitute(graph, [-x for x in flatten(slopes)], replaced)
    resting = RestingCoordinates(graph, mechanism)
    forces = TracedForces(resting, unflatten(at_motion, slopes), range(mechanism.n))
    return found, trace_accelerations(trace_frames(resting), forces)

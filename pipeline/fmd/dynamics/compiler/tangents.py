"""Tangents of a mechanism's residual ``r = M̂ a − Q̂`` along directions of its positions, rates and accelerations.

The residual is 0 along every motion, so ``δa = −M̂⁻¹ δr`` with δr at fixed accelerations (Carpentier &
Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS 2018). That takes half of the operations of
differentiating the recursion itself, and the articulated inertias are those of the accelerations.
"""

from fmd.dynamics.compiler.coordinates import Coordinates, RestingCoordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.forces import ActingForces, GivenForces
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from fmd.dynamics.compiler.recursion import BodyValues, trace_accelerations
from fmd.dynamics.compiler.residual import trace_residual
from fmd.dynamics.compiler.substitute import substitute


def trace_tangents(inputs: Coordinates, found: list[BodyValues], arguments: tuple[str, ...]) -> list[BodyValues]:
    """Trace derivatives of what bodies have along a direction of some arguments, such as ``dq`` of ``q``."""
    graph = inputs.graph
    return unflatten(differentiate(graph, flatten(found), direction_inputs(graph, arguments)), found)


def flatten(found: list[BodyValues]) -> list[Scalar | Vector]:
    """Return what has been found of bodies in a row: the entries of each joint, and the modes."""
    values: list[Scalar | Vector] = []
    for body in found:
        values += [*body.joint, body.modes]
    return values


def unflatten(values: list[Scalar | Vector], like: list[BodyValues]) -> list[BodyValues]:
    """Return values in a row, as `flatten` has them, body by body."""
    following = iter(values)
    return [BodyValues([_scalar(next(following)) for _ in body.joint], _vector(next(following))) for body in like]


def direction_inputs(graph: Graph, arguments: tuple[str, ...], prefix: str = "d") -> dict[int, Scalar | Vector]:
    """Return an input of a direction for each input of some arguments, by the numbers of these nodes."""
    seeds: dict[int, Scalar | Vector] = {}
    for number, node in enumerate(list(graph.nodes)):
        if node.operation not in ("input", "vector input"):
            continue
        argument, places = node.data  # type: ignore[misc]
        if argument in arguments:
            one = node.operation == "input"
            name = prefix + argument
            seeds[number] = graph.scalar_input(name, places[0]) if one else graph.vector_input(name, places)
    return seeds


def _scalar(value: Scalar | Vector) -> Scalar:
    assert isinstance(value, Scalar)
    return value


def _vector(value: Scalar | Vector) -> Vector:
    assert isinstance(value, Vector)
    return value


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

    Those of contact along ``dpush`` and ``dmodal`` are among them.
    ``beside`` is what the residual changes by apart from these, such as by a body's mass; empty if nothing.
    """
    graph, mechanism = inputs.graph, inputs.mechanism
    found = trace_accelerations(frames, acting)
    slopes = trace_tangents(inputs, trace_residual(inputs, frames, acting), ("inputs", "q", "v", "push", "modal"))
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

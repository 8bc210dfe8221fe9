"""Tangents of a mechanism's residual ``r = M̂ a − Q̂`` along directions of its positions, rates and accelerations."""

from __future__ import annotations

from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector
from fmd.dynamics.compiler.recursion import BodyValues


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

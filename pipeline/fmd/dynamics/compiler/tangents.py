"""Tangents of a mechanism's residual ``r = M̂ a − Q̂`` along directions of its positions, rates and accelerations."""

from __future__ import annotations

from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.differentiate import differentiate
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector
from fmd.dynamics.compiler.recursion import BodyValues


def trace_tangents(inputs: Coordinates, residual: list[BodyValues], arguments: tuple[str, ...]) -> list[BodyValues]:
    """Trace the residual's derivatives along a direction of some arguments, such as ``dq`` of ``q``."""
    graph = inputs.graph
    values: list[Scalar | Vector] = []
    for body in residual:
        values += [*body.joint, body.modes]
    slopes = iter(differentiate(graph, values, direction_inputs(graph, arguments)))
    out = []
    for body in residual:
        joint = [_scalar(next(slopes)) for _ in body.joint]
        out.append(BodyValues(joint, _vector(next(slopes))))
    return out


def direction_inputs(graph: Graph, arguments: tuple[str, ...]) -> dict[int, Scalar | Vector]:
    """Return an input of a direction for each input of some arguments, by the numbers of these nodes."""
    seeds: dict[int, Scalar | Vector] = {}
    for number, node in enumerate(list(graph.nodes)):
        if node.operation not in ("input", "vector input"):
            continue
        argument, places = node.data  # type: ignore[misc]
        if argument in arguments:
            one = node.operation == "input"
            name = f"d{argument}"
            seeds[number] = graph.scalar_input(name, places[0]) if one else graph.vector_input(name, places)
    return seeds


def _scalar(value: Scalar | Vector) -> Scalar:
    assert isinstance(value, Scalar)
    return value


def _vector(value: Scalar | Vector) -> Vector:
    assert isinstance(value, Vector)
    return value

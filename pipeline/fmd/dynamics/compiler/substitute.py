"""Substitution in a graph: nodes in which inputs are replaced by other nodes."""

from collections.abc import Mapping, Sequence

import numpy as np

from fmd.dynamics.compiler.functions import FUNCTIONS
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine


def substitute(
    graph: Graph, outputs: Sequence[Scalar | Vector], replaced: Mapping[int, Scalar | Vector]
) -> list[Scalar | Vector]:
    """Return outputs as they are with some inputs, by the numbers of their nodes, replaced by other values.

    What becomes equal to an expression that is there is that one.
    """
    values: dict[int, Scalar | Vector] = {}
    for number in graph.live_by_marks(output.node for output in outputs):
        arguments = graph.nodes[number].arguments
        if number in replaced:
            values[number] = replaced[number]
        elif all(values[k].node == k for k in arguments):
            values[number] = graph.value_of(number)
        elif isinstance(graph.value_of(number), Scalar):
            values[number] = _scalar(graph, number, [values[k] for k in arguments])
        else:
            values[number] = _vector(graph, number, [values[k] for k in arguments])
    return [values[output.node] for output in outputs]


def _scalar(graph: Graph, number: int, arguments: list[Scalar | Vector]) -> Scalar:
    operation, _, data, _ = graph.nodes[number]
    vectors = [x for x in arguments if isinstance(x, Vector)]
    if operation == "dot":
        return vectors[0].dot(vectors[1])
    if operation == "entry":
        return vectors[0].entry(data)  # type: ignore[arg-type]
    x, *others = (value for value in arguments if isinstance(value, Scalar))
    if operation in ("piece", "pick"):
        table = graph.arrays[data]  # type: ignore[index]
        return x.piece(table) if operation == "piece" else x.pick(table)
    if operation in FUNCTIONS:
        return x.apply(operation)
    if operation == "moving":
        return others[0].moving(x)
    of_several = {
        "add": "__add__",
        "subtract": "__sub__",
        "multiply": "__mul__",
        "negate": "__neg__",
        "invert": "inverse",
    }
    made: Scalar = getattr(x, of_several.get(operation, operation))(*others)
    return made


def _vector(graph: Graph, number: int, arguments: list[Scalar | Vector]) -> Vector:
    operation, _, data, _ = graph.nodes[number]
    if operation == "combine":
        return combine(list(zip(arguments[::2], arguments[1::2], strict=True)))  # type: ignore[arg-type]
    (x,) = arguments
    assert isinstance(x, Vector)
    constant = graph.arrays[data]  # type: ignore[index]
    return x.multiplied_by(np.diag(constant) if operation == "diagonal" else constant)

"""Evaluation of a graph by NumPy, node by node: slow, and the reference that compiled code is tested against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.functions import FUNCTIONS, evaluate_function
from fmd.dynamics.compiler.graph import Graph


def interpret(graph: Graph, outputs: Sequence[int], arguments: Mapping[str, Array]) -> list[Any]:
    """Return the values of nodes.

    Parameters
    ----------
    outputs : sequence of int
        Numbers of the nodes.
    arguments : mapping of str to ndarray
        What inputs read; those of lanes have an axis more. Complex entries are carried through, for derivatives by a
        complex step, by sine and cosine alone of all functions.
    """
    values: dict[int, Any] = {}
    for number in graph.live(outputs):
        operation, taken, data, _ = graph.nodes[number]
        x = [values[k] for k in taken]
        value: Any
        if operation == "number":
            value = data
        elif operation in ("input", "vector input"):
            name, places = data  # type: ignore[misc]
            value = arguments[name][list(places)] if operation == "vector input" else arguments[name][places[0]]
        elif operation == "array":
            value = graph.arrays[data]  # type: ignore[index]
        elif operation == "entry":
            value = x[0][data]
        elif operation in ("sin", "cos"):
            value = getattr(np, operation)(x[0])
        elif operation in FUNCTIONS:
            value = evaluate_function(operation, x[0])
        elif operation in ("diagonal", "matrix"):
            constant = graph.arrays[data]  # type: ignore[index]
            value = (np.diag(constant) if operation == "diagonal" else constant) @ x[0]
        else:
            value = _ARITHMETIC[operation](x)
        values[number] = value
    return [values[number] for number in outputs]


def _times(factor: Any, vector: Any) -> Any:
    """Multiply a vector; an entry for each lane, if either has one, stays in the last axis."""
    return vector[:, None] * factor if np.ndim(factor) and np.ndim(vector) == 1 else factor * vector


_ARITHMETIC: dict[str, Any] = {
    "add": lambda x: x[0] + x[1],
    "subtract": lambda x: x[0] - x[1],
    "multiply": lambda x: x[0] * x[1],
    "negate": lambda x: -x[0],
    "invert": lambda x: 1.0 / x[0],
    "dot": lambda x: np.tensordot(x[0], x[1], (0, 0)),
    "combine": lambda x: sum(_times(factor, vector) for factor, vector in zip(x[::2], x[1::2], strict=True)),
}

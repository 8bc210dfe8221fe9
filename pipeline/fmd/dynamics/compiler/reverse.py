"""Reverse differentiation of a graph: how a weighted sum of its nodes changes with all inputs at once, as nodes too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmd.dynamics.compiler.differentiate import function_slope, power_slope
from fmd.dynamics.compiler.functions import FUNCTIONS
from fmd.dynamics.compiler.graph import Graph, Scalar, Terms, Vector, combine, total


def differentiate_sum(
    graph: Graph, outputs: Sequence[Scalar | Vector], weights: Sequence[Scalar | Vector]
) -> dict[int, Scalar | Vector]:
    """Return the derivatives of ``Σ weight · output`` at fixed weights by all inputs, by the numbers of these nodes.

    See Griewank & Walther, Evaluating Derivatives, 2nd ed., SIAM, 2008, chapter 4.
    """
    sums = _Sums(graph)
    for output, weight in zip(outputs, weights, strict=True):
        sums.add(output.node, weight)
    found: dict[int, Scalar | Vector] = {}
    for number in reversed(graph.live(output.node for output in outputs)):
        change, operation = sums.take(number), graph.nodes[number].operation
        if change is None or change.is_zero or operation in ("number", "array", "below", "piece", "pick", "floor"):
            continue
        if operation in ("input", "vector input"):
            found[number] = change
        elif isinstance(change, Scalar):
            _pass_scalar(graph, number, change, sums)
        else:
            _pass_vector(graph, number, change, sums)
    return found


class _Sums:
    """Terms of the derivatives by nodes, which are complete when all that takes a node has passed its own on."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        self._scalars: dict[int, list[Scalar]] = {}
        self._vectors: dict[int, Terms] = {}

    def add(self, number: int, term: Scalar | Vector, factor: Scalar | float = 1.0) -> None:
        """Add a term, of a vector with a factor."""
        if isinstance(term, Scalar):
            self._scalars.setdefault(number, []).append(term)
        else:
            self._vectors.setdefault(number, []).append((factor, term))

    def take(self, number: int) -> Scalar | Vector | None:
        """Return the sum of a node's terms; none if there are none."""
        if number in self._scalars:
            return total(self._scalars.pop(number))
        return combine(self._vectors.pop(number)) if number in self._vectors else None


def _pass_scalar(graph: Graph, number: int, change: Scalar, sums: _Sums) -> None:
    """Add what a scalar's arguments get of the derivative by it."""
    operation, arguments, data, _ = graph.nodes[number]
    values, zero = [graph.value_of(k) for k in arguments], graph.number(0.0)
    if operation == "entry":
        assert isinstance(data, int)
        sums.add(arguments[0], graph.array(np.eye(1, graph.nodes[arguments[0]].size, data)[0]), change)
        return
    if operation == "dot":
        sums.add(arguments[0], values[1], change)
        sums.add(arguments[1], values[0], change)
        return
    s, *rest = (value for value in values if isinstance(value, Scalar))
    if operation in ("add", "subtract"):
        parts = [change, change if operation == "add" else -change]
    elif operation == "multiply":
        parts = [change * rest[0], change * s]
    elif operation == "negate":
        parts = [-change]
    elif operation == "invert":
        inverse = Scalar(graph, number)
        parts = [-(change * (inverse * inverse))]
    elif operation == "select":
        parts = [zero, s.select(change, zero), s.select(zero, change)]
    elif operation == "power":
        own = Scalar(graph, number)
        parts = [power_slope(own, s, rest[0], *both) for both in ((change, zero), (zero, change))]
    elif operation == "moving":
        parts = [rest[0].moving(change), change.moving(s)]
    else:
        assert operation in FUNCTIONS
        slope = function_slope(operation, s)
        parts = [change.moving(slope) if operation == "log" else change * slope]
    for argument, part in zip(arguments, parts, strict=True):
        sums.add(argument, part)


def _pass_vector(graph: Graph, number: int, change: Vector, sums: _Sums) -> None:
    """Add what a vector's arguments get of the derivative by it."""
    operation, arguments, data, _ = graph.nodes[number]
    if operation in ("diagonal", "matrix"):
        assert isinstance(data, int)
        constant = graph.arrays[data]
        sums.add(arguments[0], change.multiplied_by(np.diag(constant) if operation == "diagonal" else constant.T))
        return
    assert operation == "combine"
    for k in range(0, len(arguments), 2):
        factor, vector = graph.value_of(arguments[k]), graph.value_of(arguments[k + 1])
        assert isinstance(factor, Scalar) and isinstance(vector, Vector)  # noqa: PT018 - for the types
        if factor.constant is None:
            sums.add(arguments[k], vector.dot(change))
        sums.add(arguments[k + 1], change, factor)

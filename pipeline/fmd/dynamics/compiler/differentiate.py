"""Forward differentiation of a graph: derivatives of its nodes along a direction are nodes of it too."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fmd.dynamics.compiler.functions import ARC, FUNCTIONS, LAST_STUMPFF, STUMPFF
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine


def differentiate(
    graph: Graph, outputs: Sequence[Scalar | Vector], seeds: Mapping[int, Scalar | Vector]
) -> list[Scalar | Vector]:
    """Return the derivatives of outputs along a direction: derivatives of inputs, by the numbers of their nodes.

    Other inputs don't change. A direction of constants folds away what they leave out, one of inputs serves every
    direction (Griewank & Walther, Evaluating Derivatives, 2nd ed., SIAM, 2008, chapter 3).
    """
    slopes: dict[int, Scalar | Vector] = {}
    for number in graph.live_by_marks(output.node for output in outputs):
        node = graph.nodes[number]
        changes = any(not slopes[k].is_zero for k in node.arguments)
        if number in seeds:
            slopes[number] = seeds[number]
        elif not changes:
            is_scalar = isinstance(graph.value_of(number), Scalar)
            slopes[number] = graph.number(0.0) if is_scalar else graph.zeros(node.size)
        elif isinstance(graph.value_of(number), Scalar):
            slopes[number] = _scalar_slope(graph, number, slopes)
        else:
            slopes[number] = _vector_slope(graph, number, slopes)
    return [slopes[output.node] for output in outputs]


def _scalar_slope(graph: Graph, number: int, slopes: Mapping[int, Scalar | Vector]) -> Scalar:
    operation, arguments, data, _ = graph.nodes[number]
    values, changes = [graph.value_of(k) for k in arguments], [slopes[k] for k in arguments]
    if operation == "entry":
        (change,) = changes
        assert isinstance(change, Vector)
        assert isinstance(data, int)
        return change.entry(data)
    if operation == "dot":
        (x, y), (dx, dy) = values, changes
        assert isinstance(x, Vector) and isinstance(y, Vector)  # noqa: PT018 - for the types
        assert isinstance(dx, Vector) and isinstance(dy, Vector)  # noqa: PT018
        return dx.dot(y) + x.dot(dy)
    if operation in ("below", "piece", "pick", "floor"):
        return graph.number(0.0)
    s, *rest = (value for value in values if isinstance(value, Scalar))
    ds, *d_rest = (change for change in changes if isinstance(change, Scalar))
    if operation == "add":
        return ds + d_rest[0]
    if operation == "subtract":
        return ds - d_rest[0]
    if operation == "multiply":
        return ds * rest[0] + s * d_rest[0]
    if operation == "negate":
        return -ds
    if operation == "invert":
        inverse = Scalar(graph, number)
        return -(ds * (inverse * inverse))
    if operation == "select":
        return s.select(*d_rest)
    if operation == "power":
        return power_slope(Scalar(graph, number), s, rest[0], ds, d_rest[0])
    if operation == "moving":
        return rest[0].moving(ds) + d_rest[0].moving(s)
    slope = function_slope(operation, s)
    return ds.moving(slope) if operation == "log" else ds * slope


def power_slope(value: Scalar, x: Scalar, exponent: Scalar, dx: Scalar, d_exponent: Scalar) -> Scalar:
    """Return the derivative of a power; a constant exponent needs no logarithm, so that x may be 0 or negative."""
    slope = exponent * x.power(exponent - 1.0)
    if exponent.constant is None:
        slope = (exponent * exponent).select(slope, x.graph.number(0.0))  # of x to the 0, even at 0
    return dx.moving(slope) + d_exponent.moving(value * x.apply("log"))


def function_slope(function: str, x: Scalar) -> Scalar:
    """Return the derivative of one of `FUNCTIONS` at a scalar.

    Raises
    ------
    ValueError
        It is the last of a family whose derivatives are functions of their own.
    """
    value = x.apply(function)
    simple: dict[str, Callable[[], Scalar]] = {
        "sin": lambda: x.apply("cos"),
        "cos": lambda: -x.apply("sin"),
        "sqrt": lambda: 0.5 * value.inverse(),
        "exp": lambda: value,
        "log": x.inverse,
        "tanh": lambda: 1.0 - value * value,
        "positive": lambda: x.apply("step"),
        "step": lambda: x.graph.number(0.0),
        "far_sin": lambda: x.apply("far_cos"),
        "far_cos": lambda: -x.apply("far_sin"),
    }
    if function in simple:
        return simple[function]()
    if function in ARC[:-1]:
        return x.apply(f"arc{int(function.removeprefix('arc')) + 1}")
    k = int(function.removeprefix("stumpff")) if function in STUMPFF else LAST_STUMPFF
    if k + 2 > LAST_STUMPFF:
        raise ValueError(f"{function} has no derivative among {', '.join(FUNCTIONS)}")
    return (x.apply(f"stumpff{k + 2}") * k - x.apply(f"stumpff{k + 1}")) * 0.5


def _vector_slope(graph: Graph, number: int, slopes: Mapping[int, Scalar | Vector]) -> Vector:
    operation, arguments, data, _ = graph.nodes[number]
    values, changes = [graph.value_of(k) for k in arguments], [slopes[k] for k in arguments]
    if operation in ("diagonal", "matrix"):
        (change,) = changes
        assert isinstance(change, Vector)
        assert isinstance(data, int)
        constant = graph.arrays[data]
        return change.multiplied_by(np.diag(constant) if operation == "diagonal" else constant)
    terms: list[tuple[Scalar | float, Vector]] = []
    for k in range(0, len(arguments), 2):
        factor, vector, d_factor, d_vector = values[k], values[k + 1], changes[k], changes[k + 1]
        assert isinstance(factor, Scalar) and isinstance(vector, Vector)  # noqa: PT018
        assert isinstance(d_factor, Scalar) and isinstance(d_vector, Vector)  # noqa: PT018
        terms += [(d_factor, vector), (factor, d_vector)]
    return combine(terms)

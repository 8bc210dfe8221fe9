"""Reverse differentiation of a graph, and so of weighted sums of accelerations and of constraints."""

from collections.abc import Mapping, Sequence

import numpy as np

from fmd.dynamics.compiler.coordinates import Coordinates, RestingCoordinates
from fmd.dynamics.compiler.differentiate import differentiate, function_slope, power_slope
from fmd.dynamics.compiler.forces import ActingForces, GivenForces
from fmd.dynamics.compiler.frames import MovingFrame, trace_frames
from fmd.dynamics.compiler.functions import FUNCTIONS
from fmd.dynamics.compiler.graph import Graph, Scalar, Terms, Vector, combine, total
from fmd.dynamics.compiler.program import Output
from fmd.dynamics.compiler.recursion import BodyValues, trace_accelerations
from fmd.dynamics.compiler.residual import trace_residual
from fmd.dynamics.compiler.tangents import direction_inputs, flatten


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


def trace_acceleration_adjoint(
    inputs: Coordinates, frames: list[MovingFrame], acting: ActingForces
) -> tuple[list[BodyValues], list[Output]]:
    """Trace derivatives of ``weights · a`` of the accelerations, and ``x = M̂⁻¹ weights``.

    They are those of ``−x · r`` of the residual at fixed accelerations.
    """
    resting = RestingCoordinates(inputs.graph, inputs.mechanism)
    forces = GivenForces(resting, "weights", range(inputs.mechanism.n))
    x = trace_accelerations(trace_frames(resting), forces)
    residual = flatten(trace_residual(inputs, frames, acting))
    return x, _trace_adjoint(inputs, residual, [-weight for weight in flatten(x)], ("inputs", "q", "v"))


def trace_slope_adjoint(inputs: Coordinates, frames: list[MovingFrame], of: Sequence[str]) -> list[Output]:
    """Trace derivatives of ``x · r'[along]``, the weighted slope of its fast rows, by state and direction."""
    graph, rows = inputs.graph, range(len(frames))
    residual = flatten(trace_residual(inputs, frames))
    weights = flatten([BodyValues(inputs.inputs_of_joint(k, "x"), inputs.inputs_of_modes(k, "x")) for k in rows])
    fast = [k for k, weight in enumerate(weights) if _last_place(weight) >= inputs.mechanism.n_slow]
    along = direction_inputs(graph, tuple(of[: len(of) // 2]), "along_")
    slopes = differentiate(graph, [residual[k] for k in fast], along)
    return _trace_adjoint(inputs, slopes, [weights[k] for k in fast], of)


def _last_place(weight: Scalar | Vector) -> int:
    """Return the last place of an input in its argument, -1 of an empty vector."""
    data = weight.graph.nodes[weight.node].data
    return max(data[1]) if isinstance(data, tuple) else -1


def trace_rows_adjoint(inputs: Coordinates, values: Mapping[str, Sequence[Scalar]], of: Sequence[str]) -> list[Output]:
    """Trace derivatives of sums of constraints' values, whose weights are arguments of their names."""
    pairs = [(value, inputs.graph.scalar_input(name, k)) for name, own in values.items() for k, value in enumerate(own)]
    return _trace_adjoint(inputs, [value for value, _ in pairs], [weight for _, weight in pairs], of)


def _trace_adjoint(
    inputs: Coordinates, values: Sequence[Scalar | Vector], weights: Sequence[Scalar | Vector], of: Sequence[str]
) -> list[Output]:
    """Trace derivatives of a weighted sum by all inputs of some arguments, 0 by those that it hasn't."""
    graph, mechanism, outputs = inputs.graph, inputs.mechanism, list[Output]()
    sizes = {"inputs": 3 * len(inputs.signals) + len(inputs.numbers), "q": mechanism.n_positions}
    left = {name: dict.fromkeys(range(sizes.get(name.removeprefix("along_"), mechanism.n))) for name in of}
    for number, value in differentiate_sum(graph, values, weights).items():
        name, places = graph.nodes[number].data  # type: ignore[misc]
        if name in of:
            outputs.append(Output(value, (f"{name}_adjoint", places)))
            for place in places:
                del left[name][place]
    zero = graph.number(0.0)
    return outputs + [Output(zero, (f"{name}_adjoint", (place,))) for name in of for place in left[name]]

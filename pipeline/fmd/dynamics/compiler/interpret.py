"""The NumPy printer of a graph: node by node at one state, or at many states at once.

Nothing is compiled, so that a mechanism whose march needs few kernels reports its motion without any more, and code
that is compiled has a reference.
"""

import operator
from collections.abc import Callable, Mapping, Sequence
from functools import partial, reduce
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.memory import STATES_AT_ONCE
from fmd.dynamics.compiler.functions import CHOICES, FUNCTIONS, evaluate_function
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector
from fmd.dynamics.compiler.oscillators import OSCILLATED, step_oscillators


class Evaluation:
    """Nodes of a graph as a function of arrays, in steps that are found once for many calls."""

    def __init__(self, graph: Graph, outputs: Sequence[int]) -> None:
        live, kept = graph.live(outputs), {*outputs}
        place = {number: k for k, number in enumerate(live)}
        last = {argument: number for number in live for argument in graph.nodes[number].arguments}
        dropped: dict[int, list[int]] = {}
        for argument, number in last.items():
            if argument not in kept:
                dropped.setdefault(number, []).append(place[argument])
        self._outputs = [place[number] for number in outputs]
        nodes = [graph.nodes[number] for number in outputs]
        self._shapes = [(node.size,) if node.size or node.operation == "array" else () for node in nodes]
        self._constants: list[Any] = [None] * len(live)
        self._steps = []
        for k, number in enumerate(live):
            operation, taken, data, _ = graph.nodes[number]
            if operation in ("number", "array"):
                self._constants[k] = data if operation == "number" else graph.arrays[data][:, None]  # type: ignore[index]
                continue
            places = [-1] * (operation in ("input", "vector input", *OSCILLATED)) + [place[each] for each in taken]
            self._steps.append((k, _step(graph, number), places, dropped.get(number, ())))

    def __call__(self, arguments: Mapping[str, Array]) -> list[Any]:
        """Return the values: (n_states,) of scalars and (size, n_states) of vectors, with 1 for what never changes.

        Inputs read arguments (n_places, n_states). Complex entries are carried through, for derivatives by a complex
        step, by sine and cosine alone of all functions.
        """
        values: list[Any] = [*self._constants, arguments]  # the last is what inputs take
        with np.errstate(all="ignore"):  # what has no value is not a number
            for place, step, taken, dropped in self._steps:
                values[place] = step(*[values[k] for k in taken])
                for k in dropped:
                    values[k] = None
        return [values[k] for k in self._outputs]

    def at(self, arguments: Mapping[str, Array]) -> list[Any]:
        """Return the values at one state, or with an entry for each lane in a last axis, as its arguments have."""
        given = {name: np.asarray(entries) for name, entries in arguments.items()}
        lanes = {entries.shape[1] for entries in given.values() if entries.ndim == 2}
        whole = {name: entries if entries.ndim == 2 else entries[:, None] for name, entries in given.items()}
        pairs = zip(self._shapes, self(whole), strict=True)
        if not lanes:
            return [np.reshape(value, shape) for shape, value in pairs]
        return [np.broadcast_to(value, (*shape, *lanes)) for shape, value in pairs]

    def over(self, arguments: Mapping[str, Array], n_states: int) -> Array:
        """Return the values of scalars at many states, shape (n_states, n_outputs)."""
        out = np.empty((n_states, len(self._outputs)))
        for first in range(0, n_states, STATES_AT_ONCE):
            some = slice(first, first + STATES_AT_ONCE)
            values = self({name: entries[:, some] for name, entries in arguments.items()})
            for k, value in enumerate(values):
                out[some, k] = value
        return out


def evaluation_of(values: Sequence[Scalar | Vector]) -> Evaluation:
    """Return the evaluation of traced values, one at least, of one graph."""
    return Evaluation(values[0].graph, [value.node for value in values])


def _step(graph: Graph, number: int) -> Callable[..., Any]:
    """Return the function of the values that a node takes."""
    operation, _, data, _ = graph.nodes[number]
    if operation in ("input", "vector input"):
        name, places = data  # type: ignore[misc]
        at = places[0] if operation == "input" else list(places)
        return lambda arguments: arguments[name][at]
    if operation == "entry":
        return operator.itemgetter(data)
    if operation == "diagonal":
        return partial(operator.mul, graph.arrays[data][:, None])  # type: ignore[index]
    if operation == "matrix":
        return partial(operator.matmul, graph.arrays[data])  # type: ignore[index]
    if operation in OSCILLATED:
        return partial(step_oscillators, operation, data)  # type: ignore[arg-type]
    if operation == "piece":
        knots = graph.arrays[data]  # type: ignore[index]
        return lambda x: np.maximum(np.searchsorted(knots, x, side="right") - 1, 0)
    if operation == "pick":
        return graph.arrays[data].__getitem__  # type: ignore[index]
    return partial(evaluate_function, operation) if operation in FUNCTIONS else _SEVERAL[operation]


def _dot(x: Array, y: Array) -> Array:
    if x.shape[1] == 1:
        return np.asarray(x[:, 0] @ y)
    return np.asarray(y[:, 0] @ x if y.shape[1] == 1 else np.einsum("nt,nt->t", x, y))


def _combine(*terms: Any) -> Any:
    pairs = zip(terms[::2], terms[1::2], strict=True)
    products = (vector if isinstance(factor, float) and factor == 1.0 else factor * vector for factor, vector in pairs)
    return reduce(operator.add, products)


_SEVERAL: dict[str, Callable[..., Any]] = {
    **CHOICES,
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "negate": operator.neg,
    "invert": lambda x: 1.0 / x,
    "dot": _dot,
    "products": operator.mul,
    "combine": _combine,
}

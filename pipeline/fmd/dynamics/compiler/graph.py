"""Expression graphs of scalars and modal vectors, simplified while they are built.

Equal expressions share one node (hash-consing), constants are folded, and terms that are zero or factors that are one
never become nodes. So an algorithm written for the general case, run once on `Scalar` and `Vector` in place of numbers,
leaves only the arithmetic that a mechanism needs: what is zero for a plane mechanism is never computed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from fmd.core.arrays import Array
from fmd.dynamics.compiler.functions import CHOICES, evaluate_function
from fmd.dynamics.compiler.nodes import NodeTable


class Graph(NodeTable):
    """A graph under construction: makes the scalars and vectors that an algorithm computes with."""

    def __init__(self) -> None:
        super().__init__()
        self._constants: dict[float, Scalar] = {}

    def number(self, value: float) -> Scalar:
        """Make a constant scalar."""
        known = self._constants.get(value)
        if known is None:
            value = float(value) + 0.0  # no negative zero
            known = self._constants[value] = Scalar(self, self.add("number", data=value))
        return known

    def array(self, values: Array | Sequence[float]) -> Vector:
        """Make a constant vector."""
        values = np.asarray(values, dtype=float)
        return Vector(self, self.add("array", data=self.add_array(values), size=values.size), values.size)

    def zeros(self, size: int) -> Vector:
        """Make a vector of zeros."""
        return self.array(np.zeros(size))

    def scalar_input(self, argument: str, place: int) -> Scalar:
        """Make a scalar that is read from an argument."""
        return Scalar(self, self.add("input", data=(argument, (int(place),))))

    def vector_input(self, argument: str, places: Iterable[int]) -> Vector:
        """Make a vector that is read from places of an argument."""
        at = tuple(int(place) for place in places)
        if not at:
            return self.zeros(0)
        return Vector(self, self.add("vector input", data=(argument, at), size=len(at)), len(at))

    def value_of(self, node: int) -> Scalar | Vector:
        """Return the scalar or vector of a node."""
        size, operation = self.nodes[node].size, self.nodes[node].operation
        return Vector(self, node, size) if size or operation == "array" else Scalar(self, node)


class Scalar:
    """A scalar expression; operators simplify what they build."""

    __slots__ = ("constant", "graph", "node", "operation")

    def __init__(self, graph: Graph, node: int) -> None:
        self.graph, self.node = graph, node
        self.operation, _, data, _ = graph.nodes[node]
        self.constant: float | None = data if self.operation == "number" else None  # type: ignore[assignment]

    @property
    def is_zero(self) -> bool:
        """True for the number 0."""
        return self.constant == 0.0

    def _other(self, value: Scalar | float) -> Scalar:
        return value if isinstance(value, Scalar) else self.graph.number(value)

    def _make(self, operation: str, *arguments: Scalar) -> Scalar:
        return Scalar(self.graph, self.graph.add(operation, tuple([x.node for x in arguments])))

    def _make_of_pair(self, operation: str, other: Scalar) -> Scalar:
        """Make the result of a function of two scalars whose order doesn't matter."""
        a, b = self.node, other.node
        return Scalar(self.graph, self.graph.add(operation, (a, b) if a < b else (b, a)))

    @property
    def _argument(self) -> Scalar:
        """The argument of this, which is the result of a function of one scalar."""
        return Scalar(self.graph, self.graph.nodes[self.node].arguments[0])

    def __add__(self, value: Scalar | float) -> Scalar:
        other = self._other(value)
        a, b = self.constant, other.constant
        if a is not None and b is not None:
            return self.graph.number(a + b)
        if a == 0.0:
            return other
        if b == 0.0:
            return self
        if other.operation == "negate":
            return self - other._argument
        if self.operation == "negate":
            return other - self._argument
        return self._make_of_pair("add", other)

    def __radd__(self, value: float) -> Scalar:
        return self + value

    def __neg__(self) -> Scalar:
        if (value := self.constant) is not None:
            return self.graph.number(-value)
        if self.operation == "negate":
            return self._argument
        if self.operation == "subtract":
            return Scalar(self.graph, self.graph.add("subtract", self.graph.nodes[self.node].arguments[::-1]))
        return self._make("negate", self)

    def __sub__(self, value: Scalar | float) -> Scalar:
        other = self._other(value)
        a, b = self.constant, other.constant
        if a is not None and b is not None:
            return self.graph.number(a - b)
        if a == 0.0:
            return -other
        if b == 0.0:
            return self
        if self.node == other.node:
            return self.graph.number(0.0)
        if other.operation == "negate":
            return self + other._argument
        return self._make("subtract", self, other)

    def __rsub__(self, value: float) -> Scalar:
        return self._other(value) - self

    def __mul__(self, value: Scalar | float) -> Scalar:
        other = self._other(value)
        a, b = self.constant, other.constant
        if a is not None and b is not None:
            return self.graph.number(a * b)
        if a is not None or b is not None:
            factor, rest = (b, self) if a is None else (a, other)
            if factor == 0.0:
                return self.graph.number(0.0)
            if factor == 1.0:
                return rest
            if factor == -1.0:
                return -rest
        inner, outer = self.operation == "negate", other.operation == "negate"
        if inner or outer:
            product = (self._argument if inner else self) * (other._argument if outer else other)
            return product if inner and outer else -product
        for x, y in ((self, other), (other, self)):
            if x.operation == "invert" and x._argument.node == y.node:
                return self.graph.number(1.0)
        return self._make_of_pair("multiply", other)

    def __rmul__(self, value: float) -> Scalar:
        return self * value

    def inverse(self) -> Scalar:
        """Return 1 over it."""
        if (value := self.constant) is not None:
            return self.graph.number(1.0 / value if value else math.nan)
        return self._make("invert", self)

    def apply(self, function: str) -> Scalar:
        """Return one of `FUNCTIONS` of it."""
        if (value := self.constant) is not None:
            return self.graph.number(float(evaluate_function(function, value)))
        return self._make(function, self)

    def power(self, exponent: Scalar | float) -> Scalar:
        """Return its power."""
        other = self._other(exponent)
        if other.constant in (0.0, 1.0):
            return self if other.constant else self.graph.number(1.0)
        return self._choose("power", self, other)

    def below(self, other: Scalar) -> Scalar:
        """Return 1 where it is below another or no number, else 0."""
        return self._choose("below", self, other)

    def select(self, above: Scalar, other: Scalar) -> Scalar:
        """Return one scalar where it is above 0, else another."""
        if above.node == other.node:
            return above
        if (value := self.constant) is not None:
            return above if value > 0.0 else other
        return self._make("select", self, above, other)

    def moving(self, slope: Scalar) -> Scalar:
        """Return a slope times it, as a rate: 0 where it is 0, whatever the slope."""
        return slope * self if self.constant is not None else self._choose("moving", slope, self)

    def _choose(self, function: str, *arguments: Scalar) -> Scalar:
        values = [x.constant for x in arguments]
        if None not in values:
            with np.errstate(all="ignore"):
                return self.graph.number(float(CHOICES[function](*values)))
        return self._make(function, *arguments)

    def piece(self, knots: Array) -> Scalar:
        """Return the number of the last of ascending knots (n,) that it isn't below, or 0."""
        return Scalar(self.graph, self.graph.add("piece", (self.node,), self.graph.add_array(knots)))

    def pick(self, values: Array) -> Scalar:
        """Return one of some values (n,), of which it is the number."""
        if not (values - values[0]).any():
            return self.graph.number(float(values[0]))
        return Scalar(self.graph, self.graph.add("pick", (self.node,), self.graph.add_array(values)))


class Vector:
    """A modal vector expression; operators simplify what they build."""

    __slots__ = ("graph", "node", "size")

    def __init__(self, graph: Graph, node: int, size: int) -> None:
        self.graph, self.node, self.size = graph, node, size

    @property
    def constant(self) -> Array | None:
        """Values of a constant vector, else ``None``."""
        node = self.graph.nodes[self.node]
        return self.graph.arrays[node.data] if node.operation == "array" else None  # type: ignore[index]

    @property
    def is_zero(self) -> bool:
        """True if all entries are the number 0."""
        values = self.constant
        return values is not None and not values.any()

    def _factored(self) -> tuple[Scalar, Vector]:
        """Factor and vector of a product with a scalar; 1 and the vector itself if it is none."""
        node = self.graph.nodes[self.node]
        if node.operation == "combine" and len(node.arguments) == 2:
            factor, rest = node.arguments
            return Scalar(self.graph, factor), Vector(self.graph, rest, self.size)
        return self.graph.number(1.0), self

    def __add__(self, other: Vector) -> Vector:
        return combine([(1.0, self), (1.0, other)])

    def __sub__(self, other: Vector) -> Vector:
        return combine([(1.0, self), (-1.0, other)])

    def __neg__(self) -> Vector:
        return combine([(-1.0, self)])

    def __mul__(self, factor: Scalar | float) -> Vector:
        return combine([(factor, self)])

    __rmul__ = __mul__

    def dot(self, other: Vector) -> Scalar:
        """Return the scalar product with a vector of this size."""
        if self.is_zero or other.is_zero:
            return self.graph.number(0.0)
        (s, a), (t, b) = self._factored(), other._factored()
        x, y = a.constant, b.constant
        if x is not None and y is not None:
            return s * t * float(x @ y)
        for known, rest in ((x, b), (y, a)):
            if known is not None and np.count_nonzero(known) == 1:
                place = int(np.flatnonzero(known)[0])
                return s * t * float(known[place]) * rest.entry(place)
        product = self.graph.add("dot", (min(a.node, b.node), max(a.node, b.node)))
        return s * t * Scalar(self.graph, product)

    def times(self, other: Vector) -> Vector:
        """Return the products of its entries with those of a vector of this size."""
        arguments = (min(self.node, other.node), max(self.node, other.node))
        return Vector(self.graph, self.graph.add("products", arguments, size=self.size), self.size)

    def entry(self, place: int) -> Scalar:
        """Return one of its entries."""
        values = self.constant
        if values is not None:
            return self.graph.number(float(values[place]))
        factor, vector = self._factored()
        return factor * Scalar(self.graph, self.graph.add("entry", (vector.node,), place))

    def multiplied_by(self, matrix: Array) -> Vector:
        """Return a constant matrix, shape (any, size), times it."""
        matrix = np.asarray(matrix, dtype=float)
        if self.is_zero or not matrix.any():
            return self.graph.zeros(len(matrix))
        factor, vector = self._factored()
        if (values := vector.constant) is not None:
            return self.graph.array(matrix @ values) * factor
        diagonal = matrix.diagonal()
        if len(matrix) == self.size and not (matrix - np.diag(diagonal)).any():
            if not (diagonal - diagonal[0]).any():
                return vector * (factor * float(diagonal[0]))
            operation, data = "diagonal", diagonal
        else:
            operation, data = "matrix", matrix
        product = self.graph.add(operation, (vector.node,), self.graph.add_array(data), len(matrix))
        return Vector(self.graph, product, len(matrix)) * factor


Terms = list[tuple[Scalar | float, Vector]]
"""Scalars and vectors whose products add up to a modal vector."""


def combine(terms: Sequence[tuple[Scalar | float, Vector]]) -> Vector:
    """Return the sum of scalars times vectors of one size.

    Constant vectors with constant factors become one, and factors of a vector that occurs twice are added up; sums that
    are terms stay whole, as others may use them too.
    """
    graph, size = terms[0][1].graph, terms[0][1].size
    constant, factors = np.zeros(size), dict[int, Scalar]()
    for factor, vector in terms:
        inner, rest = vector._factored()
        total = inner * factor
        values, number = rest.constant, total.constant
        if values is not None and number is not None:
            constant += number * values
        elif number != 0.0 and not rest.is_zero:
            factors[rest.node] = factors[rest.node] + total if rest.node in factors else total
    if constant.any():
        node = graph.array(constant).node
        factors[node] = factors.get(node, graph.number(0.0)) + 1.0
    left = [(factor, node) for node, factor in sorted(factors.items()) if not factor.is_zero]
    if not left:
        return graph.zeros(size)
    if len(left) == 1 and left[0][0].constant == 1.0:
        return Vector(graph, left[0][1], size)
    arguments = tuple(number for factor, node in left for number in (factor.node, node))
    return Vector(graph, graph.add("combine", arguments, size=size), size)


def total(terms: Iterable[Scalar]) -> Scalar:
    """Return the sum of one scalar or more."""
    first, *others = terms
    for term in others:
        first = first + term
    return first

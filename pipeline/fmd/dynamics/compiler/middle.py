"""Equations frozen at a major cycle's middle, for all coordinates: their coefficients, and a step with them.

With the accelerations X of unit forces, constant stiffness K and damping C, and accelerations a* and rates v* of the
middle,

    a = constant − A s − B v        A = X K        B = X C        constant = a* + B v*

for coordinates s from the middle. Matrices (n_blocks, n, 8) hold a column in ``[:, j]``, K and C in row j.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fmd.core.limits.code import COLUMNS_AT_ONCE
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from fmd.dynamics.compiler.program import LANES, Output


def trace_middle(inputs: Coordinates) -> list[Output]:
    """Trace ``A``, ``B`` and ``constant`` by ``K``, ``C``, ``X``, ``frozen`` and ``middle``."""
    graph, n, outputs = inputs.graph, inputs.mechanism.n, list[Output]()
    X, every, B = [_column(graph, "X", n, j) for j in range(n)], tuple(range(n)), list[Vector]()
    for name, factor in (("A", "K"), ("B", "C")):
        B = [_sum([(graph.scalar_input(factor, n * j + k), X[k]) for k in range(n)]) for j in range(n)]
        outputs += [Output(column, (name, _places(n, j))) for j, column in enumerate(B)]
    driven = _sum([(graph.scalar_input("middle", j), column) for j, column in enumerate(B)])
    constant = combine([(1.0, graph.vector_input("frozen", np.array(every))), (1.0, driven)])
    return [*outputs, Output(constant, ("constant", every))]


def trace_middle_step(inputs: Coordinates) -> list[Output]:
    """Trace the accelerations with the rates half a step later, and a leapfrog step.

    s are ``from_middle``, rates ``rate`` and accelerations ``last``; ``clock`` begins with the step.
    """
    graph, n = inputs.graph, inputs.mechanism.n
    every, h = np.arange(n), graph.scalar_input("clock", 0)
    s, v, a, constant = (graph.vector_input(name, every) for name in ("from_middle", "rate", "last", "constant"))
    middle = combine([(1.0, v), (h * 0.5, a)])
    by = [(x.entry(j), _column(graph, name, n, j)) for name, x in (("A", s), ("B", middle)) for j in range(n)]
    new = combine([(1.0, constant), (-1.0, _sum(by))])
    rate = combine([(1.0, v), (h, new)])
    position = combine([(1.0, s), (h, rate)])
    places = tuple(range(n))
    return [Output(value, (name, places)) for name, value in (("last", new), ("rate", rate), ("from_middle", position))]


def _sum(terms: Sequence[tuple[Scalar, Vector]]) -> Vector:
    """Sum vectors with factors in parts, which hide the latency of each other's ``fma``."""
    some = range(0, len(terms), COLUMNS_AT_ONCE)
    return combine([(1.0, combine([*terms[first : first + COLUMNS_AT_ONCE]])) for first in some])


def _column(graph: Graph, name: str, n: int, j: int) -> Vector:
    return graph.vector_input(name, np.array(_places(n, j)))


def _places(n: int, j: int) -> tuple[int, ...]:
    """Return the places of a column of a matrix in blocks of eight rows."""
    return tuple(i // LANES * LANES * n + LANES * j + i % LANES for i in range(n))

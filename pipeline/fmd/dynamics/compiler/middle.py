"""Equations frozen at a major cycle's middle, for all coordinates: their coefficients, and a step with them.

With the accelerations X of unit forces, constant stiffness K and damping C, and accelerations a* and rates v* of the
middle,

    a = constant − A s − B v        A = X K        B = X C        constant = a* + B v*

for coordinates s from the middle. Matrices (n_blocks, n, 8) hold a column in ``[:, j]``, K and C in row j. What is zero
in K and C is left out, by their pattern.
"""

from collections.abc import Sequence

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.code import COLUMNS_AT_ONCE
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine
from fmd.dynamics.compiler.program import LANES, Output


def find_pattern(K: Array, C: Array) -> int:
    """Return which entries of K and C (n, n) aren't zero, as binary digits, column by column; the last one is C's."""
    entries = "".join("1" if some else "0" for some in ((K != 0.0) | (C != 0.0)).T.flat)
    return int(entries + "01"[bool(C.any())], 2)


def _rows_of_columns(pattern: int, n: int) -> tuple[dict[int, list[int]], bool]:
    """Return the rows of each column that isn't zero in K and C, and whether C has any."""
    digits = f"{pattern:0{n * n + 1}b}"
    rows = {j: [k for k in range(n) if digits[n * j + k] == "1"] for j in range(n)}
    return {j: own for j, own in rows.items() if own}, digits[-1] == "1"


def trace_middle(inputs: Coordinates, pattern: int) -> list[Output]:
    """Trace ``A``, ``B`` and ``constant`` by ``K``, ``C``, ``X``, ``frozen`` and ``middle``."""
    graph, n, outputs = inputs.graph, inputs.mechanism.n, list[Output]()
    X, every, (rows, damped) = (
        [_column(graph, "X", n, j) for j in range(n)],
        tuple(range(n)),
        _rows_of_columns(pattern, n),
    )
    parts = [(1.0, graph.vector_input("frozen", np.array(every)))]
    for name, factor in (("A", "K"), ("B", "C"))[: 2 if damped else 1]:
        columns = {j: combine(_parts([(graph.scalar_input(factor, n * j + k), X[k]) for k in rows[j]])) for j in rows}
        outputs += [Output(column, (name, _places(n, j))) for j, column in columns.items()]
        if factor == "C":
            parts += _parts([(graph.scalar_input("middle", j), column) for j, column in columns.items()])
    return [*outputs, Output(combine(parts), ("constant", every))]


def trace_middle_step(inputs: Coordinates, pattern: int) -> list[Output]:
    """Trace the accelerations with the rates half a step later, and a leapfrog step.

    s are ``from_middle``, rates ``rate`` and accelerations ``last``; ``clock`` begins with the step.
    """
    graph, n = inputs.graph, inputs.mechanism.n
    rows, damped = _rows_of_columns(pattern, n)
    every, h = np.arange(n), graph.scalar_input("clock", 0)
    s, v, a, constant = (graph.vector_input(name, every) for name in ("from_middle", "rate", "last", "constant"))
    middle = combine([(1.0, v), (h * 0.5, a)])
    factors = (("A", s), ("B", middle))[: 2 if damped else 1]
    by = [(x.entry(j), _column(graph, name, n, j)) for name, x in factors for j in rows]
    new = combine([(1.0, constant), *((-1.0, part) for _, part in _parts(by))])
    rate = combine([(1.0, v), (h, new)])
    position = combine([(1.0, s), (h, rate)])
    places = tuple(range(n))
    return [Output(value, (name, places)) for name, value in (("last", new), ("rate", rate), ("from_middle", position))]


def _parts(terms: Sequence[tuple[Scalar, Vector]]) -> list[tuple[float, Vector]]:
    """Sum vectors with factors in parts, which hide the latency of each other's ``fma``."""
    some = range(0, len(terms), COLUMNS_AT_ONCE)
    return [(1.0, combine([*terms[first : first + COLUMNS_AT_ONCE]])) for first in some]


def _column(graph: Graph, name: str, n: int, j: int) -> Vector:
    return graph.vector_input(name, np.array(_places(n, j)))


def _places(n: int, j: int) -> tuple[int, ...]:
    """Return the places of a column of a matrix in blocks of eight rows."""
    return tuple(i // LANES * LANES * n + LANES * j + i % LANES for i in range(n))

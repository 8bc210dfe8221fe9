"""Rows along which a carrier's modes are eliminated: orthogonal, however little tells them apart."""

import numpy as np
import pytest

from pipeline.dynamics.compiler.graph import Graph, combine
from pipeline.dynamics.compiler.interpret import interpret
from pipeline.dynamics.compiler.span import ModalRows, span_rows

N = 12


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6, 1e-9])
def test_rows_that_deflections_hardly_tell_apart_are_orthogonal(size: float) -> None:
    """Orthogonal but for round-off beside what is left of them: accelerations had four digits at a micrometre."""
    rng = np.random.default_rng(2)
    shapes = np.tile(rng.normal(size=(1, N)), (3, 1))
    forms = rng.normal(size=(3, N, N))
    graph = Graph()
    q = graph.vector_input("q", range(N))
    values = [
        combine([(1.0, graph.array(shape)), (1.0, q.multiplied_by(form))])
        for shape, form in zip(shapes, forms, strict=True)
    ]
    span = span_rows(graph, [ModalRows(shapes, forms, values)], np.ones(N))
    assert len(span.Q) == 3
    numbers = [row.node for row in span.Q] + [entry.node for row in span.L[0] for entry in row]
    state = size * rng.normal(size=N)
    found = interpret(graph, numbers, {"q": state})
    Q, L = np.array(found[:3]), np.array(found[3:], dtype=float).reshape(3, 3)
    sizes = np.linalg.norm(Q, axis=1)
    assert np.abs(Q @ Q.T / np.outer(sizes, sizes) - np.eye(3)).max() < 1e-13
    np.testing.assert_allclose(L @ Q, shapes + forms @ state, atol=1e-13)

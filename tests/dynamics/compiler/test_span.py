"""Rows along which a carrier's modes are eliminated: orthogonal, however little tells them apart."""

import numpy as np
import pytest

from pipeline.dynamics.compiler.graph import Graph, combine
from pipeline.dynamics.compiler.interpret import interpret
from pipeline.dynamics.compiler.span import ModalRows, span_rows

N = 12


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6])
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


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6, 1e-9])
def test_a_second_body_at_the_same_marker_leaves_accelerations_their_digits(size: float) -> None:
    """Its rows lie among the first one's: the inverse square of their round-off left accelerations two digits."""
    rng = np.random.default_rng(4)
    n, m = 40, 6
    shapes, forms = rng.normal(size=(m, n)), rng.normal(size=(m, n, n))
    graph = Graph()
    q = graph.vector_input("q", range(n))
    values = [
        combine([(1.0, graph.array(shape)), (1.0, q.multiplied_by(form))])
        for shape, form in zip(shapes, forms, strict=True)
    ]
    span = span_rows(graph, [ModalRows(shapes, forms, values), ModalRows(shapes, forms, values)], np.ones(n))
    k = len(span.Q)
    numbers = [x.node for x in (*span.Q, *span.inverse_squares)]
    numbers += [entry.node for group in span.L for row in group for entry in row]
    state = size * rng.normal(size=n)
    found = interpret(graph, numbers, {"q": state})
    Q, inverses = np.array(found[:k]), np.array(found[k : 2 * k], dtype=float)
    L = np.array(found[2 * k :], dtype=float).reshape(2, m, k)
    roots = rng.normal(size=(2, m, m))
    inertias, e = roots @ roots.transpose(0, 2, 1), rng.normal(size=n)
    # As in `recursion`: F ζ = −P⁻¹ Q e, then the modes along Q; against the modal mass as a whole.
    F = np.diag(inverses) + np.einsum("cik,cij,cjl->kl", L, inertias, L)
    zeta = -np.linalg.solve(F, inverses * (Q @ e))
    eta = -e + Q.T @ (inverses * (zeta + Q @ e))
    rows = shapes + forms @ state
    exact = -np.linalg.solve(np.eye(n) + rows.T @ inertias.sum(axis=0) @ rows, e)
    np.testing.assert_allclose(eta, exact, rtol=0, atol=1e-10)

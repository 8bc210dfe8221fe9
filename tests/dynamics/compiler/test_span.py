"""Rows along which a carrier's modes are eliminated: orthogonal, however little tells them apart."""

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve

from fmd.core.arrays import Array
from fmd.dynamics.compiler.graph import Graph, combine
from fmd.dynamics.compiler.span import ModalRows, span_rows
from tests.dynamics.compiler.comparison import interpret

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
    shapes, forms = rng.normal(size=(6, 40)), rng.normal(size=(6, 40, 40))
    assert lost_digits([(shapes, forms), (shapes, forms)], size * rng.normal(size=40), rng) < 1e-10


@pytest.mark.parametrize("size", [0.0, *10.0 ** -np.arange(0.0, 17.0, 0.5)])
def test_rows_that_lie_among_others_without_deflection_leave_accelerations_their_digits(size: float) -> None:
    """The section's slope at a bar's end goes with its deflection in the first mode: 1e-11 of it is left in a motion.

    What counted half as round-off left a row that wasn't orthogonal to it, and accelerations without any digit.
    """
    rng = np.random.default_rng(5)
    shapes, forms = rng.normal(size=(6, 40)), rng.normal(size=(6, 40, 40))
    shapes[2], shapes[4] = 2.0 * shapes[0], 0.0
    assert lost_digits([(shapes, forms)], size * rng.normal(size=40), rng) < 1e-10


@pytest.mark.parametrize("seed", range(40))
def test_rows_of_which_hardly_anything_is_left_leave_accelerations_their_digits(seed: int) -> None:
    """A threshold, which what is left of a row passes as a bar bends, gave its direction a part of the modal mass.

    Of these 40 seven had few digits or none; an arm's accelerations had a pole.
    """
    rng = np.random.default_rng([seed, 1])
    shapes, forms = rng.normal(size=(6, 40)), rng.normal(size=(6, 40, 40))
    left, (one, other, last) = 10 ** rng.uniform(-16, -6, 2), rng.permutation([1, 2, 3, 4, 5])[:3]
    A, B = rng.normal(size=(2, 40, 40))
    shapes[one], forms[one] = 2.0 * shapes[0], 2.0 * forms[0] + left[0] * A
    shapes[other], forms[other] = 3.0 * shapes[0], 3.0 * forms[0] + left[1] * (A + B) + left[0] * B
    shapes[last] = 1.5 * shapes[0]
    size = rng.choice([1.0, 0.1, 1e-3])
    assert lost_digits([(shapes, forms)], size * rng.normal(size=40), rng) < 1e-10


def lost_digits(groups: list[tuple[Array, Array]], state: Array, rng: np.random.Generator) -> float:
    """Return the largest error of accelerations and of markers' motions by eliminating modes, as `recursion` does it.

    Each group has rows ``shapes + forms q`` and carries some inertia.
    """
    graph, n = Graph(), len(state)
    q = graph.vector_input("q", range(n))
    traced = [
        ModalRows(shapes, forms, [graph.array(s) + q.multiplied_by(F) for s, F in zip(shapes, forms, strict=True)])
        for shapes, forms in groups
    ]
    span = span_rows(graph, traced, np.ones(n))
    k = len(span.Q)
    numbers = [x.node for x in (*span.Q, *span.inverse_squares)]
    numbers += [entry.node for group in span.L for row in group for entry in row]
    found = interpret(graph, numbers, {"q": state})
    Q, inverses = np.array(found[:k]), np.array(found[k : 2 * k], dtype=float)
    L = np.array(found[2 * k :], dtype=float).reshape(len(groups), -1, k)
    roots = rng.normal(size=(*L.shape[:2], L.shape[1]))
    inertias, e = roots @ roots.transpose(0, 2, 1), rng.normal(size=n)
    # F ζ = −P⁻¹ Q e, then the modes along Q; against the modal mass as a whole.
    F = np.diag(inverses) + np.einsum("cik,cij,cjl->kl", L, inertias, L)
    zeta = -cho_solve(cho_factor(F, lower=True), inverses * (Q @ e))  # without interchanges, as `factor_symmetric`
    eta = -e + Q.T @ (inverses * (zeta + Q @ e))
    rows = np.array([shapes + forms @ state for shapes, forms in groups])
    exact = -np.linalg.solve(np.eye(n) + np.einsum("cik,cij,cjl->kl", rows, inertias, rows), e)
    return float(max(np.abs(eta - exact).max(), np.abs(L @ zeta - rows @ exact).max()))

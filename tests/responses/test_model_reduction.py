"""Reduced linear models: balanced truncation beside closed forms and the whole model's response."""

import numpy as np
import pytest

from fmd.responses.model_reduction import ModelReduction
from fmd.responses.state_space import Channel, StateSpace


def model_of(A, B, C, D=None) -> StateSpace:
    A, B, C = np.array(A, dtype=float), np.array(B, dtype=float), np.array(C, dtype=float)
    sizes = {"x": len(A), "u": B.shape[1], "y": len(C)}
    named = [tuple(Channel(f"{kind}{k}", "") for k in range(n)) for kind, n in sizes.items()]
    return StateSpace(A, B, C, np.zeros((len(C), B.shape[1])) if D is None else D, *named)


def chain(n: int, damping: float, free: bool = False, seed: int = 0) -> StateSpace:
    """Masses on springs in a row, all damped alike, in a mixture of units; free of the wall if so wished."""
    rng = np.random.default_rng(seed)
    k, m = rng.uniform(1e5, 4e5, n + 1), rng.uniform(0.2, 2.0, n)
    k[0] = 0.0 if free else k[0]
    k[-1] = 0.0
    K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K / m[:, None], -damping * K / m[:, None]]])
    B, C = np.zeros((2 * n, 2)), np.zeros((3, 2 * n))
    B[n, 0], B[-1, 1] = 1.0 / m[0], 1e3 / m[-1]
    C[0, 0], C[1, n - 1], C[2, 2 * n - 1] = 1.0, 1.0, 1.0
    return model_of(A, B, C)


def test_the_singular_values_of_two_lags_are_those_by_hand():
    """With B = Cᵀ both Gramians are Pij = bi bj/(ai + aj), so the singular values are its eigenvalues."""
    a, b = np.array([1.0, 10.0]), np.array([1.0, 2.0])
    reduction = ModelReduction(model_of(np.diag(-a), b[:, None], b[None, :]))
    P = np.outer(b, b) / np.add.outer(a, a)
    at_rest = (b**2 / a).sum()  # the largest response, by which inputs and outputs are scaled
    np.testing.assert_allclose(reduction.singular_values, np.linalg.eigvalsh(P)[::-1] / at_rest, rtol=1e-12)


def test_a_lag_that_is_left_out_is_off_by_its_whole_bound():
    """1/(s + 1) has the singular value ½ and the response 1 at rest: the bound 2 σ (Glover 1984) is met."""
    found = ModelReduction(model_of([[-1.0]], [[1.0]], [[1.0]])).to_order(0)
    assert found.error == pytest.approx(1.0, rel=1e-12)
    assert found.bound == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_error_that_is_stated_is_that_of_the_response_and_below_its_bound(seed: int):
    whole = chain(12, 2e-5, seed=seed)
    reduction = ModelReduction(whole)
    frequencies = np.linspace(0.0, 400.0, 6001)
    expected = whole.frequency_response(frequencies)
    size = np.abs(expected).max(axis=0)
    for order in (6, 12, 20):
        found = reduction.to_order(order)
        off = np.abs(found.model.frequency_response(frequencies) - expected).max(axis=0)
        assert found.error <= found.bound + 1e-9
        assert (
            off / size.max(axis=1, keepdims=True)
        ).max() <= 1.1 * found.error + 3e-6  # narrow ones amplify round-off
        assert found.model.growth == 0.0
        assert len(found.model.states) == order


def test_as_few_states_are_taken_as_the_error_allows():
    reduction = ModelReduction(chain(12, 2e-5))
    found = reduction.to_error(0.01)
    assert found.error <= 0.01
    order = len(found.model.states)
    assert 2 <= order < 24
    assert reduction.to_order(order - 1).error > 0.01


def test_a_free_chain_keeps_its_rigid_motion():
    whole = chain(8, 2e-5, free=True)
    reduction = ModelReduction(whole)
    assert reduction.n_kept == 2
    found = reduction.to_order(10)
    slow = np.array([1e-3, 1e-2, 0.1])  # where the rigid motion alone is seen
    ratio = found.model.frequency_response(slow) / whole.frequency_response(slow)
    np.testing.assert_allclose(ratio, 1.0, atol=1e-5)


def test_what_can_not_be_left_out_is_refused():
    undamped = ModelReduction(chain(5, 0.0))
    assert undamped.n_kept == 10
    with pytest.raises(ValueError, match="10 are of rigid, undamped or growing"):
        undamped.to_order(4)
    assert undamped.to_order(10).error == 0.0

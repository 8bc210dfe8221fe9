"""Linear systems as the integrators take them: what they refuse, and their frequencies by parts."""

import numpy as np
import pytest

from fmd.integrators.protocol import evaluate
from tests.linear_system import LinearSystem


def test_accelerations_are_those_of_the_matrices() -> None:
    rng = np.random.default_rng(1)
    A, B, C = rng.standard_normal((3, 4, 4))
    system = LinearSystem(A @ A.T + np.eye(4), B @ B.T, 1, C)
    q, v = rng.standard_normal((2, 4))
    a = np.zeros(4)
    evaluate(system.parameters, 0.0, q, v, a)
    assert system.M @ a == pytest.approx(-system.K @ q - C @ v, rel=1e-10)


def test_each_frequency_holds_the_coordinates_of_the_other_kind() -> None:
    # M = [[1, ½], [½, 1]], K = diag(4, 9): each alone 2 and 3 rad/s.
    system = LinearSystem(np.array([[1.0, 0.5], [0.5, 1.0]]), np.diag([4.0, 9.0]), 1)
    assert system.highest_slow_frequency == pytest.approx(2.0)
    assert system.highest_fast_frequency == pytest.approx(3.0)
    assert system.coupled
    assert not LinearSystem(np.eye(2), np.eye(2), 1).coupled


def test_matrices_and_numbers_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"K has shape \(3, 3\), expected \(2, 2\)"):
        LinearSystem(np.eye(2), np.eye(3), 1)
    with pytest.raises(ValueError, match="n_slow is 3, expected 0 … 2"):
        LinearSystem(np.eye(2), np.eye(2), 3)

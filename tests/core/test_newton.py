"""Newton's method on equations whose roots are known in closed form, and how it fails."""

from collections.abc import Callable

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.newton import Solution, Tolerance, Trial, largest, settles, solve

TIGHT = Tolerance(20, relative=1e-12)


def find_root(
    start: float,
    residual: Callable[[Array], Array],
    slope: Callable[[Array], Array],
    tolerance: Tolerance = TIGHT,
    accepts: Callable[[Trial], bool] = lambda trial: True,
) -> Solution[Array]:
    def correction(x: Array, left: Array) -> Array:
        return np.linalg.solve(np.diag(slope(x)), -left)

    return solve(np.array([start]), residual, correction, np.add, tolerance, accepts=accepts)


def test_the_root_of_two_is_found_with_quadratic_convergence() -> None:
    found = find_root(1.0, lambda x: x**2 - 2.0, lambda x: 2.0 * x)
    assert found.converged
    assert found.state[0] == pytest.approx(np.sqrt(2.0), rel=1e-15)
    assert found.corrections <= 6  # digits double: 1 → 0.09 → 0.002 → 2e-6 → 2e-12 → round-off


def test_corrections_that_go_too_far_are_halved() -> None:
    # Newton's method for arctan runs away from beyond 1.3917…, where its corrections overshoot ever more.
    def slope(x: Array) -> Array:
        return 1.0 / (1.0 + x**2)

    assert abs(find_root(3.0, np.arctan, slope, Tolerance(5, relative=1e-12)).state[0]) > 1e6
    nearer = find_root(3.0, np.arctan, slope, accepts=lambda trial: largest(trial.after) < largest(trial.before))
    assert nearer.converged
    assert nearer.state[0] == pytest.approx(0.0, abs=1e-12)


def test_a_residual_that_is_small_ends_the_search_before_any_correction() -> None:
    found = find_root(1.0, lambda x: x - 1.0 - 1e-9, np.ones_like, Tolerance(5, residual=1e-8))
    assert (found.corrections, found.failure, found.state[0]) == (0, "", 1.0)


def test_each_failure_has_its_reason() -> None:
    # x² + 1 has no real root; a residual and a correction are infinite; a constant has no slope.
    assert find_root(0.7, lambda x: x**2 + 1.0, lambda x: 2.0 * x).failure == "too many corrections"
    assert find_root(1.0, lambda x: x - np.inf, np.ones_like).failure == "ran away"
    assert find_root(1.0, lambda x: x, lambda x: x * 1e-320).failure == "ran away"
    assert find_root(1.0, np.ones_like, np.zeros_like).failure == "singular"
    worse = find_root(1.0, lambda x: x, np.ones_like, accepts=lambda trial: False)
    assert (worse.failure, worse.state[0]) == ("no better", 1.0)


def test_no_more_corrections_are_made_than_allowed() -> None:
    found = find_root(1.0, lambda x: x**2 + 1.0, lambda x: 2.0 * x + 0.1, Tolerance(3))
    assert (found.failure, found.corrections) == ("too many corrections", 3)


def test_a_size_that_round_off_holds_has_settled_and_one_that_shrinks_has_not() -> None:
    assert settles(1e-15, 1.0, 1e-14, 1e-8)
    assert settles(9e-10, 1e-9, 1e-14, 1e-8)
    assert not settles(9e-10, 1e-6, 1e-14, 1e-8)  # still shrinks by a thousand
    assert not settles(1e-7, 1e-7, 1e-14, 1e-8)
    assert not settles(float("nan"), 1.0, 1e-14, 1e-8)

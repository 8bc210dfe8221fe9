"""Frequencies of small systems, against closed forms."""

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.errors import InertiaError
from fmd.dynamics.vibration import frequencies, highest_frequency, largest_leapfrog_step
from fmd.stability.splitting import cycle_growth


def test_a_chain_of_equal_masses_has_the_frequencies_of_its_sines() -> None:
    # n unit masses between two walls on n + 1 springs k: ω_j = 2 √k sin(jπ/(2(n + 1))) (Rayleigh, Theory of Sound).
    n, k = 6, 50.0
    K = k * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    exact = 2 * np.sqrt(k) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    assert frequencies(np.eye(n), K) == pytest.approx(exact, rel=1e-12)
    assert highest_frequency(np.eye(n), K) == pytest.approx(exact[-1], rel=1e-12)


def test_inertial_coupling_raises_the_highest_frequency() -> None:
    # M = [[1, β], [β, 1]] with one spring ω² on the second mass: the first is free, and ω becomes ω/√(1 − β²).
    beta, omega = 0.6, 3.0
    M, K = np.array([[1.0, beta], [beta, 1.0]]), np.diag([0.0, omega**2])
    assert frequencies(M, K) == pytest.approx([0.0, omega / np.sqrt(1 - beta**2)], abs=1e-7)


def test_what_no_spring_holds_or_a_negative_one_pushes_counts_as_zero() -> None:
    assert frequencies(np.eye(3), np.diag([-4.0, 0.0, 9.0])) == pytest.approx([0.0, 0.0, 3.0])


def test_a_system_without_coordinates_or_springs_has_a_limit_that_steps_can_be_divided_by() -> None:
    assert frequencies(np.zeros((0, 0)), np.zeros((0, 0))).size == 0
    for n in (0, 2):
        assert 0.0 < highest_frequency(np.eye(n), np.zeros((n, n))) < 1e-100


def _random_matrices(n: int, seed: int, damped: float) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    M, K, C = (A @ A.T for A in rng.normal(size=(3, n, n)))
    C[:, 0] = C[0] = 0.0  # a coordinate without a damper
    return M + np.eye(n), K, damped * C


@pytest.mark.parametrize("damped", [0.02, 1.0, 50.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_leapfrog_step_with_dampers_ends_where_the_spectral_radius_passes_1(seed: int, damped: float) -> None:
    M, K, C = _random_matrices(4, seed, damped)
    limit = largest_leapfrog_step(M, K, C)
    assert cycle_growth(M, K, 0, 0.999 * limit, 1, C) <= 1 + 1e-9
    assert cycle_growth(M, K, 0, 1.001 * limit, 1, C) > 1.0005
    assert limit < 2 / highest_frequency(M, K)


def test_a_single_damped_oscillator_has_its_closed_limit() -> None:
    omega, zeta = 3.0, 0.4  # h = 2/(ω (2 ζ + √(1 + 4 ζ²))), from κ + 4 γ = 4
    step = largest_leapfrog_step(np.eye(1), np.array([[omega**2]]), np.array([[2 * zeta * omega]]))
    assert step == pytest.approx(2 / (omega * (2 * zeta + np.sqrt(1 + 4 * zeta**2))), rel=1e-14)
    assert largest_leapfrog_step(np.eye(1), np.zeros((1, 1)), np.array([[5.0]])) == pytest.approx(1 / 5, rel=1e-14)


@pytest.mark.parametrize("damping", [0.0, 1.0])
def test_a_mass_that_is_not_positive_definite_is_told_with_its_least_value(damping: float) -> None:
    with pytest.raises(InertiaError, match=r"is -1 at least, and 2 at most"):
        largest_leapfrog_step(np.diag([2.0, -1.0]), np.eye(2), damping * np.eye(2))

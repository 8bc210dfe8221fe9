"""Frequencies of small systems, against closed forms."""

import numpy as np
import pytest

from pipeline.dynamics.vibration import frequencies, highest_frequency


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

"""The two-degree-of-freedom maps: against the general matrix, closed forms, and the law of growth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmd.stability.splitting import cycle_growth
from fmd.stability.two_dof import (
    fit_growth_law,
    stability_map,
    two_dof_growth,
    two_dof_map,
)

courant = st.floats(0.05, 2.3)


def determinant(omega_s: float, beta: float, m: int) -> float:
    """``1 + 2 β²/(1 − β²) · sin((m−1)ϑ/2) sin(mϑ/2)/cos(ϑ/2)`` with ``Ω_S = 2 sin(ϑ/2)``, derived by hand.

    It is above 1 for any β while ``m ϑ < 2π``, so one eigenvalue is: the scheme is unstable there at every step.
    """
    theta = 2 * np.arcsin(0.5 * omega_s)
    product = np.sin(0.5 * (m - 1) * theta) * np.sin(0.5 * m * theta) / np.cos(0.5 * theta)
    return float(1 + 2 * beta**2 / (1 - beta**2) * product)


@given(omega_s=courant, omega_l=courant, beta=st.floats(0.0, 0.95), m=st.integers(1, 20))
def test_the_map_is_the_general_matrix(omega_s: float, omega_l: float, beta: float, m: int) -> None:
    M, K = np.array([[1.0, beta], [beta, 1.0]]), np.diag([(omega_l / m) ** 2, omega_s**2])
    radius = cycle_growth(M, K, 1, 1.0, m)
    assert two_dof_growth(omega_s, omega_l, beta, m) == pytest.approx(
        radius, rel=1e-7
    )  # a double eigenvalue keeps half of the digits


@given(omega_s=st.floats(0.05, 1.95), omega_l=courant, beta=st.floats(0.0, 0.9), m=st.integers(2, 12))
def test_its_determinant_has_a_closed_form(omega_s: float, omega_l: float, beta: float, m: int) -> None:
    A = two_dof_map(omega_s, omega_l, beta, m)
    size = np.abs(np.linalg.eigvals(A)).max() ** 2
    assert np.linalg.det(A) == pytest.approx(determinant(omega_s, beta, m), rel=1e-8, abs=1e-10 * size)


@pytest.mark.parametrize("m", [2, 3, 10])
def test_without_coupling_each_keeps_its_own_limit(m: int) -> None:
    found = stability_map(m, 0.0, 100)  # 2 is the middle of the last fifth: a point of the grid is on it
    stable = (found.omega_l[:, None] < 2) & (found.omega_s[None] < 2)
    edge = (found.omega_l[:, None] == 2) | (found.omega_s[None] == 2)
    assert np.array_equal(found.unstable[~edge], (~stable)[~edge])


def test_the_weak_instability_grows_with_the_squares() -> None:
    """ρ − 1 = m(m − 1)/4 · β² Ω_S²/(1 − β²) where the slow coordinate is much slower."""
    for m in (2, 3, 5, 10):
        law = fit_growth_law(m)
        assert law.factor == pytest.approx(m * (m - 1) / 4, rel=5e-3)
        assert (law.coupling_power, law.courant_power) == pytest.approx((2, 2), abs=1e-3)
        assert law.misfit < 1e-2


def test_the_figures_of_the_design_hold() -> None:
    # β = 0.1, Ω_S = Ω_L = 0.1, found by hand before the code was written
    radii = [two_dof_growth(0.1, 0.1, 0.1, m) - 1 for m in (2, 3, 5, 10)]
    assert radii == pytest.approx([6.7e-5, 1.7e-4, 5.2e-4, 2.1e-3], rel=0.05)

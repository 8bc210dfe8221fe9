"""Flexibility of a half-space's surface against Boussinesq's solution."""

import numpy as np
import pytest

from fmd.contact.half_space import point_flexibility


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_a_force_that_pushes_in_draws_the_surface_to_it_unless_nothing_is_compressed(nu: float) -> None:
    """Johnson, Contact Mechanics, eq. 3.22: ``−(1 − 2 ν)/(4 π G r)`` along r, and ``(1 − ν)/(2 π G r)`` inwards."""
    E, apart = 210e9, np.array([[3.0, 4.0], [-1.0, 0.0]])
    G, r = E / (2 * (1 + nu)), np.hypot(*apart.T)
    along = np.column_stack([np.zeros(2), apart / r[:, None]])
    (inwards, *across) = point_flexibility(r, along, np.eye(3)[[0, 0]], E, nu)[:, :, 0].T
    assert inwards == pytest.approx((1 - nu) / (2 * np.pi * G * r), rel=1e-12)
    drawn = -(1 - 2 * nu) / (4 * np.pi * G * r)
    assert np.array(across) == pytest.approx(drawn * apart.T / r, rel=1e-12, abs=1e-30)

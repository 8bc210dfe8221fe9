"""Cubic splines against SciPy's."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fmd.core.splines import Ends, spline_pieces


@pytest.mark.parametrize("ends", ["clamped", "natural", "periodic"])
def test_splines_are_those_of_scipy(ends: Ends) -> None:
    rng = np.random.default_rng(0)
    for n in (2, 3, 4, 5, 9, 400):
        x, y = np.cumsum(rng.lognormal(0.0, 1.5, n)), rng.normal(size=n)
        y[-1] = y[0] if ends == "periodic" else y[-1]
        expected = CubicSpline(x, y, bc_type=ends).c[::-1].T
        step = np.diff(x)[:, None] ** np.arange(4)  # so that all have the unit of y
        np.testing.assert_allclose(spline_pieces(x, y, ends) * step, expected * step, atol=1e-11 * np.abs(y).max())

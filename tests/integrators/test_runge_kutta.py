"""Coefficients of the Runge–Kutta method against SciPy's."""

import numpy as np
from scipy.integrate import DOP853

from fmd.core.arrays import Array
from fmd.integrators import dop853


def rows(first: int, last: int) -> Array:
    dense = np.zeros((last - first, 16))
    for k, row in enumerate(dop853.ROWS[first:last]):
        dense[k, [*row]] = [*row.values()]
    return dense


def test_the_coefficients_are_scipys() -> None:
    assert np.array_equal(dop853.C, [*DOP853.C, 1.0, *DOP853.C_EXTRA])
    assert np.array_equal(rows(0, 12)[:, :12], DOP853.A)
    assert np.array_equal(rows(12, 13)[0, :12], DOP853.B)
    assert np.array_equal(rows(13, 16), DOP853.A_EXTRA)
    assert np.array_equal(rows(16, 18)[:, :13], [DOP853.E3, DOP853.E5])
    assert np.array_equal(rows(18, 22), DOP853.D)

"""Products of small dense matrices agree with NumPy's for every size around the block of eight."""

from __future__ import annotations

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.integrators.phi_functions import multiply_square
from fmd.kernels.kernel import kernel


@kernel
def multiply(A: Array, B: Array, C: Array) -> None:
    multiply_square(A, B, C)


@pytest.mark.parametrize("n", [1, 2, 7, 8, 9, 15, 16, 17, 28, 41])
def test_a_product_of_square_matrices_is_that_of_numpy(n: int) -> None:
    A, B = np.random.default_rng(n).uniform(-1.0, 1.0, (2, n, n))
    C = np.full((n, n), np.nan)
    multiply(A, B, C)
    assert np.abs(C - A @ B).max() < 4 * n * np.finfo(float).eps


def test_what_is_not_a_number_spreads_over_its_row_and_no_further() -> None:
    A, B = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 12, 12))
    A[5, 3] = np.nan
    C = np.zeros((12, 12))
    multiply(A, B, C)
    assert np.isnan(C[5]).all()
    assert np.isfinite(np.delete(C, 5, axis=0)).all()

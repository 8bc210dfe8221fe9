"""Weighted sums of rows agree with NumPy's for every size around the pieces of eight, four, two and one."""

from __future__ import annotations

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.integrators.runge_kutta import add_weighted_rows
from fmd.kernels.kernel import kernel


@kernel
def add(
    base: Array, K: Array, row: IntArray, weight: Array, count: int, latest: int, last: float, h: float, out: Array
) -> None:
    add_weighted_rows(base, K, row, weight, count, latest, last, h, out)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 15, 16, 17, 31])
@pytest.mark.parametrize("count", [4, 12])
def test_a_sum_of_rows_is_that_of_numpy(n: int, count: int) -> None:
    random = np.random.default_rng(n)
    K, base, weight = random.normal(size=(16, n)), random.normal(size=n), random.normal(size=16)
    row, out = random.permutation(16), np.full(n + 1, np.nan)
    add(base, K, row, weight, count, 7, 0.3, 0.01, out[:n])
    expected = base + 0.01 * (weight[:count] @ K[row[:count]] + 0.3 * K[7])
    assert np.abs(out[:n] - expected).max() < 4 * count * np.finfo(float).eps
    assert np.isnan(out[n])
    add(base, K, row, weight, count, 7, 0.3, 0.01, base)
    assert np.array_equal(base, out[:n])

"""Steps of uncoupled oscillators agree with the plain formula for every number around the pieces, however divided."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.dynamics.jit.compiled import kernel
from fmd.dynamics.jit.oscillators import step_damped, step_undamped

H, START = 0.01, 0.3


@kernel
def undamped(
    n_slow: int, x: Array, q: Array, v: Array, a: Array, d: Array, load: Array, first: int, count: int, begins: bool
) -> None:
    step_undamped(n_slow, x[0], x[1], x[2], q, v, a, d, load, first, START, H, count, begins)


@kernel
def damped(n_slow: int, x: Array, q: Array, v: Array, a: Array, first: int, count: int) -> None:
    step_damped(n_slow, x[0], x[1], x[2], x[3], q, v, a, first, START, H, count)


def march(n: int, n_slow: int, has_damping: bool, calls: Sequence[int]) -> tuple[Array, Array, Array, Array]:
    """Return coefficients, and positions, rates and accelerations after some calls of so many steps each."""
    random = np.random.default_rng(n)
    x, q, v = random.normal(size=(4, n)), random.normal(size=n + 1), random.normal(size=n)
    x[2:] = np.abs(x[2:])
    a, d, load, first = random.normal(size=n), np.zeros(n), np.zeros(n), 31
    for number, count in enumerate(calls):
        if has_damping:
            damped(n_slow, x, q, v, a, first, count)
        else:
            undamped(n_slow, x, q, v, a, d, load, first, count, number == 0)
        first += count
    return x, q, v, a


@pytest.mark.parametrize("has_damping", [False, True])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7, 8, 9, 15, 17])
def test_steps_of_oscillators_are_those_of_the_formula(n: int, has_damping: bool) -> None:
    for n_slow in range(min(n, 3)):
        (constant, slope, k, c), q, v, a = march(n, n_slow, has_damping, [])
        for step in range(31, 42):
            middle = v + 0.5 * H * a
            new = constant + (step * H - START) * slope - k * q[1:] - (c * middle if has_damping else 0.0)
            a[n_slow:] = new[n_slow:]
            v[n_slow:] += H * new[n_slow:]
            q[1 + n_slow :] += H * v[n_slow:]
        _, *found = march(n, n_slow, has_damping, [11])
        for one, other in zip(found, (q, v, a), strict=True):
            assert np.abs(one - other).max() < 1e-13


@pytest.mark.parametrize("has_damping", [False, True])
def test_dividing_steps_into_calls_changes_no_bit(has_damping: bool) -> None:
    _, *whole = march(13, 1, has_damping, [10])
    for calls in ([1, 9], [3, 3, 4], [1] * 10):
        _, *parts = march(13, 1, has_damping, calls)
        assert all(np.array_equal(one, other) for one, other in zip(parts, whole, strict=True))

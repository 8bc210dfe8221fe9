"""Limits by the amplification matrix: where growth jumps, and how strongly slow and fast coordinates couple."""

import numpy as np
import pytest

from fmd.core.errors import StabilityError
from fmd.dynamics.compiled_system.reference_state import FreeMotion
from fmd.dynamics.vibration import inertial_coupling
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.subcycling import Subcycling
from fmd.stability.limits import (
    explicit_method,
    find_limits,
    find_sudden_step,
)
from fmd.stability.operating_points import OperatingPoints
from fmd.stability.splitting import cycle_growth
from fmd.stability.tangent import OperatingPoint
from tests.linear_system import LinearSystem


@pytest.mark.parametrize("m", [2, 3, 7])
def test_a_coupled_limit_is_where_growth_jumps(m: int) -> None:
    """Below it a cycle grows by the weak law alone, above it by orders more."""
    M, K = np.array([[1.0, 0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.diag([1e-4, 1.0, 4.0])
    limit, rate = find_sudden_step(M, K, 1, m)
    assert limit == pytest.approx(1.0, rel=0.01)  # 2/ω of the fast coordinates
    assert rate > 0
    assert inertial_coupling(M, 1) == pytest.approx(0.02)
    system = LinearSystem(M, K, 1)
    with pytest.raises(StabilityError):
        Subcycling(1.02 * limit, m).march(system, np.ones(3), np.zeros(3), np.array([2000.0]))


def test_the_growth_rate_is_that_of_a_march_of_half_the_step() -> None:
    M, K, m = np.array([[1.0, 0.1], [0.1, 1.0]]), np.diag([1e-6, 1.0]), 5
    limit, rate = find_sudden_step(M, K, 1, m)
    cycle = 0.5 * limit * m
    march = Subcycling(0.5 * limit, m).march(LinearSystem(M, K, 1), np.ones(2), np.zeros(2), cycle * np.arange(351))
    early, late = (np.abs(march.q[cycles, 1]).max() for cycles in (slice(100, 150), slice(300, 350)))
    assert np.log(late / early) / (200 * cycle) == pytest.approx(rate, rel=0.05)


def test_without_coupling_each_limit_is_that_of_the_stricter_coordinate() -> None:
    # 2/ω of the fast coordinate, 2/(m ω) of the slow one.
    M, K = np.eye(2), np.diag([4.0, 100.0])
    for m, exact in ((1, 0.2), (2, 0.2), (5, 0.2), (8, 0.125)):
        limit, rate = find_sudden_step(M, K, 1, m)
        assert limit == pytest.approx(exact, rel=1e-6)
        assert rate == 0.0


def test_coupling_is_a_canonical_correlation() -> None:
    # It does not change with the units of the coordinates.
    beta, scale = 0.37, np.diag([10.0, 0.01])
    M = np.array([[1.0, beta], [beta, 1.0]])
    assert inertial_coupling(scale @ M @ scale, 1) == pytest.approx(beta)
    assert inertial_coupling(M, 0) == inertial_coupling(M, 2) == 0.0


def test_one_fast_step_to_a_slow_one_is_plain_central_difference() -> None:
    assert explicit_method(0.1, 1) == CentralDifference(0.1)
    assert explicit_method(0.1, 3) == Subcycling(0.1, 3)


def test_a_coupled_mechanisms_limits_shrink_with_the_duration() -> None:
    """Growth per cycle by the weak law, m(m − 1)/4 · β²/(1 − β²) · Ω_S², adds up to ln 10 over the duration."""
    beta, m, duration = 0.1, 5, 1e4
    M, K = np.array([[1.0, beta], [beta, 1.0]]), np.diag([1e-6, 1.0])
    reference = FreeMotion(M, K, np.zeros_like(K), 1)
    found = find_limits(LinearSystem(M, K, 1), reference, [1, m], duration, 1e-3)
    assert found.coupling == pytest.approx(beta)
    assert (found.along, found.n_slow, found.duration) == (False, 1, duration)
    plain, coupled = found.limits
    assert plain.critical_step == pytest.approx(2 * np.sqrt(1 - beta**2), rel=1e-3)
    law = m * (m - 1) / 4 * beta**2 / (1 - beta**2)  # per cycle m h, over h²
    assert coupled.critical_step == pytest.approx(np.log(10) * m / (law * duration), rel=0.05)
    assert coupled.critical_step < 0.2 * coupled.sudden_step
    step, ratio = found.recommended  # grows by less than the wanted error
    assert duration / (ratio * step) * np.log(cycle_growth(M, K, 1, step, ratio)) < 1e-3


def test_at_rest_an_operating_point_adds_nothing_to_the_reference_state() -> None:
    M, K = np.eye(2), np.diag([0.01, 1.0])
    system, rest = LinearSystem(M, K, 1), OperatingPoint(0.0, np.zeros(2), np.zeros(2))
    reference = FreeMotion(M, K, np.zeros_like(K), 1)
    points = OperatingPoints(system, (rest,), 100.0)
    alone, along = (find_limits(system, reference, [1, 2], 100.0, 1e-2, at) for at in (None, points))
    assert along.along
    for one, other in zip(alone.limits, along.limits, strict=True):
        assert other.critical_step == pytest.approx(one.critical_step, rel=0.02)
        assert other.worst_time == 0.0

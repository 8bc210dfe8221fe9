"""The amplification matrix: by formula, by the integrators that run scenes, and by what marches really do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from fmd.core.arrays import Array
from fmd.core.errors import StabilityError
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.exponential import Exponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.protocol import Integrator, State
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.subcycling import Subcycling
from fmd.stability.splitting import amplification_matrix, cycle_growth, spectral_radius
from tests.linear_system import LinearSystem


def random_system(n: int, n_slow: int, seed: int, with_rates: bool) -> LinearSystem:
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((3, n, n))
    return LinearSystem(A @ A.T + np.eye(n), B @ B.T, n_slow, C if with_rates else None)


def measured_matrix(method: Integrator, system: LinearSystem) -> Array:
    """Map of positions, rates and accelerations over one major cycle, by feeding unit vectors to an integrator."""
    rest = np.zeros(system.n)
    base = method.march(system, rest, rest, np.zeros(1)).end
    parts = np.cumsum([base.q.size, base.v.size])

    def cycle(values: Array) -> Array:
        q, v, a = np.split(values, parts)
        end = method.resume(system, replace(base, q=q, v=v, a=a), np.array([base.step * method.step])).end
        return np.concatenate([end.q, end.v, end.a])

    units = np.eye(base.q.size + base.v.size + base.a.size)
    return np.stack([(cycle(unit) - cycle(-unit)) / 2 for unit in units], axis=1)


def of_positions_and_rates(A: Array, n: int) -> Array:
    return A[: 2 * n, : 2 * n]


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    n=st.integers(2, 7),
    share=st.floats(0.0, 1.0),
    m=st.integers(1, 12),
    seed=st.integers(0, 10**6),
    with_rates=st.booleans(),
    step=st.floats(0.01, 1.5),
)
def test_formula_and_integrator_agree(n: int, share: float, m: int, seed: int, with_rates: bool, step: float) -> None:
    n_slow = 1 + int(share * (n - 2))
    system = random_system(n, n_slow, seed, with_rates)
    h = step / system.highest_frequency
    formula = amplification_matrix(system.M, system.K, n_slow, h, m, system.C)
    measured = measured_matrix(Subcycling(h, m), system)
    assert np.abs(measured - formula).max() <= 1e-10 * np.abs(formula).max()


@pytest.mark.parametrize("with_rates", [False, True])
def test_one_substep_is_central_difference(with_rates: bool) -> None:
    system = random_system(5, 2, 3, with_rates)
    h = 0.7 / system.highest_frequency
    plain, sub = (measured_matrix(method, system) for method in (CentralDifference(h), Subcycling(h, 1)))
    assert plain == pytest.approx(sub, abs=1e-12 * np.abs(sub).max())


def test_central_difference_is_stable_up_to_its_limit() -> None:
    system = random_system(6, 3, 4, False)
    limit = 2 / system.highest_frequency
    assert cycle_growth(system.M, system.K, 3, 0.999 * limit, 1) <= 1 + 1e-9
    assert cycle_growth(system.M, system.K, 3, 1.001 * limit, 1) > 1.01


def test_an_uncoupled_oscillator_grows_beyond_its_own_limit_alone() -> None:
    M, K = np.eye(2), np.diag([4.0, 100.0])
    assert cycle_growth(M, K, 1, 0.19, 5) <= 1 + 1e-9  # 10 · 0.19 and 2 · 0.95
    assert cycle_growth(M, K, 1, 0.201, 2) > 1.1
    assert cycle_growth(M, K, 1, 0.1, 11) > 1.1


@pytest.mark.parametrize("m", [2, 3, 10])
def test_amplitudes_grow_as_the_radius_says(m: int) -> None:
    """Marched over many major cycles from the vector that grows most, β = 0.3."""
    M, K = np.array([[1.0, 0.3], [0.3, 1.0]]), np.diag([0.02, 1.0])
    h, cycles = 0.2, 200
    system = LinearSystem(M, K, 1)
    A = amplification_matrix(M, K, 1, h, m)
    values, vectors = np.linalg.eig(A)
    k = int(np.abs(values).argmax())
    # the real plane of a complex pair: its two coordinates are read off by the left eigenvector
    left = np.linalg.inv(vectors)[k]
    state = vectors[:, k].real
    start = State(0, *state.reshape(3, 2))
    end = Subcycling(h, m).resume(system, start, np.array([(cycles * m - 1) * h])).end
    assert end.step == cycles * m
    grown = abs(left @ np.concatenate([end.q, end.v, end.a])) / abs(left @ state)
    assert grown == pytest.approx(abs(values[k]) ** cycles, rel=0.01)
    assert abs(values[k]) > 1 + 1e-6


@settings(max_examples=60, deadline=None)
@given(n=st.integers(2, 6), m=st.integers(1, 8), seed=st.integers(0, 10**6), share=st.floats(0.05, 3.0))
def test_no_march_ends_in_what_is_no_number(n: int, m: int, seed: int, share: float) -> None:
    """Random systems at random steps, stable or not: numbers, or an error that tells when and where."""
    system = random_system(n, 1, seed, with_rates=False)
    method = Subcycling(share / system.highest_frequency, m)
    times = np.linspace(0.0, 3000 * method.step, 7)
    try:
        found = method.march(system, np.ones(n), np.zeros(n), times)
    except StabilityError:
        with pytest.raises(StabilityError, match=r"diverged at t = [0-9.e+-]+ s, most in coordinate [0-9]+"):
            method.march(system, np.ones(n), np.zeros(n), times)
        return
    assert np.isfinite(found.q).all()
    assert np.isfinite(found.v).all()
    again = method.march(system, np.ones(n), np.zeros(n), times[[0, -1]])
    assert np.array_equal(found.q[-1], again.q[-1])  # whatever else was asked for on the way


@settings(max_examples=20, deadline=None)
@given(n=st.integers(2, 11), m=st.integers(1, 12), seed=st.integers(0, 10**6), with_rates=st.booleans())
def test_reversible_sub_cycling_of_a_linear_system_is_central_difference(
    n: int, m: int, seed: int, with_rates: bool
) -> None:
    """Half a drift, a kick with the rates half a step later, and half a drift, whatever couples."""
    system = random_system(n, 1, seed, with_rates)
    h, (q, v, a) = 0.7 / system.highest_frequency, np.eye(3 * n).reshape(3, n, 3 * n).copy()
    C = np.zeros((n, n)) if system.C is None else system.C
    for _ in range(m):
        q += 0.5 * h * v
        a[:] = -np.linalg.solve(system.M, system.K @ q + C @ (v + 0.5 * h * a))
        v += h * a
        q += 0.5 * h * v
    measured = measured_matrix(ReversibleSubcycling(h, m), system)
    expected = np.concatenate([q, v, a])
    assert np.abs(measured - expected).max() <= 1e-10 * np.abs(expected).max()


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(n=st.integers(2, 6), m=st.integers(1, 12), seed=st.integers(0, 10**6))
def test_reversible_sub_cycling_is_stable_below_its_limits(n: int, m: int, seed: int) -> None:
    """Whatever couples through the mass matrix and through the stiffness; and not above them."""
    system = random_system(n, 1 + seed % (n - 1), seed, with_rates=False)
    limit = ReversibleSubcycling(1.0, m).largest_step(system)
    assert spectral_radius(measured_matrix(ReversibleSubcycling(0.98 * limit, m), system)) <= 1 + 1e-6
    assert spectral_radius(measured_matrix(ReversibleSubcycling(1.02 * limit, m), system)) > 1 + 1e-3


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8, 1.0])
def test_generalized_alpha_is_stable_at_any_step(rho: float) -> None:
    system = random_system(4, 2, 5, False)
    for h in (0.1, 10.0, 1e4):
        A = measured_matrix(GeneralizedAlpha(h / system.highest_frequency, rho), system)
        assert spectral_radius(A) <= 1 + 1e-9


def test_what_is_damped_to_nothing_is_no_failure() -> None:
    """The fast mode shrinks to 0.861 a step: after 5000 steps the smallest number is reached; the slow one goes on."""
    system = LinearSystem(np.eye(2), np.diag([1.0, 1e4]), 1)
    found = GeneralizedAlpha(20 * 2 / 100, 0.8).march(system, np.ones(2), np.zeros(2), np.array([0.0, 4e3]))
    assert abs(found.q[-1, 1]) < 1e-150
    slow = np.hypot(found.q[-1, 0], found.v[-1, 0])
    assert slow == pytest.approx(0.99998324**10_000, rel=0.01)  # the scheme's eigenvalue at ω h = 0.4


def test_the_exponential_method_takes_uncoupled_modes_exactly() -> None:
    system = LinearSystem(np.eye(3), np.diag([1.0, 50.0, 4000.0]), 1)
    h = 0.3
    A = of_positions_and_rates(measured_matrix(Exponential(h), system), 3)
    first_order = np.block([[np.zeros((3, 3)), np.eye(3)], [-system.K, np.zeros((3, 3))]])
    assert pytest.approx(expm(h * first_order), abs=1e-9) == A
    assert spectral_radius(A) <= 1 + 1e-9

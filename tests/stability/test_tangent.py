"""Growth rates by tangent maps: against energies of real marches, closed forms and amplification matrices."""

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.march_tables import state_slopes
from fmd.integrators.protocol import evaluate
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.subcycling import Subcycling
from fmd.stability.operating_points import find_operating_points, settle
from fmd.stability.splitting import amplification_matrix
from fmd.stability.tangent import (
    OperatingPoint,
    cycles_within,
    differentiate,
    differentiate_states,
    scheme_growth_rates,
    scheme_tangents,
    slope_growth_rates,
    system_slopes,
)
from tests.linear_system import LinearSystem

REST = OperatingPoint(0.0, np.zeros(2), np.zeros(2))


@pytest.mark.parametrize("rate", [0.5, 2.0])
@pytest.mark.parametrize(
    "method", [Subcycling(0.011, 5), Subcycling(0.06, 1), Subcycling(0.002, 10), ReversibleSubcycling(0.013, 5)]
)
def test_vibrations_grow_in_marches_as_the_tangent_says(
    coasting: CompiledSystem, rate: float, method: Subcycling | ReversibleSubcycling
) -> None:
    """Against the energy of the difference of two marches, averaged over ten periods, over 20 s."""
    turning = OperatingPoint(0.0, np.zeros(2), np.array([rate, 0.0]))
    (at,), cycle = settle(coasting, [turning], np.array([1])), method.substeps * method.step
    by_tangent = scheme_growth_rates(method, coasting, [at], 0.01)[0, 0]
    times = np.arange(0.0, 20.0, cycle)
    one, other = (method.march(coasting, at.q + np.array([0.0, x]), at.v, times) for x in (0.0, 1e-7))
    energy = (200 - rate**2) * (other.q - one.q)[:, 1] ** 2 + (other.v - one.v)[:, 1] ** 2
    window = round(4.4 / cycle)
    means = np.convolve(energy, np.ones(window) / window, "valid")
    in_marches = 0.5 * np.polyfit(times[: len(means)], np.log(means), 1)[0]
    assert by_tangent == pytest.approx(in_marches, rel=3e-3, abs=1e-5)


def test_the_growth_of_the_equations_is_that_of_their_eigenvalues() -> None:
    # A mass on a spring that pushes, −4 N/m on 1 kg, grows by 2 per second; one on a spring that pulls doesn't.
    system = LinearSystem(np.eye(2), np.diag([-4.0, 9.0]), 1)
    assert slope_growth_rates(system_slopes(system, [REST]))[0] == pytest.approx([2, 0, 0, -2], abs=1e-6)


def test_the_tangent_of_a_linear_system_is_its_amplification_matrix() -> None:
    # It begins one cycle late, which changes nothing where the equations are the same at all times.
    M, K, C = np.array([[1.0, 0.3], [0.3, 1.0]]), np.diag([0.02, 1.0]), np.diag([0.01, 0.05])
    A = amplification_matrix(M, K, 1, 0.2, 5, C)
    (tangent,), duration = scheme_tangents(Subcycling(0.2, 5), LinearSystem(M, K, 1, C), [REST], 3.2)
    assert duration == pytest.approx(3.0)
    assert tangent == pytest.approx(np.linalg.matrix_power(A, 3), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_step_of_central_difference_maps_disturbances_as_marches_do(seed: int) -> None:
    random = np.random.default_rng(seed)
    M, K, C = (
        scale * (A @ A.T + own * np.eye(3))
        for scale, own, A in zip((1, 9, 0.3), (3, 0, 0), random.normal(size=(3, 3, 3)), strict=True)
    )
    system, rest = LinearSystem(M, K, 1, C), OperatingPoint(0.0, np.zeros(3), np.zeros(3))
    method = CentralDifference(0.3)
    (marched,), duration = scheme_tangents(method, system, [rest], 0.3)
    assert duration == 0.3
    assert method.maps_slopes(system)
    assert method.map_slopes(system_slopes(system, [rest]))[0] == pytest.approx(marched, abs=1e-6)


def test_along_a_motion_maps_of_slopes_grow_as_marches_of_central_difference_do() -> None:
    # The rod turns ever faster, and at 0.95 of the limit its slider's oscillations are fed.
    run = Pipeline(load_scene("rod-slider"))
    method = CentralDifference(0.95 * run.system.largest_step)
    points = find_operating_points(run.system, run.mechanism, *run.start, 10.0)
    marched = scheme_growth_rates(method, run.system, points.points, 1e-2)[:, 0]
    mapped = points.excess_growth(method)[:, 0] + np.maximum(points.growth_rates[:, 0], 0.0)
    assert mapped.max() > 0.5
    assert mapped == pytest.approx(marched, abs=0.07 * mapped.max())


def test_a_method_that_keeps_two_accelerations_has_a_tangent_of_both() -> None:
    # ρ∞ = 1 neither damps nor feeds an oscillator (Chung & Hulbert 1993); what it forgets decays.
    system = LinearSystem(np.eye(2), np.diag([1.0, 9.0]), 1)
    (tangent,), duration = scheme_tangents(GeneralizedAlpha(0.1, 1.0), system, [REST], 0.1)
    assert tangent.shape == (8, 8)
    assert duration == pytest.approx(0.1)
    (rates,) = scheme_growth_rates(GeneralizedAlpha(0.1, 1.0), system, [REST], 0.1)
    assert rates[:4] == pytest.approx(np.zeros(4), abs=1e-6)


def test_damping_shows_as_decay_in_both() -> None:
    # ẍ + 2 δ ẋ + x = 0 decays by δ; central difference follows it to second order.
    system = LinearSystem(np.eye(2), np.eye(2), 1, 0.2 * np.eye(2))
    assert slope_growth_rates(system_slopes(system, [REST]))[0] == pytest.approx(np.full(4, -0.1), abs=1e-6)
    assert scheme_growth_rates(CentralDifference(0.01), system, [REST], 1.0)[0, :4] == pytest.approx(-0.1, abs=1e-4)


def test_slopes_at_many_states_are_those_of_each_by_itself(coasting: CompiledSystem) -> None:
    random = np.random.default_rng(5)
    times, states = random.uniform(0.0, 1.0, 6), random.normal(0.0, 0.1, (6, 4))
    together = state_slopes(coasting, times, states)
    for t, state, found in zip(times, states, together, strict=True):
        q, v, a = state[:2].copy(), state[2:].copy(), np.zeros(2)
        evaluate(coasting.parameters, t, q, v, a)
        assert np.array_equal(found, np.concatenate([v, a]))
    by_one = differentiate_states(coasting, times, states, np.array([3]), np.array([1e-4]))[:, :, 0]
    for t, state, slope in zip(times, states, by_one, strict=True):
        alone = differentiate(lambda x, t=t: state_slopes(coasting, np.array([t]), x[None])[0], state, np.full(4, 1e-4))
        assert slope == pytest.approx(alone[:, 3], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("span", "cycle", "whole"), [(1.0, 0.3, 3), (1.0, 0.26, 4), (0.1, 0.5, 1), (0.0, 0.5, 1)])
def test_a_span_is_rounded_to_whole_cycles(span: float, cycle: float, whole: int) -> None:
    assert cycles_within(span, cycle) == whole


def test_central_differences_are_exact_for_quadratic_functions() -> None:
    J = differentiate(lambda x: np.array([x[0] * x[1], x[1] ** 2, x[0]]), np.array([2.0, 3.0]), np.array([0.1, 0.2]))
    assert pytest.approx(np.array([[3.0, 2.0], [0.0, 6.0], [1.0, 0.0]])) == J


def test_steps_of_a_driven_loop_are_studied_where_it_is() -> None:
    """The loop closes at its own time alone: at the point's, and not where the crank stands at time 0."""
    run = Pipeline(load_scene("slider-crank"))
    points = find_operating_points(run.system, run.mechanism, *run.start, run.scene.simulation.duration)
    limit = run.system.largest_step
    assert points.e_folds(CentralDifference(0.5 * limit)) < np.log(10.0)
    assert points.e_folds(CentralDifference(1.05 * limit)) > np.log(10.0)

"""Published mechanisms with loops, and random ones against an independent reference."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.reactions import closing_reactions
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.protocol import Trajectory
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta
from tests.verification.loop_mechanisms import (
    Case,
    Z,
    andrews_squeezer,
    bricard,
    double_four_bar,
    flexible_slider_crank,
    point_of,
    slider_crank_state,
)
from tests.verification.random_loops import random_loop


def largest_gap(case: Case, march: Trajectory) -> float:
    """Largest gap of the loops at the output times [m, or a cosine]."""
    compiled = case.system.compiled
    states = zip(march.times, march.q, march.v, strict=True)
    return max(float(np.abs(compiled.residuals(float(t), q, v)[0]).max()) for t, q, v in states)


def energy_error(case: Case, march: Trajectory) -> float:
    """Largest difference of the energy from that at the start, at the output times [J]."""
    states = zip(march.times, march.q, march.v, strict=True)
    energies = np.array([case.energy(float(t), q, v) for t, q, v in states])
    return float(np.abs(energies - case.energy(0.0, case.q, case.v)).max())


IVP_ANGLE, IVP_PLACE = -3.311734987910881e-01, 1.697373326718410e-01
IVP_RATES = 6.025346682645789e01, -8.753116989887888
IVP_SHAPES = [1.893192460247178e-04, 2.375751865617931e-05, -5.323907988763734e-06, -8.363283141616840e-06]
IVP_SHAPE_RATES = [-3.005536801092212e-02, -5.500488291932075e-03, 4.978243404809343e-04, 1.104933470696396e-03]
IVP_MULTIPLIERS = -6.232893262533717e01, -1.637910131687472e02, 2.529853213732781e01  # across, along, of the crank


def force_of_pin(case: Case, q: Array, v: Array) -> Array:
    """Force of the slider's pin on the rod at 0.1 s, along the guide and across it [N]."""
    (pin,) = closing_reactions(case.system.mechanism, np.array([0.1]), q[None], v[None])["pin"][0, :1, :2]
    return np.asarray(pin)


def test_the_flexible_slider_crank_of_the_ivp_test_set_is_met_to_nine_digits() -> None:
    case = flexible_slider_crank()
    times = np.array([0.0, *(0.1 + 1e-6 * np.arange(-3, 4))])
    march = RungeKutta(1e-11).march(case.system, case.q, case.v, times)
    q, v, (_, turned, slid) = march.q[4], march.v[4], case.system.mechanism.layout.rate
    assert 15.0 + q[turned] == pytest.approx(IVP_ANGLE, rel=1e-9)  # the joint's angle is from the crank
    assert q[slid] == pytest.approx(IVP_PLACE, rel=1e-9)
    assert (150.0 + v[turned], v[slid]) == pytest.approx(IVP_RATES, rel=1e-7)
    # The start is given to nine digits, whose axial vibration is 2.5e-6 of the forces.
    assert force_of_pin(case, q, v) == pytest.approx([IVP_MULTIPLIERS[1], -IVP_MULTIPLIERS[0]], rel=4e-6)
    energies = np.array([case.energy(t, *at) for t, *at in zip(times[1:], march.q[1:], march.v[1:], strict=True)])
    power = energies @ [-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0] / 60e-6
    assert -power / 150.0 == pytest.approx(IVP_MULTIPLIERS[2], rel=4e-6)
    assert largest_gap(case, march) < 1e-13


def test_multipliers_of_the_ivp_test_sets_slider_crank_are_met_at_its_state() -> None:
    case = flexible_slider_crank()
    q = slider_crank_state(case, IVP_ANGLE - 15.0, IVP_PLACE, IVP_SHAPES)
    v = slider_crank_state(case, IVP_RATES[0] - 150.0, IVP_RATES[1], IVP_SHAPE_RATES)
    assert force_of_pin(case, q, v) == pytest.approx([IVP_MULTIPLIERS[1], -IVP_MULTIPLIERS[0]], rel=1e-8)


def test_andrews_squeezer_is_met_to_nine_digits() -> None:
    """The angles at 0.03 s are those of the IVP test set, from seven runs of other programs."""
    case = andrews_squeezer()
    march = RungeKutta(1e-12).march(case.system, case.q, case.v, np.array([0.0, 0.03]))
    beta, theta, gamma, delta, phi, epsilon, omega = march.q[-1]
    assert beta == pytest.approx(15.81077119629904, rel=1e-9)
    assert theta == pytest.approx(-15.75637105984298, rel=1e-9)
    assert gamma == pytest.approx(0.04082224013073101, rel=1e-9)
    assert [phi, delta] == pytest.approx([-0.5347301163226948, 0.5244099658805304], rel=1e-9)
    assert [omega, epsilon] == pytest.approx([0.5347301163226948, 1.048080741042263], rel=1e-9)
    assert largest_gap(case, march) < 1e-13


def test_bricards_redundant_loop_runs_as_written_and_keeps_its_energy() -> None:
    """P3 at 10 s is that of the benchmark's solution in other programs: 0.99999973, -1.00073539, 0.99926434 m."""
    case = bricard()
    march = RungeKutta(1e-10).march(case.system, case.q, case.v, np.linspace(0.0, 10.0, 101))
    p3 = point_of(case, "rod2", Z, 10.0, march.q[-1])
    assert p3 == pytest.approx([0.99999973, -1.00073539, 0.99926434], abs=1e-8)
    assert np.ptp(march.q[:, 0]) > 2.0  # it has moved
    assert energy_error(case, march) < 1e-8
    assert largest_gap(case, march) < 1e-13


def parallel_cranks(times: Array) -> Array:
    """Angle of the cranks of the double four-bar as long as they stay parallel, 3 θ̈ = -3.5 · 9.81 cos θ."""

    def rates(_: float, y: Array) -> list[float]:
        return [y[1], -3.5 * 9.81 / 3.0 * np.cos(y[0])]

    found = solve_ivp(rates, (0.0, times[-1]), [np.pi / 2, -1.0], "DOP853", times, rtol=1e-13, atol=1e-13)
    return np.asarray(found.y[0])


def test_a_double_four_bar_stays_a_parallelogram_through_its_singular_positions() -> None:
    case, times = double_four_bar(), np.linspace(0.0, 10.0, 101)
    march = RungeKutta(1e-10).march(case.system, case.q, case.v, times)
    exact = parallel_cranks(times)
    assert np.ptp(exact) > 8 * np.pi  # five turns, with ten singular positions
    assert march.q[:, 0] == pytest.approx(exact, abs=1e-7)
    for angle in (march.q[:, 0] + march.q[:, 1], march.q[:, 2], march.q[:, 3] - exact, march.q[:, 4] - exact):
        assert np.abs(np.sin(angle)).max() < 1e-7
    for time in times[10::10]:  # at steps' ends: what is interpolated between them is off by a little more
        end = RungeKutta(1e-10).march(case.system, case.q, case.v, np.array([time])).end
        assert case.energy(end.time, end.q, end.v) == pytest.approx(case.energy(0.0, case.q, case.v), abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("make", [bricard, double_four_bar])
def test_loops_stay_closed_over_many_steps(make: Callable[[], Case]) -> None:
    case, step = make(), 1e-3
    march = CentralDifference(step).march(case.system, case.q, case.v, np.linspace(0.0, 2e5 * step, 401))
    assert march.evaluations >= 200_000
    assert largest_gap(case, march) < 1e-12
    assert energy_error(case, march) < 1e-3  # of 34 J and 20 J that go to and fro, without a drift


def orders(case: Case, method: Callable[[float], Any], settings: Array, end: float) -> tuple[Array, Array]:
    """Evaluations and errors of a method at some of its settings."""
    times = np.linspace(0.0, end, 5)
    exact = RungeKutta(1e-13).march(case.system, case.q, case.v, times).q
    marches = [method(setting).march(case.system, case.q, case.v, times) for setting in settings]
    errors = [np.abs(march.q - exact).max() for march in marches]
    return np.array([march.evaluations for march in marches], dtype=float), np.array(errors)


@pytest.mark.parametrize("method", [CentralDifference, GeneralizedAlpha])
def test_methods_of_fixed_steps_keep_order_two_on_a_loop(method: Callable[[float], Any]) -> None:
    steps = 5e-3 / 2.0 ** np.arange(4)
    _, errors = orders(bricard(), method, steps, 1.0)
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)


def test_rosenbrocks_method_keeps_order_four_on_a_loop() -> None:
    evaluations, errors = orders(bricard(), ExponentialRosenbrock, 10.0 ** -np.arange(5, 10), 1.0)
    assert np.polyfit(np.log(evaluations), np.log(errors), 1)[0] == pytest.approx(-4.0, abs=0.2)


def test_runge_kuttas_method_keeps_order_eight_on_a_loop() -> None:
    evaluations, errors = orders(bricard(), RungeKutta, 10.0 ** -np.arange(6.5, 11.0, 0.5), 40.0)
    assert np.polyfit(np.log(evaluations), np.log(errors), 1)[0] == pytest.approx(-8.0, abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2, 3))])
def test_random_loops_move_as_bodies_in_absolute_coordinates(seed: int, spatial: bool) -> None:
    loop, times = random_loop(seed, spatial), np.linspace(0.0, 0.2, 3)
    system = CompiledSystem(loop.mechanism)
    march = RungeKutta(1e-11).march(system, loop.mechanism.rest_positions, np.zeros(system.n), times)
    positions, rotations = loop.reference.march(loop.places[:-1], times)
    assert np.abs(rotations[-1] - np.eye(3)).max() > 0.1  # it has moved
    for k, t in enumerate(times):
        origins, axes, _ = system.compiled.frames(float(t), march.q[k], march.v[k])
        assert origins == pytest.approx(positions[k], abs=1e-8)
        assert axes == pytest.approx(rotations[k], abs=1e-8)

"""The bouncing bar against its exact solution by characteristics, and steps too long for it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd.contact.histories import AREA, BEGIN, END, ENERGY, ERROR, IMPULSE, N_VALUES
from fmd.core.errors import StabilityError
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.tangents import Direction, TangentSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.exponential import Exponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.protocol import Trajectory
from fmd.integrators.runge_kutta import RungeKutta
from tests.contact.touching_mechanisms import LENGTH, RHO, bouncing_bar

PERIOD = 16 / 3  # it falls for 1 s, is in contact for 2/3 s, and is up again 1 s later: then once more down and up
FALL = 5.0


def march(n: int, share: float, duration: float) -> tuple[Trajectory, np.ndarray]:
    """March with a share of the largest stable step, and return the total energy, too."""
    mechanism = bouncing_bar(n)
    system = share_system(mechanism)
    q0 = np.zeros(mechanism.n_positions)
    q0[0] = LENGTH / 2 + FALL
    times = np.arange(0.0, duration, 0.01)
    motion = CentralDifference(share * system.largest_step).march(system, q0, np.zeros(mechanism.n), times)
    kinetic, potential = Kinematics(mechanism, times, motion.q, motion.v).energies
    return motion, kinetic + potential + motion.contacts[:, ENERGY]


def test_a_bouncing_bar_has_the_exact_impulse_speed_and_time_of_contact() -> None:
    motion, _ = march(60, 0.25, 2.0)
    last, later = motion.contacts[-1], motion.times[180] - 5 / 3
    assert last[IMPULSE] == pytest.approx(266.667, abs=0.2)  # the exact bar: 300 + 300 (t − 1) N over 2/3 s
    assert last[BEGIN] == pytest.approx(1.0, abs=1e-3)
    assert last[END] == pytest.approx(5 / 3, abs=2e-3)
    assert 9.98 < motion.v[180, 0] + 10.0 * later < 10.0
    at = np.arange(110, 160, 5)  # means over 0.1 s, since a truncated shock rings
    mean = (motion.contacts[at + 5, IMPULSE] - motion.contacts[at - 5, IMPULSE]) / 0.1
    np.testing.assert_allclose(mean, 300.0 + 300.0 * (motion.times[at] - 1.0), rtol=0.03)


@pytest.mark.parametrize("method", [CentralDifference, GeneralizedAlpha])
def test_tangents_by_the_height_of_its_fall_are_exact_for_the_steps_and_near_those_of_the_exact_bar(
    method: type[CentralDifference | GeneralizedAlpha],
) -> None:
    """It leaves with the speed √(2 g h) that it came with: a time τ after, its place changes by 2 g τ/√(2 g h) − 1."""
    mechanism = bouncing_bar(10)
    system = share_system(mechanism)
    march, start, times = method(0.03 * system.largest_step), np.zeros(mechanism.n_positions), np.array([1.5, 1.9])
    start[0] = LENGTH / 2 + FALL
    along, rest = np.eye(mechanism.n)[0], np.zeros(mechanism.n)
    touching = tuple(0.0 * x for x in system.contact_numbers(rest))
    both: Any = TangentSystem(system, [Direction(np.zeros(0), [], along, rest, contact=touching)])
    found = march.march(both, *both.join(start, rest), times)
    assert found.contacts[0, AREA] > 0.0
    q, v = (x[:, :, 0] for x in both.part(found.q, found.v))
    low, high = (march.march(system, start + side * along, rest, times) for side in (-1e-6, 1e-6))
    np.testing.assert_allclose(q, (high.q - low.q) / 2e-6, atol=1e-7)
    np.testing.assert_allclose(v, (high.v - low.v) / 2e-6, atol=1e-5)
    rows = (high.contacts - low.contacts)[:, N_VALUES:] / 2e-6
    np.testing.assert_allclose(both.part_rows(found.contacts)[:, 0, N_VALUES:], rows, atol=1e-5 * np.abs(rows).max())
    assert q[-1, 0] == pytest.approx(2.0 * (1.9 - 5 / 3) - 1.0, abs=0.03)  # as of the first order of the step


def test_its_energy_stays_over_ten_periods() -> None:
    motion, energy = march(60, 0.25, 10 * PERIOD)
    assert energy[-1] == pytest.approx(energy[0], abs=0.005 * 500.0)  # of the 500 J that it falls with
    assert abs(motion.contacts[-1, ERROR]) < 0.005 * 500.0


def test_beyond_half_of_the_limit_it_gains_energy_and_the_summed_error_says_so() -> None:
    motion, energy = march(30, 0.8, 10 * PERIOD)
    assert energy[-1] > energy[0] + 0.2 * 500.0
    assert abs(motion.contacts[-1, ERROR]) > 0.05 * 500.0


def test_a_march_turned_round_after_the_shock_comes_back() -> None:
    """Forces without friction follow from positions alone, so central differences are reversible; half the limit."""
    mechanism = bouncing_bar(30)
    system = share_system(mechanism)
    method = CentralDifference(0.5 * system.largest_step)
    q0, times = np.zeros(mechanism.n_positions), np.array([0.0, 800 * method.step])
    q0[0] = LENGTH / 2 + FALL
    there = method.march(system, q0, np.zeros(mechanism.n), times)
    assert there.v[-1, 0] > 1.0
    back = method.march(system, there.q[-1], -there.v[-1], times)
    np.testing.assert_allclose(back.q[-1], q0, atol=1e-10)


def test_the_impulse_is_the_change_of_momentum() -> None:
    motion, _ = march(20, 0.3, 1.7)
    momentum = RHO * LENGTH * motion.v[:, 0]
    weight = -10.0 * RHO * LENGTH * motion.times
    np.testing.assert_allclose(momentum, weight + motion.contacts[:, IMPULSE], atol=1e-9 * 266.0)


def test_runge_kuttas_impulse_is_that_of_scipy_and_the_change_of_momentum() -> None:
    """By 20 modes; SciPy's DOP853 with the force ``max(0, -y)/D``, in steps that resolve its kinks."""
    mechanism = bouncing_bar(20)
    (body,) = mechanism.contacts
    omega, end, D = mechanism.links[0].omega, body.points.shapes[0, 0], body.points.G[0, 0, 0, 0]

    def slope(_: float, u: np.ndarray) -> np.ndarray:
        force = max(0.0, -(u[0] - LENGTH / 2 + end @ u[2:22])) / D
        return np.concatenate(
            [[u[1], force / (RHO * LENGTH) - 10.0], u[22:42], end * force - omega**2 * u[2:22], [force]]
        )

    start, times = np.zeros(43), np.linspace(0.0, 2.0, 41)
    start[:2] = LENGTH / 2 + FALL, 0.0
    exact = solve_ivp(slope, (0.0, 2.0), start, "DOP853", rtol=1e-11, atol=1e-12, max_step=0.002).y[-1, -1]
    motion = RungeKutta(1e-9).march(share_system(mechanism), start[[0, *range(2, 22)]], np.zeros(21), times)
    impulse = motion.contacts[:, IMPULSE]
    assert impulse[-1] == pytest.approx(exact, rel=1e-8)
    np.testing.assert_allclose(RHO * LENGTH * (motion.v[:, 0] + 10.0 * times), impulse, atol=1e-10)
    assert motion.contacts[-1, BEGIN] == pytest.approx(1.0, abs=1e-6)
    kinetic, potential = Kinematics(mechanism, times, motion.q, motion.v).energies
    np.testing.assert_allclose(kinetic + potential + motion.contacts[:, ENERGY], potential[0], rtol=1e-8)


@pytest.mark.parametrize("share", [0.5, 4.0])
def test_exponential_steps_keep_the_energy_in_each_step_of_ten_periods(share: float) -> None:
    """Also where they are far beyond 2/ω; their impulse is within 0.3 % of the exact bar's."""
    mechanism = bouncing_bar(20)
    system = share_system(mechanism)
    q0 = np.zeros(mechanism.n_positions)
    q0[0] = LENGTH / 2 + FALL
    method = Exponential(share * system.largest_step)
    times = method.step * np.arange(int(10 * PERIOD / method.step))
    motion = method.march(system, q0, np.zeros(mechanism.n), times)
    kinetic, potential = Kinematics(mechanism, times, motion.q, motion.v).energies
    np.testing.assert_allclose(kinetic + potential + motion.contacts[:, ENERGY], potential[0], rtol=1e-10)
    assert np.abs(motion.contacts[:, ERROR]).max() < 1e-10 * potential[0]
    assert motion.contacts[times < 2.0, IMPULSE][-1] == pytest.approx(266.667, rel=3e-3)
    momentum = RHO * LENGTH * (motion.v[:, 0] + 10.0 * times)
    np.testing.assert_allclose(momentum, motion.contacts[:, IMPULSE], atol=1e-7)


MAKERS: list[Callable[[float], Any]] = [
    lambda limit: CentralDifference(0.25 * limit),
    lambda _: RungeKutta(1e-6),
    lambda limit: Exponential(2.0 * limit),
]


@pytest.mark.parametrize("make", MAKERS, ids=["central-difference", "runge-kutta", "exponential"])
def test_a_march_in_two_parts_is_that_without_a_break(make: Callable[[float], Any]) -> None:
    mechanism = bouncing_bar(10)
    system = share_system(mechanism)
    q0 = np.zeros(mechanism.n_positions)
    q0[0] = LENGTH / 2 + FALL
    method, times = make(system.largest_step), np.linspace(0.0, 2.0, 41)
    whole = method.march(system, q0, np.zeros(mechanism.n), times)
    first = method.march(system, q0, np.zeros(mechanism.n), times[times < 1.3])
    rest = method.resume(system, first.end, times)
    later = times > 1.35
    np.testing.assert_array_equal(rest.q[later], whole.q[later])
    np.testing.assert_array_equal(rest.contacts[later], whole.contacts[later])


def test_a_march_goes_on_from_any_end_also_where_surfaces_came_to_touch_or_left() -> None:
    mechanism = bouncing_bar(3)
    system, method, times = share_system(mechanism), RungeKutta(1e-5), np.linspace(0.0, 0.6, 13)
    q0 = np.zeros(mechanism.n_positions)
    q0[0] = LENGTH / 2 + 0.1
    whole = method.march(system, q0, np.zeros(mechanism.n), times)
    end = method.start(system, q0, np.zeros(mechanism.n))
    for k, time in enumerate(times[1:], start=1):
        part = method.resume(system, end, times[k : k + 1])
        assert part.end.time > time
        np.testing.assert_array_equal(part.q[0], whole.q[k])
        end = part.end
    assert whole.contacts[:, AREA].any()


def test_a_march_without_forces_of_contact_says_so() -> None:
    mechanism = bouncing_bar(5)
    (body,) = mechanism.contacts
    wrong = replace(body, points=replace(body.points, G=-body.points.G))  # no flexibility is negative
    system = share_system(replace(mechanism, contacts=[wrong]))
    q0 = np.zeros(mechanism.n_positions)
    q0[0] = LENGTH / 2 + 1e-3
    with pytest.raises(StabilityError, match=r"no forces of contact were found at t = 0\.01"):
        CentralDifference(1e-3).march(system, q0, np.zeros(mechanism.n), np.array([0.1]))

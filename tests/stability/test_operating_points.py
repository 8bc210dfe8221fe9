"""Operating points: where loads leave what rests, along a motion in closed form, and what a scheme adds about them."""

from collections.abc import Sequence

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.limits.stability import SPAN
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.system import System
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.subcycling import Subcycling
from fmd.stability import operating_points
from fmd.stability.operating_points import OperatingPoints, find_operating_points, find_steady_points, settle
from fmd.stability.splitting import cycle_growth
from fmd.stability.tangent import OperatingPoint, scheme_growth_rates
from tests.linear_system import LinearSystem

REST = OperatingPoint(0.0, np.zeros(2), np.zeros(2))
SLIDER = np.array([1])


def test_the_slider_comes_to_rest_where_the_centrifugal_force_holds_its_spring(coasting: CompiledSystem) -> None:
    # k x = m Ω² (d + x), k = 1000 N/m, m = 5 kg, d = 1 m
    turning = OperatingPoint(0.0, np.zeros(2), np.array([2.0, 0.3]))
    found = find_steady_points(coasting, [turning], SLIDER)
    assert found is not None
    (steady,) = found
    assert steady.q[1] == pytest.approx(20 / 980, rel=1e-9)
    assert np.array_equal(steady.v, [2.0, 0.0])
    assert np.array_equal(turning.v, [2.0, 0.3])  # untouched


def test_where_nothing_balances_coordinates_rest_where_they_are() -> None:
    # A load without a spring: ẍ = −C v alone, whose slopes by the position are 0, and Newton's correction stays put.
    system = LinearSystem(np.eye(2), np.zeros((2, 2)), 1, np.array([[0.0, 0.0], [1.0, 0.0]]))
    pushed = OperatingPoint(0.0, np.array([0.1, 0.2]), np.array([3.0, 0.5]))
    (settled,) = settle(system, [pushed], SLIDER)
    assert np.array_equal(settled.q, pushed.q)
    assert np.array_equal(settled.v, [3.0, 0.0])


def test_no_coordinates_to_settle_leave_a_point_as_it_is(coasting: CompiledSystem) -> None:
    assert find_steady_points(coasting, [REST], np.array([], dtype=np.int64)) == [REST]


def test_points_follow_the_rod_that_its_torque_turns() -> None:
    # A constant torque of 100·π/180 N m on an inertia of 23/3 kg m², the slider 1 m from the hinge.
    run = Pipeline(load_scene("rod-slider"))
    duration = run.scene.simulation.duration
    points = find_operating_points(run.system, run.mechanism, *run.start, duration)
    times = np.array([at.time for at in points.points])
    assert times == pytest.approx((np.arange(8) + 0.5) * duration / 8)
    first = points.points[0]
    assert first.v[0] == pytest.approx(np.pi / 180 * 100 / (23 / 3) * times[0], rel=1e-2)
    for at in points.points:  # the slider rests where its spring holds it: k x = m Ω² (d + x)
        assert at.q[1] == pytest.approx(5 * at.v[0] ** 2 / (1000 - 5 * at.v[0] ** 2), rel=1e-6)
        assert at.v[1] == 0.0


def test_points_of_the_beam_have_the_rates_of_its_torque_pulse() -> None:
    # The half-sine pulse brings the undeformed beam to 20 rad/s in 0.1 s: rate 10 (1 − cos(π t/0.1)).
    run = Pipeline(load_scene("beam-paper", ["simulation.duration=0.2 s"]))
    points = find_operating_points(run.system, run.mechanism, *run.start, 0.2).points
    times = np.array([at.time for at in points])
    exact = 10 * (1 - np.cos(np.pi * np.minimum(times / 0.1, 1.0)))
    # Leapfrog sums the torque up with an error of (π h/0.1 s)²/12 = 8.2e-9 at its h = 10 µs.
    assert np.array([at.v[0] for at in points]) == pytest.approx(exact, rel=1e-8)
    assert all(np.array_equal(at.v[1:], np.zeros(run.mechanism.n - 1)) for at in points)
    assert all(np.abs(at.q[1:]).max() > 0 for at in points if at.time < 0.1)  # bent by the torque


def test_another_split_has_the_same_points_in_its_own_order() -> None:
    split = 'simulation.run=[{integrator="sub-cycling", substeps=5, split="200 Hz"}]'
    run = Pipeline(load_scene("arm", ["body.forearm.modes.enrich=none", split, "simulation.duration=0.2 s"]))
    (plan,) = Pipeline(
        load_scene(
            "arm", ["body.forearm.modes.enrich=none", split, "simulation.duration=0.2 s", "simulation.step=1 us"]
        )
    ).plans.values()
    other = plan.mechanism
    assert other.n_slow > run.mechanism.n_slow
    start = run.mechanism, *run.start
    one, two = (find_operating_points(system, *start, 0.2) for system in (run.system, plan.system))
    for a, b in zip(one.points, two.points, strict=True):
        # Slow modes of the split rest, too: all is as before but for the order of the rates.
        here, there = (
            Kinematics(mechanism, np.zeros(1), at.q[None], at.v[None]).frames
            for mechanism, at in ((run.mechanism, a), (other, b))
        )
        for frame, moved in zip(here, there, strict=True):
            assert frame.origin == pytest.approx(moved.origin, abs=1e-9)


def test_growth_of_the_equations_is_not_the_schemes_fault() -> None:
    # A mass on a spring that pushes, −4 N/m on 1 kg, grows by 2 per second in truth.
    points = OperatingPoints(LinearSystem(np.eye(2), np.diag([-4.0, 9.0]), 1), (REST,), 10.0)
    assert points.growth_rates == pytest.approx(np.array([[2.0, 0.0, 0.0, -2.0]]), abs=1e-6)
    assert points.e_folds(CentralDifference(1e-3)) == pytest.approx(0.0, abs=1e-3)


def test_a_schemes_own_growth_adds_up_over_the_duration() -> None:
    """Coupling β = 0.3 alone: cycles times the logarithm of the amplification matrix's spectral radius."""
    M, K = np.array([[1.0, 0.3], [0.3, 1.0]]), np.diag([0.02, 1.0])
    points = OperatingPoints(LinearSystem(M, K, 1), (REST,), 500.0)
    for m in (2, 5):
        formula = 500.0 / (0.2 * m) * np.log(cycle_growth(M, K, 1, 0.2, m))
        assert points.e_folds(Subcycling(0.2, m)) == pytest.approx(formula, rel=1e-6)
    assert points.e_folds(CentralDifference(2.1)) > 100


def test_a_march_that_diverges_at_once_has_infinite_e_folds() -> None:
    points = OperatingPoints(LinearSystem(np.eye(2), np.eye(2), 1), (REST,), 1e6)
    assert points.e_folds(Subcycling(50.0, 2)) == np.inf


@pytest.mark.parametrize(("frame", "spans"), [("joint-conforming", [1 / 16]), ("free", [1 / 16, 1.0])])
def test_a_step_by_which_nothing_grows_is_known_after_a_part_of_the_span(
    frame: str, spans: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Pipeline(load_scene("beam-paper", [f"simulation.frame={frame}"]))
    points = find_operating_points(run.system, run.mechanism, *run.start, run.scene.simulation.duration)
    method = Subcycling(0.1 * Subcycling(1.0, 5).largest_step(run.system), 5)
    taken: list[float] = []

    def spied(method: Subcycling, system: System, at: Sequence[OperatingPoint], span: float) -> Array:
        taken.append(span / (SPAN * points.duration))
        return scheme_growth_rates(method, system, at, span)

    monkeypatch.setattr(operating_points, "scheme_growth_rates", spied)
    found = points.e_folds(method)
    assert taken == spans
    whole = scheme_growth_rates(method, run.system, points.points, SPAN * points.duration)
    own = whole[:, : points.growth_rates.shape[1]] - np.maximum(points.growth_rates, 0.0)
    assert found == pytest.approx(own.mean(axis=0).max() * points.duration, abs=1e-3)

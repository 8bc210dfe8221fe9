"""How fast marches make vibrations grow: what the tangent tells, against energies of real marches and formulas."""

import numpy as np
import pytest

from pipeline import Pipeline, load_scene
from pipeline.dynamics.linear.linear import LinearSystem
from pipeline.dynamics.mechanism import Mechanism
from pipeline.integrators.central_difference import CentralDifference
from pipeline.integrators.subcycling import Subcycling
from pipeline.stability.amplification import growth
from pipeline.stability.growth import GROWN, Course, Instant, longest_safe_step, march_rates, steadied, true_rates


@pytest.fixture(scope="module")
def coasting() -> Mechanism:
    """Rod and slider without a torque."""
    return Pipeline(load_scene("rod-slider", ["drive.motor.torque=0 N m"])).mechanism


def turning(tree: Mechanism, rate: float) -> Instant:
    return steadied(tree, Instant(0.0, np.zeros(2), np.array([rate, 0.0])), np.array([1]))


def test_the_slider_comes_to_rest_where_the_centrifugal_force_holds_its_spring(coasting: Mechanism) -> None:
    # k x = m Ω² (d + x), k = 1000 N/m, m = 5 kg, d = 1 m
    assert turning(coasting, 2.0).q[1] == pytest.approx(20 / 980, rel=1e-9)


@pytest.mark.parametrize("rate", [0.5, 2.0])
@pytest.mark.parametrize(("m", "step"), [(5, 0.011), (1, 0.06), (10, 0.002)])
def test_vibrations_grow_as_the_tangent_tells(coasting: Mechanism, rate: float, m: int, step: float) -> None:
    """Against the energy of the difference of two marches, averaged over ten periods, over 20 s."""
    at, method = turning(coasting, rate), Subcycling(step, m)
    told = march_rates(method, coasting, at, 0.01)[0]
    times = np.arange(0.0, 20.0, m * step)
    one, other = (method.march(coasting, at.q + np.array([0.0, x]), at.v, times) for x in (0.0, 1e-7))
    energy = (200 - rate**2) * (other.q - one.q)[:, 1] ** 2 + (other.v - one.v)[:, 1] ** 2
    window = round(4.4 / (m * step))
    means = np.convolve(energy, np.ones(window) / window, "valid")
    found = 0.5 * np.polyfit(times[: len(means)], np.log(means), 1)[0]
    assert told == pytest.approx(found, rel=2e-3, abs=1e-5)


def test_true_growth_is_that_of_the_linearised_equations() -> None:
    # A mass on a spring that pushes, −4 N/m on 1 kg, grows by 2 per second; one on a spring that pulls doesn't.
    system = LinearSystem(np.eye(2), np.diag([-4.0, 9.0]), 1)
    rest = Instant(0.0, np.zeros(2), np.zeros(2))
    assert true_rates(system, rest) == pytest.approx([2, 0, 0, -2], abs=1e-6)
    # and it isn't the scheme's fault
    assert Course(system, (rest,), 10.0).e_folds(CentralDifference(1e-3)) == pytest.approx(0.0, abs=1e-3)


def test_growth_beyond_the_truth_adds_up_over_the_duration() -> None:
    """Coupling β = 0.3 alone: cycles times the logarithm of the amplification matrix's spectral radius."""
    M, K = np.array([[1.0, 0.3], [0.3, 1.0]]), np.diag([0.02, 1.0])
    course = Course(LinearSystem(M, K, 1), (Instant(0.0, np.zeros(2), np.zeros(2)),), 500.0)
    for m in (2, 5):
        formula = 500.0 / (0.2 * m) * np.log(growth(M, K, 1, 0.2, m))
        assert course.e_folds(Subcycling(0.2, m)) == pytest.approx(formula, rel=1e-6)
    assert course.e_folds(CentralDifference(2.1)) > 100


def test_the_longest_safe_step_is_where_vibrations_grow_tenfold() -> None:
    for power in (1, 3):
        exact = 0.37 * np.log(GROWN) ** (1 / power)
        found = longest_safe_step(lambda h, p=power: (h / 0.37) ** p, 2.0)  # type: ignore[misc]
        assert exact * (1 - 1 / 128) <= found <= exact
    assert longest_safe_step(lambda h: 0.0, 2.0) == 2.0
    assert longest_safe_step(lambda h: 3.0, 2.0) == 0.0
    # a window of steps that happen to be stable again doesn't count
    assert longest_safe_step(lambda h: 3.0 * (0.1 < h < 1.5), 2.0) <= 0.1


@pytest.mark.parametrize(("summit", "limit"), [(1.5, 0.3), (2.29, 0.3), (2.5, 0.2711), (1.0, 1.0)])
def test_what_is_calm_beyond_a_summit_of_growth_is_not_trusted(summit: float, limit: float) -> None:
    def folds(step: float) -> float:
        return float(summit * np.exp(-(((step - 0.3) / 0.1) ** 2)) + 5.0 * (step > 1.0))

    assert longest_safe_step(folds, 2.0) == pytest.approx(limit, rel=0.05)

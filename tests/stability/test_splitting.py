"""The choice of split, ratio and step: phase errors in closed form, growth by the amplification matrix."""

import numpy as np
import pytest

from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.stability.splitting import choose_split, cycle_growth, longest_step, recommend_step, split_at, step_limits

SLOW, FAST = 2 * np.pi * 1.0, 2 * np.pi * 100.0  # rad/s


def cart_with_slider(slider_axis: tuple[float, float, float]) -> CompiledSystem:
    """A cart of 99 kg on a spring along x that carries a slider of 1 kg on a spring of its own."""
    along, nothing = np.array([1.0, 0.0, 0.0]), np.zeros((3, 3))
    cart = Link("cart", rigid_integrals(99.0, np.zeros(3), nothing), PRISMATIC, axis=along, spring=100.0 * SLOW**2)
    integrals = rigid_integrals(1.0, np.zeros(3), nothing)
    slider = Link("slider", integrals, PRISMATIC, parent=0, axis=np.array(slider_axis), spring=FAST**2)
    return CompiledSystem(Mechanism([cart, slider]))


@pytest.fixture(scope="module")
def across() -> CompiledSystem:
    """The slider across the cart's way: no coupling through the mass matrix, 1 Hz and 100 Hz."""
    return cart_with_slider((0.0, 1.0, 0.0))


def test_what_is_below_the_frequency_is_slow(across: CompiledSystem) -> None:
    assert across.frequencies_hz == pytest.approx([1.0, 100.0])
    assert split_at(across, 10.0) == (["slider"], {"cart": 0, "slider": 0})
    assert split_at(across, 0.5)[0] == ["cart", "slider"]
    assert split_at(across, 200.0)[0] == []


def test_the_step_of_the_lowest_vibration_is_where_its_phase_is_off_by_the_error() -> None:
    # Leapfrog turns by 2 asin(ω h/2) a step (Hairer, Lubich & Wanner, Acta Numerica 2003): too fast by (ω h)²/24.
    omega, error, duration = 3.0, 1e-3, 40.0
    (h,) = step_limits(np.array([omega]), omega, error, duration)
    off = (2 * np.arcsin(0.5 * omega * h) / h - omega) * duration
    assert off == pytest.approx(error, rel=1e-3)


def test_high_vibrations_are_limited_by_stability_alone() -> None:
    # Their share of a deflection falls as 1/ω², faster than their phase error grows with ω³.
    omega = np.array([1.0, 1e4])
    limits = step_limits(omega, 1.0, 1e-2, 10.0)
    assert limits[1] == pytest.approx(0.8 * 2 / omega[1])
    assert limits[0] > 100 * limits[1]


def test_a_split_takes_the_slow_coordinate_by_many_fast_steps(across: CompiledSystem) -> None:
    error, duration = 1e-2, 4.0
    split = choose_split(across, error, duration, spin=0.0)
    assert 1.0 < split.frequency_hz < 100.0
    assert split.substeps > 1
    low, high = step_limits(np.array([SLOW, FAST]), SLOW, error, duration)
    assert split.step <= high
    assert split.substeps * split.step <= min(low, duration / 200) * (1 + 1e-12)
    assert (split.substeps + 1) * split.step > min(low, duration / 200)


def test_a_given_step_is_kept_and_a_tighter_error_takes_a_smaller_ratio(across: CompiledSystem) -> None:
    wide, tight = (choose_split(across, error, 1.0, spin=0.0, step=1e-4) for error in (1e-2, 1e-5))
    assert wide.step == tight.step == 1e-4
    assert tight.substeps < wide.substeps


def test_forces_of_a_spin_that_a_cycle_holds_bound_the_ratio(across: CompiledSystem) -> None:
    # ½ Ω² H T ≤ error is the bound where what is slow has no limit of its own below it.
    still, spinning = (choose_split(across, 1e-2, 1.0, spin) for spin in (0.0, 100.0))
    assert spinning.substeps <= still.substeps


def test_coupling_that_would_show_in_the_result_leaves_a_smaller_ratio(across: CompiledSystem) -> None:
    """Slider along the cart's way: both couple through the mass matrix, and each cycle grows a little."""
    along, error, duration = cart_with_slider((1.0, 0.0, 0.0)), 1e-3, 10.0
    split = choose_split(along, error, duration, spin=0.0)
    assert split.substeps < choose_split(across, error, duration, spin=0.0).substeps
    M, K, _ = along.linear_matrices
    if split.substeps > 1:
        growth = cycle_growth(M, K, 1, split.step, split.substeps)
        assert duration / (split.substeps * split.step) * np.log(growth) < error


def test_a_mechanism_without_springs_is_stepped_over_its_motion() -> None:
    cart = Link("cart", rigid_integrals(1.0, np.zeros(3), np.zeros((3, 3))), PRISMATIC)
    free = CompiledSystem(Mechanism([cart]))
    split = choose_split(free, 1e-3, 4.0, spin=0.0)
    assert (split.frequency_hz, split.substeps, split.step) == (np.inf, 1, 4.0 / 200)


def test_the_recommended_step_and_ratio_keep_phase_and_growth_below_the_error() -> None:
    M, K = np.eye(2), np.diag([SLOW**2, FAST**2])
    step, ratio = recommend_step(M, K, 1, 1e-2, 4.0)
    low, high = step_limits(np.array([SLOW, FAST]), SLOW, 1e-2, 4.0)
    assert step == pytest.approx(min(high, 4.0 / 200))
    assert 1 < ratio <= min(low, 4.0 / 200) / step
    beta = 0.5
    coupled = np.array([[1.0, beta], [beta, 1.0]])
    step, ratio = recommend_step(coupled, K, 1, 1e-2, 4.0)
    if ratio > 1:
        assert 4.0 / (ratio * step) * np.log(cycle_growth(coupled, K, 1, step, ratio)) < 1e-2
    assert longest_step(M, K, 1e-2, 4.0) == pytest.approx(min(low, high, 4.0 / 200))


@pytest.mark.parametrize("n_slow", [0, 2])
def test_no_ratio_is_recommended_where_all_coordinates_are_on_one_side(n_slow: int) -> None:
    M, K = np.eye(2), np.diag([SLOW**2, FAST**2])
    assert recommend_step(M, K, n_slow, 1e-2, 4.0) == (longest_step(M, K, 1e-2, 4.0), 1)


def test_a_mechanism_without_freedom_has_the_longest_step_of_its_duration() -> None:
    nothing = np.zeros((0, 0))
    assert longest_step(nothing, nothing, 1e-2, 4.0) == pytest.approx(4.0 / 200)

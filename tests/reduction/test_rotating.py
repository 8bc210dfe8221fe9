"""Frequencies on a hub that turns: a mass on springs, and a rod on a hub that is free."""

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals, inertia_integrals
from fmd.reduction.rotating import WhirlingModes, order_poles, rotating_modes

MASS, ARM = 2.0, 0.5


def body_of(x: Array, m: Array, shapes: Array, omega: Array) -> FlexibleBody:
    integrals: InertiaIntegrals = inertia_integrals(x, m, shapes)
    n = len(omega)
    still = MarkerShapes(np.zeros(3), np.zeros((3, n)), np.zeros((3, n)))
    return FlexibleBody(x, shapes, omega, np.array([0.0, 0.0, 1.0]), "hub", {"hub": still}, integrals, 0.0)


def rotating_frequencies(body: FlexibleBody, axis: Array, rate: float, hub_is_free: bool = False) -> Array:
    return 2 * np.pi * rotating_modes(body, axis, rate, hub_is_free).frequencies_hz


def mass_on_springs(omega: Array, x: float = 0.0) -> FlexibleBody:
    """A point mass at (x, 0, 0), free along all three axes, each with its spring."""
    return body_of(np.array([[x, 0.0, 0.0]]), np.array([[MASS]]), np.eye(3)[None] / np.sqrt(MASS), omega)


@pytest.mark.parametrize("rate", [0.0, 1.0, 3.0, 12.0])
def test_a_mass_on_equal_springs_has_its_frequency_plus_and_minus_the_rate(rate: float) -> None:
    # seen from the ground it keeps its frequency ω, whichever way it circles; along the axis nothing changes
    found = rotating_frequencies(mass_on_springs(np.full(3, 5.0)), np.array([0.0, 0.0, 2.0]), rate)
    assert found == pytest.approx(np.sort([abs(5.0 - rate), 5.0, 5.0 + rate]), rel=1e-9)


def test_a_mass_on_unequal_springs_follows_its_textbook_equation() -> None:
    """(ω_x² − Ω² − λ²)(ω_y² − Ω² − λ²) = 4 Ω² λ², for a rotor on an axis along x, and z left alone."""
    omega, rate = np.array([7.0, 4.0, 6.0]), 2.5
    found = rotating_frequencies(mass_on_springs(omega), np.array([1.0, 0.0, 0.0]), rate)
    a, b = omega[1:] ** 2 - rate**2
    squares = np.roots([1.0, -(a + b + 4 * rate**2), a * b])
    assert found == pytest.approx(np.sort([*np.sqrt(squares), 7.0]), rel=1e-9)


def test_a_hub_that_is_free_leaves_no_torque_about_the_axis() -> None:
    """A mass on a radial spring, its hub free: the spin's momentum is kept, so λ² = ω² + 3 Ω² about r₀.

    From r̈ = −ω²(r − r_s) + h²/r³ with h = r₀² Ω: the effective stiffness is ω² + 3 Ω² about the radius that is taken.
    """
    shapes = np.array([[[1.0], [0.0], [0.0]]]) / np.sqrt(MASS)
    body = body_of(np.array([[ARM, 0.0, 0.0]]), np.array([[MASS]]), shapes, np.array([5.0]))
    axis = np.array([0.0, 0.0, 1.0])
    assert rotating_frequencies(body, axis, 2.0, hub_is_free=True) == pytest.approx([np.sqrt(25.0 + 12.0)], rel=1e-9)
    assert rotating_frequencies(body, axis, 2.0) == pytest.approx([np.sqrt(25.0 - 4.0)], rel=1e-9)


def test_a_free_hub_with_a_mass_on_two_springs_follows_its_equations() -> None:
    """Hub of inertia J₀, mass m on springs along and across its arm a; the spin ν is eliminated by its momentum.

    From T = ½ J₀ θ̇² + ½ m ((ẋ − θ̇ y)² + (ẏ + θ̇ (a + x))²) with k = m a²/(J₀ + m a²), about x = y = 0, θ̇ = Ω:
    ẍ − 2Ω(1 − k) ẏ + (ω_x² − Ω² + 4kΩ²) x = 0 and (1 − k)(ÿ + 2Ω ẋ) + (ω_y² − Ω²) y = 0.
    """
    x = np.array([[ARM, 0.0, 0.0], [-0.7, 0.0, 0.0]])
    shapes = np.zeros((2, 3, 2))
    shapes[0, :2] = np.eye(2) / np.sqrt(MASS)
    omega, rate = np.array([7.0, 4.0]), 2.5
    found = rotating_frequencies(body_of(x, np.diag([MASS, 1.0]), shapes, omega), np.array([0, 0, 1.0]), rate, True)
    k = MASS * ARM**2 / (MASS * ARM**2 + 0.7**2)
    along, across = omega**2 - rate**2 + [4 * k * rate**2, 0.0]
    squares = np.roots([1 - k, -((1 - k) * along + across + 4 * rate**2 * (1 - k) ** 2), along * across])
    assert found == pytest.approx(np.sort(np.sqrt(squares)), rel=1e-9)


def test_a_mode_that_has_lost_its_stiffness_grows_instead_of_vibrating() -> None:
    # r̈ = (Ω² − ω²) r: real poles ±√(36 − 25).
    shapes = np.array([[[1.0], [0.0], [0.0]]]) / np.sqrt(MASS)
    body = body_of(np.array([[ARM, 0.0, 0.0]]), np.array([[MASS]]), shapes, np.array([5.0]))
    found = rotating_modes(body, np.array([0.0, 0.0, 1.0]), 6.0)
    assert found.growth == pytest.approx([np.sqrt(11.0), -np.sqrt(11.0)], rel=1e-12)
    assert found.frequencies_hz.tolist() == [0.0, 0.0]
    assert found.damping == pytest.approx([-1.0, 1.0])


def test_damping_is_none_where_nothing_moves() -> None:
    still = np.zeros(1)
    assert WhirlingModes(still, still, still).damping.tolist() == [0.0]


@pytest.mark.parametrize("rate", [3.0, 5.0, 6.9, 7.5])
def test_between_its_two_frequencies_a_mass_on_unequal_springs_grows(rate: float) -> None:
    """Poles λ of (ω_x² − Ω² + λ²)(ω_y² − Ω² + λ²) + 4 Ω² λ² = 0: one real pair for ω_y < Ω < ω_x."""
    omega = np.array([7.0, 4.0, 6.0])
    found = rotating_modes(mass_on_springs(omega[[2, 0, 1]]), np.array([1.0, 0.0, 0.0]), rate)
    a, b = omega[:2] ** 2 - rate**2
    squares = np.roots([1.0, a + b + 4 * rate**2, a * b])
    growth = np.sqrt(squares[squares > 0])
    assert len(growth) == (4.0 < rate < 7.0)
    assert found.growth[found.growth > 1e-9] == pytest.approx(growth, rel=1e-9)
    vibrations = np.sqrt(-squares[squares < 0])
    assert found.frequencies_hz[found.frequencies_hz > 0] * 2 * np.pi == pytest.approx(np.sort([*vibrations, 6.0]))


def test_poles_that_round_off_makes_complex_are_real_ones() -> None:
    """A vibration of 50 rad/s, and two equal ones that are overdamped, the slower pole split by round-off."""
    poles = np.array([-1 + 50j, -1 - 50j, -3 + 1e-12j, -3 - 1e-12j, -90, -90, 1e-9j, -1e-9j])
    kept = order_poles(poles, abs(poles.imag))
    assert poles[kept].real.tolist() == [-3, -3, -1, -90, -90]

"""Blocks that slide, stick and stop by friction, and one that rocks, against closed forms."""

import numpy as np
import pytest

from fmd.contact.histories import AREA, DAMPED, ERROR, FORCE, FRICTION, IMPULSE, MEAN_SLIP, SLIP
from fmd.contact.recorded import ContactRecord
from fmd.dynamics.compiled_system.shared import share_system
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.protocol import Trajectory
from tests.contact.touching_mechanisms import soft_footed_block

MASS, HALF = 2.0, 0.1


def slide(angle: float, friction: float, speed: float = 0.0, duration: float = 1.0, damping: float = 0.0) -> Trajectory:
    """March a block of 0.4 × 0.2 m that begins on a slope, at rest across it."""
    tilt = np.deg2rad(angle)
    gravity = 10.0 * np.array([-np.sin(tilt), 0.0, -np.cos(tilt)])
    mechanism, sunk = soft_footed_block((0.4, 2 * HALF), MASS, gravity, friction, 1e6, damping=damping)
    system = share_system(mechanism)
    q0, v0 = mechanism.rest_positions, np.zeros(6)
    q0[2], v0[0] = HALF - sunk, speed
    times = np.linspace(0.0, duration, 201)
    return CentralDifference(0.25 * system.largest_step).march(system, q0, v0, times)


@pytest.mark.parametrize("friction", [0.3, 0.5, 0.57])
def test_a_block_slides_down_a_slope(friction: float) -> None:
    motion = slide(30.0, friction, damping=1e-4)
    acceleration = -10.0 * (0.5 - friction * np.sqrt(0.75))
    later = motion.times > 0.3
    found = np.polyfit(motion.times[later], motion.v[later, 0], 1)[0]
    assert found == pytest.approx(acceleration, abs=1e-5)  # −g (sin 30° − μ cos 30°)
    lost = MASS * 10.0 * 0.5 * -motion.q[-1, 0] - 0.5 * MASS * motion.v[-1, 0] ** 2
    assert motion.contacts[-1, FRICTION] == pytest.approx(lost, rel=1e-3)
    assert abs(motion.contacts[-1, ERROR]) < 1e-3 * motion.contacts[-1, FRICTION]


def test_a_block_stops_where_friction_has_taken_its_energy() -> None:
    motion = slide(0.0, 0.3, speed=1.5)
    assert motion.q[-1, 0] == pytest.approx(1.5**2 / (2 * 0.3 * 10.0), rel=2e-3)
    assert np.ptp(motion.q[motion.times > 0.6, 0]) < 1e-4
    np.testing.assert_allclose(motion.contacts[-1, [SLIP, MEAN_SLIP]], motion.q[-1, 0], rtol=1e-3)  # of each point
    change = MASS * (motion.v[:, 0] - 1.5)
    np.testing.assert_allclose(motion.contacts[:, IMPULSE], change, atol=1e-9 * MASS * 1.5)


def test_points_slip_without_friction_as_far_as_their_body_goes() -> None:
    motion = slide(0.0, 0.0, speed=0.5, duration=0.1)
    np.testing.assert_allclose(motion.contacts[1:, SLIP], 0.5 * motion.times[1:], atol=0.5 * motion.step)
    mechanism, _ = soft_footed_block((0.4, 2 * HALF), MASS, np.zeros(3), 0.0, 1e6)
    record = ContactRecord(mechanism.contacts, motion.contacts)
    np.testing.assert_array_equal(record.slips["block"].max(axis=1), motion.contacts[:, SLIP])


def test_friction_is_never_more_than_its_cone() -> None:
    v = slide(30.0, 0.5).contacts
    across = np.hypot(v[:, FORCE], v[:, FORCE + 1])
    assert (across <= 0.5 * v[:, FORCE + 2] * (1.0 + 1e-9)).all()
    assert across.max() > 0.4 * MASS * 10.0 * np.cos(np.deg2rad(30.0))


def test_a_block_sticks_where_friction_is_just_enough() -> None:
    """Let go with its foot unsheared it slips at first; tan 30° = 0.57735."""
    motion = slide(30.0, 0.58, damping=1e-4)
    later = motion.times > 0.3
    assert np.abs(motion.v[later, 0]).max() < 1e-6


def test_a_block_rocks_as_housners() -> None:
    """Quarter period ``arcosh(1/(1 − θ₀/α))/p``, ``p² = 3 g/(4 R)`` (Housner, Bull Seismol Soc Am 53, 1963)."""
    gravity = np.array([0.0, 0.0, -10.0])
    mechanism, _ = soft_footed_block((0.2, 0.8), 2.0, gravity, 0.8, 1e7, n=2)
    (body,) = mechanism.contacts
    alpha, radius = np.arctan(0.25), np.hypot(0.1, 0.4)
    theta, p = 0.6 * alpha, np.sqrt(3 * 10.0 / (4 * radius))
    inertia_about_corner = 4 / 3 * 2.0 * radius**2
    assert mechanism.links[0].integrals.mass * 10.0 * radius / inertia_about_corner == pytest.approx(p**2)
    system = share_system(mechanism)
    q0 = mechanism.rest_positions
    q0[3:7] = [0.0, np.sin(theta / 2), 0.0, np.cos(theta / 2)]
    R = np.array([[np.cos(theta), 0, np.sin(theta)], [0, 1, 0], [-np.sin(theta), 0, np.cos(theta)]])
    q0[2] = -(body.points.x @ R[2]).min()
    times = np.linspace(0.0, 0.45, 451)
    motion = CentralDifference(0.25 * system.largest_step).march(system, q0, np.zeros(6), times)
    angle = 2 * np.arctan2(motion.q[:, 4], motion.q[:, 6])
    at = int(np.argmax(angle < 0.0))
    crossing = times[at - 1] + 1e-3 * angle[at - 1] / (angle[at - 1] - angle[at])
    assert crossing == pytest.approx(np.arccosh(1 / (1 - theta / alpha)) / p, rel=5e-3)  # 0.3674 s


def test_a_damped_foot_takes_from_a_bounce_what_a_spring_and_damper_do() -> None:
    """Restitution ``exp(−ζ (π − 2 asin ζ)/√(1 − ζ²))`` of a contact that ends with its force, ``ζ = β ω/2``."""
    free, zeta, speed = np.zeros(3), 0.3, 0.2
    stiff = soft_footed_block((0.4, 2 * HALF), MASS, free, 0.0, 1e6)[0].contacts[0].points.G[:, 2, :, 2]
    omega = np.sqrt(np.linalg.inv(stiff).sum() / MASS)
    mechanism, _ = soft_footed_block((0.4, 2 * HALF), MASS, free, 0.0, 1e6, damping=2 * zeta / omega)
    system = share_system(mechanism)
    q0, v0 = mechanism.rest_positions, np.zeros(6)
    q0[2], v0[2] = HALF + 1e-5, -speed
    motion = CentralDifference(0.02 * system.largest_step).march(system, q0, v0, np.linspace(0.0, 8.0 / omega, 50))
    kept = np.exp(-zeta * (np.pi - 2 * np.arcsin(zeta)) / np.sqrt(1 - zeta**2))
    assert motion.v[-1, 2] == pytest.approx(kept * speed, rel=0.01)
    energy = 0.5 * MASS * (speed**2 - motion.v[-1, 2] ** 2)
    damped, error = motion.contacts[-1, [DAMPED, ERROR]]  # what steps make is told, and all is summed up
    assert damped - error == pytest.approx(energy, rel=1e-6)
    assert abs(error) < 3e-3 * energy


def test_points_that_come_to_touch_beside_pressed_ones_begin_with_their_displacement_with_damping() -> None:
    """Energy that steps make or lose falls with them; where points begin undisplaced, it doesn't."""
    tilt, speed, errors = 3e-4, 0.1, []
    mechanism, _ = soft_footed_block((0.4, 2 * HALF), MASS, np.zeros(3), 0.0, 1e6, damping=1e-3)
    (body,) = mechanism.contacts
    system = share_system(mechanism)
    q0, v0 = mechanism.rest_positions, np.zeros(6)
    q0[3:7] = [0.0, np.sin(tilt / 2), 0.0, np.cos(tilt / 2)]
    R = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    q0[2], v0[2] = 1e-6 - (body.points.x @ R[2]).min(), -speed
    for share in (0.04, 0.02, 0.01):
        motion = CentralDifference(share * system.largest_step).march(system, q0, v0, np.linspace(0.0, 0.01, 50))
        damped, error = motion.contacts[-1, [DAMPED, ERROR]]
        assert motion.contacts[:, AREA].max() > 0.3  # of 0.4: most of eight points, and one at first
        assert damped > 0.3 * 0.5 * MASS * speed**2
        errors.append(abs(error) / (0.5 * MASS * speed**2))
    assert errors[1] < 0.7 * errors[0]
    assert errors[2] < 0.7 * errors[1]

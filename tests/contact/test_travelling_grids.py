"""Grids that follow a contact along a curved face: balls that turn and roll, against Hertz and conservation laws."""

import numpy as np
import pytest

from fmd import Pipeline
from fmd.contact.curved_grid import CurvedGrid, GridFrame
from fmd.core.arrays import Array
from fmd.output.contacts import contact_figures, contact_warnings
from fmd.verification.case import open_scene
from tests.contact.test_sub_cycled_contact import march_in_two_parts

RADIUS = 10e-3
STIFF = 210e9 / (1.0 - 0.3**2)
TURNS = 'joint.flight.spin=["300 rad/s", "950 rad/s", "0 rad/s"]'


def ball_by(*overrides: str) -> Pipeline:
    return open_scene("verification/ball", None, overrides)


def rolling_ball(speed: float, spin: float, duration: float, *overrides: str) -> Pipeline:
    """Open a ball of 31 g on the plane, pressed by 1 N, at half of the depth in which it rests: it sways by that."""
    depth = 0.5e3 * (0.75 / (STIFF * np.sqrt(RADIUS))) ** (2.0 / 3.0)
    return ball_by(
        f'joint.flight.velocity=["{speed} m/s", "0 m/s", "0 m/s"]',
        f'joint.flight.spin=["0 rad/s", "{spin} rad/s", "0 rad/s"]',
        'simulation.gravity=["0 m/s^2", "0 m/s^2", "-31 m/s^2"]',
        f"contact.floor.clearance={-1e-3 - depth} mm",
        f"simulation.duration={1e3 * duration} ms",
        f"simulation.output_step={10e3 * duration} us",
        *overrides,
    )


def pressures_over_hertz(run: Pipeline) -> Array:
    """``p₀ = 3 F/(2 π a²)`` with ``a³ = 3 F R/(4 E*)``, where at least a tenth of the largest force presses."""
    own = run.motion.contacts["floor"]
    force = own.force[:, 2]
    radius = np.cbrt(0.75 * force * RADIUS / STIFF)
    pressed = force > 0.1 * force.max()
    return np.asarray(own.peak_pressure[pressed] * np.pi * radius[pressed] ** 2 / (1.5 * force[pressed]))


@pytest.fixture(scope="module")
def grid() -> CurvedGrid:
    (body,) = ball_by("contact.floor.points=60").mechanism.contacts
    (own,) = body.points.grids.values()
    return own


def test_a_ball_that_turns_in_its_shock_is_pressed_as_one_that_does_not() -> None:
    """It turns by 0.1 rad, six widths of the contact; its force was 0.3 % less, as on a grid that covers the way."""
    still, turning = ball_by(), ball_by(TURNS)
    wanted, found = (contact_figures(run)["contacts"]["floor"] for run in (still, turning))
    assert found["near_field"].endswith("that follows the contact")
    assert found["largest_force_n"] == pytest.approx(wanted["largest_force_n"], rel=5e-3)
    assert found["largest_pressure_pa"] == pytest.approx(wanted["largest_pressure_pa"], rel=1e-2)
    assert found["largest_stress_below_pa"] == pytest.approx(wanted["largest_stress_below_pa"], rel=1e-2)
    assert contact_warnings(turning) == []


@pytest.mark.parametrize(
    "run_by",
    ['integrator="central-difference"', 'integrator="generalized-alpha"', 'integrator="sub-cycling",substeps=4'],
)
def test_a_ball_that_rolls_without_friction_is_pressed_as_hertz_says_all_the_way(run_by: str) -> None:
    run = rolling_ball(0.5, 50.0, 0.5e-3, f"simulation.run=[{{{run_by}}}]")
    motion, own = run.motion, run.motion.contacts["floor"]
    (places,) = motion.touched.places.values() if motion.touched else ()
    assert np.ptp(places.mean(axis=1)[:, 0]) > 3.0 * np.sqrt(own.area.max())
    np.testing.assert_allclose(pressures_over_hertz(run), 1.0, atol=0.015)
    energy = motion.energies[0] + motion.energies[1] + own.energy
    np.testing.assert_allclose(energy, energy[0], atol=1e-3 * own.energy.max())
    assert not own.beyond_grid


def test_a_ball_that_slides_comes_to_roll_as_its_momentum_about_the_plane_says() -> None:
    """``v = v₀/(1 + k²)``, and friction takes ``k²/(1 + k²)`` of its energy: 5/7 and 2/7 of a sphere with k² = 2/5."""
    run = rolling_ball(0.05, 0.0, 2.5e-3, "contact.floor.friction=0.3")
    motion, own = run.motion, run.motion.contacts["floor"]
    mass, kinetic = motion.mechanism.mass, motion.energies[0]
    speed = motion.kinematics.momentum[:, 0] / mass
    spin = motion.kinematics.body_spin(0)[-1, 1]
    turning = 2.0 * kinetic[-1] / spin**2 - mass * (speed[-1] / spin) ** 2  # moment of inertia of the mesh
    k2 = turning / (mass * RADIUS**2)
    assert k2 == pytest.approx(0.4, rel=0.15)
    assert speed[-1] == pytest.approx(0.05 / (1.0 + k2), rel=0.01)
    assert spin * RADIUS == pytest.approx(speed[-1], rel=0.01)
    assert (np.diff(own.slip) >= 0.0).all()
    assert own.friction_work[-1] == pytest.approx(kinetic[0] * k2 / (1.0 + k2), rel=0.02)
    assert not own.beyond_grid


def test_a_grid_stays_where_its_face_ends_and_a_contact_that_goes_on_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its face is made to end 0.1 mm from where the ball begins, over which it rolls in two thirds of the time."""
    end, whole = 0.1e-3, CurvedGrid.is_on_face
    monkeypatch.setattr(CurvedGrid, "is_on_face", lambda grid, x: whole(grid, x) and bool(x[:, 0].max() < end))
    run = rolling_ball(0.5, 50.0, 0.3e-3)
    (places,) = run.motion.touched.places.values() if run.motion.touched else ()
    reached = places[:, :, 0].max(axis=1)
    assert reached[0] < 0.6 * end
    assert 0.9 * end < reached.max() < end
    assert run.motion.contacts["floor"].beyond_grid
    assert "contact-grid" in {warning["code"] for warning in contact_warnings(run)}


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_march_goes_on_from_a_state_whose_grid_has_travelled(friction: float) -> None:
    """Flexibilities about a place follow from the place, so that the motion is that of one march to round-off."""
    run = rolling_ball(0.5, 50.0, 0.1e-3, f"contact.floor.friction={friction}")
    second, whole = march_in_two_parts(run)
    np.testing.assert_allclose(second, whole, rtol=0.0, atol=1e-12 * np.abs(run.motion.trajectory.q).max())


def test_rectangles_that_stay_keep_their_places_and_those_ahead_are_as_far_apart(grid: CurvedGrid) -> None:
    there = grid.goes_on(grid.start, np.array([3, -2]))
    ahead = grid.places(there, grid.cells)
    before = grid.places(grid.start, grid.cells + np.array([3, -2]))
    assert np.linalg.norm(ahead - before, axis=1).max() < 0.01 * grid.cell[0]
    np.testing.assert_allclose(grid.surface.values(ahead), 0.0, atol=1e-9 * np.abs(grid.surface.A).max() * RADIUS**2)
    np.testing.assert_allclose(there.axes @ there.axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(there.axes[0], -there.place / RADIUS, atol=1e-6)


def test_a_place_beyond_the_nodes_of_a_face_is_not_on_it(grid: CurvedGrid) -> None:
    assert grid.is_on_face(grid.places(grid.start, grid.cells))
    far = GridFrame(grid.start.place - 3.0 * RADIUS * grid.start.axes[1], grid.start.axes)
    assert not grid.is_on_face(far.place[None])
    assert not grid.is_on_face(np.full((1, 3), np.nan))


def test_a_grid_stays_where_faces_wear() -> None:
    worn = ball_by('contact.floor.wear="1e-14 1/Pa"', "contact.floor.friction=0.1")
    assert contact_figures(worn)["contacts"]["floor"]["near_field"].endswith("mm")

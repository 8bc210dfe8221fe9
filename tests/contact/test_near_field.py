"""Grids on curved faces, whose near field is a half-space's, against Hertz, Cattaneo and Mindlin, and integrals."""

import numpy as np
import pytest
from scipy.optimize import nnls

from fmd import Pipeline
from fmd.accuracy.contact_errors import contact_errors
from fmd.contact.half_space import half_space_flexibility, point_flexibility
from fmd.core.arrays import Array
from fmd.output.contacts import contact_figures, contact_warnings
from fmd.recovery.stress_below import point_force_stress
from fmd.verification.case import open_scene

RADIUS, WIDE = 10.0, 0.25  # of a sphere and of its contact


def disc(count: int, half: float) -> tuple[Array, float]:
    """Return middles of squares in a circle, and their sides."""
    n = int(np.sqrt(4 * count / np.pi))
    middles = (np.arange(n) + 0.5) / n * 2 * half - half
    places = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    return places[np.hypot(*places.T) < half], 2 * half / n


def test_rectangles_move_as_the_integral_over_points_says() -> None:
    cell, places = (0.3, 0.5), np.array([[0.0, 0.0], [0.3, 0.0], [0.6, 1.0], [1.2, -1.0]])
    found = half_space_flexibility(places, cell, 2.1, 0.3)
    np.testing.assert_allclose(found, found.transpose(2, 3, 0, 1), atol=1e-14)
    middles = (np.arange(200) + 0.5) / 200 - 0.5
    sources = np.stack(np.meshgrid(cell[0] * middles, cell[1] * middles), axis=-1).reshape(-1, 2)
    for k in range(1, 4):
        r = np.hypot(*(places[k] - sources).T)
        along = np.column_stack([np.zeros(len(r)), (places[k] - sources) / r[:, None]])
        exact = point_flexibility(r, along, np.eye(3)[np.zeros(len(r), dtype=int)], 2.1, 0.3).mean(axis=0)
        np.testing.assert_allclose(found[k, :, 0], exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize(("count", "force_error", "peak_error"), [(80, 0.01, 0.03), (250, 0.005, 0.005)])
def test_a_sphere_is_pressed_as_hertz_says(count: int, force_error: float, peak_error: float) -> None:
    """``F = 4/3 E* √R δ^1.5`` and ``p₀ = 3 F/(2 π a²)``."""
    E, nu = 210e3, 0.3
    places, side = disc(count, 1.25 * WIDE)
    D = half_space_flexibility(places, (side, side), E, nu)[:, 0, :, 0]
    approach, stiff = WIDE**2 / RADIUS, E / (1 - nu**2)
    L = np.linalg.cholesky(D)
    force, _ = nnls(L.T, -np.linalg.solve(L, (places**2).sum(axis=1) / (2 * RADIUS) - approach))
    assert force.sum() == pytest.approx(4 / 3 * stiff * np.sqrt(RADIUS) * approach**1.5, rel=force_error)
    a = (0.75 * force.sum() * RADIUS / stiff) ** (1 / 3)
    assert force.max() / side**2 == pytest.approx(1.5 * force.sum() / (np.pi * a**2), rel=peak_error)


def test_a_roller_is_pressed_in_its_middle_as_hertz_says() -> None:
    """``p₀ = √(q E*/(π R))`` with the force on its length there, q; rectangles are seven times as long as wide."""
    E, nu, side = 210e3, 0.3, (2.6 * WIDE / 13, 20 * WIDE / 15)
    middles = [(np.arange(n) - (n - 1) / 2) * own for n, own in zip((13, 15), side, strict=True)]
    places = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)
    D = half_space_flexibility(places, side, E, nu)[:, 0, :, 0]
    L, approach = np.linalg.cholesky(D), 2.0 * WIDE**2 / RADIUS
    force, _ = nnls(L.T, -np.linalg.solve(L, places[:, 0] ** 2 / (2 * RADIUS) - approach))
    middle = force.reshape(13, 15)[:, 7]
    assert middle[0] == middle[-1] == 0.0
    line = middle.sum() / side[1]
    assert middle.max() / (side[0] * side[1]) == pytest.approx(
        np.sqrt(line * E / (1 - nu**2) / np.pi / RADIUS), rel=0.01
    )


def ball_by(*overrides: str) -> Pipeline:
    return open_scene("verification/ball", None, overrides)


@pytest.fixture(scope="module")
def ball() -> Pipeline:
    return ball_by()


def test_a_ball_of_coarse_elements_has_a_grid_and_nothing_to_warn_of(ball: Pipeline) -> None:
    assert contact_figures(ball)["contacts"]["floor"]["near_field"].startswith("half-space")
    assert contact_warnings(ball) == []


def test_a_grid_that_is_too_small_or_too_coarse_is_warned_of(ball: Pipeline) -> None:
    narrow = ball.variant(ball_by("contact.floor.width=0.1 mm").scene)
    assert "reaches the border" in " ".join(own["text"] for own in contact_warnings(narrow))
    wide = ball.variant(ball_by("contact.floor.width=1.5 mm").scene)
    assert "are pressed, of which 32 give" in " ".join(own["text"] for own in contact_warnings(wide))


def test_few_points_of_a_curved_mesh_are_warned_of(ball: Pipeline) -> None:
    meshed = ball.variant(ball_by('contact.floor.near_field="mesh"').scene)
    (coarse,) = [own for own in contact_warnings(meshed) if own["code"] == "contact-coarse"]
    assert "points of a curved face are pressed, of which 12 give the force to 2 %" in coarse["text"]


def test_a_face_that_may_touch_between_nodes_which_miss_the_plane_is_told(ball: Pipeline) -> None:
    """A ball that turns as it comes down by 9 µm; not one that is higher than it bulges, by h²/4R."""
    meshed = 'contact.floor.near_field="mesh"'
    turned = ball.variant(ball_by(meshed, 'joint.flight.spin=["0 rad/s","1000 rad/s","0 rad/s"]').scene)
    (missed,) = [own["text"] for own in contact_warnings(turned) if own["code"] == "contact-unseen"]
    assert "bulges by as much between nodes, which come within 8.75e-07 m of the plane" in missed
    assert 1e-5 < float(missed.split("up to ")[1].split(" m")[0]) < 9e-3**2 / (4 * 10e-3)
    above = ball.variant(ball_by(meshed, "contact.floor.clearance=3 mm").scene)
    assert [own for own in contact_warnings(above) if own["code"] == "contact-unseen"] == []


def test_stress_under_forces_on_points_is_in_equilibrium_with_them_and_itself() -> None:
    """Its divergence is 0, planes below bear the whole force, and the surface beside it bears nothing."""
    nu, step, force = 0.3, 1e-3, np.array([[2.0, 0.7, -0.4]])
    source, place = np.zeros((1, 2)), np.array([0.3, -0.2])

    def stress(x: float, y: float, z: float) -> Array:
        xx, yy, zz, yz, xz, xy = point_force_stress(np.array([[x, y]]), source, force, z, nu)[0]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    at = np.array([*place, 0.5])
    slopes = [(stress(*(at + d)) - stress(*(at - d))) / (2 * step) for d in step * np.eye(3)]
    np.testing.assert_allclose(np.einsum("aab->b", np.array(slopes)), 0.0, atol=1e-4 * np.abs(slopes).max())
    middles = 0.25 * (np.arange(-400, 400) + 0.5)
    plane = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    tensors = point_force_stress(plane, source, force, 0.5, nu)
    np.testing.assert_allclose(-(0.25**2) * tensors[:, [2, 4, 3]].sum(axis=0), force[0], rtol=0.01)
    free = point_force_stress(place[None], source, force, 1e-9, nu)[0]
    np.testing.assert_allclose(free[[2, 3, 4]], 0.0, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize(("points", "speed"), [(60, 0.05), (120, 0.05), (250, 0.05), (120, 0.2)])
def test_the_error_by_the_grid_covers_what_a_ball_is_off_by_from_hertz(points: int, speed: float) -> None:
    """With the ball's own mass the mesh has no part in it: its curvature is exact."""
    run = ball_by(f"contact.floor.points={points}", f'joint.flight.velocity=["0 m/s", "0 m/s", "{-speed} m/s"]')
    radius, stiff = 1e-3 * RADIUS, 210e9 / (1.0 - 0.3**2)
    approach = (15.0 / 16.0 * run.mechanism.mass * speed**2 / (stiff * np.sqrt(radius))) ** 0.4
    force, area = 4.0 / 3.0 * stiff * np.sqrt(radius) * approach**1.5, np.pi * radius * approach
    exact = {"largest_force_n": force, "largest_pressure_pa": 1.5 * force / area, "largest_area_m2": area}
    figures, errors = contact_figures(run)["contacts"]["floor"], contact_errors(run)["floor"]
    for key, value in exact.items():
        parts = errors[key].summary()
        assert parts["near field"] > 0.0
        stated = 2.0 * np.sqrt(sum(parts[source] ** 2 for source in ("near field", "modes", "step")))
        assert abs(figures[key] - value) < stated < 0.6 * value, key

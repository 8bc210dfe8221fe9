"""Grids on curved faces, whose near field is a half-space's, against Hertz, Cattaneo and Mindlin, and integrals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls

from fmd import Pipeline, load_scene
from fmd.contact.half_space import half_space_flexibility, point_flexibility
from fmd.contact.touching_body import ContactPlane, ContactPoints, TouchingBody
from fmd.core.arrays import Array
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import evaluate
from fmd.meshes.gmsh_session import gmsh_model
from fmd.output.contacts import contact_figures, contact_warnings
from fmd.recovery.stress_below import point_force_stress
from fmd.scene.joints.free import FREE

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
        exact = point_flexibility((places[k] - sources)[None], 2.1, 0.3).mean(axis=2)[0]
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


def test_a_sphere_that_is_pushed_aside_slips_from_the_border_inwards() -> None:
    """Cattaneo and Mindlin: ``Q = μ F (1 − (1 − s/s₁)^1.5)`` up to the slide, which begins at s₁ = 3 μ F/(16 a G*).

    ν = 0.5, so that pressure doesn't move the surface along itself, as it doesn't between equal spheres.
    """
    E, nu, friction = 210e3, 0.5, 0.3
    places, side = disc(150, 1.1 * WIDE)
    n = len(places)
    foot = ContactPoints(
        x=np.column_stack([places, (places**2).sum(axis=1) / (2 * RADIUS)]),
        areas={"foot": np.full(n, side**2)},
        shapes=np.zeros((n, 3, 0)),
        G=half_space_flexibility(places, (side, side), E, nu)[:, [1, 2, 0]][..., [1, 2, 0]],
        faces={"foot": np.arange(n)},
    )
    plane = ContactPlane("floor", np.zeros(3), np.array([0.0, 0.0, 1.0]), friction, "foot")
    link = Link("ball", rigid_integrals(1.0, np.zeros(3), np.eye(3)), FREE)
    system = share_system(Mechanism([link], contacts=[TouchingBody("ball", foot, (plane,))]))
    q, p = system.mechanism.rest_positions, system.parameters
    c, q[2] = p.contact, -(WIDE**2) / RADIUS

    def press() -> None:
        evaluate(p, 0.0, q, np.zeros(6), np.zeros(6))
        c.tip[:] = c.spot + np.einsum("ikb,ik->ib", c.Q, c.moved)
        c.known[:], c.seen[:, 1] = np.einsum("ikb,ik->ib", c.Q, c.own), 1

    press()
    pressed = c.force[:, 0].sum()
    slide = 3 * friction * pressed / (16 * WIDE) * (2 - nu) * 2 * (1 + nu) / E
    for step, expected in enumerate([0.1462, 0.2845, 0.4143, 0.5352, 0.6464, 0.7470, 0.8357, 0.9106, 0.9684]):
        q[0] += 0.1 * slide
        press()
        across = np.linalg.norm((c.force[:, 1:, None] * plane.axes[1:]).sum(axis=(0, 1)))
        assert across / (friction * pressed) == pytest.approx(expected, abs=0.01), step


E, NU, R, SPEED = 210e9, 0.3, 0.01, 0.05
STIFF = E / (1 - NU**2)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A ball of steel of 10 mm that meets a plane at 50 mm/s."""
    file = tmp_path_factory.mktemp("ball") / "ball.step"
    with gmsh_model("ball") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.model.occ.addSphere(0, 0, 0, 10)
        gmsh.model.occ.synchronize()
        gmsh.write(str(file))
    body = {"E": "210 GPa", "nu": 0.3, "rho": "7850 kg/m^3", "modes": {"count": 4}}
    body |= {"mesh": {"cad": str(file), "size": "9 mm", "order": 1}}
    body |= {"marker": {"skin": {"near": ["0 mm", "0 mm", "-10 mm"]}}}
    flight = {"type": "free", "parent": "ground", "child": "ball.skin", "velocity": ["0 m/s", "0 m/s", "-50 mm/s"]}
    return {
        "title": "ball",
        "body": {"ball": body},
        "ground": {"floor": {"at": ["0 m", "0 m", "-10.001 mm"]}},
        "joint": {"flight": flight},
        "contact": {"floor": {"between": ["ground.floor", "ball.skin"], "normal": [0, 0, 1], "points": 250}},
        "simulation": {
            "duration": "0.2 ms",
            "output_step": "1 us",
            "step": "auto",
            "tip": "ball.skin",
            "gravity": ["0 m/s^2"] * 3,
            "run": [{"integrator": "central-difference"}],
        },
    }


@pytest.fixture(scope="module")
def ball(scene: dict[str, Any]) -> Pipeline:
    return Pipeline(load_scene(scene))


def test_a_ball_of_coarse_elements_bounces_as_hertz_says(ball: Pipeline) -> None:
    """Largest approach ``(15 m v²/(16 E* √R))^0.4``, contact for 2.9432 of it over v; modes take next to nothing."""
    floor, mass = contact_figures(ball)["contacts"]["floor"], ball.mechanism.mass
    assert floor["near_field"].startswith("half-space")
    approach = (15 / 16 * mass * SPEED**2 / (STIFF * np.sqrt(R))) ** 0.4
    largest = 4 / 3 * STIFF * np.sqrt(R) * approach**1.5
    assert floor["largest_force_n"] == pytest.approx(largest, rel=0.01)
    assert floor["largest_pressure_pa"] == pytest.approx(1.5 * largest / (np.pi * R * approach), rel=0.01)
    assert floor["largest_stress_below_pa"] == pytest.approx(0.62 * floor["largest_pressure_pa"], rel=0.02)
    assert floor["its_depth_m"] == pytest.approx(0.48 * np.sqrt(R * approach), rel=0.06)
    assert floor["end_s"] - floor["begin_s"] == pytest.approx(2.9432 * approach / SPEED, rel=0.02)
    assert floor["impulse_n_s"][2] == pytest.approx(2 * mass * SPEED, rel=0.01)
    assert floor["largest_area_m2"] == pytest.approx(np.pi * R * approach, rel=0.05)
    assert contact_warnings(ball) == []


def test_a_grid_that_is_too_small_or_too_coarse_is_warned_of(scene: dict[str, Any], ball: Pipeline) -> None:
    narrow = ball.variant(load_scene(scene, ["contact.floor.width=0.1 mm"]))
    assert "reaches the border" in " ".join(own["text"] for own in contact_warnings(narrow))
    wide = ball.variant(load_scene(scene, ["contact.floor.width=1.5 mm"]))
    assert "are pressed, of which 32 give" in " ".join(own["text"] for own in contact_warnings(wide))


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

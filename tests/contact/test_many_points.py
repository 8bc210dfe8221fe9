"""Faces with more points than are followed at once, against the same faces with all of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.contact import assemble
from fmd.contact.touching_body import TouchingBody
from fmd.core.arrays import Array
from fmd.core.cache import Cache
from fmd.core.errors import StabilityError
from fmd.core.limits import contact as limits
from fmd.integrators.protocol import evaluate
from fmd.stages.basis import ConstrainedModel
from fmd.stages.contacts import find_contact_points
from tests.contact.test_between_nodes import BODY, STEEL, ball_onto_plate, free
from tests.contact.test_contact_points import BLOCK, block
from tests.contact.test_friction_newton import remember
from tests.contact.test_pairs import rod_on_block

FRICTION = 0.3


def ball_along_plate(modes: int) -> Pipeline:
    """A ball of 3 m that comes down on a plate of 9 × 9 points at 1 m/s, and 100 m/s along it."""
    plate: dict[str, Any] = BLOCK["body"]["block"] | {
        "length": 0.04,
        "depth": 0.01,
        "width": 0.04,
        "mesh": {"divisions": [8, 1, 8], "order": 1},
        "modes": {"count": modes, "enrich": "none"},
        "marker": {"middle": {"at": [0.02, 0, 0]}, "above": {"face": "y+"}},
    }
    joints = {
        "flight": free("ball.centre", [-0.003, 3.005001, 0.0003], [100.0, -1.0, 0]),
        "rest": free("plate.middle", [0, 0, 0], [0, 0, 0]),
    }
    ball = BODY | {"surface": {"skin": {"type": "ball", "radius": 3.0, **STEEL}}}
    scene = BLOCK | {
        "body": {"plate": plate, "ball": ball},
        "joint": joints,
        "contact": {"hit": {"between": ["plate.above", "ball.skin"], "friction": FRICTION}},
        "simulation": BLOCK["simulation"]
        | {"duration": 6e-5, "output_step": 2e-6, "step": 1.8e-7, "tip": "ball.centre", "gravity": [0, 0, 0]},
    }
    return Pipeline(load_scene(scene))


def with_few(run: Pipeline, body: str, most: int, monkeypatch: pytest.MonkeyPatch) -> Pipeline:
    """The same scene, of whose points so many are followed at once."""
    few = Pipeline(run.scene, run.store.cache)
    for module in (limits, assemble):
        monkeypatch.setattr(module, "MOST_POINTS", most)
    few.parts[body].results["contact"] = find_contact_points(few.parts[body])
    return few


def forces(run: Pipeline, body: str) -> Array:
    assert run.motion.touched is not None
    return run.motion.touched.forces[body]


@pytest.mark.parametrize("modes", [6, 30])
def test_points_that_come_near_have_the_forces_of_all(modes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the same step: one that differs by a billionth changes forces by a ten millionth."""
    whole = ball_along_plate(modes)
    expected, limit, all_points = forces(whole, "plate"), whole.system.largest_step, whole.parts["plate"].contact_points
    few = with_few(whole, "plate", 64, monkeypatch)
    found = forces(few, "plate")
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
    assert few.system.largest_step == pytest.approx(limit, rel=1e-6)
    own = few.parts["plate"].contact_points
    blocks = np.einsum("iaib->iab", all_points.G)
    np.testing.assert_allclose(own.softness, np.linalg.eigvalsh(blocks)[:, -1], rtol=1e-6)
    touched = next(body for body in few.system.mechanism.contacts if body.body == "plate").points
    assert touched.columns is not None
    assert (np.abs(expected).max(axis=(0, 2)) > 0.0).sum() >= 4
    some = np.arange(0, len(own.x), 5)
    entries = all_points.between(some)
    np.testing.assert_allclose(touched.between(some), entries, rtol=0.0, atol=1e-9 * np.abs(entries).max())


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_nodes_below_points_and_corners_have_columns_too(friction: float, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = rod_on_block(friction, "1.6 us")
    expected = forces(whole, "rod")
    found = forces(with_few(whole, "block", 20, monkeypatch), "rod")
    assert np.abs(expected).max() > 0.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


def test_flexibility_that_modes_have_nearly_all_of_is_raised_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each direction in which they leave less than a thousandth of the whole."""
    whole = block("body.block.modes.count=150")
    expected = whole.parts["block"].contact_points
    few = with_few(whole, "block", 8, monkeypatch)
    (touching,) = few.system.mechanism.contacts
    assert expected.raised > 0.0
    assert touching.points.raised == pytest.approx(expected.raised)
    everything = np.arange(len(expected.x))
    np.testing.assert_allclose(touching.points.between(everything), expected.G, atol=1e-9 * np.abs(expected.G).max())
    J = np.concatenate([np.broadcast_to(np.eye(3), (len(expected.x), 3, 3)), expected.shapes], axis=2)
    stiffness = TouchingBody("block", expected).stiffness(J)
    np.testing.assert_allclose(touching.stiffness(J), stiffness, atol=1e-6 * np.abs(stiffness).max())


def test_a_body_with_many_points_is_set_down(monkeypatch: pytest.MonkeyPatch) -> None:
    ceiling = 'contact.ceiling={between=["ground","block.top"],normal=[0,-1,0],clearance="1 m"}'
    whole = block('simulation.start="equilibrium"', 'body.block.marker.top={face="y+"}', ceiling)
    expected = forces(whole, "block")
    assert (expected[0] != 0.0).any(axis=1).sum() == 15
    found = forces(with_few(whole, "block", 20, monkeypatch), "block")
    np.testing.assert_allclose(found[0], expected[0], rtol=0.0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("damping", "remedy"),
    [
        ("0 us", "; a smaller face or larger elements help"),
        ("0.5 us", ", with damping all before a plane; a smaller face, larger elements or no damping helps"),
    ],
)
def test_more_points_at_once_than_there_is_room_for_are_refused(
    damping: str, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = with_few(block(f'contact.floor.damping="{damping}"'), "block", 8, monkeypatch)
    with pytest.raises(StabilityError, match=f"more than 1000 points come near at once{remedy}"):
        _ = few.motion


def test_columns_that_are_stored_take_no_factor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, found, some = block(), list[Array](), np.array([1, 4, 7])
    for _ in range(2):
        few = with_few(Pipeline(whole.scene, Cache(tmp_path)), "block", 8, monkeypatch)
        monkeypatch.setattr(ConstrainedModel, "solver_on_joint", lambda *_: pytest.fail("asked for"))
        (touching,) = few.system.mechanism.contacts
        if not found:
            monkeypatch.undo()
        found.append(touching.points.between(some))
    np.testing.assert_array_equal(found[1], found[0])


def test_points_far_from_a_rigid_surface_are_not_placed_and_have_no_force() -> None:
    """Random steps of a ball, some of them long, against the forces of a system that places all: it takes no steps."""
    run, rng = ball_onto_plate(8, 0.5, duration=2e-5), np.random.default_rng(6)
    q, p, other, pressed, placed = run.motion.trajectory.q[0], run.system.parameters, run.system.parameters, 0, 0
    for k in range(120):
        q = q + np.eye(len(q))[:3].T @ rng.uniform(-1.0, 1.0, 3) * (1e-4 if k % 30 == 0 else 1e-6)
        q[1] = np.clip(q[1], 0.504984, 0.504994)
        for own in (p, other):
            evaluate(own, float(k), q, np.zeros(run.system.n), np.zeros(run.system.n))
        found, expected = p.contact.force, other.contact.force
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
        pressed += int(expected.any())
        placed += p.contact.seen[:, 0].sum()
        assert other.contact.seen[:, 0].all()
        remember(p, float(k), q, np.zeros(run.system.n))
    assert 20 < pressed < 110
    assert placed < 0.5 * 120 * len(p.contact.node)

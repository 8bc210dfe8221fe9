"""Rigid surfaces that go between the nodes of a face, which alone touch them: said with the depth, against geometry."""

from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.contact.primitives import BALL, BORE, BOX, PIN, Primitive
from fmd.output.contacts import contact_warnings, describe_depths, distances_from
from tests.contact.test_contact_points import BLOCK
from tests.contact.test_rigid_contacts import BALL as BODY
from tests.contact.test_rigid_contacts import STEEL, free

SIDE, SPEED = 0.04, 1.0


def ball_onto_plate(divisions: int, radius: float, beside: float = 0.0, duration: float = 2e-3) -> Pipeline:
    """A ball that falls onto the middle of an element of a plate, or beside it, in flight without gravity."""
    middle = 0.5 * SIDE / divisions * (1 - divisions % 2) + beside
    plate: dict[str, Any] = {
        "shape": "bar",
        "length": SIDE,
        "depth": 0.01,
        "width": SIDE,
        "E": 70e9,
        "nu": 0.3,
        "rho": 2700.0,
        "mesh": {"divisions": [divisions, 1, divisions], "order": 1},
        "modes": {"count": 2, "enrich": "none"},
        "marker": {"middle": {"at": [SIDE / 2, 0, 0]}, "above": {"face": "y+"}},
    }
    ball = BODY | {"surface": {"skin": {"type": "ball", "radius": radius, **STEEL}}}
    joints = {
        "flight": free("ball.centre", [middle, 0.005 + radius + 1e-5, middle], [0, -SPEED, 0]),
        "rest": free("plate.middle", [0, 0, 0], [0, 0, 0]),
    }
    simulation = BLOCK["simulation"] | {"duration": duration, "output_step": 2e-5, "tip": "ball.centre"}
    scene = BLOCK | {
        "body": {"plate": plate, "ball": ball},
        "joint": joints,
        "contact": {"hit": {"between": ["plate.above", "ball.skin"]}},
        "simulation": simulation | {"gravity": [0, 0, 0]},
    }
    return Pipeline(load_scene(scene))


def test_a_ball_that_falls_between_nodes_is_said_with_its_depth() -> None:
    """Smaller than an element it flies through, and is as deep at the end as it has flown."""
    run = ball_onto_plate(2, 0.004)
    assert run.motion.contacts["hit"].span == (None, None)
    (text,) = describe_depths(run, run.motion).values()
    assert "ball.skin goes up to 0.00199 m deeper into plate.above between its nodes" in text  # 1 m/s for 2 ms
    assert "elements of at most 0.0008 m there help" in text
    (text,) = (own["text"] for own in contact_warnings(run) if own["code"] == "contact-material")
    assert "ball.skin is rigid before a face of elements, and its E of 2.1e+11 Pa counts for nothing" in text


def test_a_ball_that_is_far_smaller_than_elements_is_said_wherever_it_falls() -> None:
    """It is as deep as its radius as its middle passes the face."""
    run = ball_onto_plate(2, 0.001, beside=0.00125, duration=1.1e-3)
    (text,) = describe_depths(run, run.motion).values()
    depth = float(text.split("up to ")[1].split(" m")[0])
    assert depth == pytest.approx(0.001, rel=0.1)


def test_a_ball_on_fine_elements_is_not() -> None:
    run = ball_onto_plate(8, 0.05, duration=4e-4)
    assert run.motion.contacts["hit"].impulse[-1, 1] > 0.0
    assert describe_depths(run, run.motion) == {}


@pytest.mark.parametrize(
    ("kind", "half", "exact"),
    [
        (BALL, (0, 0, 0), lambda x: np.linalg.norm(x, axis=1) - 0.1),
        (PIN, (0, 0, 9), lambda x: np.hypot(x[:, 0], x[:, 1]) - 0.1),
        (BORE, (0, 0, 9), lambda x: 0.1 - np.hypot(x[:, 0], x[:, 1])),
        (BOX, (0.3, 0.2, 0.4), lambda x: np.array([2.7, 0.3, -0.3])),
    ],
)
def test_distances_from_rigid_surfaces_are_those_of_geometry(kind: int, half: Any, exact: Any) -> None:
    x = np.array([[3.1, 0, 0], [0.1, 0.6, 0.2], [0.0, 0.0, 0.0]])
    rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    found = distances_from(Primitive(kind, (1.0, 2.0, 3.0), rows, half, 0.1), x + np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(found, exact(x), atol=1e-12)

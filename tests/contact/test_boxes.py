"""Boxes on boxes: corners on faces both ways, and edges that cross, against closed forms and conservation laws."""

from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from tests.contact.test_rigid_contacts import free, scene

SIDE, ROUNDING, MASS, E, NU = 0.1, 0.005, 1.0, 1e9, 0.3


def box(size: tuple[float, float, float], rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    squares = np.array(size) ** 2
    surface = {"type": "box", "size": list(size), "rotation": list(rotation), "E": E, "nu": NU, "rounding": ROUNDING}
    inertia = MASS / 12.0 * (squares.sum() - squares)
    if any(rotation):  # one long side, turned about it
        assert size[1] == size[2]
    marker = {"middle": {"at": [0, 0, 0]}}
    return {"shape": "rigid", "mass": MASS, "inertia": inertia.tolist(), "marker": marker, "surface": {"skin": surface}}


def stack(x: float, y: float, duration: float) -> Pipeline:
    """A cube on a held one of its size, a little turned and moved along both sides; by less than half, it rests."""
    bodies = {"low": box((SIDE,) * 3), "high": box((SIDE,) * 3)}
    held = {"type": "fixed", "parent": "ground", "child": "low.middle"}
    place = [x, y, SIDE + 1e-6]
    joints = {"free": free("high.middle", place, [0, 0, 0]) | {"rotate": [0, 0, 0.05]}, "held": held}
    contact = {"on": {"between": ["low.skin", "high.skin"], "friction": 0.5, "damping": 5e-5}}
    return Pipeline(load_scene(scene(bodies, joints, contact, duration, gravity=[0, 0, -10.0], step=1e-5)))


def test_a_cube_stands_on_the_corners_of_what_it_shares_with_another() -> None:
    """Two of these are where edges cross: without them it would tip over the line between the other two."""
    run = stack(0.3 * SIDE, 0.1 * SIDE, 0.04)
    own, motion = run.motion.contacts["on"], run.motion
    later = motion.times > 0.02
    np.testing.assert_allclose(own.force[later].mean(axis=0), [0.0, 0.0, 10.0 * MASS], atol=0.05 * 10.0 * MASS)
    place = np.array([0.3 * SIDE, 0.1 * SIDE, SIDE])
    np.testing.assert_allclose(motion.trajectory.q[:, :3], [place] * len(motion.times), atol=1e-4)
    assert np.abs(motion.trajectory.v[-1, 3:]).max() < 0.1  # over the line of two corners: 1 rad/s
    assert own.lost_part(motion.energies[0]) < 1e-3  # as tangents jump with the normal; 0.06 if their dents stayed


def test_a_cube_that_is_more_than_half_beyond_tips() -> None:
    motion = stack(0.75 * SIDE, 0.0, 0.05).motion
    assert np.linalg.norm(motion.trajectory.v[-1, 3:]) > 1.0


def crossing(turn: float, speed: float = 0.0, **contact: Any) -> Pipeline:
    """Two long boxes that meet with edges across each other at an angle [rad], and slide along."""
    quarter, high = np.pi / 4, np.sqrt(2.0) * (0.5 * 0.04 - ROUNDING) + ROUNDING
    bodies = {name: box((0.2, 0.04, 0.04), (quarter, 0.0, 0.0)) for name in ("low", "high")}
    joints = {
        "high": free("high.middle", [0, 0, 2 * high + 1e-6], [speed, 0, -0.1]) | {"rotate": [0, 0, turn]},
        "low": free("low.middle", [0.02 if speed else 0.0, 0, 0], [0, 0, 0.1]),
    }
    hit = {"hit": {"between": ["low.skin", "high.skin"], **contact}}
    return Pipeline(load_scene(scene(bodies, joints, hit, 4e-3)))


def test_edges_that_cross_at_a_right_angle_are_hertz_of_a_ball() -> None:
    """Crossed cylinders of one radius touch as a ball of it on a plane (Johnson, Contact Mechanics, 4.2)."""
    run, stiff = crossing(np.pi / 2), 0.5 * E / (1.0 - NU**2)
    energy = 0.5 * (0.5 * MASS) * 0.2**2
    approach = (energy * 15.0 / (8.0 * stiff * np.sqrt(ROUNDING))) ** 0.4
    own = run.motion.contacts["hit"].figures
    assert own["largest_force_n"] == pytest.approx(4.0 / 3.0 * stiff * np.sqrt(ROUNDING) * approach**1.5, rel=2e-3)
    np.testing.assert_allclose(run.motion.kinematics.momentum, 0.0, atol=1e-12)
    np.testing.assert_allclose(own["impulse_n_s"], [0.0, 0.0, 0.2 * MASS], atol=2e-4)


def test_boxes_that_meet_aslant_keep_momentum_and_energy() -> None:
    run = crossing(1.0, speed=0.1, friction=0.3)
    motion, own = run.motion, run.motion.contacts["hit"]
    whole = sum(motion.energies) + own.energy + own.friction_work
    assert np.abs(own.force).max() > 10.0
    assert own.friction_work[-1] > 0.0
    assert np.ptp(motion.kinematics.momentum, axis=0).max() < 1e-12
    assert np.ptp(motion.kinematics.angular_momentum, axis=0).max() < 1e-7
    assert abs(whole[-1] - whole[0]) < 0.01 * whole[0]

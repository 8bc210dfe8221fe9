"""An eccentric cam under a flat follower on a spring: friction's work a turn, and the speed at which it jumps."""

import numpy as np

from fmd import Pipeline, load_scene
from fmd.contact.round_laws import ball_law, joint_modulus
from tests.contact.test_rigid_contacts import STEEL, scene

RADIUS, ECCENTRIC, SPRING, PRELOAD, FRICTION = 0.02, 0.005, 20e3, 800.0, 0.2
JUMP = 14758 * 2 * np.pi / 60  # [rad/s], where m e ω² = F0 + k e
MASS = (PRELOAD + SPRING * ECCENTRIC) / (ECCENTRIC * JUMP**2)


def cam(rate: float, turns: float) -> Pipeline:
    """The follower starts as deep in the cam as the preload presses it, and as fast as the lift and the dent grow."""
    row = ball_law((1 / RADIUS, 1 / RADIUS), joint_modulus((STEEL["E"], STEEL["nu"]), (STEEL["E"], STEEL["nu"])))[0]
    dent = (PRELOAD / row[1]) ** (2 / 3)
    growing = (SPRING * ECCENTRIC - MASS * ECCENTRIC * rate**2) * rate / (1.5 * PRELOAD / dent)
    lobe = {"type": "ball", "radius": RADIUS, "at": [ECCENTRIC, 0, 0], **STEEL}
    face = {"type": "box", "size": [0.06, 0.02, 0.06], "at": [0, RADIUS + 0.01, 0], **STEEL}
    bodies = {
        "cam": {"mass": 0.1, "inertia": [1e-6] * 3, "surface": {"lobe": lobe}},
        "follower": {"mass": MASS, "inertia": [1e-5] * 3, "surface": {"face": face}},
    }
    bodies = {k: own | {"shape": "rigid", "marker": {"middle": {"at": [0, 0, 0]}}} for k, own in bodies.items()}
    joints = {
        "shaft": {"type": "revolute", "axis": [0, 0, 1], "parent": "ground", "child": "cam.middle"},
        "guide": {"type": "prismatic", "axis": [0, 1, 0], "parent": "ground", "child": "follower.middle"},
    }
    joints["guide"] |= {"spring": SPRING, "rest": -PRELOAD / SPRING, "rate": ECCENTRIC * rate - growing}
    contact = {"between": ["follower.face", "cam.lobe"], "friction": FRICTION, "clearance": -dent, "damping": 2e-6}
    own = scene(bodies, joints, {"flat": contact}, turns * 2 * np.pi / rate)
    motion = {"type": "motion", "joint": "shaft", "angle": {"formula": f"{rate}*t", "unit": "rad"}}
    own["simulation"]["tip"] = "follower.middle"
    return Pipeline(load_scene(own | {"drive": {"turn": motion}}))


def test_friction_of_a_cam_takes_the_work_of_the_rigid_pair_a_turn() -> None:
    """``μ (2π F0 R + π (k e − m e ω²) e)``, 20.416 J at 600 a minute."""
    rate = 600 * 2 * np.pi / 60
    run = cam(rate, 1.0)
    own = run.motion.contacts["flat"]
    more = np.pi * (SPRING * ECCENTRIC - MASS * ECCENTRIC * rate**2) * ECCENTRIC
    exact = FRICTION * (2 * np.pi * PRELOAD * RADIUS + more)
    assert abs(exact - 20.416) < 0.01
    np.testing.assert_allclose(own.friction_work[-1], exact, rtol=5e-3)
    assert abs(own.energy_error[-1]) < 0.005 * exact
    angle = rate * run.motion.times
    force = PRELOAD + (SPRING * ECCENTRIC - MASS * ECCENTRIC * rate**2) * np.sin(angle)
    np.testing.assert_allclose(-own.force[20:, 1], force[20:], rtol=0.02)


def test_the_follower_jumps_off_at_the_speed_of_the_rigid_pair() -> None:
    """Within 1 %; below it the contact is never lost, whatever little it rings."""
    below, above = (cam(part * JUMP, 1.0).motion.contacts["flat"] for part in (0.99, 1.01))
    assert (below.force[:, 1] != 0.0).all()
    assert (above.force[:, 1] == 0.0).any()

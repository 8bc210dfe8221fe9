"""Universal, cylindrical, planar and screw joints of scenes, against closed forms."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError

BODY = """
title = "Body on a joint"

[body.part]
shape = "rigid"
mass = "2 kg"
inertia = ["0.02 kg m^2", "0.03 kg m^2", "0.04 kg m^2"]
marker = { centre = { at = ["0 m", "0 m", "0 m"] }, side = { at = ["0.1 m", "0 m", "0 m"] } }

[simulation]
duration = "1 s"
output_step = "10 ms"
tip = "part.side"
gravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]

[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-11

[joint.only]
parent = "ground"
child = "part.centre"
"""


LOAD = """
[body.load]
shape = "point"
mass = "1 kg"
marker = { c = { at = ["0 m", "0 m", "0 m"] } }

[joint.rail]
type = "prismatic"
parent = "ground"
child = "load.c"
axis = [1, 0, 0]

"""


def run_of(folder: Path, text: str, *overrides: str) -> Pipeline:
    (folder / "scene.toml").write_text(text)
    return Pipeline(load_scene(folder / "scene.toml", overrides))


def coordinates(run: Pipeline) -> tuple[np.ndarray, np.ndarray]:
    return run.motion.kinematics.joint_coordinates(0)


def test_a_puck_on_a_plane_keeps_its_velocity_and_its_spin(tmp_path: Path) -> None:
    joint = 'type = "planar"\naxis = [0, 0, 1]\nposition = ["0.2 m", "-0.1 m"]\nangle = "30 deg"\n'
    run = run_of(tmp_path, BODY + joint + 'velocity = ["1 m/s", "2 m/s"]\nrate = "10 rad/s"\n')
    t = run.motion.times
    expected = np.stack([0.2 + t, -0.1 + 2 * t, np.pi / 6 + 10 * t], axis=1)
    assert coordinates(run)[0] == pytest.approx(expected, abs=1e-9)
    tip = expected[:, :2] + 0.1 * np.stack([np.cos(expected[:, 2]), np.sin(expected[:, 2])], axis=1)
    assert run.motion.tip_position[:, :2] == pytest.approx(tip, abs=1e-9)
    assert run.motion.tip_position[:, 2] == pytest.approx(0.0, abs=1e-12)


def test_a_cylindrical_joint_swings_along_and_about_its_axis(tmp_path: Path) -> None:
    joint = 'type = "cylindrical"\naxis = [0, 0, 2]\nspring = "200 N/m"\nrest = "0.3 m"\nposition = "0.25 m"\n'
    joint += 'turning_spring = "3 N m/rad"\nturning_damper = "0.1 N m s/rad"\nangle = "40 deg"\nvelocity = "0.5 m/s"\n'
    run = run_of(tmp_path, BODY + joint)
    t, (q, _) = run.motion.times, coordinates(run)
    still, omega = 0.3 - 2 * 9.81 / 200, np.sqrt(100)
    swing = still + (0.25 - still) * np.cos(omega * t) + 0.5 / omega * np.sin(omega * t)
    assert q[:, 0] == pytest.approx(swing, abs=1e-8)
    decay, damped = 0.1 / 0.08, np.sqrt(3 / 0.04 - (0.1 / 0.08) ** 2)
    turn = np.deg2rad(40) * np.exp(-decay * t) * (np.cos(damped * t) + decay / damped * np.sin(damped * t))
    assert q[:, 1] == pytest.approx(turn, abs=1e-8)


def test_a_part_runs_down_its_screw_as_its_lead_lets_it(tmp_path: Path) -> None:
    run = run_of(tmp_path, BODY + 'type = "screw"\naxis = [0, 0, 1]\nlead = "50 mm"\nrate = "2 rad/s"\n')
    lead = 0.05 / (2 * np.pi)
    slow = -2 * 9.81 * lead / (0.04 + 2 * lead**2)  # (J + m l²) φ̈ = −m g l
    t = run.motion.times
    angle = 2.0 * t + 0.5 * slow * t**2
    assert run.motion.joint_position("only") == pytest.approx(angle, abs=1e-9)
    assert run.motion.tip_position[:, 2] == pytest.approx(lead * angle, abs=1e-10)
    driven = '\n[drive.turn]\ntype = "motion"\njoint = "only"\nangle = { formula = "3*t", unit = "rad" }\n'
    free = BODY.replace("[joint.only]", f"{LOAD}[joint.only]")
    given = run_of(tmp_path, free + 'type = "screw"\naxis = [0, 0, 1]\nlead = "50 mm"\n' + driven).motion
    assert given.tip_position[:, 2] == pytest.approx(3 * lead * given.times, abs=1e-12)


SHAFTS = """
title = "Cardan shaft"
[body.one]
shape = "rigid"
mass = "1 kg"
inertia = ["0.01 kg m^2", "0.01 kg m^2", "0.01 kg m^2"]
marker = { end = { at = ["0 m", "0 m", "0 m"] } }
[body.two]
shape = "rigid"
mass = "1 kg"
inertia = ["0.01 kg m^2", "0.01 kg m^2", "0.01 kg m^2"]
marker = { start = { at = ["0 m", "0 m", "0 m"] }, rim = { at = ["0 m", "0.1 m", "0 m"] } }
[ground.tilted]
at = ["0 m", "0 m", "0 m"]
rotation = ["0 deg", "0 deg", "35 deg"]
[joint.input]
type = "revolute"
parent = "ground"
child = "one.end"
axis = [1, 0, 0]
[joint.output]
type = "revolute"
parent = "ground.tilted"
child = "two.start"
axis = [1, 0, 0]
[joint.cardan]
type = "universal"
parent = "one.end"
child = "two.start"
axis = [0, 1, 0]
child_axis = [0, 0, 1]
[simulation]
duration = "1 s"
output_step = "10 ms"
tip = "two.rim"
[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-11
"""


def test_a_universal_joint_closes_a_cardan_shaft_of_the_known_ratio(tmp_path: Path) -> None:
    run = run_of(
        tmp_path,
        SHAFTS.replace("axis = [1, 0, 0]\n[joint.output]", 'axis = [1, 0, 0]\nrate = "6 rad/s"\n[joint.output]'),
    )
    one, two = run.motion.joint_position("input"), run.motion.joint_position("output")
    # cos φ₁ sin φ₂ cos β = sin φ₁ cos φ₂: the joint's axes stay perpendicular.
    beta = np.deg2rad(35.0)
    assert np.cos(one) * np.sin(two) * np.cos(beta) == pytest.approx(np.sin(one) * np.cos(two), abs=1e-9)
    assert one[-1] > 5.0
    energy = np.sum(run.motion.energies, axis=0)
    assert energy == pytest.approx(energy[0], rel=1e-9)


def test_a_universal_joint_of_the_tree_starts_with_its_angles_and_rates(tmp_path: Path) -> None:
    joint = 'type = "universal"\naxis = [0, 1, 0]\nchild_axis = [1, 0, 0]\nangles = ["20 deg", "-30 deg"]\n'
    joint += 'rates = ["1 rad/s", "2 rad/s"]\nsprings = ["1 N m/rad", "2 N m/rad"]\n'
    joint += 'dampers = ["0.1 N m s/rad", "0 N m s/rad"]\n'
    run = run_of(tmp_path, BODY + joint)
    q, v = coordinates(run)
    assert np.rad2deg(q[0]) == pytest.approx([20.0, -30.0])
    assert v[0] == pytest.approx([1.0, 2.0])
    a, b = np.deg2rad([20.0, -30.0])
    Ry = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    Rx = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    assert run.motion.kinematics.frames[0].rotation[0] == pytest.approx(Ry @ Rx, abs=1e-12)
    assert run.motion.kinematics.frames[0].spin[0] == pytest.approx([0, 1, 0] + Ry @ [2, 0, 0], abs=1e-12)
    energy = np.sum(run.motion.energies, axis=0)
    assert energy[-1] < energy[0]


@pytest.mark.parametrize(
    ("joint", "key", "said"),
    [
        ('type = "universal"\naxis = [0, 1, 0]\nchild_axis = [1, 1, 0]', "child_axis", "perpendicular"),
        ('type = "planar"\naxis = [0, 0, 0]', "axis", "has no direction"),
        ('type = "screw"\naxis = [0, 0, 1]', "lead", "is missing"),
        ('type = "cylindrical"\naxis = [0, 0, 1]\nspring = "1 N m/rad"', "spring", "translational stiffness is wanted"),
    ],
)  # fmt: skip
def test_joints_that_can_not_be_are_refused(tmp_path: Path, joint: str, key: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        run_of(tmp_path, BODY + joint)
    assert caught.value.key == f"joint.only.{key}"
    assert said in str(caught.value)


def test_a_screw_can_not_close_a_loop(tmp_path: Path) -> None:
    screw = SHAFTS.replace('type = "universal"', 'type = "screw"\nlead = "1 mm"').replace(
        "child_axis = [0, 0, 1]\n", ""
    )
    with pytest.raises(InputError, match=r"joint\.cardan\.type = 'screw': can't close a loop"):
        run_of(tmp_path, screw)

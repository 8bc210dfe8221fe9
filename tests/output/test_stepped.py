"""A scene in the hands of a program: against the exact recurrence and the scene's own controllers, and faults."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import fmd
from fmd.core.errors import InputError

INERTIA = 2 / 3  # of the rod about its hinge [kg m²]
ROD = """
title = "Rod"

[body.rod]
shape = "rod"
mass = "2 kg"
length = "1 m"
marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }

[joint.hinge]
type = "revolute"
parent = "ground"
child = "rod.hinge"
axis = [0, 0, 1]

[drive.motor]
type = "torque"
joint = "hinge"
torque = { formula = "command + inner", unit = "N m" }

[controller.inner]
type = "pid"
error = "-hinge.rate"
proportional = 1.0
sample_time = "10 ms"

[controller.command]
type = "external"
value = 0.5

[simulation]
duration = "0.5 s"
output_step = "5 ms"
tip = "rod.end"

[[simulation.run]]
integrator = "auto"
"""
OBSERVED = ["hinge.angle", "hinge.rate", "rod.end.x", "inner"]


@pytest.fixture
def scene(tmp_path: Path) -> fmd.Scene:
    file = tmp_path / "rod.toml"
    file.write_text(ROD)
    return fmd.load_scene(file)


def test_steps_are_those_of_the_exact_recurrence(scene: fmd.Scene):
    times, seen = fmd.SteppedScene(scene, OBSERVED, 5e-3).run(lambda t, seen: [40 * (0.3 - seen[0])])
    block = expm(np.array([[0, 1, 0], [0, 0, 1 / INERTIA], [0, 0, 0]]) * 5e-3)
    x, inner, exact = np.zeros(2), 0.0, []
    for k in range(len(times)):
        # What is seen where the scene's own controller samples is its value before: it samples as the step begins.
        exact.append([*x, np.cos(x[0]), inner])
        inner = -x[1] if k % 2 == 0 else inner
        x = (block @ [*x, 40 * (0.3 - x[0]) + inner])[:2]
    assert times == pytest.approx(np.arange(101) * 5e-3, abs=1e-15)
    assert np.abs(seen - exact).max() < 1e-10


def test_a_program_does_what_the_same_controller_in_the_scene_does(scene: fmd.Scene, tmp_path: Path):
    own = (
        '\n[controller.command]\ntype = "pid"\nerror = "0.3 - hinge.angle"\nproportional = 40.0\nsample_time = "5 ms"\n'
    )
    file = tmp_path / "own.toml"
    file.write_text(ROD.replace('\n[controller.command]\ntype = "external"\nvalue = 0.5\n', own))
    motion = fmd.load(file).motion
    _, seen = fmd.SteppedScene(scene, OBSERVED, 5e-3).run(lambda t, seen: [40 * (0.3 - seen[0])])
    assert np.abs(seen[:, 0] - motion.joint_position("hinge")).max() < 1e-10


def test_it_begins_anew_bit_for_bit_and_takes_any_step(scene: fmd.Scene):
    env = fmd.SteppedScene(scene, ["hinge.angle"], 0.02)
    assert env.actions == ("command",)
    first = [env.step([1.0])[0].copy() for _ in range(5)]
    observation, info = env.reset(seed=3)
    assert (observation.tolist(), info) == ([0.0], {"time": 0.0})
    assert [env.step([1.0])[0].tolist() for _ in range(5)] == [each.tolist() for each in first]
    _, reward, terminated, truncated, info = env.step(dt=0.003)  # the value stays
    assert (reward, terminated, truncated) == (0.0, False, False)
    assert info["time"] == pytest.approx(0.103, abs=1e-15)
    assert env.step()[4]["time"] == pytest.approx(0.123, abs=1e-15)
    q, v = env.state
    assert (q.shape, v.shape) == ((1,), (1,))
    while not truncated:
        _, _, _, truncated, info = env.step()
    assert (info["time"], env.time) == (0.5, 0.5)


def test_what_it_keeps_is_the_value_of_the_scene(scene: fmd.Scene):
    env = fmd.SteppedScene(scene, ["hinge.angle", "command"], 0.01)
    (angle, command), *_ = env.step()
    assert command == 0.5
    assert angle == pytest.approx(0.5 * 0.5 / INERTIA * 0.01**2, rel=1e-9)


def test_what_means_nothing_is_refused(scene: fmd.Scene):
    env = fmd.SteppedScene(scene)
    for action in ([1.0, 2.0], [np.nan]):
        with pytest.raises(ValueError, match="an action holds one finite number for each of command, not"):
            env.step(action)
    with pytest.raises(InputError, match=r"observe = 'hinge\.angel'.*there is no 'hinge\.angel'"):
        fmd.SteppedScene(scene, ["hinge.angel"])
    with pytest.raises(InputError, match="no such joint"):
        fmd.SteppedScene(scene, ["elbow.angle"])
    with pytest.raises(InputError, match="must be a time above 0"):
        fmd.SteppedScene(scene, sample_time=0.0)

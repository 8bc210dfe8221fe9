"""Every motion of a scene's joints has inertia, or the scene is refused before anything is integrated."""

from pathlib import Path
from typing import Any

import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError

SCENE = """
title = "A body without extent"
[body.part]
SHAPE
marker = { at = { at = ["0 m", "0 m", "0 m"] } }
[joint.ball]
JOINT
parent = "ground"
child = "part.at"
[simulation]
duration = "1 s"
output_step = "10 ms"
tip = "part.at"
run = [{ integrator = "auto" }]
"""
ROD, POINT = 'shape = "rod"\nmass = "1 kg"\nlength = "1 m"', 'shape = "point"\nmass = "1 kg"'
HINGE = 'type = "revolute"\naxis = [1, 0, 0]'


def scene(folder: Path, shape: str, joint: str) -> Pipeline:
    file = folder / "scene.toml"
    file.write_text(SCENE.replace("SHAPE", shape).replace("JOINT", joint))
    return Pipeline(load_scene(file))


@pytest.mark.parametrize(
    ("shape", "joint", "motion"),
    [
        (ROD, 'type = "spherical"', r"rotation about \[1, 0, 0\] in the child's axes"),
        (ROD, 'type = "free"', r"rotation about \[1, 0, 0\] in the child's axes"),
        (ROD, HINGE, "rotation;"),
        (POINT, HINGE, "rotation;"),
    ],
)
def test_a_motion_that_moves_no_mass_is_refused_with_its_joint(
    tmp_path: Path, shape: str, joint: str, motion: str
) -> None:
    with pytest.raises(InputError, match=rf"joint\.ball: nothing has inertia against its {motion}"):
        _ = scene(tmp_path, shape, joint).motions


def test_a_rod_that_turns_across_its_axis_is_taken(tmp_path: Path) -> None:
    run = scene(tmp_path, ROD, 'type = "revolute"\naxis = [0, 0, 1]\nrate = "1 rad/s"')
    assert run.motion.joint_position("ball")[-1] == pytest.approx(1.0)


def test_the_command_line_ends_with_status_2(tmp_path: Path, fmd: Any, capsys: pytest.CaptureFixture[str]) -> None:
    scene(tmp_path, ROD, 'type = "spherical"')
    assert fmd("run", tmp_path / "scene.toml", "--out", tmp_path / "out") == 2
    assert "Traceback" not in capsys.readouterr().err

"""A scene to start from, and what the shell completes."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from pipeline.cli.app import app
from pipeline.scene.reading import list_ready_scenes
from pipeline.scene.scene import load_scene


@pytest.mark.slow
def test_the_scene_to_start_from_runs_as_it_is_written(fmd, tmp_path, capsys):
    path = tmp_path / "part.toml"
    assert fmd("new", str(path)) == 0
    assert capsys.readouterr().out == f"{path} is written; fmd run {path} computes it\n"
    assert fmd("run", str(path), "--no-pictures", "--no-budget", "--out", str(tmp_path / "out"), "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    # Half a sine of torque gives the whole body its mean speed: 10 rad/s for 175 ms, and half of that for 50 ms.
    assert summary["final"]["joint_angle_rad"] == pytest.approx(10 * (0.2 - 0.05 / 2), rel=0.02)
    comments = [line for line in path.read_text().splitlines() if "#" in line]
    assert len(comments) > 30


def test_a_ready_scene_can_be_the_start(fmd, tmp_path):
    for name in list_ready_scenes():
        path = tmp_path / f"{name}.toml"
        assert fmd("new", str(path), "--from", name) == 0
        assert load_scene(path).model_dump() == load_scene(name).model_dump()


def test_a_file_that_exists_is_left_alone(fmd, tmp_path, capsys):
    path = tmp_path / "part.toml"
    path.write_text("mine")
    assert fmd("new", str(path)) == 2
    assert "exists already and is left as it is" in capsys.readouterr().err
    assert path.read_text() == "mine"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["part.txt"], "must end in .toml, e.g. part.toml"),
        (["part.toml", "--from", "beem"], "did you mean 'beam'"),
        (["file/part.toml"], "can't be written"),
    ],
)
def test_a_wrong_start_is_refused(fmd, arguments, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    assert fmd("new", *arguments) == 2
    assert said in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_shell_completes_commands_and_options(fmd, tmp_path, capsys):
    script = tmp_path / "fmd"
    assert fmd("--install-completion", "--shell", "bash", "--output", str(script)) == 0
    assert script.read_text() == app.generate_completion(shell="bash")
    ask = f"source {script}; COMP_WORDS=(fmd {{}}); COMP_CWORD={{}}; _fmd 2>/dev/null; echo ${{{{COMPREPLY[@]}}}}"
    for words, number, wanted in (("swe", 1, {"sweep"}), ("sweep --sch", 2, {"--scheduler"}), ("re", 1, {"report"})):
        done = subprocess.run(
            ["bash", "-c", ask.format(words, number)], capture_output=True, text=True, check=True, timeout=20
        )
        assert set(done.stdout.split()) == wanted

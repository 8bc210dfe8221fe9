"""A scene to start from, and what the shell completes."""

import json
import math
import re
import subprocess
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from fmd import Pipeline
from fmd.cli.app import app
from fmd.scene.scene import load_scene
from fmd.scene.schema import write_schema
from fmd.scene.toml_files import list_ready_scenes


@pytest.mark.slow
def test_the_scene_to_start_from_runs_as_it_is_written(fmd, tmp_path, capsys):
    path = tmp_path / "part.toml"
    assert fmd("new", str(path)) == 0
    assert capsys.readouterr().out == f"{path} is written; fmd run {path} computes it\n"
    assert fmd("run", str(path), "--no-pictures", "--no-budget", "--out", str(tmp_path / "out"), "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    # Half a sine of torque gives the whole body its mean speed: 10 rad/s for 175 ms, and half of that for 50 ms.
    assert summary["final"]["joint_positions"]["hub"] == pytest.approx(10 * (0.2 - 0.05 / 2), rel=0.02)
    comments = [line for line in path.read_text().splitlines() if "#" in line]
    assert len(comments) > 30


def test_the_contact_of_the_scene_to_start_from_is_sound_once_it_is_no_comment(fmd, tmp_path):
    path = tmp_path / "part.toml"
    assert fmd("new", path) == 0
    head, comments = path.read_text().split("# [ground.stop]")
    stop, tail = comments.split("\n\n", 1)
    text = head + re.sub("(?m)^# ", "", f"# [ground.stop]{stop}") + "\n\n" + tail.replace("# step", "step")
    path.write_text(text.replace('integrator = "auto"', 'integrator = "generalized-alpha"'))
    assert load_scene(path).contact["stop"].between == ("ground.stop", "part.side")


def test_a_ready_scene_can_be_the_start(fmd, tmp_path):
    for name in list_ready_scenes():
        path = tmp_path / f"{name}.toml"
        assert fmd("new", str(path), "--from", name) == 0
        assert load_scene(path).model_dump() == load_scene(name).model_dump()


def test_a_new_scene_names_the_schema_beside_it_by_which_editors_check_it(fmd, tmp_path):
    path = tmp_path / "part.toml"
    assert fmd("new", path) == 0
    first, text = path.read_text().split("\n", 1)
    schema = json.loads((tmp_path / first.removeprefix("#:schema ")).read_text())
    validator = jsonschema.Draft202012Validator(schema)
    assert validator.is_valid(tomllib.loads(text))
    assert not validator.is_valid(tomllib.loads(text.replace("axis =", "axes =")))


def test_a_tube_from_cad_is_held_at_its_end_not_at_its_whole_bore(fmd, tmp_path):
    from fmd.meshes.gmsh_session import gmsh_model

    with gmsh_model("tube") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        occ = gmsh.model.occ
        bore, rod = (occ.addCylinder(0, 0, 0, 300, 0, 0, radius) for radius in (8, 10))
        occ.cut([(3, rod)], [(3, bore)])
        occ.synchronize()
        gmsh.write(str(tmp_path / "tube.step"))
    assert fmd("new", tmp_path / "tube.toml", "--from", tmp_path / "tube.step") == 0
    scene = load_scene(tmp_path / "tube.toml")
    assert (scene.joint["mount"].child, scene.simulation.tip) == ("tube.xmin", "tube.xmax")


def test_a_scene_for_a_cad_part_has_a_line_for_each_face_and_runs(fmd, tmp_path, capsys):
    """The marker of the hole is on the cylinder, and the part is as heavy as its volume says."""
    from fmd.meshes.gmsh_session import gmsh_model

    with gmsh_model("lug") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # else that of the model before may be written
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(0, 0, 0, 60, 20, 10))], [(3, occ.addCylinder(10, 10, -1, 0, 0, 12, 5))])
        occ.synchronize()
        gmsh.write(str(tmp_path / "lug 1.step"))
    path = tmp_path / "scenes" / "lug.toml"
    assert fmd("new", path, "--from", tmp_path / "lug 1.step") == 0
    scene = load_scene(path)
    (body,) = scene.flexible.values()
    assert {name: marker.face for name, marker in body.marker.items()} == {"xmax": "xmax", "hole-1": "hole-1"}
    for name in ("xmin", "ymin", "ymax", "zmin", "zmax"):  # a line each, to be taken in
        assert f'\n# {name} = {{ face = "{name}" }} # plane' in path.read_text()
    assert (scene.joint["mount"].child, scene.simulation.tip) == ("lug-1.hole-1", "lug-1.xmax")
    capsys.readouterr()
    coarse = ["--set", "body.lug-1.mesh.size=6mm", "--set", "simulation.stiffening=off", "--set", "output=[]"]
    assert fmd("run", path, *coarse, "--no-budget", "--out", tmp_path / "out", "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["final"]["time_s"] == pytest.approx(scene.simulation.duration)
    part = Pipeline(load_scene(path, ["body.lug-1.mesh.size=6mm"])).part
    assert part.mass == pytest.approx(7850 * (60 * 20 - math.pi * 25) * 10e-9, rel=1e-3)
    radius = np.hypot(*(part.space.x[part.markers["hole-1"].nodes][:, :2] - 0.01).T)
    assert radius == pytest.approx(0.005, rel=1e-6)


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
        (["part.toml", "--from", "none.step"], "none.step: no such file"),
        (["part.toml", "--from", "part.docx"], "is no CAD file (.step"),
        (["part.toml", "--from", "file"], "is no CAD file (.step"),
        (["part.toml", "--from", "fan.msh"], 'a mesh by mesh = { file = "fan.msh", unit = "mm" }'),
    ],
)
def test_a_wrong_start_is_refused(fmd, arguments, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("file", "fan.msh"):
        Path(name).touch()
    assert fmd("new", *arguments) == 2
    assert said in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"file", "fan.msh"}


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


def test_a_schema_of_another_is_left_alone_and_an_own_one_is_renewed(fmd, tmp_path, capsys):
    schema, own = tmp_path / "scene.schema.json", write_schema()
    for text in ('{"title": "Scene"}', "[1]", "no JSON", own.replace('"title": "fmd scene"', '"title": "mine"', 1)):
        schema.write_text(text)
        path = tmp_path / "part.toml"
        assert fmd("new", path) == 0
        assert f"{schema} is another's and left as it is: the scene names no schema" in capsys.readouterr().out
        assert (schema.read_text(), path.read_text().partition("\n")[0][:8]) == (text, "# A scen"), text
        path.unlink()
    schema.write_text('{"title": "fmd scene"}')  # of another version
    assert fmd("new", path) == 0
    assert (schema.read_text(), path.read_text()[:9]) == (own, "#:schema ")


def test_a_schema_that_can_not_be_written_is_named_and_no_scene_left(fmd, tmp_path, capsys, monkeypatch):
    def full(path: Path, text: str) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("fmd.cli.new.write_text", full)
    assert fmd("new", tmp_path / "part.toml") == 2
    assert f"{tmp_path / 'scene.schema.json'}: can't be written: No space left" in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]

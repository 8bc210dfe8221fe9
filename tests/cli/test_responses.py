"""``fmd frf`` and ``fmd linearise``, and frequency responses that a scene lists."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from fmd import load_scene

SMALL = ("--set", "body.plate.mesh.divisions=[6,4,2]")
REDUCED = """
title = "Reduced"

[body.plate]
body = { file = "plate.nc" }
modes = { damping = 0.01 }
marker = { root = { node = "root" }, tip = { node = "tip" } }

[joint.clamp]
type = "fixed"
parent = "ground"
child = "plate.root"

[simulation]
duration = "1 ms"
output_step = "0.1 ms"
tip = "plate.tip"

[[simulation.run]]
integrator = "auto"
"""


def test_frf_gives_poles_zeros_and_files(fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    channels = ("--in", "side.z", "--out", "plate.tip.z", "--out", "plate.root.xx")
    folder = ("--folder", tmp_path, *SMALL)
    assert fmd("frf", "plate", *channels, "--to", "2kHz", "--points", 50, *folder, "--psd", "0.1", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert {"frequencies_hz", "real", "imaginary", "poles_hz", "damping"} <= found.keys()
    assert len(found["frequencies_hz"]) == len(found["real"]) == len(found["imaginary"])
    assert found["files"] == ["frf.png", "frf.csv", "frf.nc"]
    assert found["damping"][0] == pytest.approx(0.01)
    assert [row["unit"] for row in found["random"]] == ["m", "Pa"]
    with xarray.open_dataset(tmp_path / "frf.nc") as data:
        np.testing.assert_allclose(data["real"][:, 0, 0], found["real"])
        assert data["units"].values[:, 0].tolist() == ["m/N", "Pa/N"]
    with (tmp_path / "frf.csv").open() as file:
        header, first, *_ = csv.reader(file)
    assert header[3] == "plate.tip.z by side.z magnitude [m/N]"
    assert float(first[3]) == pytest.approx(np.hypot(found["real"][0], found["imaginary"][0]))
    assert fmd("frf", "plate", *channels, "--to", "2kHz", "--points", 5, "--no-budget", *folder) == 0
    assert "zeros of plate.tip.z by side.z" in " ".join(capsys.readouterr().out.split())


def test_linearise_names_states_inputs_and_outputs(
    fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert fmd("linearise", "plate", "--folder", tmp_path, *SMALL, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["inputs"] == [{"name": "drive.hammer", "unit": "N"}]
    assert [channel["name"] for channel in found["outputs"]] == ["plate.tip.x", "plate.tip.y", "plate.tip.z"]
    assert found["states"][0] == {"name": "plate.mode 1", "unit": "kg^(1/2) m"}
    assert found["files"] == ["model.npz", "model.mat"]
    model = np.load(tmp_path / "model.npz")
    assert model["A"].shape == (len(found["states"]),) * 2
    assert fmd("linearise", "plate", "--folder", tmp_path, *SMALL, "--format", "npz") == 0
    assert "plate.mode 1.rate" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--in", "side.z", "--out", "plate.tip.z", "--to", "2"), "needs a unit"),
        (("--in", "side.z", "--out", "plate.tip.z", "--to", "0 Hz"), "must be above zero"),
        (("--in", "side.z", "--out", "plate.tip.z", "--to", "10 Hz", "--from", "20 Hz"), "above the lowest"),
        (("--in", "side.z", "--out", "plate.tip.z", "--to", "10 Hz", "--points", "1"), "2 … 100000"),
        (("--in", "side.zz", "--out", "plate.tip.z", "--to", "10 Hz"), "no such input"),
        (("--in", "side.z", "--out", "plate.tip.z", "--to", "10 Hz", "--psd", "t"), "not of t"),
    ],
)
def test_a_wrong_option_is_refused(
    fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    assert fmd("frf", "plate", *arguments, "--folder", tmp_path, *SMALL) == 2
    assert message in capsys.readouterr().err


def test_a_scene_lists_its_responses(fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    listed = '{type="frf", file="frf.png", input="plate.side.z", output=["plate.tip.z", "plate.root.xx"], to="2kHz"}'
    options = ("--no-pictures", "--no-budget", "--out", tmp_path, *SMALL, "--set", "simulation.duration=5ms")
    options = (*options, "--set", f"output=[{listed}]", "--set", "output.0.psd=0.1")
    assert fmd("run", "plate", *options, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    (response,) = summary["responses"]
    assert response["files"] == ["frf.csv", "frf.nc"]
    assert {"frf.csv", "frf.nc"} <= set(summary["files"])
    assert response["outputs"] == ["plate.tip.z", "plate.root.xx"]
    assert len(response["random"]) == 2
    assert json.loads((tmp_path / "summary.json").read_text())["responses"] == summary["responses"]
    number = 0
    assert fmd("run", "plate", *options, "--set", f"output.{number}.input=plate.sid.z") == 2
    assert f"output.{number}.input = 'plate.sid.z': no such input" in capsys.readouterr().err
    assert fmd("run", "plate", *options, "--set", f"output.{number}.file=motion.png") == 2
    assert "over the motion's file" in capsys.readouterr().err
    assert fmd("run", "plate", *options, "--set", f"output.{number}.from=3kHz") == 2
    assert "must be below the highest frequency" in capsys.readouterr().err


def test_a_body_that_comes_reduced_is_not_corrected(
    fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert fmd("export", "plate", "--to", "python", "--out", tmp_path / "plate.nc", *SMALL) == 0
    (tmp_path / "scene.toml").write_text(REDUCED, encoding="utf-8")
    capsys.readouterr()
    channels = ("--in", "plate.tip.z", "--out", "plate.tip.z", "--to", "500 Hz", "--points", 5)
    assert fmd("frf", tmp_path / "scene.toml", *channels, "--folder", tmp_path, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [warning["code"] for warning in found["warnings"]] == ["not-corrected"]
    assert fmd("modes", "plate", *SMALL, "--json") == 0
    modes = json.loads(capsys.readouterr().out)["frequencies_hz"]
    assert found["poles_hz"][:3] == pytest.approx(modes[:3], rel=1e-6)


def test_the_plate_has_all_its_outputs(fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """Responses, envelope, fatigue, histories and extremes of one scene, pictures and tables alike."""
    sizes = [part for number in (2, 4, 5) for part in ("--set", f"output.{number}.size=[320, 240]")]
    options = ("--no-budget", "--out", tmp_path, *SMALL, "--set", "simulation.duration=5ms", *sizes)
    assert fmd("run", "plate", *options, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    wanted = {output.file for output in load_scene("plate").output} | {"frf.csv", "frf.nc"}
    assert wanted <= set(summary["files"])
    assert all((tmp_path / file).stat().st_size > 200 for file in summary["files"])
    assert summary["fatigue"]["life.png"]["repeats_to_failure"] > 1e6
    assert {row["quantity"] for row in summary["tables"]["extremes.csv"]} >= {"clamp.force.size", "clamp.moment.z"}


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--order", "0"], "--order = 0: must be 1 or more states"),
        (["--order", "4", "--error", "1 %"], "--order = 4: can't stand beside --error"),
        (["--error", "1"], "--error = '1': must be a percentage as text"),
    ],
)
def test_a_reduction_that_no_model_can_have_is_refused_before_one_is_computed(
    options: list[str], told: str, fmd, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fmd.stages.linear_model.linearise_scene", None)
    assert fmd("linearise", "plate", *options) == 2
    assert told in capsys.readouterr().err

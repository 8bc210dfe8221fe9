"""`fmd run`: its files and figures, the cache, and wrong input."""

import json
import re

import imageio_ffmpeg
import numpy as np
import pytest
import xarray
from matplotlib.image import imread

from fmd.stages.pipeline import RUN_STAGES

# Stages of a scene without pieces that run in each process.
NEVER_KEPT = {stage.name for stage in RUN_STAGES.values() if stage.inputs is None}
NEVER_KEPT -= {"pieces", "periodic motion", "Floquet multipliers", "contact stress"}
QUICK = ["--set", "body.beam.mesh.divisions=[24, 2, 1]", "--set", "simulation.duration=50 ms"]


def test_run_without_pictures_writes_summary_and_motion(fmd, tmp_path, capsys):
    assert fmd("run", "beam-paper", *QUICK, "--no-pictures", "--out", str(tmp_path), "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "summary.json").read_text())
    keys = {"scene", "seconds", "stages_run", "stages_cached", "stages_skipped", "frequencies_hz", "integrations"}
    assert keys | {"final", "files"} <= printed.keys()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["motion.nc", "summary.json"]
    assert "pictures" in printed["stages_skipped"]
    for row in printed["integrations"]:
        wanted = {"integrator", "step_s", "substeps", "seconds", "ratio_to_plain", "evaluations"}
        assert wanted | {"tip_difference_m"} <= row.keys()
    assert [row["substeps"] for row in printed["integrations"]] == [1, 5, 10]
    with xarray.open_dataset(tmp_path / "motion.nc", engine="scipy") as motion:
        assert dict(motion.sizes) == {"run": 3, "time": 101, "axis": 3, "quaternion": 4, "beam.mode": 5}
        assert motion.momentum.units == "kg m/s"


@pytest.mark.slow
def test_run_draws_everything_that_the_scene_lists(fmd, tmp_path, capsys):
    sizes = ("3.size=[320, 180]", "4.size=[640, 360]", "5.size=[320, 180]", "5.frames=3")
    small = [word for size in sizes for word in ("--set", f"output.{size}")]
    assert fmd("run", "beam-paper", *QUICK, *small, "--no-budget", "--out", str(tmp_path)) == 0
    printed = capsys.readouterr().out
    for word in ("central-difference", "sub-cycling 10:1", "131.2", "MPa", "summary.json"):
        assert word in printed
    pictures = [*(f"mode-{k}.png" for k in range(1, 6)), "von-mises.png"]
    charts = ["fig-09-com-position.png", "fig-10-com-velocity.png", "fig-11-com-angular-velocity.png"]
    assert {path.name for path in tmp_path.iterdir()} == {*pictures, *charts, "motion.mp4", "motion.nc", "summary.json"}
    assert imread(tmp_path / "von-mises.png").shape[:2] == (360, 640)
    for name in pictures + charts:
        assert imread(tmp_path / name)[..., :3].std() > 0.01, f"{name} is blank"
    frames = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "motion.mp4"))[0]
    assert frames == 3


@pytest.mark.slow
def test_rod_slider_turns_as_in_figure_4_and_draws_the_papers_charts(fmd, tmp_path, capsys):
    assert fmd("run", "rod-slider", "--out", str(tmp_path), "--json") == 0
    result = json.loads(capsys.readouterr().out)
    # 100 N m taken per degree, on the inertia with the slider at rest at 1 m: ½ τ/J t² = 652° after 10 s (Fig. 4).
    expected = 0.5 * (100 * np.pi / 180) / (2 * 2**2 / 3 + 5 * 1**2) * 10**2
    assert result["final"]["joint_positions"]["hinge"] == pytest.approx(expected, rel=0.01)
    assert [row["substeps"] for row in result["integrations"]] == [1, 5, 10]
    found = set(result["stages_run"]) - {"loads"}  # which another test may have found
    assert found == {*NEVER_KEPT, "stability", "pictures", "error budget"}
    assert {"mesh", "assembly", "modes", "body", "stress"} <= set(result["stages_skipped"])
    charts = {"fig-04-06-angle.png", "fig-05-07-slider.png"}
    assert {path.name for path in tmp_path.iterdir()} == {*charts, "motion.nc", "summary.json"}
    for name in charts:
        assert imread(tmp_path / name)[..., :3].std() > 0.01
    with xarray.open_dataset(tmp_path / "motion.nc", engine="scipy") as motion:
        assert motion["hinge.position"].units == "rad"
        assert motion["slide.position"].units == "m"
        assert float(np.abs(motion["slide.position"]).max()) < 0.2  # Figs. 5 and 7 stay within ±0.2 m


def test_printed_positions_have_their_units_and_run_times_say_of_what(fmd, tmp_path, capsys):
    short = ["--set", "simulation.duration=0.1 s", "--no-pictures", "--out", str(tmp_path)]
    assert fmd("run", "rod-slider", *short) == 0
    printed = capsys.readouterr().out
    assert re.search(r"hinge: \S+ rad at the end; the runs differ by \S+, \S+ rad\n", printed)
    assert re.search(r"slide: \S+ m at the end; the runs differ by \S+, \S+ m\n", printed)
    assert "of time integration alone" in printed
    assert json.loads((tmp_path / "summary.json").read_text())["joint_units"] == {"hinge": "rad", "slide": "m"}


def test_every_integrator_can_be_chosen_by_name(fmd, tmp_path, capsys):
    runs = ['{ integrator = "exponential", step = "1 ms" }', '{ integrator = "generalized-alpha", rho = 0.9 }']
    runs.append('{ integrator = "runge-kutta", tolerance = 1e-8 }')
    chosen = f"simulation.run=[{', '.join(runs)}]"
    only = ("--no-pictures", "--no-budget", "--out", str(tmp_path), "--json")
    assert fmd("run", "beam-paper", *QUICK, "--set", chosen, *only) == 0
    rows = json.loads(capsys.readouterr().out)["integrations"]
    assert [row["integrator"] for row in rows] == ["exponential", "generalized-alpha", "runge-kutta"]
    # Generalised-α at 10 µs is good to 1e-4 of the 5 mm deflection; Runge-Kutta and the exponential method agree.
    assert rows[1]["tip_deflection_difference_m"] < 5e-6
    assert rows[2]["tip_deflection_difference_m"] < 1e-6


def test_second_run_meshes_assembles_and_solves_nothing(fmd, tmp_path, capsys):
    arguments = ["run", "beam-paper", *QUICK, "--no-pictures", "--out", str(tmp_path), "--json"]
    assert fmd(*arguments) == 0
    first = json.loads(capsys.readouterr().out)
    assert fmd(*arguments) == 0
    second = json.loads(capsys.readouterr().out)
    assert set(second["stages_run"]) == NEVER_KEPT
    of_body = {"modes", "body", "deformation", "surface", "stress"}
    assert of_body | {"loads", "stability", "error budget"} == set(second["stages_cached"])
    assert {"mesh", "assembly"} <= set(second["stages_skipped"])
    for key in ("frequencies_hz", "final", "worst_stress"):
        assert first[key] == second[key]


def test_no_cache_computes_all_again(fmd, tmp_path, capsys):
    only = ["--no-pictures", "--no-cache", "--no-budget", "--out", str(tmp_path), "--json"]
    assert fmd("run", "beam-paper", *QUICK, "--set", "body.beam.mesh.divisions=[6, 1, 1]", *only) == 0
    assert json.loads(capsys.readouterr().out)["stages_cached"] == []


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("body.beam.lenght=300mm", "did you mean 'length'"),
        ("body.beam.depth=25 kg", "length"),
        ("body.beam.depth=-25 mm", "body.beam.depth"),
        ("body.beam.nu=0.5", "0.499"),
        ("simulation.step=300 us", "largest stable step"),
    ],
)
def test_wrong_input_is_one_line_and_status_2(fmd, override, said, tmp_path, capsys):
    out = tmp_path / "out"
    assert fmd("run", "beam-paper", "--set", override, "--no-pictures", "--out", str(out)) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert said in printed.err
    assert override.partition("=")[0].rpartition(".")[2] in printed.err
    assert not out.exists()


def test_an_output_folder_that_cannot_be_written_is_refused(fmd, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert fmd("run", "beam-paper", *QUICK, "--no-pictures", "--out", str(tmp_path / "file" / "out")) == 2
    assert "can't be written" in capsys.readouterr().err


HELD = """
title = "A slider under a force across its way"
[body.block]
shape = "point"
mass = "1 kg"
marker = { at = { at = ["0 m", "0 m", "0 m"] } }
[joint.slide]
type = "prismatic"
parent = "ground"
child = "block.at"
axis = [1, 0, 0]
[drive.push]
type = "point force"
marker = "block.at"
direction = [0, 1, 0]
force = { formula = "10*sin(100*t)", unit = "N" }
[simulation]
duration = "10 ms"
output_step = "1 ms"
step = "0.1 ms"
tip = "block.at"
run = [{ integrator = "auto" }]
"""


def test_a_load_that_moves_nothing_ends_with_status_3_and_its_results(fmd, tmp_path, capsys):
    (tmp_path / "held.toml").write_text(HELD)
    assert fmd("run", tmp_path / "held.toml", "--out", tmp_path / "out") == 3
    printed = capsys.readouterr()
    assert "a load acts, but nothing moves; check its place and direction" in printed.err
    (warning,) = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    assert warning["code"] == "load-without-motion"
    (tmp_path / "free.toml").write_text(HELD.replace("[0, 1, 0]", "[1, 1, 0]"))
    assert fmd("run", tmp_path / "free.toml", "--out", tmp_path / "out") == 0


def test_a_budgets_time_limit_is_an_option_and_what_it_leaves_out_is_named(fmd, tmp_path, capsys):
    only = ["--no-pictures", "--no-cache", "--out", str(tmp_path)]
    assert fmd("run", "beam-paper", *QUICK, *only, "--budget-seconds", "0") == 2
    assert "--budget-seconds = 0.0: must be a time above 0" in capsys.readouterr().err
    assert fmd("run", "beam-paper", *QUICK, *only, "--budget-seconds", "1e-6") == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "warning: the error budget isn't whole: " in printed
    (left_out,) = re.findall(r"isn't whole: (.*?): not estimated: it would take longer than the time limit", printed)
    assert "time" in left_out.split(", ")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert "budget-incomplete" in [warning["code"] for warning in summary["warnings"]]
    assert summary["error_budget"]["left_out"]

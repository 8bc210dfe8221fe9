"""A wanted accuracy holds for every command and in Python: all give the results of the refined scene."""

import ast
import io
import json
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import xarray

import fmd as fmd_package
from fmd import Result, load, load_scene, solve
from fmd.accuracy import refinement
from fmd.accuracy.solved_scene import SETTINGS
from fmd.cli.app import main
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.sweep.points import point_key
from fmd.sweep.work import compute_point

QUICK = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms", "output=[]"]
WANTED = [*QUICK, "accuracy=30 %"]
OWN_TIMES = ("seconds", "files", "file", "log")


def fmd(command: str, overrides: list[str], *arguments: Any) -> Any:
    """Call a command on the beam with overrides; it answers with what it has printed as JSON."""
    values = [part for text in overrides for part in ("--set", text)]
    out, errors = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(errors), pytest.raises(SystemExit) as stop:
        main([command, "beam", *values, "--json", *map(str, arguments)])
    assert not stop.value.code, errors.getvalue()
    return json.loads(out.getvalue())


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> dict[str, Any]:
    """The summary of `fmd run` of the scene with its wanted accuracy."""
    return fmd("run", WANTED, "--no-pictures", "--out", tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def chosen(run) -> list[str]:
    """The settings that `fmd run` names, written into the scene by hand."""
    accuracy = run["accuracy"]
    settings = accuracy["rounds"][accuracy["chosen_round"] - 1]
    beam = settings["bodies"]["beam"]
    assert beam["mesh"]["divisions"] not in ([12, 2, 1], [6, 1, 1])  # neither the scene's nor the first round's
    return [
        *QUICK[1:],
        f"body.beam.mesh.divisions={beam['mesh']['divisions']}",
        f"body.beam.mesh.order={beam['mesh']['order']}",
        f"body.beam.modes.count={beam['modes']}",
        f"body.beam.modes.enrich={beam['enrich']}",
        "simulation.run=[{integrator='auto'}]",
        f"simulation.error={settings['integration_error']}",
    ]


def figures(found: Any) -> Any:
    """What a command prints but for run times and names of files."""
    if isinstance(found, dict):
        return {key: figures(value) for key, value in found.items() if key not in OWN_TIMES and "second" not in key}
    return [figures(each) for each in found] if isinstance(found, list) else found


@pytest.mark.parametrize(
    ("command", "arguments"),
    [
        ("modes", ()),
        ("mesh", ()),
        ("compile", ()),
        ("stability", ("--substeps", "2")),
        ("frf", ("--in", "beam.tip.y", "--out", "beam.tip.y", "--to", "200 Hz", "--points", "5", "--no-budget")),
        ("campbell", ("--to", "100 rpm", "--points", "2")),
    ],
)
def test_a_command_gives_what_it_gives_of_the_scene_with_these_settings(
    command, arguments, chosen, tmp_path, monkeypatch
):
    for chart in ("response_chart.draw_response", "campbell_chart.draw_campbell"):  # they aren't compared
        monkeypatch.setattr(f"fmd.render.{chart}", Mock())
    if command == "frf":
        arguments = (*arguments, "--folder", tmp_path)
    elif command == "campbell":
        arguments = (*arguments, "--out", tmp_path)
    found = figures(fmd(command, WANTED, *arguments))
    assert found == figures(fmd(command, chosen, *arguments))
    assert found != figures(fmd(command, QUICK, *arguments))


def test_a_sweep_a_report_and_an_exported_body_are_of_the_refined_scene(run, tmp_path):
    (row,) = fmd("sweep", WANTED, "--vary", "body.beam.modes.damping=0", "--out", tmp_path / "sweep")["rows"]
    assert row["worst_stress.von_mises_pa"] == run["worst_stress"]["von_mises_pa"]
    fmd("export", WANTED, "--to", "python", "--out", tmp_path / "body.nc")
    with xarray.open_dataset(tmp_path / "body.nc") as body:
        assert body.elastic_frequencies.values.tolist() == run["frequencies_hz"]
    fmd("report", WANTED, "--no-budget", "--out", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for hertz in run["frequencies_hz"]:
        assert f">{hertz:.2f}<" in page


def test_python_gives_the_results_of_the_command(run, chosen):
    summary = load("beam", *WANTED).summary
    assert summary["accuracy"] == run["accuracy"]
    for key in ("frequencies_hz", "peak_tip_deflection_m", "final", "dofs"):
        assert summary[key] == run[key]
    assert summary["worst_stress"]["von_mises_pa"] == run["worst_stress"]["von_mises_pa"]
    by_hand = solve(load_scene("beam", chosen))
    assert by_hand.settings.refinement == {}
    assert by_hand.motion.trajectory.q.tolist() == load("beam", *WANTED).motion.trajectory.q.tolist()


def test_settings_are_found_once_and_kept(tmp_path):
    first, again = (
        Result(load_scene("beam", [*QUICK, "accuracy=50 %", f"title=turn {k}"]), Cache(tmp_path)) for k in range(2)
    )
    assert not first.is_settled
    assert first.run.log.run[-1] == SETTINGS.name
    assert again.is_settled
    assert again.run.scene.body == first.run.scene.body
    assert again.run.scene.title == "turn 1"
    assert again.log.cached == [SETTINGS.name]
    assert again.settings == first.settings
    assert Result(load_scene("beam", QUICK), Cache(tmp_path)).log.run == []


def test_an_accuracy_without_a_motion_is_refused(tmp_path):
    scene = load_scene("beam", ["accuracy=1 %"], ["simulation", "joint", "drive", "reference", "output"])
    with pytest.raises(InputError, match="a scene without simulation has none"):
        solve(scene).modes  # noqa: B018
    assert Path(scene.file).name == "beam.toml"


def test_an_accuracy_that_is_not_met_is_told_by_every_door(capsys, monkeypatch):
    monkeypatch.setattr(refinement.limits, "MOST_ROUNDS", 1)
    values = [part for text in WANTED for part in ("--set", text)]
    with pytest.raises(SystemExit, match="0"):
        main(["modes", "beam", *values, "--no-cache", "--json"])
    said = "accuracy: 30 % was not met: refining ended at 1 rounds; the best, round 1, states "
    assert f"warning: {said}" in " ".join(capsys.readouterr().err.split())
    scene = load_scene("beam", WANTED)
    monkeypatch.setattr("fmd.sweep.work.SolvedScene", lambda scene, *_, **__: Result(scene, Cache(None)))
    point = compute_point(point_key(scene), scene)
    assert (point.status, point.message[: len(said)]) == ("failed", said)
    (warning,) = (each for each in point.summary["warnings"] if each["code"] == "accuracy-not-met")
    assert warning["text"] == point.message


def test_stages_of_a_scene_are_made_by_the_door_alone():
    """What has a scene gets its numbers from `SolvedScene`; variants of it are the accuracy's own."""
    package = Path(fmd_package.__file__).parent
    texts = {path: path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    makers = {
        path.relative_to(package).parts[0]
        for path, text in texts.items()
        if "Pipeline(" in text
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Pipeline"
    }
    assert makers == {"stages", "accuracy"}

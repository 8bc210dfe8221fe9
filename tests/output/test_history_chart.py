"""Charts of histories, and the sheet for those who decide, on a rod that falls from level about its end."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import load_scene
from fmd.accuracy.solved_scene import SolvedScene
from fmd.core.errors import InputError
from fmd.output.histories import draw_history, extremes, history_variables, write_history
from fmd.output.report.contents import show_outputs
from fmd.output.report.page import make_brief, make_page
from fmd.output.variable_errors import VariableErrors
from fmd.stages.pipeline import Pipeline

SCENE = """
title = "pendulum"
[body.rod]
shape = "rod"
mass = "2 kg"
length = "1 m"
marker = { top = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }
[joint.hinge]
type = "revolute"
parent = "ground"
child = "rod.top"
axis = [0, 0, 1]
[simulation]
duration = "0.8 s"
output_step = "2 ms"
tip = "rod.end"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
run = [{ integrator = "runge-kutta", tolerance = 1e-6 }]
[[output]]
type = "history"
file = "loads.csv"
quantities = ["joint_reaction", "joint_position", "energy"]
[[output]]
type = "table"
file = "extremes.csv"
quantities = ["joint_reaction", "joint_position", "energy", "marker_position", "marker_velocity"]
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "pendulum.toml"
    path.write_text(SCENE)
    return path


@pytest.fixture(scope="module")
def run(file: Path) -> Pipeline:
    return SolvedScene(load_scene(file)).run


def test_a_history_is_drawn_a_frame_for_each_quantity_with_the_components_that_move(
    run: Pipeline, tmp_path: Path
) -> None:
    """The hinge bears 5/2 of the weight when the rod hangs, and no moment; nothing is across the rod's plane."""
    calls: list[Any] = []
    history = run.scene.output[0].model_copy(update={"file": "loads.svg"})
    draw_history(run, history, tmp_path, lambda *given, **_: calls.append(given))
    (_, times, frames, _) = calls[0]
    by_name = {frame.name: frame for frame in frames}
    assert [*by_name] == ["hinge.force", "hinge.position", "kinetic_energy", "potential_energy"]
    force = by_name["hinge.force"]
    assert (force.unit, force.components) == ("N", ("x", "y"))
    assert force.columns[:, 1].max() == pytest.approx(2.5 * 2 * 9.81, rel=1e-4)
    assert len(times) == len(force.columns) == 401
    draw_history(run, history, tmp_path)
    text = (tmp_path / "loads.svg").read_text()
    assert all(f"<!-- {words} -->" in text for words in ("hinge.force", "[N]", "[rad]", "time [s]", "pendulum: loads"))


def test_formulas_of_the_motion_are_histories_and_have_extremes(file: Path, tmp_path: Path) -> None:
    """The rod's end is 1 m below the hinge when it hangs, with a speed of √(3 g) as its energy has it."""
    formulas = 'formulas={drop="-rod.end.y",speed="abs(hinge.rate)"}'
    overrides = [f'output=[{{type="history",file="a.csv",{formulas}}},{{type="table",file="b.csv",{formulas}}}]']
    own = SolvedScene(load_scene(file, overrides)).run
    write_history(own, own.scene.output[0], tmp_path)
    header, *rows = (tmp_path / "a.csv").read_text().splitlines()
    assert header == "time [s],drop [SI],speed [SI]"
    drop, speed = np.array([[float(x) for x in row.split(",")[1:]] for row in rows]).T
    np.testing.assert_allclose(speed**2, 3 * 9.81 * drop, atol=1e-4)
    assert drop.max() == pytest.approx(1.0, abs=1e-4)
    assert extremes(own, own.scene.output[1])[0]["largest"] == pytest.approx(drop.max(), rel=1e-9)
    frames: list[Any] = []
    draw_history(own, own.scene.output[0], tmp_path, lambda *given, **_: frames.extend(given[2]))
    assert [frame.name for frame in frames] == ["drop", "speed"]
    small = {"quantities": ("energy",), "formulas": {"kinetic_energy": "1e-20*rod.end.y"}}
    mixed = own.scene.output[0].model_copy(update=small)
    formula = history_variables(own, mixed, own.motion)[-1]
    assert VariableErrors(own).of(formula) == "not stated: the error budget doesn't compare it"  # not that of energy
    draw_history(own, mixed, tmp_path, lambda *given, **_: frames.extend(given[2]))
    assert [frame.name for frame in frames[2:]] == ["kinetic_energy", "potential_energy", "kinetic_energy"]
    for wrong, said in (("rod.tip.y", "no such marker"), ("rod.end.y +", "formulas.a")):
        with pytest.raises(InputError, match=said):
            load_scene(file, [f'output=[{{type="history",file="a.csv",formulas={{a="{wrong}"}}}}]'])
    with pytest.raises(InputError, match=r"quantities.*is missing"):
        load_scene(file, ['output=[{type="history",file="a.csv"}]'])


def test_the_report_shows_charts_of_histories_and_short_tables_of_short_numbers(run: Pipeline) -> None:
    history, table = show_outputs(run)
    assert [len(history["pictures"]), history["table"]] == [1, None]
    assert history["pictures"][0]["png"].startswith("iVBOR")
    rows = table["table"]["rows"]
    assert len(rows) <= 12
    assert table["table"]["left_out"] > 0
    digits = [re.sub(r"\D", "", str(cell).partition("e")[0]).lstrip("0") for row in rows for cell in row]
    assert max(map(len, digits)) == 5


def test_the_brief_has_the_answer_pictures_and_doubts_on_one_sheet(file: Path) -> None:
    solved = SolvedScene(load_scene(file))
    brief, page = make_brief(solved, budget=True), make_page(solved, budget=True)
    assert brief.count("data:image/png;base64,") <= 3 <= page.count("data:image/png;base64,") + 1
    for words in ("The answer", "What is uncertain", "What was asked", "fmd report pendulum --brief"):
        assert words in brief
    doubts = re.findall(r"<li>(.*?)</li>", brief)
    assert any("within" in text for text in doubts) or doubts
    assert np.mean([len(text) for text in doubts]) < 200


def test_a_coordinate_that_stays_at_zero_is_drawn_beside_its_reaction(file: Path, tmp_path: Path) -> None:
    still = SolvedScene(load_scene(file, ['simulation.gravity=["9.81 m/s^2", "0 m/s^2", "0 m/s^2"]'])).run
    calls: list[Any] = []
    draw_history(still, still.scene.output[0], tmp_path, lambda *given, **_: calls.append(given))
    assert [frame.name for frame in calls[0][2]] == ["hinge.force", "hinge.position", "potential_energy"]

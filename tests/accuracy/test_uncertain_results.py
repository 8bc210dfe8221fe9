"""Results that the error budget states as uncertain, and what is said of them."""

import re
from pathlib import Path
from typing import Any

import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import Budget
from fmd.accuracy.time_limit import TIME_IS_SHORT
from fmd.accuracy.uncertain_results import _source
from fmd.core.cache import Cache
from fmd.output.stated_errors import largest_stress
from fmd.output.summary import _budget_warnings, summarise

LENGTH, RATE, DENSITY = 1.0, 20.0, 2700.0
TURNING = f"""
title = "Bar that turns steadily"
[body.arm]
shape = "bar"
length = "{LENGTH} m"
depth = "6 mm"
width = "20 mm"
E = "70 GPa"
nu = 0.0
rho = "{DENSITY} kg/m^3"
mesh = {{ divisions = [12, 1, 1] }}
modes = {{ count = 2, enrich = "none" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
[joint.hub]
type = "revolute"
parent = "ground"
child = "arm.root"
axis = [0, 0, 1]
rate = "{RATE} rad/s"
[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "arm.tip"
start = "steady"
run = [{{ integrator = "auto" }}]
"""

PLATE = """
title = "Wide plate that is clamped at one side"
[body.plate]
shape = "bar"
length = "150 mm"
depth = "100 mm"
width = "4 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { order = 2, divisions = [4, 3, 1] }
modes = { count = 3, boundary = "joint", enrich = "inertia", damping = 0.005 }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.hub]
type = "fixed"
parent = "ground"
child = "plate.root"
[drive.push]
type = "point force"
marker = "plate.tip"
direction = [0, 0, 1]
force = "1 N"
[simulation]
duration = "50 ms"
output_step = "0.5 ms"
tip = "plate.tip"
run = [{ integrator = "auto" }]
"""


def summary_of(folder: Path, *changes: str) -> dict[str, Any]:
    (folder / "turning.toml").write_text(TURNING)
    return summarise(Pipeline(load_scene(folder / "turning.toml", changes), Cache(None)), [], budget=True)


def test_stress_that_the_modes_leave_out_is_told_with_a_remedy_that_works(tmp_path: Path) -> None:
    exact = 0.5 * DENSITY * (RATE * LENGTH) ** 2  # at the root
    summary = summary_of(tmp_path)
    assert summary["worst_stress"]["von_mises_pa"] < 0.5 * exact
    (warning,) = [each["text"] for each in summary["warnings"] if each["code"] == "uncertain-results"]
    assert "'potential energy' may be off by up to 200 %" in warning
    assert 'the modes leave too much out for that; enrich = "inertia" of [body.arm.modes] helps' in warning
    assert 'accuracy = "20 %" refines by itself' in warning
    enriched = summary_of(tmp_path, "body.arm.modes.enrich=inertia")
    assert enriched["worst_stress"]["von_mises_pa"] == pytest.approx(exact, rel=0.02)
    assert "uncertain-results" not in [each["code"] for each in enriched["warnings"]]


def test_meshes_of_files_are_not_said_to_be_refined_by_accuracy(tmp_path: Path) -> None:
    text = TURNING.replace("divisions = [12, 1, 1]", 'file = "arm.inp", unit = "m"')
    for key in ("shape", "length", "depth", "width"):
        text = re.sub(rf"^{key} = .*\n", "", text, count=1, flags=re.MULTILINE)
    (tmp_path / "arm.toml").write_text(re.sub(r'"x[-+]"', '"END"', text))
    scene = load_scene(tmp_path / "arm.toml", ("body.arm.mesh.order=2",))
    assert _source("recovery", scene) == "the mesh is too coarse for stress; a finer mesh helps"
    assert "accuracy" in _source("truncation", scene)


def test_a_clamp_that_is_fixed_on_average_is_told_where_that_matters(tmp_path: Path) -> None:
    file = tmp_path / "plate.toml"
    file.write_text(PLATE)
    told = 'attachment = "rigid" of its marker fixes every point of it'.replace('"', "'")
    for changes, warned in ((("body.plate.marker.root.attachment=averaged",), 1), ((), 0)):
        summary = summarise(Pipeline(load_scene(file, changes), Cache(None)), [], budget=True)
        texts = [each["text"] for each in summary["warnings"] if each["code"] == "uncertain-results"]
        assert len([text for text in texts if told in text]) == warned


def test_more_time_is_no_remedy_for_an_estimate_that_failed(tmp_path: Path) -> None:
    (tmp_path / "turning.toml").write_text(TURNING)
    run = Pipeline(load_scene(tmp_path / "turning.toml"), Cache(None))
    for why, remedy in (
        ("not estimated: Newton's iteration did not converge", False),
        (f"not estimated: {TIME_IS_SHORT} 100 s", True),
    ):
        budget = Budget((), left_out=(f"truncation: {why}", f"time: {why}"), seconds=0.2)
        (warning,) = _budget_warnings(run, budget, 100.0)
        assert warning["text"].endswith("with --budget-seconds 500 more of it is estimated") == remedy
        assert warning["text"].count(why) == 1
        assert warning["text"].startswith(f"the error budget isn't whole: truncation, time: {why}")


def test_figures_carry_what_is_stated_of_them() -> None:
    row = {"quantity": "arm, largest von Mises stress", "value": 2e6, "better": 2.001e6, "interval": [1.8e6, 2.2e6]}
    summary: dict[str, Any] = {"worst_stress": {"body": "arm", "von_mises_pa": 2e6}}
    assert largest_stress(summary) == "2 MPa"
    assert largest_stress(summary | {"error_budget": {"rows": [row]}}) == "2 MPa (from 1.8 MPa to 2.2 MPa)"
    row["better"] = 2.1e6
    better = "2.1 MPa (from 1.8 MPa to 2.2 MPa; the run itself has 2 MPa)"
    assert largest_stress(summary | {"error_budget": {"rows": [row]}}) == better
    row |= {"interval": None, "why": "not estimated: it would take longer than the time limit of 20 s"}
    assert largest_stress(summary | {"error_budget": {"rows": [row]}}) == (
        "2 MPa (error not stated: it would take longer than the time limit of 20 s)"
    )

"""Errors of the model itself: what a run leaves out, against runs that have it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.coarse_mesh import make_coarse_pair
from fmd.accuracy.deflection import stiffening_by_stretch
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.error_estimates import MORE_OF_MODEL, Row
from fmd.accuracy.estimators import Estimates
from fmd.accuracy.model_errors import ModelErrors
from fmd.core.cache import Cache
from fmd.core.limits import errors as limits
from fmd.core.limits.errors import COARSE_SHARE, SAFETY
from fmd.output.summary import summarise

pytestmark = pytest.mark.slow

SPUN = [
    "body.beam.mesh.divisions=[12, 2, 1]",
    "body.beam.modes.enrich=inertia",
    "simulation.duration=0.1 s",
    'simulation.run=[{integrator="auto"}]',
]
CLAMPED = """
title = "Clamped bar"
[body.bar]
shape = "bar"
length = "200 mm"
depth = "20 mm"
width = "20 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { element = "hexahedron", order = 2, divisions = [12, 2, 2] }
modes = { count = 3, boundary = "joint", damping = 0.01 }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.root]
type = "fixed"
parent = "ground"
child = "bar.root"
[drive.push]
type = "point force"
marker = "bar.tip"
direction = [0, 1, 0]
force = { formula = "100*sin(100*t)", unit = "N" }
[simulation]
duration = "20 ms"
output_step = "0.2 ms"
tip = "bar.tip"
run = [{ integrator = "auto" }]
"""


def rows_of(run: Pipeline) -> dict[str, Row]:
    return {row.name: row for row in state_errors(run).rows}


def test_geometric_stiffening_that_is_left_off_is_stated() -> None:
    scenes = (load_scene("beam-paper", [*SPUN, f"simulation.stiffening={x}"]) for x in ("off", "on"))
    off, on = (Pipeline(scene) for scene in scenes)
    budget = state_errors(off)
    rows = {row.name: row for row in budget.rows}
    (cause,) = (each for each in budget.model if each.cause == "stiffening left off")
    ours, theirs = off.motion.tip_deflection, on.motion.tip_deflection
    true = np.linalg.norm(ours - theirs, axis=1).max() / np.linalg.norm(theirs, axis=1).max()
    assert true > 1e-3
    assert true <= rows["tip, deflection"].total <= 5 * true + rows["tip, deflection"].numerical
    stated = [part for row in rows.values() if isinstance(part := row.parts["model"], float)]
    assert cause.error == pytest.approx(max(stated), rel=0.5)
    assert not [each for each in state_errors(on).model if each.cause == "stiffening left off"]


def test_the_model_is_a_source_of_the_stated_error_and_not_of_the_numerical_one() -> None:
    row = Row("x", "m", 1.0, True, {"time": 0.003, "truncation": 0.0, "model": 0.004})
    assert row.numerical == pytest.approx(SAFETY * 0.003)
    assert row.total == pytest.approx(SAFETY * 0.005)
    assert row.dominant == "time"


def bar(folder: Any, *settings: str, cache: Cache | None = None) -> Pipeline:
    file = folder / "bar.toml"
    file.write_text(CLAMPED)
    return Pipeline(load_scene(file, list(settings)), cache)


def test_an_averaged_root_is_off_by_what_a_rigid_one_changes_on_a_fine_mesh(tmp_path: Any) -> None:
    fine = ["body.bar.mesh.divisions=[20, 4, 4]"]
    averaged, rigid = bar(tmp_path, *fine), bar(tmp_path, *fine, "body.bar.marker.root.attachment=rigid")
    true = rigid.modes.omega[0] / averaged.modes.omega[0] - 1
    stated = rows_of(bar(tmp_path))["bar, frequency 1"].parts["model"]
    assert isinstance(stated, float)
    assert true < SAFETY * stated < 3 * true
    assert rows_of(bar(tmp_path, "body.bar.marker.root.attachment=rigid", "body.bar.mesh.divisions=[4, 1, 1]"))[
        "bar, frequency 1"
    ].parts["model"] == ("no part in it")


def test_rigid_roots_of_a_large_mesh_take_the_time_of_the_coarser_one_alone(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A propeller's were left out for want of the time that its own mesh would have taken, which isn't solved."""
    of = Estimates(bar(tmp_path, cache=Cache(None)))
    of.pair = make_coarse_pair(of.run)
    required: list[float] = []
    monkeypatch.setattr(limits, "LARGE_MESH", 0)
    monkeypatch.setattr(of, "require_modes", required.append)
    assert ModelErrors(of)._attachment()
    assert required == [COARSE_SHARE]


def test_missing_damping_is_named_and_not_counted(tmp_path: Any) -> None:
    with_it, without = bar(tmp_path), bar(tmp_path, "body.bar.modes.damping=0")
    assert not [each for each in state_errors(with_it).model if each.cause == "no damping"]
    (cause,) = (each for each in state_errors(without).model if each.cause == "no damping")
    assert not cause.counted
    assert cause.error > 1e-3


def test_a_cause_whose_variant_fails_leaves_lower_bounds(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: ModelErrors) -> None:
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr(ModelErrors, "_attachment", fail)
    budget = state_errors(bar(tmp_path, cache=Cache(None)))
    assert "attachment: not estimated: singular" in [each.text for each in budget.model]
    (row,) = (row for row in budget.rows if row.name == "tip, deflection")
    assert row.parts[MORE_OF_MODEL] == "not estimated: singular"


def test_a_wanted_accuracy_beyond_the_models_is_warned_of(tmp_path: Any) -> None:
    summary = summarise(bar(tmp_path, "accuracy=0.01 %"), [], budget=True)
    codes = [warning["code"] for warning in summary["warnings"]]
    assert "model-error" in codes
    assert {each["cause"] for each in summary["error_budget"]["model"]} >= {"attachment"}


PLATE = [
    "body.bar.length=600 mm",
    "body.bar.depth=200 mm",
    "body.bar.width=1 mm",
    "body.bar.mesh.divisions=[18, 6, 1]",
    'drive={twist={type="point torque", marker="bar.tip", direction=[1, 0, 0], torque="0.1 N m"}}',
    "simulation.start=equilibrium",
]


def test_a_strip_that_twists_is_warned_of_without_a_budget_too(tmp_path: Path) -> None:
    """A twist by t for each length stretches a strip's edges, which takes a torque ``E h b⁵ t³ / 360`` (Weber)."""
    run = bar(tmp_path, *PLATE)
    E, h, b = 70e9, 0.001, 0.2
    linear = E / (2 * 1.33) * b * h**3 / 3
    twist = 0.1 / linear
    assert stiffening_by_stretch(run, "bar") == pytest.approx(E * h * b**5 * twist**2 / (360 * linear), rel=0.25)
    (warning,) = (each for each in summarise(run, [], budget=False)["warnings"] if each["code"] == "large-deflection")
    assert "as a plate that twists" in warning["text"]

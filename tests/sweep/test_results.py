"""Results of a sweep that are asked for by name, against closed forms, and what becomes of names that nothing has."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest
import xarray

from fmd.core.errors import InputError
from fmd.scene.result_names import require_results
from fmd.scene.scene import Scene, load_scene
from fmd.sweep.plot import draw_sweep
from fmd.sweep.points import Point, Variation, point_key
from fmd.sweep.record import Record, Wanted
from fmd.sweep.study import Sweep, run_sweep
from fmd.sweep.table import SweepTable, write_tables
from fmd.sweep.work import compute_point

# A rod that falls from level, about its end, and a block on a spring beside it, of 4 rad/s and a damping of 5 %.
SCENE = """
title = "pendulum and oscillator"
[body.rod]
shape = "rod"
mass = "1 kg"
length = "1 m"
marker = { top = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }
[body.block]
shape = "rigid"
mass = "2 kg"
inertia = ["1 kg m^2", "1 kg m^2", "1 kg m^2"]
marker = { centre = { at = ["0 m", "0 m", "0 m"] } }
[joint.hinge]
type = "revolute"
parent = "ground"
child = "rod.top"
axis = [0, 0, 1]
[joint.slide]
type = "prismatic"
parent = "ground"
child = "block.centre"
axis = [1, 0, 0]
spring = "32 N/m"
damper = "0.8 N s/m"
[simulation]
duration = "0.8 s"
output_step = "2 ms"
tip = "rod.end"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
run = [{ integrator = "runge-kutta", tolerance = 1e-6 }]
[[output]]
type = "frf"
file = "frf.png"
input = "block.centre.x"
output = "block.centre.x"
to = "2 Hz"
"""
OF = ("hinge.force.size", "gap = rod.end.y + 1", "block.centre.x by block.centre.x", "mass")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "both.toml"
    path.write_text(SCENE)
    return path


def study(scene: Path, folder: Path, wanted: Wanted, masses: tuple[str, ...] = ("1 kg", "2 kg")) -> tuple[Sweep, int]:
    """Return the sweep over the rod's mass, and how many points were computed."""
    count = 0

    def compute(scenes: Mapping[str, Scene]) -> Iterator[tuple[str, Record]]:
        nonlocal count
        for key, own in scenes.items():
            count += 1
            yield key, compute_point(key, own, wanted)

    loaded = [load_scene(scene, [f"body.rod.mass={mass}"]) for mass in masses]
    points = [Point((mass,), own, point_key(own)) for mass, own in zip(masses, loaded, strict=True)]
    return run_sweep([Variation("body.rod.mass", masses)], points, folder, compute, wanted=wanted), count


def test_results_by_name_are_columns_charts_and_histories_that_a_sweep_keeps(scene: Path, tmp_path: Path) -> None:
    """The force of a rod's hinge is 5/2 of its weight when it hangs, its end then 1 m below the hinge."""
    sweep, count = study(scene, tmp_path, Wanted(results=OF, histories=True))
    assert count == 2
    table = SweepTable(sweep)
    for mass, row in zip((1.0, 2.0), table.rows, strict=True):
        assert row["hinge.force.size.largest"] == pytest.approx(2.5 * mass * 9.81, rel=1e-4)
        assert row["gap.smallest"] == pytest.approx(0.0, abs=1e-4)
        assert row["gap.largest"] == pytest.approx(1.0, abs=1e-9)
        peak = 1.0 / (2 * 0.05 * 32.0 * np.sqrt(1 - 0.05**2))
        assert row["block.centre.x by block.centre.x"] == pytest.approx(peak, rel=1e-3)
        assert row["mass"] == pytest.approx(mass + 2.0)
    assert table.results["hinge.force.size"] == ("N", ["hinge.force.size.smallest", "hinge.force.size.largest"])
    assert table.results["block.centre.x by block.centre.x"][0] == "m/N"
    assert {*write_tables(table, tmp_path), *draw_sweep(table, tmp_path, "Study")} >= {"sweep.nc", "sweep.png"}
    data = xarray.load_dataset(tmp_path / "sweep.nc", engine="scipy")
    assert data["hinge.force.size.history"].units == "N"
    np.testing.assert_allclose(data["gap.history"].max("sample"), 1.0)
    np.testing.assert_allclose(data["time_s"][1], np.arange(401) * 2e-3, atol=1e-12)


def test_a_sweep_computes_anew_what_lacks_a_result_and_nothing_else(scene: Path, tmp_path: Path) -> None:
    assert study(scene, tmp_path, Wanted(results=OF[:1]))[1] == 2
    assert study(scene, tmp_path, Wanted(results=OF[:1]))[1] == 0
    assert study(scene, tmp_path, Wanted())[1] == 2  # results by name have no summary
    assert study(scene, tmp_path, Wanted(results=OF[:1], histories=True))[1] == 2
    assert study(scene, tmp_path, Wanted())[1] == 0  # the summary from before is kept beside them
    assert study(scene, tmp_path, Wanted(results=("mass",)))[1] == 2


def test_a_result_that_a_point_lacks_is_its_message_and_is_not_kept(scene: Path, tmp_path: Path) -> None:
    sweep, _ = study(scene, tmp_path, Wanted(results=("hinge.force.w",)), ("1 kg",))
    assert sweep.records[0].status == "failed"
    assert "--of: hinge.force.w: no such result; did you mean" in sweep.records[0].message
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("hinge.forces", "--of: hinge.forces: no such result; did you mean 'hinge.force'?"),
        ("hinge.force.w", "--of: hinge.force.w: no such result; did you mean 'hinge.force'?"),
        ("rod.end.position.speed", "no such result; did you mean 'rod.end.position'?"),
        ("rod.stress", "--of: rod.stress: no such result"),
        ("frequency.1", "--of: frequency.1: no such result"),
        ("critical_speed", "--of: critical_speed: no such result"),
        ("tip", "--of: tip = 'rod.end': is on a rigid body and doesn't deflect; 'rod.end.position' or"),
        ("gap = rod.and.y + 1", "rod.and"),
        ("gap = rod.end.y +", "gap = 'rod.end.y +'"),
        ("block.centre.y by block.centre.x", "no [[output]] of type frf has it; did you mean"),
    ],
)
def test_names_that_no_result_has_are_refused_before_anything_is_computed(
    scene: Path, fmd, capsys, name: str, text: str
) -> None:
    assert fmd("sweep", scene, "--vary", "body.rod.mass=1..2:2 kg", "--of", name) == 2
    assert text in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("life", "takes one [[output]] of type fatigue for forearm; the scene has 0"),
        ("forearm.frequency.0", "no such result"),
        ("forearm.frequency.²", "no such result"),
        ("gripper.stress", "no such result"),
        ("forearm.stress.x", "no such result"),
    ],
)
def test_results_that_a_body_can_not_have_are_refused_by_the_scene_alone(name: str, text: str) -> None:
    arm = load_scene("arm")
    with pytest.raises(InputError, match=re.escape(text)):
        require_results(arm, [name])
    require_results(arm, ["tip", "stress", "forearm.frequency.3", "gripper.mass", "mass", "elbow.force.size"])


def test_a_joint_that_turns_in_space_is_offered_by_its_orientation() -> None:
    with pytest.raises(InputError, match=r"did you mean 'float\.orientation'"):
        require_results(load_scene("rotor"), ["float.orientations"])


def test_the_terminal_says_how_many_points_it_leaves_out(scene: Path, fmd, capsys, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr("fmd.cli.swept_points.SWEPT_ROWS", 1)
    runs = 'simulation.run=[{integrator="runge-kutta"},{integrator="auto"}]'
    given = ["--set", runs, "--vary", "body.rod.mass=1..3:3 kg", "--vary", "body.block.mass=1,2 kg"]
    given += ["--of", "mass", "--out", tmp_path / "out"]  # three columns of one short name
    assert fmd("sweep", scene, *given) == 0
    said = capsys.readouterr().out
    assert "and 5 more points: sweep.csv" in said
    assert "of the scene's 2 runs" not in said  # results by name are those of the first run

"""Envelope and fatigue as a scene asks for them: pictures, surfaces and tables agree with the stress in motion."""

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import meshio
import numpy as np
import pytest
import rainflow

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.output.stress_fields import draw_envelope, draw_fatigue, find_fatigue, life_intervals
from fmd.output.stress_warnings import output_time_warnings
from fmd.output.summary import summarise
from fmd.recovery.stress import stress_measure
from tests.output.test_histories import SCENE

SN = 'sn = { amplitude = "5 MPa", cycles = 1e6, slope = 5, slope_beyond = 9 }'
OUTPUTS = f"""
[[output]]
type = "envelope"
file = "envelope.csv"
body = "bar"
count = 7
[[output]]
type = "envelope"
file = "envelope.vtu"
body = "bar"
[[output]]
type = "envelope"
file = "envelope.png"
body = "bar"
component = "principal 3"
[[output]]
type = "fatigue"
file = "life.csv"
body = "bar"
stress = "critical plane"
{SN}
[[output]]
type = "fatigue"
file = "life.vtu"
body = "bar"
{SN}
[[output]]
type = "fatigue"
file = "life.png"
body = "bar"
stress = "signed von Mises"
{SN}
mean_stress = {{ goodman = "310 MPa" }}
"""
BARE = SCENE.partition("[[output]]")[0]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "scene.toml"
    file.write_text(BARE + OUTPUTS)
    return file


@pytest.fixture(scope="module")
def out(scene: Path, fmd: Callable[..., int]) -> Path:
    assert fmd("run", scene, "--out", scene.parent / "out", "--no-budget", "--no-pictures") == 0
    return scene.parent / "out"


@pytest.fixture(scope="module")
def run(scene: Path) -> Pipeline:
    return Pipeline(load_scene(scene), Cache(None))


def read_rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))


def test_the_table_has_the_worst_nodes_and_when(out: Path, run: Pipeline) -> None:
    rows, stress = read_rows(out / "envelope.csv"), run.stress_of("bar")
    values = stress.measure_at(np.arange(101))
    largest = values.max(axis=0)
    assert len(rows) == 7
    worst = [float(row["largest_von_mises_pa"]) for row in rows]
    assert worst == pytest.approx(np.sort(largest)[::-1][:7], rel=1e-9)
    for row in rows:
        (place,) = np.flatnonzero(stress.nodes == int(row["node"]))
        assert float(row["largest_von_mises_pa"]) == pytest.approx(largest[place], rel=1e-9)
        assert float(row["largest_von_mises_at_s"]) == pytest.approx(stress.times[values[:, place].argmax()], abs=1e-9)
        assert [float(row[key]) for key in ("x_m", "y_m", "z_m")] == pytest.approx(run.part.space.x[int(row["node"])])


def test_the_surface_has_the_fields_of_all_nodes(out: Path, run: Pipeline) -> None:
    mesh, stress = meshio.read(out / "envelope.vtu"), run.stress_of("bar")
    tensors = np.einsum("nij,tj->nit", stress.modal, stress.q)
    assert mesh.points == pytest.approx(run.part.space.x[stress.nodes])
    assert len(mesh.cells_dict["triangle"]) == len(run.part.surface.triangles)
    assert mesh.point_data["node"] == pytest.approx(stress.nodes)
    smallest = stress_measure("principal 3")(tensors).min(axis=1)
    assert mesh.point_data["smallest_principal_pa"] == pytest.approx(smallest, rel=1e-9, abs=1e-3)


def test_the_life_of_a_node_is_that_of_its_history(out: Path, run: Pipeline) -> None:
    """The worst node by critical planes: its axial stress counted by the rainflow package."""
    rows = read_rows(out / "life.csv")
    worst, stress = rows[0], run.at_vibrations.stress_of("bar")
    normal = np.array([float(worst[f"plane_normal_{axis}"]) for axis in "xyz"])
    (place,) = np.flatnonzero(stress.nodes == int(worst["node"]))
    tensors = stress.modal[place] @ stress.q.T
    history = np.einsum("i,ijt,j->t", normal, tensors[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]], normal)
    damage = 0.0
    for size, _, count, *_ in rainflow.extract_cycles(history):
        amplitude = 0.5 * size / 5e6
        damage += count * amplitude ** (5 if amplitude >= 1 else 9) / 1e6
    assert float(worst["damage"]) == pytest.approx(damage, rel=1e-8)
    assert float(worst["repeats_to_failure"]) == pytest.approx(1.0 / damage, rel=1e-8)
    assert float(worst["life_s"]) == pytest.approx(0.05 / damage, rel=1e-8)
    assert [float(row["damage"]) for row in rows] == sorted((float(row["damage"]) for row in rows), reverse=True)


def test_the_summary_has_the_worst_node_of_each(out: Path) -> None:
    summary = json.loads((out / "summary.json").read_text())
    found = summary["envelope"]["bar"]["von Mises"]
    assert found["value_pa"] == pytest.approx(summary["worst_stress"]["von_mises_pa"])
    assert found["time_s"] == summary["worst_stress"]["time_s"]
    assert found["position_m"] == pytest.approx(summary["worst_stress"]["position_m"])
    life = summary["fatigue"]["life.csv"]
    assert life["node"] == int(read_rows(out / "life.csv")[0]["node"])
    assert life["repeats_to_failure"] == pytest.approx(1.0 / life["damage"])
    assert life["assessed_nodes"] <= life["nodes"]
    assert life["repeats_interval"] is None
    assert "no error budget" in life["why"]


def test_a_life_lies_between_those_of_less_and_of_more_stress(run: Pipeline) -> None:
    """Lives go with stress to the power of a slope between 5 and 9."""
    for output in (output for output in run.scene.output if output.type == "fatigue" and output.mean_stress is None):
        found = find_fatigue(run, output)
        worst = found.worst(4)[[2, 0, 3, 1]]  # in an order that isn't the surface's
        intervals = life_intervals(run, output, worst, 0.1)
        for (low, high), repeats in zip(intervals, found.repeats[worst], strict=True):
            assert 0.9**9.01 < low / repeats < 0.9**4.99
            assert 1.1**4.99 < high / repeats < 1.1**9.01
        assert not life_intervals(run, output, worst, 1.2)[:, 0].any()


def test_extremes_and_lives_of_a_finer_model_lie_within_the_errors(scene: Path, fmd: Callable[..., int]) -> None:
    """Against 40 elements in place of 8, and 12 modes in place of 3, which no variant of the budget has."""
    own, finer = scene.parent / "own", scene.parent / "finer"
    assert fmd("run", scene, "--out", own, "--no-pictures", "--budget-seconds", "100") == 0
    finely = ("--set", "body.bar.mesh.divisions=[20, 2, 1]", "--set", "body.bar.modes.count=12")
    assert fmd("run", scene, "--out", finer, "--no-pictures", "--no-budget", *finely) == 0
    errors = {row["column"]: row for row in read_rows(own / "envelope-errors.csv")}
    true = json.loads((finer / "summary.json").read_text())["envelope"]["bar"]
    ours = json.loads((own / "summary.json").read_text())["envelope"]["bar"]
    columns = {"von Mises": "largest_von_mises_pa", "principal 1": "largest_principal_pa"}
    columns["principal 3"] = "smallest_principal_pa"
    for name, column in columns.items():
        apart = abs(true[name]["value_pa"] - ours[name]["value_pa"])
        assert apart <= float(errors[column]["error"]) <= max(20 * apart, 0.2 * abs(true[name]["value_pa"])), name
    assert errors["largest_von_mises_at_s"]["why not"].startswith("not stated: ")
    life = read_rows(finer / "life.csv")[0]
    first = read_rows(own / "life.csv")[0]
    assert float(first["repeats_at_least"]) <= float(life["repeats_to_failure"]) <= float(first["repeats_at_most"])
    assert json.loads((own / "summary.json").read_text())["fatigue"]["life.csv"]["repeats_interval"] == pytest.approx(
        [float(first["repeats_at_least"]), float(first["repeats_at_most"])]
    )
    assert "table (.csv)" in read_rows(own / "life.vtu-errors.csv")[0]["why not"]


def test_pictures_show_the_worst_of_all_times(run: Pipeline, tmp_path: Path) -> None:
    seen: dict[str, Any] = {}

    def note(function: str, surface: Any, values: Any, path: Path, **settings: Any) -> None:
        seen[path.name] = SimpleNamespace(function=function, values=values, **settings)

    outputs = {output.file: output for output in run.scene.output}
    draw_envelope(run, outputs["envelope.png"], tmp_path, note)
    draw_fatigue(run, outputs["life.png"], tmp_path, note)
    envelope, life = seen["envelope.png"], seen["life.png"]
    assert envelope.values == pytest.approx(run.envelope_of("bar").principal_3 * 1e-6)
    assert envelope.limits[0] == pytest.approx(envelope.values.min())
    assert envelope.weights.argmax() == envelope.values.argmin()
    assert life.limits[0] <= life.values.min() < life.limits[0] + 1
    assert life.weights.argmax() == life.values.argmin()
    assert life.camera.colour_map == "light turbo_r"
    assert life.label.endswith("repeats")


def test_a_part_that_nothing_damages_lasts(run: Pipeline, scene: Path, tmp_path: Path) -> None:
    seen: list[Any] = []
    output = next(output for output in run.scene.output if output.file == "life.png")
    sn = output.sn.model_copy(update={"amplitude": 1e12, "slope_beyond": "infinite"})  # type: ignore[union-attr]
    draw_fatigue(run, output.model_copy(update={"sn": sn}), tmp_path, lambda *_, **settings: seen.append(settings))  # type: ignore[arg-type]
    assert seen[0]["label"] == "no damage anywhere"


def test_output_times_too_far_apart_are_warned_of(scene: Path) -> None:
    """On a stiff spring the bar swings nine times faster; the step that the warning gives resolves it."""
    stiff = ["joint.hinge.spring=4000 N m", "joint.hinge.damper=0 N m s", "simulation.duration=64 ms"]

    def run_with(step: str) -> Pipeline:
        keys = [*stiff, f"simulation.output_step={step}", "output=[]"]  # the largest stress is reported of itself
        return Pipeline(load_scene(scene, keys), Cache(None))

    def warnings_of(run: Pipeline) -> list[dict[str, str]]:
        return output_time_warnings(run, {"bar": run.stress_of("bar").worst()[1]})

    coarse = run_with("9 ms")
    (warning,) = warnings_of(coarse)
    assert warning in summarise(coarse, [], budget=False)["warnings"]
    assert warning["code"] == "coarse-output-times"
    (step,) = re.findall(r"output_step = '([^']+)'", warning["text"])
    assert step != "9 ms"
    assert warnings_of(run_with(step)) == []
    stated = float(re.findall(r"is ([\d.]+) %", warning["text"])[0])
    missed = run_with("0.1 ms").envelope_of("bar").von_mises.max() / coarse.envelope_of("bar").von_mises.max() - 1.0
    assert stated == pytest.approx(100 * missed, rel=0.02)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('type = "envelope"\nfile = "a.txt"\nbody = "bar"', "ending in .png or .vtu or .csv"),
        ('type = "envelope"\nfile = "a.png"\nbody = "ball"', "is rigid"),
        ('type = "envelope"\nfile = "a.csv"\nbody = "bar"\nzoom = 2.0', "belongs to a .png file"),
        ('type = "envelope"\nfile = "a.png"\nbody = "bar"\ncount = 3', "belongs to a .csv file"),
        ('type = "fatigue"\nfile = "a.png"\nbody = "bar"', "sn: is missing"),
        (
            f'type = "fatigue"\nfile = "a.png"\nbody = "bar"\n{SN}\nstress = "signed von Mises"\nplanes = 4',
            "'findley' and",
        ),
        (f'type = "fatigue"\nfile = "a.png"\nbody = "bar"\n{SN}\nmean_stress = {{ fkm = 0.3 }}', "mean stress in it"),
        (f'type = "fatigue"\nfile = "a.png"\nbody = "bar"\n{SN}\nmean_stress = {{}}', "needs one of goodman"),
        ('type = "fatigue"\nfile = "a.png"\nbody = "bar"\n' + SN.replace("5 MPa", "5 m"), "sn.amplitude"),
    ],
)
def test_a_wrong_output_is_refused_in_one_message(
    scene: Path, fmd: Callable[..., int], capsys: pytest.CaptureFixture[str], keys: str, said: str
) -> None:
    file = scene.with_name("wrong.toml")
    file.write_text(f"{BARE}\n[[output]]\n{keys}\n")
    assert fmd("run", file, "--out", scene.parent / "wrong", "--no-budget") == 2
    err = capsys.readouterr().err
    assert said in " ".join(err.split())
    assert "Traceback" not in err

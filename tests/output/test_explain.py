"""What `fmd run --explain` foretells is what happens."""

import json
import tracemalloc
from importlib.resources import files

import pytest

from fmd import Result, load_scene
from fmd.cli.app import main
from fmd.core.cache import Cache
from fmd.output.explain import Forecast, bytes_of_modes, forecast_run
from fmd.output.write import write_results
from fmd.stages.part import PART_STAGES
from fmd.stages.pipeline import RUN_STAGES, Pipeline

QUICK = ["body.beam.mesh.divisions=[6, 2, 1]", "body.beam.modes.count=2", "simulation.duration=10 ms"]
MORE = """
[body.beam.element.middle]
at = ["170 mm", "0 mm", "0 mm"]
[[output]]
type = "export"
body = "beam"
file = "body.nc"
[[output]]
type = "export"
body = "beam"
file = "motion.vtkhdf"
frames = 2
"""


def plan_and_run(folder, overrides, scene="beam-paper", budget=False) -> tuple[Forecast, Result]:
    """Plan, and run by a pipeline of its own."""
    cache, loaded = Cache(folder / "cache"), load_scene(scene, overrides)
    plan = forecast_run(Result(loaded, cache), pictures=False, budget=budget)
    run = Result(loaded, cache)
    write_results(run, folder / "out", pictures=False, budget=budget)
    return plan, run


def stages(plan: Forecast, fate: str) -> set[str]:
    return {step.stage for step in plan.steps if step.fate == fate}


def require_foretold(plan: Forecast, run: Result, decided_later: frozenset[str] = frozenset()) -> None:
    assert stages(plan, "run") - decided_later == set(run.log.run) - decided_later
    assert stages(plan, "cached") - decided_later == set(run.log.cached) - decided_later


def lose(folder, stage: str) -> None:
    lost = list((folder / "cache").glob(f"{stage}-*"))
    assert lost
    for file in lost:
        file.write_bytes(file.read_bytes()[:-1])


def test_the_plan_of_a_first_a_second_and_a_damaged_run_is_what_happens(tmp_path):
    """Of a scene with stress of elements, files and stiffening."""
    scene, overrides = str(tmp_path / "more.toml"), [*QUICK, 'simulation.stiffening="on"']
    ready = files("fmd.models").joinpath("beam.toml").read_text(encoding="utf-8")
    (tmp_path / "more.toml").write_text(ready + MORE, encoding="utf-8")
    first = plan_and_run(tmp_path, overrides, scene)
    require_foretold(*first)
    assert "mesh" in first[1].log.run
    second = plan_and_run(tmp_path, overrides, scene)
    require_foretold(*second)
    assert {"modes", "body"} <= set(second[1].log.cached)
    for stage in ("stress", "modes"):
        lose(tmp_path, stage)
        plan, run = plan_and_run(tmp_path, overrides, scene)
        require_foretold(plan, run)
        (step,) = [step for step in plan.steps if step.stage == stage]
        assert (step.fate, step.why) == ("run", "no longer in the cache, or damaged")


def test_the_plan_tells_what_has_changed_and_what_it_took(tmp_path):
    _, run = plan_and_run(tmp_path, QUICK)
    plan, _ = plan_and_run(tmp_path, [*QUICK, "body.beam.modes.enrich='inertia'", "simulation.stiffening='auto'"])
    steps = {step.stage: step for step in plan.steps}
    assert steps["modes"].fate == "cached"
    assert steps["body"].why == "its inputs or the source have changed"
    assert steps["body"].seconds == run.log.seconds["body"]
    assert steps["mesh"].fate == "cached"
    assert steps["stiffening"].fate == "open"
    assert "body" in plan.line


def test_a_scene_without_flexible_bodies_skips_all_but_the_motion(tmp_path):
    plan, run = plan_and_run(tmp_path, ["simulation.duration=0.1 s"], "rod-slider")
    require_foretold(plan, run)
    assert not stages(plan, "run") & {*PART_STAGES}


@pytest.mark.slow
def test_the_plan_of_an_error_budget_is_what_happens(tmp_path):
    shared = frozenset({"mesh", "assembly"})  # what a budget's neighbours take over hangs on what is computed already
    require_foretold(*plan_and_run(tmp_path, QUICK, budget=True), shared)
    require_foretold(*plan_and_run(tmp_path, QUICK, budget=True), shared)
    lose(tmp_path, "error budget")
    require_foretold(*plan_and_run(tmp_path, QUICK, budget=True), shared)


def test_a_dry_run_prints_the_plan_and_leaves_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FMD_CACHE", str(tmp_path / "cache"))
    with pytest.raises(SystemExit, match="0"):
        main(["run", "beam-paper", "--dry-run", "--json", "--out", str(tmp_path / "out")])
    plan = json.loads(capsys.readouterr().out)["plan"]
    fates = {step["stage"]: step["fate"] for step in plan["stages"]}
    assert fates["mesh"] == fates["pictures"] == "run"
    assert not (tmp_path / "out").exists()
    assert not (tmp_path / "cache" / "stages").exists()


def test_the_plan_of_a_wanted_accuracy_is_open_until_its_settings_are_kept(tmp_path):
    first, run = plan_and_run(tmp_path, [*QUICK, "output=[]", "accuracy=40 %"], budget=True)
    assert {step.stage: step.fate for step in first.steps} == {
        **dict.fromkeys((*PART_STAGES, *RUN_STAGES, "error budget"), "open"),
        "accuracy": "run",
        "responses": "skipped",
        "files": "skipped",
        "pictures": "skipped",
    }
    assert "accuracy" in run.log.run
    again = plan_and_run(tmp_path, [*QUICK, "output=[]", "accuracy=40 %"], budget=True)
    require_foretold(*again)
    assert "accuracy" in stages(again[0], "cached")
    assert {"motion", "machine code"} <= stages(again[0], "run")
    assert not stages(again[0], "run") & {*PART_STAGES, "loads", "stability"}


@pytest.mark.parametrize(
    ("scene", "overrides"),
    [
        ("beam", ["body.beam.mesh.divisions=[28, 4, 4]"]),
        pytest.param("beam", ["body.beam.mesh.divisions=[40, 5, 7]"], marks=pytest.mark.long),
        pytest.param("gears", [], marks=pytest.mark.long),
        pytest.param("propeller", [], marks=pytest.mark.long),
    ],
)
def test_the_memory_of_modes_is_foretold_within_a_factor_of_two(scene: str, overrides: list[str]) -> None:
    """Against what Python counts of arrays: 0.8 to 1.6 times as much; other ready scenes have fewer unknowns."""
    run = Pipeline(load_scene(scene, overrides))
    for name, part in run.parts.items():
        expected = bytes_of_modes(run, name)
        tracemalloc.start()
        part.modes  # noqa: B018
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert 0.5 * peak < expected < 2.0 * peak


def test_large_memory_of_modes_is_in_the_forecast() -> None:
    """One line for all; a small one isn't told."""
    assert "; modes about 3 GB of memory" in Forecast((), memory_of_modes=3e9).line
    assert "modes" not in Forecast((), memory_of_modes=3e7).line
    large = forecast_run(Result(load_scene("gears"), Cache(None)), pictures=False, budget=False)
    run = Pipeline(load_scene("gears"))
    assert large.memory_of_modes == max(bytes_of_modes(run, name) for name in run.parts) > 1e8

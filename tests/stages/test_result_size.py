"""Results that don't fit into the memory are refused before anything is integrated."""

import re
import tracemalloc
from pathlib import Path

import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.solved_scene import SolvedScene
from fmd.cli.app import main
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.output.explain import forecast_run


def test_too_many_output_times_are_wrong_input_and_no_memory_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["run", "rod-slider", "--set", "simulation.output_step=1 as", "--out", str(tmp_path), "--no-pictures"])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert re.search(r"simulation\.output_step = '1e-18 s': makes 1e\+19 output times, .* GB are free: ", said)


def test_results_that_do_not_fit_are_refused_before_a_mesh_is_made(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And the forecast tells how much they take: of one body on a hinge with five modes, in three runs."""
    monkeypatch.setattr("fmd.stages.run_checks.available_memory", lambda: 1e8)
    given = ["beam-paper", "--set", "simulation.output_step=0.5 us", "--set", "simulation.run=[{integrator='auto'}]"]
    with pytest.raises(SystemExit) as stop:
        main(["run", *given, "--out", str(tmp_path), "--no-cache"])
    assert stop.value.code == 2
    assert "GB are free" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    forecast = forecast_run(SolvedScene(load_scene("beam-paper", given[2::2])), pictures=False, budget=False)
    scene = load_scene("beam-paper")
    n_times = scene.simulation.duration / 0.5e-6
    assert forecast.memory == pytest.approx(3 * 8 * (60 + 4 * 2 * (1 + 5)) * n_times)
    assert f"results take about {forecast.memory / 1e9:.2g} GB" in forecast.line


def test_the_step_in_the_message_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fmd.stages.run_checks.ALWAYS_FIT", 0.0)
    monkeypatch.setattr("fmd.stages.run_checks.available_memory", lambda: 1e6)
    with pytest.raises(InputError, match=r"0\.001 GB are free: \S+ s or longer fits") as caught:
        _ = Pipeline(load_scene("rod-slider")).motions
    (step,) = re.findall(r"free: (\S+) s", str(caught.value))
    # Two bodies of 60 numbers, two coordinates of 4 numbers for position and rate, 8 bytes each, in three runs.
    assert float(step) == pytest.approx(10 * 3 * 8 * (2 * 60 + 2 * 2 * 4) / 1e6, rel=0.12)
    assert Pipeline(load_scene("rod-slider", [f"simulation.output_step={step} s"])).motions


def test_a_budget_copies_no_motion_of_which_all_times_are_outputs() -> None:
    """Peaks for each output time: 33 numbers of quantities, of both marches and of their differences; copies had 41."""
    only, peaks = "simulation.run=[{integrator='central-difference'}]", []
    for n_times in (10_000, 60_000):
        step = f"simulation.output_step={2.0 / n_times} s"
        run = Pipeline(load_scene("rod-slider", [only, step, "simulation.duration=2 s"]), Cache(None))
        run.fine_motion  # noqa: B018 - the budget's own memory is meant
        tracemalloc.start()
        state_errors(run)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / 50_000 < 8 * 37

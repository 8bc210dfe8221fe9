"""A wanted accuracy: chosen settings meet it by true errors, or the message has the best that was measured."""

import json

import pytest

from pipeline import Pipeline, accuracy, load_scene
from pipeline.accuracy import meet_accuracy
from pipeline.budget import true_errors
from pipeline.cache import Cache
from pipeline.checks import AccuracyError, InputError
from pipeline.cli import main

QUICK = ("simulation.duration=0.1 s", "simulation.output_step=1 ms", "body.beam.mesh.divisions=[24, 2, 1]")


@pytest.mark.slow
def test_four_percent_on_the_beam_take_more_than_the_first_try_and_true_errors_are_below() -> None:
    run = Pipeline(load_scene("beam", [*QUICK, "accuracy=4 %"]), Cache(None))
    met, rounds = meet_accuracy(run)
    assert rounds[0].worst.total > 0.04 >= rounds[-1].worst.total
    finer = ["body.beam.mesh.divisions=[48, 4, 2]", "body.beam.modes.count=10", "body.beam.modes.enrich=ritz"]
    exact = [*QUICK[:2], *finer, "simulation.error=1e-6", 'simulation.run=[{integrator="auto"}]']
    assert max(true_errors(met, Pipeline(load_scene("beam", exact), Cache(None))).values()) < 0.04


def test_a_chain_of_rigid_bodies_meets_it_by_its_integrator_alone(tmp_path, capsys) -> None:
    overrides = ["--set", "accuracy=0.1 %", "--set", "simulation.duration=1 s"]
    with pytest.raises(SystemExit) as stop:
        main(["run", "rod-slider", *overrides, "--no-pictures", "--out", str(tmp_path), "--json"])
    assert not stop.value.code
    summary = json.loads(capsys.readouterr().out)
    assert summary["accuracy"]["wanted"] == pytest.approx(1e-3)
    assert summary["accuracy"]["rounds"][-1]["worst"]["stated"] <= 1e-3
    assert max(row["total"] for row in summary["error_budget"]["rows"]) <= 1e-3
    assert [row["integrator"] for row in summary["integrations"]] == ["auto (runge-kutta)"]


def test_what_is_not_met_ends_with_the_best_that_was_measured(monkeypatch) -> None:
    monkeypatch.setattr(accuracy, "_MOST_ROUNDS", 1)
    run = Pipeline(load_scene("beam", [*QUICK, "accuracy=0.1 %"]), Cache(None))
    with pytest.raises(AccuracyError, match=r"accuracy = 0.10%: not met in 1 rounds; the best states \d+"):
        meet_accuracy(run)


@pytest.mark.parametrize(("given", "message"), [("0.01", "as text"), ("1", "as text"), ("80 %", "between 0.0001 %")])
def test_an_accuracy_is_a_percentage(given: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_scene("beam", [f"accuracy={given}"])


def test_an_accuracy_needs_the_budget(tmp_path, capsys) -> None:
    arguments = ["run", "rod-slider", "--set", "accuracy=1 %", "--no-budget", "--no-pictures", "--out", str(tmp_path)]
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert "--no-budget" in capsys.readouterr().err

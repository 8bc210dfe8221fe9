"""Run time against error: what the table holds, and that it can't be had from a doubtful reference."""

import csv
import json

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.cli.app import main
from fmd.core.errors import AccuracyError
from fmd.output.work_precision import Errors, compare, compare_on_scene

SHORT = ["simulation.duration=25 ms"]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def result():
    return compare_on_scene(Pipeline(load_scene("beam-paper", SHORT)), repeats=1)


def rows_of(result, name):
    return [row for row in result.rows if row.integrator == name]


@pytest.mark.long
def test_every_method_is_there_and_measured(result):
    methods = {"central-difference", "sub-cycling 5:1", "sub-cycling 10:1", "generalized-alpha", "exponential"}
    adaptive = {"exponential-rosenbrock", "runge-kutta", "Radau", "LSODA"}
    assert {row.integrator for row in result.rows} == methods | adaptive
    assert all(row.seconds > 0 and row.evaluations > 0 and np.isfinite(row.error) for row in result.rows)


@pytest.mark.long
def test_the_references_agree_far_beyond_what_is_compared(result):
    # Runge-Kutta of order 8 and the exponential method at a fine step share neither formula nor steps.
    assert result.reference_error < 1e-10


@pytest.mark.long
@pytest.mark.parametrize(("name", "order"), [("central-difference", 2), ("sub-cycling 5:1", 2), ("exponential", 4)])
def test_errors_fall_at_least_at_the_declared_order(result, name, order):
    rows = [row for row in rows_of(result, name) if 1e-10 < row.error < 1e-3]
    slope = np.polyfit(np.log([row.step_s for row in rows]), np.log([row.error for row in rows]), 1)[0]
    assert slope > order - 0.35  # a fit over the whole range: at the coarse end errors fall faster than they must


def test_a_reference_that_cannot_be_confirmed_stops_the_comparison():
    run = Pipeline(load_scene("beam-paper", SHORT))
    times = np.linspace(0, 0.01, 3)
    with pytest.raises(AccuracyError, match=r"two references differ by 1\.0e\+00, above 1e-08"):
        compare(run.system, *run.start, times, lambda found, exact: Errors(1.0, 1.0, 1.0))


def test_the_command_writes_table_and_chart(tmp_path, capsys):
    with pytest.raises(SystemExit) as done:
        main(["bench", "rod-slider", "--set", "simulation.duration=0.01 s", "--out", str(tmp_path), "--json"])
    assert not done.value.code
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert {"integrator", "step_s", "substeps", "seconds", "error", "evaluations"} <= rows[0].keys()
    lines = (tmp_path / "rod-slider.csv").read_text().splitlines()
    assert lines[0].startswith("# ")
    assert len(list(csv.DictReader(lines[1:]))) == len(rows)
    assert (tmp_path / "rod-slider.png").stat().st_size > 10_000

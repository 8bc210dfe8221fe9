"""Errors of a sweep's figures: in their own columns, or the reason why none is stated."""

import csv

import numpy as np
import pytest
import xarray
from scipy.integrate import solve_ivp

from fmd import load_scene
from fmd.sweep.points import Point, Variation, point_key
from fmd.sweep.record import Record, Wanted
from fmd.sweep.study import run_sweep
from fmd.sweep.table import SweepTable, write_tables
from fmd.sweep.work import compute_point

pytestmark = pytest.mark.slow

PENDULUM = """
title = "pendulum"
[body.rod]
shape = "rod"
mass = "1 kg"
length = "1 m"
marker = { top = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }
[joint.hinge]
type = "revolute"
parent = "ground"
child = "rod.top"
axis = [0, 0, 1]
[simulation]
duration = "2 s"
output_step = "20 ms"
tip = "rod.end"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
run = [{ integrator = "runge-kutta", tolerance = 1e-4 }]
"""


@pytest.fixture(scope="module")
def points(tmp_path_factory):
    """Return two pendulums of a sweep, one whose errors are stated and one without."""
    file = tmp_path_factory.mktemp("scene") / "pendulum.toml"
    file.write_text(PENDULUM)
    scenes = [load_scene(file, [f"body.rod.length={length} m"]) for length in (1, 2)]
    return [Point((f"{k + 1} m",), scene, point_key(scene)) for k, scene in enumerate(scenes)]


@pytest.fixture(scope="module")
def study(points, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")

    def compute(scenes):
        for number, (key, scene) in enumerate(scenes.items()):
            yield key, compute_point(key, scene, Wanted(budget=number == 0))

    return run_sweep([Variation("body.rod.length", ("1 m", "2 m"))], points, folder, compute), folder


def test_the_end_of_a_pendulum_by_quadrature_lies_within_the_error_of_its_column(study):
    """The equation of motion θ'' = −3 g cos θ / 2 l by SciPy at a tolerance of 1e-12."""
    row, other = SweepTable(study[0]).rows
    exact = solve_ivp(
        lambda _, y: [y[1], -1.5 * 9.81 * np.cos(y[0])], (0.0, 2.0), [0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12
    )
    name = "run.0.final.joint_positions.hinge"
    apart = abs(row[name] - exact.y[0, -1])
    assert 1e-9 < apart <= row[f"{name}.error"] < 1e-2
    assert other[f"{name}.error"] is None


def test_files_say_which_column_has_an_error_or_why_none_is_stated(study):
    sweep, folder = study
    files = write_tables(SweepTable(sweep), folder)
    assert files == ["sweep.csv", "sweep.nc", "sweep-errors.csv"]
    errors = {row["column"]: row for row in csv.DictReader((folder / "sweep-errors.csv").read_text().splitlines())}
    assert errors["run.0.final.joint_rates.hinge"]["why not"] == "run.0.final.joint_rates.hinge.error has it"
    assert errors["run.0.seconds"]["why not"].startswith("not stated: ")
    attributes = xarray.load_dataset(folder / "sweep.nc", engine="scipy")["run.final.kinetic_energy_j"].attrs
    assert attributes == {"units": "J", "error": "run.final.kinetic_energy_j.error has it"}


def test_a_sweep_with_budget_computes_points_anew_that_have_none(points, study):
    """And refused points, or those that a budget couldn't help, aren't computed again."""
    seen = []

    def compute(scenes):
        seen.extend(scenes)
        return iter([(key, Record("refused", "not again")) for key in scenes])

    run_sweep([Variation("body.rod.length", ("1 m", "2 m"))], points, study[1], compute, wanted=Wanted(budget=True))
    assert seen == [points[1].key]

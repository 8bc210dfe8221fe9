"""Frequencies of bases with few fixed-interface modes, held against a free beam in closed form."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.estimators import Estimates
from fmd.accuracy.time_limit import TimeLimit

LENGTH, E, RHO = 0.4, 70e9, 2700.0
SCENE = f"""
title = "bar between two joints"
[body.bar]
shape = "bar"
length = "{LENGTH} m"
depth = "30 mm"
width = "20 mm"
E = "{E} Pa"
nu = 0.33
rho = "{RHO} kg/m^3"
mesh = {{ order = 2, divisions = [8, 1, 1] }}
modes = {{ count = 2, boundary = "interface" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
[joint.hub]
type = "fixed"
parent = "ground"
child = "bar.root"
[simulation]
duration = "0.1 ms"
output_step = "0.1 ms"
tip = "bar.tip"
run = [{{ integrator = "central-difference", step = "1 us" }}]
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("interface") / "bar.toml"
    file.write_text(SCENE)
    return file


@pytest.fixture(scope="module")
def run(file: Path) -> Pipeline:
    return Pipeline(load_scene(file))


def test_a_frequency_that_two_modes_make_half_too_high_has_that_error(run: Pipeline) -> None:
    """The second bending across 20 mm of a free beam, (βL)² = 61.67: 1803 Hz, with shear 1.2 % less, not 2634."""
    exact = 61.67 / (2 * np.pi * LENGTH**2) * 0.02 * np.sqrt(E / RHO / 12)
    estimates = Estimates(run)
    errors, given = estimates._interface_modes(), float(run.part.modes.frequencies_hz[2])
    assert given > 1.4 * exact
    assert errors["bar, frequency 3"] == pytest.approx(given / exact - 1, rel=0.05)
    assert given + estimates.corrections["bar, frequency 3"] == pytest.approx(exact, rel=0.02)
    assert errors["bar, frequency 1"] < 0.01


def test_what_the_time_limit_leaves_out_is_not_stated(run: Pipeline) -> None:
    errors = Estimates(run, TimeLimit(0.0))._interface_modes()
    assert len(errors) == len(run.part.modes.omega)
    assert all(str(why).startswith("not estimated: it would take longer") for why in errors.values())


def test_a_basis_of_vibrations_has_nothing_to_compare(file: Path) -> None:
    free = Pipeline(load_scene(file, ["body.bar.modes.boundary=joint"]))
    assert Estimates(free)._interface_modes() == {}


def test_the_command_warns_of_frequencies_that_are_upper_bounds(file: Path, fmd: Any, capsys: Any) -> None:
    assert fmd("modes", file) == 0
    assert "upper bounds" in " ".join(capsys.readouterr().out.split())

"""What tolerances make of results, against closed forms of an oscillator and samples of these."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.core.errors import InputError
from fmd.fitting.parameters import find_parameter
from fmd.fitting.uncertainty import combine_tolerances, sample_tolerances
from fmd.output.channels import find_channels
from tests.fitting.test_sensitivities import MASS, OSCILLATOR, START, STIFFNESS

TOLERANCES = ("body.block.mass=2 kg ± 1 %", "joint.slide.spring=800 N/m ± 24 N/m", "joint.slide.position=10 mm ± 0.5 %")
SHARES = np.array([0.01, 0.03, 0.005])
KEYS = ["body.block.mass", "joint.slide.spring", "joint.slide.position"]


def closed_form(mass: Any, spring: Any, start: Any, t: np.ndarray) -> Any:
    return start * np.cos(np.sqrt(spring / mass) * t)


@pytest.fixture(scope="module")
def result() -> Any:
    return package.load(OSCILLATOR, *TOLERANCES, "simulation.step=0.2 ms")


def test_tolerances_combine_by_their_squares(result: Any) -> None:
    found = package.jacobian(result, ["slide.position", "block.mass"], KEYS)
    place, mass = combine_tolerances(found, result.run.scene.tolerances)
    t = result.run.output_times
    omega = np.sqrt(STIFFNESS / MASS)
    by_spring = -0.5 * START * omega * t * np.sin(omega * t)
    parts = np.array([-by_spring, by_spring, START * np.cos(omega * t)]) * SHARES[:, None]
    expected = np.sqrt(np.mean(parts**2, axis=1))
    np.testing.assert_allclose([place.shares[key] for key in KEYS], expected, rtol=1e-4)
    assert place.half_width == pytest.approx(np.sqrt((expected**2).sum()), rel=1e-4)
    row = place.row()
    assert sum(row["contributions"].values()) == pytest.approx(1.0, rel=1e-12)
    assert row["contributions"]["joint.slide.spring"] == pytest.approx(
        9 * row["contributions"]["body.block.mass"], rel=1e-4
    )
    assert (mass.value, mass.half_width) == pytest.approx((2.0, 0.02), rel=1e-9)


def test_samples_have_the_intervals_of_the_closed_form(result: Any) -> None:
    run = result.run
    channels = [each for name in ("slide.position", "block.mass") for each in find_channels(run, name)]
    parameters = [find_parameter(run.scene, key) for key in KEYS]
    found = sample_tolerances(run, channels, parameters, run.scene.tolerances, 60)
    t = run.output_times
    drawn = 1.0 + np.random.default_rng(1).normal(size=(20000, 3)) * SHARES / 1.96
    motions = closed_form(*(drawn[:, k, None] * size for k, size in enumerate((MASS, STIFFNESS, START))), t)
    low, high = np.quantile(motions, [0.025, 0.975], axis=0)
    (half,) = found["slide.position"]
    # Quantiles of 60 samples are good to a tenth or so.
    assert half == pytest.approx(np.sqrt(np.mean((0.5 * (high - low)) ** 2)), rel=0.15)
    np.testing.assert_allclose(found["block.mass"], [1.98, 2.02], atol=0.003)


def test_the_command_takes_the_numbers_with_tolerances_and_writes_table_and_chart(
    fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "block.toml"
    path.write_text(TOML)
    given = ["--of", "slide.position,mass", "--out", tmp_path / "out"]
    assert fmd("sensitivities", path, *given, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"][-2:] == ["uncertainties.csv", "uncertainties.png"]
    assert {row["to"] for row in found["rows"]} == {"body.block.mass", "joint.slide.spring"}
    (place, mass) = found["uncertainties"]
    assert mass["contributions"] == {"body.block.mass": 1.0, "joint.slide.spring": 0.0}
    assert place["sampled"] is None
    with (tmp_path / "out" / "uncertainties.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4
    assert sum(float(row["part_of_variance"]) for row in rows) == pytest.approx(2.0, rel=1e-6)
    assert fmd("sensitivities", path, *given, "--sample", "40") == 0
    text = capsys.readouterr().out
    assert "variance" in text  # a narrow column wraps
    assert "sampled" in text
    assert fmd("sensitivities", path, *given, "--sample", "3") == 2
    assert "takes 40 at least" in capsys.readouterr().err
    assert fmd("sensitivities", "arm", "--of", "tip") == 2
    assert "or tolerances in the scene" in capsys.readouterr().err


def test_a_tolerance_of_what_is_no_number_of_the_results_is_refused() -> None:
    result = package.load(OSCILLATOR, "simulation.duration=0.5 s ± 1 %")
    with pytest.raises(InputError, match="is no number that results change with smoothly"):
        package.jacobian(result, ["slide.position"], [*result.run.scene.tolerances])


TOML = """
title = "Block"

[body.block]
shape = "rigid"
mass = "2 kg ± 1 %"
inertia = ["0.1 kg m^2", "0.1 kg m^2", "0.1 kg m^2"]
marker = { hook = { at = ["0 m", "0 m", "0 m"] } }

[joint.slide]
type = "prismatic"
parent = "ground"
child = "block.hook"
axis = [1, 0, 0]
spring = "800 N/m ± 3 %"
position = "10 mm"

[simulation]
duration = "0.1 s"
output_step = "10 ms"
step = "1 ms"
tip = "block.hook"

[[simulation.run]]
integrator = "central-difference"
"""

"""Fits of a scene's numbers to measured histories: what data can tell, intervals, files and messages."""

import csv
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.core import progress
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.fitting import fit as fits
from fmd.fitting.experiment_files import read_experiments
from fmd.fitting.experiments import HistoryExperiment
from fmd.fitting.fit import fit_scene
from fmd.fitting.fit_model import FitModel
from fmd.fitting.fit_result import find_information, probability_of, whiteness
from fmd.fitting.measured_tables import read_table
from fmd.fitting.measurements import estimate_noise, noise_spread, read_measurements
from fmd.fitting.parameters import find_parameter
from fmd.fitting.varied import VariedNumber, read_varied
from fmd.output.channels import find_channels
from tests.fitting.test_sensitivities import OSCILLATOR, SMALL_ARM

TRUTH = {
    "joint.elbow.spring": (75.0, "N m"),
    "joint.elbow.damper": (0.27, "N m s"),
    "body.gripper.mass": (0.5, "kg"),
    "joint.wrist.spring": (16.0, "N m"),
}
CHANNELS = ("elbow.position", "wrist.position", "forearm.wrist.position.y")


def measure(
    result: Any, names: Sequence[str], path: Path, noise: float, seed: int = 0, units: Mapping[str, str] | None = None
) -> dict[str, float]:
    """Write histories of a scene with noise, a part of each one's spread, as a file; return the noise in SI units."""
    rng, run = np.random.default_rng(seed), result.run
    header, columns, sigmas = ["time [ms]"], [1e3 * run.output_times], {}
    for name in names:
        (channel,) = find_channels(run, name)
        values = np.asarray(channel.read(run))
        sigmas[name] = noise * float(values.std())
        unit, factor = (units or {}).get(name, channel.unit), 1e3 if name in (units or {}) else 1.0
        header.append(f"{name} [{unit}]")
        columns.append(factor * (values + sigmas[name] * rng.standard_normal(values.shape)))
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(header)
        table.writerows([f"{x:.12g}" for x in row] for row in zip(*columns, strict=True))
    return sigmas


@pytest.fixture(scope="module")
def true_arm() -> Any:
    return package.load("arm", *SMALL_ARM, *(f"{key}={value} {unit}" for key, (value, unit) in TRUTH.items()))


@pytest.mark.parametrize(("seed", "codes"), [(0, []), (1, ["not-white"])])
def test_four_numbers_of_the_arm_come_back_from_histories_with_five_per_cent_of_noise(
    true_arm: Any, tmp_path: Path, seed: int, codes: list[str]
) -> None:
    """Of seed 1 one channel's correlations have a probability of 1e-4 by chance, but χ² has 0.96: no false minimum."""
    units = {"forearm.wrist.position.y": "mm"}
    sigmas = measure(true_arm, CHANNELS, tmp_path / "measured.csv", 0.05, seed=seed, units=units)
    arm = package.load("arm", *SMALL_ARM)
    fit = fit_scene(
        read_experiments([(arm.run, str(tmp_path / "measured.csv"))], sigmas), read_varied(arm.run, [*TRUTH])
    )
    assert fit.evaluations <= 10
    assert fit.probability > 1e-3
    for (true, _), value, half in zip(TRUTH.values(), fit.values, fit.after.half_widths, strict=True):
        assert abs(np.log(value / true)) < 1.5 * half  # three standard deviations
    assert [each["code"] for each in fit.warnings()] == codes
    assert all(probability > 1e-3 for probability in fit.white.values()) == (not codes)


def test_what_the_data_do_not_determine_is_refused_by_name(true_arm: Any, tmp_path: Path) -> None:
    measure(true_arm, ["elbow.position"], tmp_path / "measured.csv", 0.05)
    arm = package.load("arm", *SMALL_ARM)
    keys = [*TRUTH, "body.forearm.E", "body.forearm.modes.damping"]
    with pytest.raises(InputError, match="these data don't determine") as caught:
        fit_scene(read_experiments([(arm.run, str(tmp_path / "measured.csv"))], {}), read_varied(arm.run, keys))
    assert "body.forearm.modes.damping (±" in str(caught.value)
    assert "body.gripper.mass (±" in str(caught.value)
    assert "it goes with joint.elbow.spring and body.forearm.E" in str(caught.value)
    assert "joint.elbow.damper" not in str(caught.value)


def test_of_a_mass_on_a_spring_the_position_tells_but_the_ratio(tmp_path: Path) -> None:
    """Both scale the one frequency: without something known of one of them neither is determined."""
    measure(package.load(OSCILLATOR), ["slide.position"], tmp_path / "measured.csv", 0.02)
    data, keys = str(tmp_path / "measured.csv"), ["joint.slide.spring", "body.block.mass"]
    start = package.load(OSCILLATOR | {"title": "Start"}, "joint.slide.spring=700 N/m")
    with pytest.raises(InputError, match=r"joint.slide.spring \(.*\), body.block.mass \("):
        fit_scene(read_experiments([(start.run, data)], {}), read_varied(start.run, keys))
    fit = fit_scene(read_experiments([(start.run, data)], {}), read_varied(start.run, keys, ["body.block.mass=2 %"]))
    spring, mass = fit.values
    assert spring / mass == pytest.approx(400.0, rel=2e-3)
    half = fit.after.half_widths
    np.testing.assert_allclose(half, 1.96 * 0.02, rtol=0.02)  # the prior's: the data tell the ratio far better
    assert fit.after.partners(0) == [1]


def test_the_jacobian_is_that_of_the_closed_form(tmp_path: Path) -> None:
    true = package.load(OSCILLATOR)
    sigmas = measure(true, ["slide.position"], tmp_path / "measured.csv", 0.05)
    varied = read_varied(true.run, ["joint.slide.spring=1..2000"])
    model = FitModel(read_experiments([(true.run, str(tmp_path / "measured.csv"))], sigmas), varied)
    t = true.run.output_times
    expected = -0.01 * 20.0 * t / 2.0 * np.sin(20.0 * t) / sigmas["slide.position"]
    np.testing.assert_allclose(model.jacobian(np.zeros(1))[:, 0], expected, atol=1e-5 * np.abs(expected).max())


def test_information_is_the_inverse_normal_matrix_and_infinite_where_nothing_is_told() -> None:
    J = np.random.default_rng(0).standard_normal((30, 3)) * [1.0, 1e6, 1e-4]
    np.testing.assert_allclose(find_information(J).covariance, np.linalg.inv(J.T @ J), rtol=1e-9)
    dependent = np.column_stack([J, 2.0 * J[:, 1], np.zeros(30)])
    found = find_information(dependent)
    assert np.isfinite(found.half_widths).tolist() == [True, False, True, False, False]
    assert [found.partners(k) for k in range(5)] == [[], [3], [], [1], []]
    assert found.correlation[1, 3] == pytest.approx(-1.0)  # more of one and less of the other leave all as it is
    fewer = find_information(np.column_stack([J[:2], np.zeros(2)]))  # two residuals of four numbers
    assert np.isinf(fewer.half_widths).all()
    assert fewer.partners(3) == []


def test_chi_squared_of_noise_that_is_estimated_has_the_probability_that_it_is_so_large() -> None:
    """Of 4,000 noises of 400 values each, one in a hundred is below 0.01 and one in ten below 0.1."""
    noises = np.random.default_rng(4).standard_normal((4000, 400))
    t = np.linspace(0.0, 1.0, 400)
    found = [probability_of(float(np.sum((x / estimate_noise(t, x)) ** 2)), 400, noise_spread()) for x in noises]
    assert np.mean(np.array(found) < 0.1) == pytest.approx(0.1, abs=0.02)
    assert np.mean(np.array(found) < 0.01) == pytest.approx(0.01, abs=0.007)


def test_noise_is_estimated_on_a_smooth_history_and_its_residuals_are_white() -> None:
    rng, t = np.random.default_rng(3), np.linspace(0.0, 1.0, 2000)
    noise = 0.01 * rng.standard_normal(2000)
    assert estimate_noise(t, np.sin(6.0 * t) + noise) == pytest.approx(0.01, rel=0.1)
    assert estimate_noise(t, t**3) < 1e-12
    uneven = np.sort(rng.permutation(t)[:1500])
    few = uneven[(uneven < 0.4) | (uneven > 0.5)][::5]
    for some in (uneven, few, t[(t < 0.3) | (t > 0.6)][::10]):
        own = 0.01 * rng.standard_normal(some.size)
        assert estimate_noise(some, np.sin(20.0 * some) + own) == pytest.approx(0.01, rel=0.2)
    assert whiteness(noise) > 0.01
    assert whiteness(noise + 0.005 * np.sin(6.0 * t)) < 1e-6


def test_swift_histories_whose_noise_is_estimated_too_large_are_doubted_by_their_correlations(tmp_path: Path) -> None:
    """At 2.2 rad a sample fourth differences take the vibration itself for noise."""
    true = package.load(OSCILLATOR, "joint.slide.spring=1e5 N/m")
    measure(true, ["slide.position"], tmp_path / "measured.csv", 0.02)
    experiments = read_experiments([(true.run, str(tmp_path / "measured.csv"))], {})
    model = FitModel(experiments, read_varied(true.run, ["joint.slide.spring"]))
    doubted = []
    for share in (0.0, 0.3):
        shares = np.array([share])
        residuals, information = model.residuals(shares), find_information(model.jacobian(shares))
        found = fits.Fit(model, information, information, shares, float(residuals @ residuals), 1, 1)
        assert found.probability > 0.02
        doubted.append(found.doubtful)
    assert doubted == [False, True]


def test_bounds_take_units_and_a_number_below_zero_counts_by_shares() -> None:
    arm = package.load("arm", *SMALL_ARM)
    spring, mass = read_varied(arm.run, ["joint.elbow.spring=10..2e5 N mm", "body.gripper.mass=100 g..2 kg"])
    assert (spring.low, spring.high) == pytest.approx((0.01, 200.0))
    assert (mass.low, mass.high) == pytest.approx((0.1, 2.0))
    assert mass.by_logarithm
    gravity = VariedNumber(find_parameter(arm.scene, "simulation.gravity.1"))
    assert not gravity.by_logarithm
    assert gravity.from_share(gravity.to_share(-9.0)) == pytest.approx(-9.0)


@pytest.mark.parametrize(
    ("vary", "prior", "words"),
    [
        ([], [], "is missing: numbers to vary"),
        (["joint.elbow.spring=100..200"], [], "scene's value, 60 N m/rad; without a unit bounds are in N m/rad"),
        (["joint.elbow.spring=200..10"], [], "the first bound must be below the second"),
        (["joint.elbow.spring=10"], [], "must be two bounds"),
        (["joint.elbow.spring=10 kg..100 kg"], [], "must be in a unit of N m/rad"),
        (["joint.elbow.spring", "joint.elbow.spring"], [], "is varied twice"),
        (["joint.elbow.spring"], ["joint.elbow.damper=5 %"], "isn't varied"),
        (["joint.elbow.spring"], ["joint.elbow.spring=5"], "must be a percentage"),
    ],
)
def test_what_is_varied_wrongly_is_refused(vary: list[str], prior: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_varied(package.load("arm", *SMALL_ARM).run, vary, prior)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("seconds\n0\n1\n", "has one column"),
        ("time [s],slide.position [kg]\n0,1\n0.1,2\n", "is no unit of this result; m works"),
        ("time [s],slide.positoin [m]\n0,1\n0.1,2\n", "did you mean 'slide.position'"),
        ("time [s],slide.position [m]\n0,1\n0.9,2\n", "the scene's motion from 0 s to 0.5 s"),
        ("time [s],slide.force [N]\n0,1\n0.1,2\n", "is no history of one number"),
        ("time [s],slide.position [m]\n0,1\n0.1,\n", "the cell is empty"),
        ("time [s],slide.position [m]\n0,1\n0.1,2\n", "shows no noise"),
    ],
)
def test_a_wrong_table_is_refused(table: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "measured.csv"
    path.write_text(table)
    with pytest.raises(InputError, match=words):
        read_measurements(package.load(OSCILLATOR).run, read_table(str(path)), {})


def test_displacements_count_from_the_start_though_the_measurement_begins_later(tmp_path: Path) -> None:
    true = package.load(OSCILLATOR)
    path = tmp_path / "measured.csv"
    path.write_text("time [s],block.hook.displacement.x [m]\n" + "".join(f"{t},0\n" for t in (0.1, 0.2, 0.3)))
    measured = read_measurements(true.run, read_table(str(path)), {"block.hook.displacement.x": 1e-3})
    model = FitModel((HistoryExperiment(true.run, measured),), read_varied(true.run, ["joint.slide.spring"]))
    expected: Array = 0.01 * (np.cos(20.0 * np.array([0.1, 0.2, 0.3])) - 1.0)
    np.testing.assert_allclose(model.predict(np.zeros(1))[0][0], expected, atol=1e-7)


def test_the_command_writes_the_scene_that_fits(
    fmd: Any,
    true_arm: Any,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(fits, "FIRST_PARTS", ())  # a bound keeps it from the minimum: searches by parts find no other
    measure(true_arm, CHANNELS, tmp_path / "measured.csv", 0.02)
    settings = [word for text in SMALL_ARM for word in ("--set", text)]
    given = ["--to", tmp_path / "measured.csv", "--vary", "joint.elbow.spring=10..61,drive.swing.torque"]
    given += ["--vary", "body.gripper.mass", "--vary", "joint.wrist.spring", "--out", tmp_path / "fit"]
    monkeypatch.setattr(progress, "SAY_AFTER_SECONDS", 1e-3)
    assert fmd("fit", "arm", *settings, *given, "--sigma", "elbow.position=0.1 deg") == 0
    said, lines = capsys.readouterr()
    assert re.search(r"s: fit: derivatives, (25|50|75) %, about \d+ s left\n", lines)
    assert "at its" in said  # bound: a narrow column wraps
    assert "estimated from its values" in said
    assert {path.name for path in (tmp_path / "fit").iterdir()} == {"fit.png", "fit.csv", "fit.json", "fitted.toml"}
    found = json.loads((tmp_path / "fit" / "fit.json").read_text())
    spring, torque, *_ = found["parameters"]
    assert spring["at_bound"]
    assert {"at-bound", "poor-fit"} <= {each["code"] for each in found["warnings"]}
    assert [each["estimated"] for each in found["noise"]] == [False, True, True]
    assert np.shape(found["correlation"]) == (4, 4)
    again = package.load_scene(tmp_path / "fit" / "fitted.toml")
    assert again.joint["elbow"].spring == pytest.approx(spring["value"], rel=1e-12)
    assert again.drive["swing"].torque.formula == f"{torque['value']!r}*(12*sin(2*pi*t))"
    assert again.simulation.duration == 0.2
    text = (tmp_path / "fit" / "fitted.toml").read_text()
    assert text.startswith("# Fitted by fmd fit arm to ")
    assert fmd("fit", "arm", *settings, *given, "--sigma", "elbow.positoin=1 deg") == 2
    assert "no such channel; did you mean 'elbow.position'" in capsys.readouterr().err


def test_a_history_in_another_unit_is_named_where_the_fit_ends_and_where_it_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers in millimetres whose heading says metres: a thousand times as much as the scene has."""
    result = package.load(OSCILLATOR)
    measure(result, ["slide.position"], path := tmp_path / "wrong.csv", 0.05, units={"slide.position": "m"})
    varied = read_varied(result.run, ["joint.slide.position"])
    with pytest.raises(
        InputError, match=r"don't determine joint\.slide\.position .*; slide\.position varies .* its unit"
    ):
        fit_scene(read_experiments([(result.run, str(path))], {}), varied)
    experiments = read_experiments([(result.run, str(path))], {"slide.position": 1e-3})
    fit = fit_scene(experiments, varied)
    (text,) = [each["text"] for each in fit.warnings() if each["code"] == "unlike-size"]
    assert re.fullmatch(r"slide\.position varies 99\d times as much .* at first: check its unit", text)

    (still,) = [channel.values.copy() for channel in fit.model.experiments[0].channels]
    still[:] = 0.3 + 1e-16 * np.arange(still.size)
    with monkeypatch.context() as patched:
        patched.setattr(FitModel, "predict", lambda *_: [[still]])
        assert fit.model.unlike_size() == ""  # round-off of what rests

    def fail(*_: Any) -> None:
        raise AccuracyError("the motion fails")

    monkeypatch.setattr(fits, "_search_from", fail)
    with pytest.raises(AccuracyError, match=r"the motion fails; slide\.position varies .*: check its unit"):
        fit_scene(experiments, varied)

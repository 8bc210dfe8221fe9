"""Fits to modes, to frequency responses and to several experiments at once, against scenes whose numbers are known."""

import copy
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.optimize import OptimizeResult

import fmd as package
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.fitting import fit
from fmd.fitting.experiment_files import assurance, read_experiments
from fmd.fitting.fit import fit_scene
from fmd.fitting.fit_model import FitModel
from fmd.fitting.measured_tables import read_table
from fmd.fitting.varied import read_varied
from fmd.stages.linear_model import linearise_scene
from tests.fitting.test_fit import measure
from tests.fitting.test_measured_files import universal_text
from tests.fitting.test_sensitivities import OSCILLATOR

PLATE: dict[str, Any] = {
    "title": "Plate on an elastic clamp",
    "body": {
        "plate": {
            "shape": "bar",
            "length": 0.24,
            "depth": 0.16,
            "width": 0.006,
            "E": 210e9,
            "nu": 0.3,
            "rho": 7850.0,
            "mesh": {"element": "hexahedron", "order": 2, "divisions": [4, 2, 1]},
            "modes": {"count": 8, "enrich": "residual", "damping": 0.01},
            "marker": {
                "root": {"face": "x-", "attachment": "rigid"},
                "a": {"at": [0.12, -0.08, 0.0]},
                "b": {"at": [0.12, 0.08, 0.0]},
                "c": {"at": [0.24, -0.08, 0.0]},
                "d": {"at": [0.24, 0.0, 0.0]},
                "e": {"at": [0.24, 0.08, 0.0]},
            },
        }
    },
    "joint": {
        "clamp": {
            "type": "revolute",
            "parent": "ground",
            "child": "plate.root",
            "axis": [0, 1, 0],
            "spring": 2000.0,
            "damper": 0.05,
        }
    },
    "simulation": {"duration": 0.02, "output_step": 1e-4, "tip": "plate.e", "run": [{"integrator": "auto"}]},
}
OUTPUTS = [f"plate.{marker}.z" for marker in "abcde"]
START = ["body.plate.E=180 GPa", "joint.clamp.spring=1500 N m", "body.plate.modes.damping=0.02"]


def write_table(path: Path, columns: Mapping[str, Array]) -> str:
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(f"{x:.12g}" for x in row) for row in rows)]) + "\n")
    return str(path)


def modes_of(run: Any, count: int, outputs: Sequence[str] = ()) -> tuple[Array, Array, Array]:
    """Return frequencies, damping ratios and shapes of a scene's first modes, by SciPy's solver of the pencil."""
    from scipy.linalg import eig

    model = linearise_scene(run, (), outputs).model
    values, vectors = eig(model.A)
    chosen = sorted((k for k in range(len(values)) if values[k].imag > 1.0), key=lambda k: abs(values[k]))[:count]
    poles = values[chosen]
    return np.abs(poles) / (2.0 * np.pi), -poles.real / np.abs(poles), np.asarray((model.C @ vectors[:, chosen]).T)


def write_modes(path: Path, run: Any, count: int, outputs: Sequence[str], off: float = 0.0, seed: int = 0) -> str:
    rng = np.random.default_rng(seed)
    hertz, damping, shapes = modes_of(run, count, outputs)
    hertz = hertz * (1.0 + off * rng.standard_normal(count))
    order = np.argsort(hertz)
    columns = {
        "frequency_hz": hertz[order],
        "damping": damping[order] * (1.0 + 20.0 * off * rng.standard_normal(count)),
    }
    for name, column in zip(outputs, shapes.T, strict=True):
        # A mode that is known but for its size and phase: measured ones are real.
        largest = shapes[np.arange(count), np.abs(shapes).argmax(axis=1)]
        columns[name] = (column / largest).real[order]
    return write_table(path, columns)


def write_responses(path: Path, run: Any, outputs: Sequence[str], hertz: Array) -> str:
    """Write displacements by a force at a corner, ``C (iω − A)⁻¹ B + D`` by a solution at each frequency."""
    model = linearise_scene(run, ("plate.e.z",), outputs).model
    columns = {"frequency_hz": hertz}
    for name, c, d in zip(outputs, model.C, model.D, strict=True):
        eye = np.eye(len(model.A))
        values = np.array([c @ np.linalg.solve(2j * np.pi * f * eye - model.A, model.B[:, 0]) + d[0] for f in hertz])
        columns |= {f"{name} by plate.e.z real": values.real, f"{name} by plate.e.z imaginary": values.imag}
    return write_table(path, columns)


@pytest.fixture(scope="module")
def true_plate() -> Any:
    return package.load(PLATE).run


def test_modulus_clamp_and_damping_of_a_plate_come_back_from_its_modes(true_plate: Any, tmp_path: Path) -> None:
    """From starts 14 % and 25 % off, at which modes lie beside others' frequencies."""
    file = write_modes(tmp_path / "modes.csv", true_plate, 6, OUTPUTS)
    start = package.load(PLATE, *START).run
    keys = ["body.plate.E", "joint.clamp.spring", "body.plate.modes.damping"]
    fit = fit_scene(read_experiments([(start, file)], {"frequency": 0.001, "damping": 0.02}), read_varied(start, keys))
    E, spring, damping = fit.values
    assert pytest.approx(210e9, rel=1e-3) == E
    assert spring == pytest.approx(2000.0, rel=5e-3)
    assert damping == pytest.approx(0.01, rel=2e-2)
    assert min(fit.likeness["1"]) > 0.999
    assert fit.warnings() == []


def test_modes_are_paired_by_their_shapes_whatever_their_order(true_plate: Any, tmp_path: Path) -> None:
    """Measured modes 1, 2, 4 and 5 are found beside the scene's of these numbers, not its first four."""
    file = write_modes(tmp_path / "modes.csv", true_plate, 6, OUTPUTS)
    header, *rows = Path(file).read_text().splitlines()
    Path(file).write_text("\n".join([header, *(rows[k] for k in (0, 1, 3, 4))]) + "\n")
    (experiment,) = read_experiments([(true_plate, file)], {"frequency": 0.001, "damping": 0.02})
    found = experiment.predict({})
    np.testing.assert_allclose(found[0], modes_of(true_plate, 6)[0][[0, 1, 3, 4]], rtol=1e-9)
    without = write_table(tmp_path / "few.csv", {"frequency [Hz]": found[0], "damping": found[1]})
    (by_order,) = read_experiments([(true_plate, without)], {"frequency": 0.001, "damping": 0.02})
    np.testing.assert_allclose(by_order.predict({})[0], modes_of(true_plate, 4)[0], rtol=1e-9)
    assert by_order.likeness({}) is None
    alone = write_table(tmp_path / "alone.csv", {"frequency_hz": found[0]})
    (only,) = read_experiments([(true_plate, alone)], {"frequency": 0.001})
    assert [each.name for each in only.channels] == ["frequency"]
    np.testing.assert_allclose(only.predict({})[0], modes_of(true_plate, 4)[0], rtol=1e-9)


@pytest.mark.long
def test_responses_after_modes_find_the_numbers_from_a_start_with_other_resonances(
    true_plate: Any, tmp_path: Path
) -> None:
    """A modulus 29 % and a spring 55 % off: the search by modes comes near, that by responses ends at the truth.

    Accelerations by a force come from a universal file, in which one accelerometer looks the other way.
    """
    keys = ["body.plate.E", "joint.clamp.spring", "body.plate.modes.damping"]
    hertz, outputs = np.linspace(20.0, 400.0, 120), ["plate.e.z.acceleration", "plate.a.z.acceleration"]
    _, *columns = read_table(write_responses(tmp_path / "frf.csv", true_plate, outputs, hertz)).columns
    response, other = columns[0] + 1j * columns[1], columns[2] + 1j * columns[3]
    (tmp_path / "frf.uff").write_text(universal_text(4, 12, [(5, 3, hertz, response), (1, -3, hertz, -other)]))
    responses = f"{tmp_path / 'frf.uff'}; 5=plate.e; 1=plate.a"
    noise = {f"{name} by plate.e.z": 1e-1 for name in outputs}
    modes = write_modes(tmp_path / "modes.csv", true_plate, 5, OUTPUTS, off=5e-4)
    far = package.load(PLATE, "body.plate.E=150 GPa", "joint.clamp.spring=900 N m", "body.plate.modes.damping=0.02").run
    runs = [(far, modes), (far, responses)]
    fit = fit_scene(read_experiments(runs, {**noise, "frequency": 1e-3, "damping": 0.05}), read_varied(far, keys))
    E, spring, damping = fit.values
    assert pytest.approx(210e9, rel=1e-4) == E
    assert spring == pytest.approx(2000.0, rel=1e-4)
    assert damping == pytest.approx(0.01, rel=1e-3)


def test_slopes_of_responses_and_modes_are_those_of_scenes_solved_anew(true_plate: Any, tmp_path: Path) -> None:
    modes = write_modes(tmp_path / "modes.csv", true_plate, 4, OUTPUTS)
    responses = write_responses(tmp_path / "frf.csv", true_plate, ["plate.a.z"], np.linspace(20.0, 300.0, 30))
    sigmas = {"frequency": 1e-3, "damping": 0.05, "plate.a.z by plate.e.z": 1e-6}
    runs = [(true_plate, modes), (true_plate, responses)]
    varied = read_varied(true_plate, ["joint.clamp.spring"])
    model = FitModel(read_experiments(runs, sigmas), varied)
    J = model.jacobian(np.zeros(1))[:, 0]
    low, high = (model.residuals(np.array([side * 1e-3])) for side in (-1.0, 1.0))  # logarithms, and half of the step
    np.testing.assert_allclose(J, (high - low) / 2e-3, atol=1e-4 * np.abs(J).max())


def test_two_experiments_tell_what_one_does_not(tmp_path: Path) -> None:
    """Position alone tells the ratio of stiffness and mass; a known mass added tells both (k/m and k/(m + 1 kg))."""
    heavy = copy.deepcopy(OSCILLATOR)
    heavy["body"]["block"]["mass"] = "3 kg"
    sigmas = measure(package.load(OSCILLATOR), ["slide.position"], tmp_path / "light.csv", 0.02)
    measure(package.load(heavy), ["slide.position"], tmp_path / "heavy.csv", 0.02, seed=1)
    start = package.load(OSCILLATOR, "joint.slide.spring=760 N/m").run
    varied = read_varied(start, ["joint.slide.spring", "joint.slide.position"])
    loaded = start.variant(package.load(heavy, "joint.slide.spring=760 N/m").scene)
    runs = [(start, str(tmp_path / "light.csv")), (loaded, str(tmp_path / "heavy.csv"))]
    both = fit_scene(read_experiments(runs, sigmas), varied)
    one = fit_scene(read_experiments(runs[:1], sigmas), varied)
    assert both.values[0] == pytest.approx(800.0, rel=3.0 * both.after.half_widths[0] / 1.96)
    assert both.after.half_widths[0] < 0.8 * one.after.half_widths[0]
    assert set(both.white) == {"slide.position"}


def test_a_fit_by_parts_or_from_several_starts_finds_the_minimum_that_one_search_misses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A history of several oscillations has false minima: from a tenth of the stiffness a search ends in one."""
    sigmas = measure(package.load(OSCILLATOR), ["slide.position"], tmp_path / "measured.csv", 0.02)
    start = package.load(OSCILLATOR, "joint.slide.spring=60 N/m").run
    experiments = read_experiments([(start, str(tmp_path / "measured.csv"))], sigmas)
    varied = read_varied(start, ["joint.slide.spring=50..3000"])
    by_parts = fit_scene(experiments, varied)
    monkeypatch.setattr(fit, "FIRST_PARTS", ())
    alone, several = (fit_scene(experiments, varied, starts) for starts in (1, 6))
    assert alone.chi2 > 10.0 * several.chi2
    assert any("--starts 6" in warning["text"] for warning in alone.warnings())
    assert not by_parts.warnings()
    for found in (by_parts, several):
        assert found.values[0] == pytest.approx(800.0, rel=0.01)
        assert found.summary()["starts"][0]["chi2"] == pytest.approx(found.chi2)
    assert by_parts.chi2 == pytest.approx(several.chi2, rel=1e-3)
    with pytest.raises(InputError, match="needs bounds"):
        fit_scene(experiments, read_varied(start, ["joint.slide.spring"]), 3)


@pytest.mark.parametrize("error", [AccuracyError("a motion fails"), InputError("--shift", "time", 1, "a motion fails")])
def test_a_search_by_parts_that_stops_is_named_and_the_first_search_stands(
    error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sigmas = measure(package.load(OSCILLATOR), ["slide.position"], tmp_path / "measured.csv", 0.02)
    start = package.load(OSCILLATOR, "joint.slide.spring=60 N/m").run
    experiments = read_experiments([(start, str(tmp_path / "measured.csv"))], sigmas)
    varied = read_varied(start, ["joint.slide.spring=50..3000"])
    monkeypatch.setattr(fit, "FIRST_PARTS", ())
    alone = fit_scene(experiments, varied)

    def stop(*_: Any) -> Any:
        raise error

    monkeypatch.setattr(fit, "_search_by_parts", stop)
    found = fit_scene(experiments, varied)
    assert found.values == alone.values
    (warning,) = [each for each in found.warnings() if each["code"] == "parts-stopped"]
    assert "the search by parts of the histories stopped" in warning["text"]
    assert "a motion fails" in warning["text"]


def test_of_searches_that_end_and_one_that_does_not_those_that_end_come_first() -> None:
    ended, endless, part = (
        OptimizeResult(success=success, cost=cost) for success, cost in ((True, 3.0), (False, 1.0), (False, np.inf))
    )
    assert min([part, endless, ended], key=fit._rank) is ended
    assert min([part, endless], key=fit._rank) is endless


def test_assurance_is_one_of_shapes_that_differ_by_a_complex_factor_and_nought_of_orthogonal_ones() -> None:
    rng = np.random.default_rng(0)
    shapes = rng.standard_normal((3, 7)) + 1j * rng.standard_normal((3, 7))
    np.testing.assert_allclose(assurance(shapes, (0.3 - 2.0j) * shapes).diagonal(), 1.0, rtol=1e-12)
    Q = np.linalg.qr(rng.standard_normal((7, 7)))[0]
    np.testing.assert_allclose(assurance(Q, Q), np.eye(7), atol=1e-14)


@pytest.mark.parametrize(
    ("table", "sigmas", "words"),
    [
        ("frequency [Hz],damping\n1,0.1\n2,0.1\n", {}, "has no noise that its values show; give it"),
        ("frequency [Hz],damping\n1,0.1\n2,0\n", {"frequency": 0.01, "damping": 0.1}, "must be above 0 for each mode"),
        ("frequency [Hz],plate.q.z\n1,1\n2,1\n", {"frequency": 0.01}, "no such output"),
        ("frequency_hz\n1\n2\n3\n4\n5\n6\n7\n8\n9\n10\n11\n", {}, "has no noise that its values show"),
        ("frequency_hz,plate.a.z by plate.e.z real\n1,1\n2,1\n", {}, "has no noise that its values show"),
        (
            "frequency_hz,plate.a.z by plate.e.z real\n1,1\n2,1\n",
            {"plate.a.z by plate.e.z": 1.0},
            "imaginary: is missing",
        ),
        ("frequency [Hz],damping\n1,0.1\n2,0.1\n", {"frequency": 0.01, "damping": 0.1, "x": 1.0}, "no such channel"),
    ],
)
def test_a_wrong_table_is_refused(
    table: str, sigmas: Mapping[str, float], words: str, true_plate: Any, tmp_path: Path
) -> None:
    path = tmp_path / "measured.csv"
    path.write_text(table)
    with pytest.raises(InputError, match=words):
        read_experiments([(true_plate, str(path))], sigmas)


def test_the_command_takes_experiments_with_settings_of_their_own(
    fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / "mass.toml"
    scene.write_text(
        """
title = "Mass on a spring"
[body.block]
shape = "point"
mass = "2 kg"
marker = { hook = { at = ["0 m", "0 m", "0 m"] } }
[joint.slide]
type = "prismatic"
parent = "ground"
child = "block.hook"
axis = [1, 0, 0]
spring = "700 N/m"
damper = "2 N s/m"
[simulation]
duration = "0.5 s"
output_step = "10 ms"
tip = "block.hook"
[[simulation.run]]
integrator = "exponential"
step = "1 ms"
"""
    )
    hertz = np.sqrt(800.0 / np.array([2.0, 3.0])) / (2.0 * np.pi)
    files = [tmp_path / "light.csv", tmp_path / "heavy.csv"]
    for file, value in zip(files, hertz, strict=True):
        file.write_text(f"frequency_hz,damping\n{value},0.02\n")
    given = ["--to", files[0], "--to", f"{files[1]}; body.block.mass=3 kg", "--vary", "joint.slide.spring"]
    noise = ["--sigma", "frequency=0.1%,damping=50%", "--out", tmp_path / "fit"]
    assert fmd("fit", scene, *given, *noise, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"][0]["value"] == pytest.approx(800.0, rel=1e-4)
    assert found["files"] == ["fit.png", "fit.csv", "fit-2.png", "fit-2.csv", "fit.json", "fitted.toml"]
    monkeypatch.setattr("fmd.render.fit_chart.draw_fit", Mock())  # it was drawn
    assert fmd("fit", scene, *given, *noise) == 0
    assert "of each value" in capsys.readouterr().out
    alone = tmp_path / "alone.csv"
    alone.write_text(f"frequency_hz\n{hertz[0]}\n")
    noise = ["--sigma", "frequency=0.1%", "--out", tmp_path / "fit"]
    assert fmd("fit", scene, "--to", alone, "--vary", "joint.slide.spring", *noise, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["probability"] == 1.0
    assert [each["code"] for each in found["warnings"]] == ["no-freedom"]
    wrong = ["--to", f"{files[1]}; joint.slide.spring=900 N/m", "--vary", "joint.slide.spring"]
    assert fmd("fit", scene, *wrong, *noise) == 2
    assert "is fitted; leave it out" in capsys.readouterr().err

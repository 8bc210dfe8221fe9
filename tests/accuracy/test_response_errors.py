"""Stated errors of frequency responses, held against a much finer mesh with many more modes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray

from fmd import Pipeline, load_scene
from fmd.accuracy import response_errors
from fmd.accuracy.coarse_mesh import NO_COARSER_MESH
from fmd.accuracy.response_errors import BandErrors, estimate_band_errors
from fmd.core.cache import Cache
from fmd.output.responses import FrequencyResponse, compute_response, write_model, write_response
from fmd.responses.model_reduction import ModelReduction
from fmd.stages.linear_model import linearise_scene

SCENE = """
title = 'a bar under noise'
[body.bar]
shape = 'bar'
length = '400 mm'
depth = '10 mm'
width = '20 mm'
E = '70 GPa'
nu = 0.33
rho = '2700 kg/m^3'
mesh = { order = 2, divisions = [6, 1, 1] }
[body.bar.marker]
root = { face = 'x-', attachment = 'rigid' }
tip = { face = 'x+' }
[body.bar.modes]
count = 4
damping = 0.01
boundary = 'joint'
[joint.hub]
type = 'fixed'
parent = 'ground'
child = 'bar.root'
[simulation]
duration = '1 ms'
output_step = '1 ms'
tip = 'bar.tip'
[[simulation.run]]
integrator = 'auto'
"""
INPUTS, OUTPUTS = ["bar.tip.y"], ["bar.tip.y", "bar.tip.y.acceleration"]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("response")
    (folder / "bar.toml").write_text(SCENE)
    return folder


def respond(folder: Path, *overrides: str) -> tuple[Pipeline, FrequencyResponse]:
    run = Pipeline(load_scene(folder / "bar.toml", list(overrides)), Cache(None))
    psd = ("1e-3", folder, ("bar.toml", "psd"))
    return run, compute_response(run, INPUTS, OUTPUTS, 1500.0, 5.0, 400, psd=psd)


@pytest.mark.parametrize("coarser", [True, False])
def test_the_errors_of_response_and_root_mean_square_hold_those_against_a_finer_mesh(
    files: Path, coarser: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a mesh that can't be coarser, as one from a file, recovered stress alone tells."""
    if not coarser:
        monkeypatch.setattr(response_errors, "make_coarse_pair", lambda run: NO_COARSER_MESH)
    run, found = respond(files)
    found = found.with_errors(run)
    finer = "body.bar.mesh={order=2, divisions=[24, 2, 2]}"
    _, reference = respond(files, finer, "body.bar.modes.count=16")
    assert found.errors is not None
    assert not found.why
    true = np.abs(found.values - reference.linear.frequency_response(found.frequencies_hz))
    stated = found.errors.values
    assert np.mean(true <= stated) > 0.99
    assert (true.max(axis=0) <= stated.max(axis=0)).all()
    assert (stated.max(axis=0) <= 20 * true.max(axis=0)).all()
    assert found.random is not None
    assert reference.random is not None
    off = np.abs(found.random.rms - reference.random.rms)
    assert (off <= found.errors.rms).all()
    assert (found.errors.rms <= 20 * off).all()


def test_files_hold_the_errors_or_say_why_there_are_none(files: Path) -> None:
    run, found = respond(files)
    write_response(found, files / "plain.png", "", chart=False)
    with xarray.open_dataset(files / "plain.nc") as data:
        assert data["real"].attrs["error"] == "not stated: no errors were estimated"
        assert "error" not in data
    assert found.summary()["largest_errors"] == [{"why": "no errors were estimated"}]
    found = found.with_errors(run)
    write_response(found, files / "stated.png", "", chart=False)
    assert found.errors is not None
    with xarray.open_dataset(files / "stated.nc") as data:
        assert data["error"].values == pytest.approx(found.errors.values)
    header = (files / "stated.csv").read_text().partition("\n")[0].split(",")
    column = header.index("bar.tip.y by bar.tip.y error [m/N]")
    table = np.loadtxt(files / "stated.csv", delimiter=",", skiprows=1)
    assert table[:, column] == pytest.approx(found.errors.values[:, 0, 0], rel=1e-8)


def test_a_model_holds_up_to_half_of_what_its_modes_reach(files: Path) -> None:
    run, found = respond(files)
    assert found.linear.holds_to_hz == pytest.approx(0.5 * run.parts["bar"].modes.frequencies_hz.max())


def test_a_models_errors_by_frequency_hold_those_against_a_finer_mesh(files: Path) -> None:
    """In each range, at frequencies of its own; a model of fewer states is off by what it leaves out, too."""
    run, _ = respond(files)
    request = (INPUTS, OUTPUTS, "start")
    linear = linearise_scene(run, *request)
    whole = estimate_band_errors(run, linear, request)
    finer = load_scene(files / "bar.toml", ["body.bar.mesh={order=2, divisions=[24, 2, 2]}", "body.bar.modes.count=16"])
    reference = linearise_scene(Pipeline(finer, Cache(None)), *request)
    frequencies = np.geomspace(whole.edges_hz[0], whole.edges_hz[-1], 3000)[:-1]
    own = linear.frequency_response(frequencies)
    true = np.abs(own - reference.frequency_response(frequencies))
    band = np.searchsorted(whole.edges_hz, frequencies, side="right") - 1
    worst = np.array([true[band == k].max(axis=0) for k in range(len(whole.values))])
    assert np.mean(worst <= whole.values) > 0.97
    assert np.median(whole.values / worst) < 6.0
    few = replace(linear, model=ModelReduction(linear.model).to_order(4).model)
    reduced = estimate_band_errors(run, linear, request, few)
    apart = np.abs(few.frequency_response(frequencies) - own)
    assert (reduced.values >= 0.99 * np.array([apart[band == k].max(axis=0) for k in range(len(worst))])).all()


def test_a_model_in_a_file_has_its_errors_or_says_why_not(files: Path) -> None:
    run, _ = respond(files)
    linear = linearise_scene(run, INPUTS, OUTPUTS)
    write_model(linear, files, [".npz"])
    with np.load(files / "model.npz") as data:
        assert str(data["error"]) == "not stated: no errors were estimated"
    errors = BandErrors(np.array([1.0, 2.0]), np.full((1, 2, 1), 3.0), np.ones(1))
    write_model(linear, files, [".npz", ".mat"], errors)
    with np.load(files / "model.npz") as data:
        assert data["error"] == pytest.approx(errors.values)
        assert data["error_edges_hz"] == pytest.approx(errors.edges_hz)

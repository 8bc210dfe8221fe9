"""Stated errors of a rotor's frequencies and orbits, held against a finer mesh with more modes."""

from dataclasses import replace

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy import response_errors
from fmd.accuracy.coarse_mesh import NO_COARSER_MESH
from fmd.core.cache import Cache
from fmd.output.campbell import CampbellDiagram, compute_campbell, write_campbell
from fmd.output.unbalance import CircularResponse, compute_circular_response, with_orbit_errors, write_circular_response

BEARING = 'between = ["ground.{0}", "shaft.{0}"]\naxis = [1, 0, 0]\nradial = "2e6 N/m"\nradial_damper = "100 N s/m"'
SCENE = f"""
title = "Shaft in two bearings"
[body.shaft]
shape = "bar"
length = "600 mm"
depth = "20 mm"
width = "20 mm"
E = "210 GPa"
nu = 0.3
rho = "7800 kg/m^3"
mesh = {{ order = 2, divisions = [4, 1, 1] }}
modes = {{ count = 2 }}
marker = {{ near = {{ face = "x-" }}, far = {{ face = "x+" }}, middle = {{ at = ["300 mm", "0 mm", "0 mm"] }} }}
[ground]
near = {{ at = ["0 mm", "0 mm", "0 mm"] }}
far = {{ at = ["600 mm", "0 mm", "0 mm"] }}
[joint.float]
type = "free"
parent = "ground.near"
child = "shaft.near"
[bearing.near]
{BEARING.format("near")}
axial = "1e6 N/m"
[bearing.far]
{BEARING.format("far")}
"""
FINER = ("body.shaft.mesh={order=2, divisions=[8, 2, 2]}", "body.shaft.modes.count=6")
RATES = np.linspace(0.0, 600.0, 3)
SPEEDS = np.linspace(500.0, 900.0, 9)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Pipeline, Pipeline]:
    file = tmp_path_factory.mktemp("rotor") / "shaft.toml"
    file.write_text(SCENE)
    cache = Cache(None)
    return Pipeline(load_scene(file), cache), Pipeline(load_scene(file, FINER), cache)


@pytest.fixture(scope="module")
def diagram(runs: tuple[Pipeline, Pipeline]) -> CampbellDiagram:
    return compute_campbell(runs[0], RATES, [1.0])


@pytest.fixture(scope="module")
def finer(runs: tuple[Pipeline, Pipeline]) -> CampbellDiagram:
    return compute_campbell(runs[1], RATES, [])


def orbits(run: Pipeline) -> CircularResponse:
    return compute_circular_response(run, "shaft.middle", unbalance, SPEEDS)


def unbalance(rate: float) -> float:
    return 1e-4 * rate**2


def test_the_errors_of_frequencies_hold_those_against_a_finer_rotor(runs, diagram, finer, tmp_path) -> None:
    found = diagram.with_errors(runs[0])
    n = 5
    true = np.abs(found.frequencies_hz - finer.frequencies_hz[:, : found.frequencies_hz.shape[1]])[:, :n]
    stated = found.errors_hz[:, :n]
    assert (true <= stated).all()
    assert np.median(stated / true) < 20
    assert found.rows()[0]["error_hz"][:n] == stated[0].tolist()
    write_campbell(found, tmp_path)
    header, first, *_ = (tmp_path / "campbell.csv").read_text().splitlines()
    assert float(first.split(",")[header.split(",").index("mode_1_error_hz")]) == pytest.approx(stated[0, 0], rel=1e-3)


def test_a_rotor_of_a_mesh_that_cannot_be_coarser_has_errors_by_recovered_stress(
    runs, diagram, finer, monkeypatch
) -> None:
    """As one from a mesh file, of which nothing was stated."""
    monkeypatch.setattr(response_errors, "make_coarse_pair", lambda run: NO_COARSER_MESH)
    stated = diagram.with_errors(runs[0]).errors_hz[:, :5]
    true = np.abs(diagram.frequencies_hz - finer.frequencies_hz[:, : diagram.frequencies_hz.shape[1]])[:, :5]
    assert (true <= stated).all()
    assert np.median(stated / true) < 20


def test_a_diagram_without_errors_says_so(diagram, tmp_path) -> None:
    write_campbell(diagram, tmp_path)
    header, first, *_ = (tmp_path / "campbell.csv").read_text().splitlines()
    assert header.endswith(",error")
    assert first.endswith(",not stated: no errors were estimated")


def test_a_frequency_without_an_error_is_not_counted_as_exact(diagram) -> None:
    errors = 1e-3 * diagram.frequencies_hz
    assert replace(diagram, errors_hz=errors).largest_error(5) == pytest.approx(1e-3)
    errors[0, 0] = np.nan  # more modes leave fewer vibrations below the others
    assert replace(diagram, errors_hz=errors).largest_error(5) is None


@pytest.mark.long
def test_the_errors_of_orbits_and_critical_speeds_hold_those_against_a_finer_rotor(runs, tmp_path) -> None:
    found = with_orbit_errors(orbits(runs[0]), runs[0], "shaft.middle", unbalance)
    finer = orbits(runs[1])
    there = np.isin(found.rates, SPEEDS)
    true = np.abs(found.amplitude[there] - finer.amplitude[np.isin(finer.rates, SPEEDS)])
    assert np.mean(true <= found.errors[there]) > 0.95
    assert np.median(found.errors[there] / true) < 20
    assert len(found.criticals) == len(finer.criticals) > 0
    for at in found.criticals:
        exact = next(each for each in finer.criticals if each.marker == at.marker)
        assert abs(at.rate - exact.rate) <= at.rate_error <= 20 * abs(at.rate - exact.rate)
        assert abs(at.amplitude - exact.amplitude) <= at.amplitude_error
    write_circular_response(found, tmp_path)
    assert "shaft.middle.amplitude_error_m" in (tmp_path / "unbalance.csv").read_text()


def test_a_rotor_of_many_modes_is_still_the_same_all_around(runs) -> None:
    """Its free rotation's stiffness is round-off of the stiffest mode, which was taken for a bearing's."""
    many = runs[0].variant(load_scene(runs[0].scene.file, ["body.shaft.modes.count=30"]))
    assert len(compute_campbell(many, RATES[:2], []).rates) == 2

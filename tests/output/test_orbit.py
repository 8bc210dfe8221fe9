"""The path of a marker as a picture and as a table."""

import csv

import numpy as np
import pytest
from matplotlib.image import imread

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.output.output_kinds import kind_of

CRANK = """
title = "crank"
[body.crank]
shape = "rod"
mass = "1 kg"
length = "0.3 m"
[body.crank.marker]
pin = { at = ["0 m", "0 m", "0 m"] }
end = { at = ["0.3 m", "0 m", "0 m"] }
[joint.shaft]
type = "revolute"
parent = "ground"
child = "crank.pin"
axis = [0, 0, 1]
[drive.turn]
type = "motion"
joint = "shaft"
angle = { formula = "10*t", unit = "rad" }
[simulation]
duration = "0.5 s"
output_step = "10 ms"
step = "10 ms"
tip = "crank.end"
[[simulation.run]]
integrator = "exponential"
[[output]]
type = "orbit"
file = "orbit.FILE"
marker = "crank.end"
plane = "yx"
start = "START"
"""


@pytest.fixture
def run(tmp_path, request):
    file, start = request.param
    path = tmp_path / "crank.toml"
    path.write_text(CRANK.replace("FILE", file).replace("START", start))
    return Pipeline(load_scene(path), Cache(None))


def make(run, folder):
    (output,) = run.scene.output
    return kind_of(output).make(run, output, folder)


@pytest.mark.parametrize("run", [("csv", "0.2 s")], indirect=True)
def test_the_table_of_a_crank_has_its_circle_from_the_start_that_is_asked_for(run, tmp_path):
    assert make(run, tmp_path) == ["orbit.csv", "orbit-errors.csv"]
    assert "--no-budget" in (tmp_path / "orbit-errors.csv").read_text()
    header, *rows = csv.reader((tmp_path / "orbit.csv").read_text().splitlines())
    assert header == ["time [s]", "y [m]", "x [m]"]
    times, y, x = np.array(rows, dtype=float).T
    assert times[0] == pytest.approx(0.2)
    # a circle of the crank's length, at the prescribed angle
    assert np.allclose([x, y], 0.3 * np.array([np.cos(10 * times), np.sin(10 * times)]), atol=1e-8)


@pytest.mark.parametrize("run", [("png", "0 s")], indirect=True)
def test_the_circle_of_a_crank_is_as_wide_as_it_is_high(run, tmp_path):
    assert make(run, tmp_path) == ["orbit.png"]
    pixels = imread(tmp_path / "orbit.png")[..., :3]
    assert pixels.shape == (1120, 1120, 3)
    blue = np.abs(pixels - np.array([0x1F, 0x5F, 0xA8]) / 255).max(axis=2) < 0.1  # the curve's colour
    rows, columns = np.flatnonzero(blue.any(axis=1)), np.flatnonzero(blue.any(axis=0))
    height, width = np.ptp(rows), np.ptp(columns)
    assert 600 < width < 1100
    assert width == pytest.approx(height, abs=10)


@pytest.mark.parametrize("run", [("png", "0.5 s")], indirect=True)
def test_an_orbit_that_starts_at_the_end_is_refused(run, tmp_path):
    with pytest.raises(InputError, match=r"output\.0\.start = 0\.5: leaves no path"):
        make(run, tmp_path)


def test_an_unknown_marker_is_refused(tmp_path):
    path = tmp_path / "crank.toml"
    path.write_text(
        CRANK.replace("FILE", "png").replace("START", "0 s").replace('"crank.end"\nplane', '"crank.tip"\nplane')
    )
    with pytest.raises(InputError, match="no such marker"):
        load_scene(path)

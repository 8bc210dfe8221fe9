"""Warnings about named elements whose middles are far from their points."""

from pathlib import Path

import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.output.stress_warnings import spot_stress_warnings

FORCE, LENGTH, DEPTH, WIDTH = 10.0, 0.2, 0.008, 0.02
SCENE = f"""
title = "Cantilever"
[body.bar]
shape = "bar"
length = "{LENGTH} m"
depth = "{DEPTH} m"
width = "{WIDTH} m"
E = "70 GPa"
nu = 0.0
rho = "2700 kg/m^3"
mesh = {{ divisions = [8, 1, 1] }}
modes = {{ count = 2, boundary = "joint", enrich = "inertia" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
element = {{ top = {{ at = ["{LENGTH / 2} m", "{DEPTH / 2} m", "0 m"] }} }}
[joint.clamp]
type = "fixed"
parent = "ground"
child = "bar.root"
[drive.load]
type = "point force"
marker = "bar.tip"
direction = [0, 1, 0]
force = "{FORCE} N"
[simulation]
duration = "1 ms"
output_step = "0.1 ms"
tip = "bar.tip"
start = "equilibrium"
run = [{{ integrator = "auto" }}]
"""


def test_an_element_whose_middle_has_other_stress_than_its_point_is_told(tmp_path: Path) -> None:
    """One element across the bar has its middle on the neutral axis; at the point the beam has 6 F (L − x)/b h²."""
    (tmp_path / "bar.toml").write_text(SCENE)
    (warning,) = spot_stress_warnings(Pipeline(load_scene(tmp_path / "bar.toml"), Cache(None)))
    assert warning["code"] == "element-off-point"
    at_point = float(warning["text"].partition("MPa there and ")[2].split()[0])
    assert at_point == pytest.approx(1e-6 * 6 * FORCE * LENGTH / 2 / (WIDTH * DEPTH**2), rel=0.1)
    fine = load_scene(tmp_path / "bar.toml", ["body.bar.mesh.divisions=[16,24,1]"])
    assert spot_stress_warnings(Pipeline(fine, Cache(None))) == []

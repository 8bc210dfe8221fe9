"""Stress in the middle of long quadratic elements, whose own shear there is by bending, against beam theory."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache

LENGTH, DEPTH, WIDTH, FORCE = 0.9, 0.03, 0.045, 10.0
SCENE = f"""
title = "Bar that a force bends"
[body.bar]
shape = "bar"
length = "{LENGTH} m"
depth = "{DEPTH} m"
width = "{WIDTH} m"
E = "3 GPa"
nu = 0.35
rho = "1200 kg/m^3"
mesh = {{ order = 2, divisions = [15, 2, 1] }}
modes = {{ count = 2, boundary = "joint" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
element = {{ spot = {{ at = ["0.51 m", "7.5 mm", "0 m"] }} }}
[joint.clamp]
type = "fixed"
parent = "ground"
child = "bar.root"
[drive.push]
type = "point force"
marker = "bar.tip"
direction = [0, 1, 0]
force = "{FORCE} N"
[simulation]
duration = "1 us"
output_step = "1 us"
tip = "bar.tip"
start = "equilibrium"
gravity = ["0 m/s^2", "0 m/s^2", "0 m/s^2"]
run = [{{ integrator = "auto" }}]
"""


def test_shear_in_the_middle_of_long_elements_is_that_of_the_force(tmp_path: Path) -> None:
    """Elements twice as long as the bar is deep had a tenth of it by their own displacements in the middle."""
    file = tmp_path / "bar.toml"
    file.write_text(SCENE)
    run = Pipeline(load_scene(file), Cache(None))
    area, inertia = DEPTH * WIDTH, WIDTH * DEPTH**3 / 12
    (shear,), (bending,) = (run.element_stress("bar.spot", component).values() for component in ("xy", "xx"))
    # Quadratic elements have shear that is linear across each: the mean of the parabola over half of the depth.
    assert shear[0] == pytest.approx(FORCE / area, rel=0.03)
    assert bending[0] == pytest.approx(-FORCE * (LENGTH - 0.51) * 0.0075 / inertia, rel=0.01)
    place = np.array([[0.51, 0.0075, 0.0]])
    np.testing.assert_allclose(run.part.stress_at(place)[0], run.part.element_stress[0], rtol=1e-9, atol=1.0)

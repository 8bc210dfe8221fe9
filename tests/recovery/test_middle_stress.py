"""Stress in the middle of long quadratic elements, along which a bar's moment is curved, against beam theory."""

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import state_errors
from fmd.core.cache import Cache
from fmd.recovery.stress import excess_in_middle

LENGTH, DEPTH, WIDTH, FORCE, RHO, GRAVITY = 0.9, 0.03, 0.045, 0.5, 1200.0, 9.81
ELEMENTS = 15
DISTANCE = 2.5 * LENGTH / ELEMENTS  # of the spot from the tip
WEIGHT = RHO * DEPTH * WIDTH * GRAVITY  # of a metre
SCENE = f"""
title = "Bar that a force bends"
[body.bar]
shape = "bar"
length = "{LENGTH} m"
depth = "{DEPTH} m"
width = "{WIDTH} m"
E = "3 GPa"
nu = 0.35
rho = "{RHO} kg/m^3"
mesh = {{ order = 2, divisions = [{ELEMENTS}, 2, 1] }}
modes = {{ count = 8, boundary = "joint" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
element = {{ spot = {{ at = ["{LENGTH - DISTANCE} m", "7.5 mm", "0 m"] }} }}
[joint.clamp]
type = "fixed"
parent = "ground"
child = "bar.root"
[drive.push]
type = "point force"
marker = "bar.tip"
direction = [0, -1, 0]
force = "{FORCE} N"
[simulation]
duration = "1 us"
output_step = "1 us"
tip = "bar.tip"
start = "equilibrium"
stiffening = "off"
gravity = ["0 m/s^2", "-{GRAVITY} m/s^2", "0 m/s^2"]
run = [{{ integrator = "auto" }}]
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Pipeline:
    file = tmp_path_factory.mktemp("middle") / "bar.toml"
    file.write_text(SCENE)
    return Pipeline(load_scene(file), Cache(None))


def test_shear_in_the_middle_of_long_elements_is_that_of_the_forces(run: Pipeline) -> None:
    """Elements twice as long as the bar is deep had a tenth of it by their own displacements in the middle."""
    (shear,) = run.element_stress("bar.spot", "xy").values()
    # Quadratic elements have shear that is linear across each: the mean of the parabola over half of the depth.
    assert shear[0] == pytest.approx(-(FORCE + WEIGHT * DISTANCE) / (DEPTH * WIDTH), rel=0.03)
    place = np.array([[LENGTH - DISTANCE, 0.0075, 0.0]])
    np.testing.assert_allclose(run.part.stress_at(place)[0], run.part.element_stress[0], rtol=1e-9, atol=1.0)


def test_a_moment_that_is_curved_along_an_element_is_stated_and_made_better(run: Pipeline) -> None:
    """Under its own weight a bar's moment is a parabola; the middle of an element has its mean, w h² / 24 too much."""
    (found,) = run.element_stress("bar.spot", "xx").values()
    excess = excess_in_middle(run.part.space, run.part.material, run.part.body.shapes, *run.part.elements.values())
    (q,) = run.motion.modal("bar")[:1]
    arm, inertia = 0.0075, WIDTH * DEPTH**3 / 12
    true = (FORCE * DISTANCE + WEIGHT * DISTANCE**2 / 2) * arm / inertia
    beyond = WEIGHT * (LENGTH / ELEMENTS) ** 2 / 24 * arm / inertia
    print(found[0], true, found[0] - true, beyond, (excess @ q)[0])
    assert found[0] - true == pytest.approx(beyond, rel=0.2)
    assert (excess @ q)[0] == pytest.approx(beyond, rel=0.1)
    rows = {row.name: row for row in state_errors(run).rows}
    for name in ("bar.spot, von Mises stress", "bar.spot, von Mises stress, largest"):
        print(rows[name])
        assert (found[0] / true - 1) < rows[name].numerical < 4 * (found[0] / true - 1)

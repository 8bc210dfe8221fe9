"""Stress of a plate that a rigid face clamps: without limit at the face's edge, by beam theory away from it."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from fmd import Pipeline, load_scene
from fmd.accuracy.coarse_mesh import make_coarse_pair
from fmd.accuracy.corner_stress import find_corner_stress
from fmd.accuracy.error_budget import state_errors
from fmd.core.limits.errors import CLAMPED_EDGE, OF_WEDGE

pytestmark = pytest.mark.slow

LENGTH, DEPTH, WIDTH, FORCE = 0.08, 0.04, 0.01, 100.0
X, Y = 0.0425, 0.0125  # middle of an element, from the clamp and from the axis
SCENE = f"""
title = "Clamped strip"
[body.plate]
shape = "bar"
length = "{LENGTH} m"
depth = "{DEPTH} m"
width = "{WIDTH} m"
E = "70 GPa"
nu = 0.3
rho = "2700 kg/m^3"
mesh = {{ order = 2, divisions = DIVISIONS }}
modes = {{ count = 2, boundary = "joint" }}
marker = {{ root = {{ face = "x-"ATTACHED }}, tip = {{ face = "x+" }} }}
element = {{ away = {{ at = ["{X} m", "{Y} m", "0 m"] }} }}
[joint.clamp]
type = "fixed"
parent = "ground"
child = "plate.root"
[drive.push]
type = "point force"
marker = "plate.tip"
direction = [0, 1, 0]
force = "{FORCE} N"
[simulation]
duration = "1 us"
output_step = "1 us"
tip = "plate.tip"
start = "equilibrium"
gravity = ["0 m/s^2", "0 m/s^2", "0 m/s^2"]
run = [{{ integrator = "auto" }}]
"""


def plate(folder: Path, divisions: str, attached: str = "") -> Pipeline:
    file = folder / "plate.toml"
    file.write_text(SCENE.replace("DIVISIONS", divisions).replace("ATTACHED", attached))
    return Pipeline(load_scene(file))


def test_the_exponent_at_a_clamped_edge_is_that_of_the_theory() -> None:
    kappa = 3 - 4 * 0.3
    root = brentq(lambda x: np.sin(x * np.pi / 2) ** 2 - ((kappa + 1) ** 2 / 4 - x**2) / kappa, 0.5, 0.99)
    assert pytest.approx(1 - root, abs=5e-4) == CLAMPED_EDGE


def test_no_error_is_stated_of_stress_at_the_edge_of_a_rigid_face(tmp_path: Path) -> None:
    run = plate(tmp_path, "[16, 8, 1]")  # a broad face, which is rigid by default
    budget = state_errors(run)
    (corner,) = budget.corners
    assert OF_WEDGE * CLAMPED_EDGE < corner.growth < 1.5 * CLAMPED_EDGE
    assert corner.place[0] == 0.0
    (row,) = (row for row in budget.rows if row.name == "plate, largest von Mises stress")
    assert row.interval is None
    assert "no limit at the edge of the rigid face plate.root" in row.why
    assert "attachment = 'averaged'" in corner.warning
    # Away from the face it is that of a beam, by its moment and by its shear force.
    away = "plate.away, von Mises stress, largest"
    (stated,) = (row for row in budget.rows if row.name == away)
    bending = FORCE * (LENGTH - X) * Y / (WIDTH * DEPTH**3 / 12)
    shear = 1.5 * FORCE / (WIDTH * DEPTH) * (1 - (2 * Y / DEPTH) ** 2)
    exact = np.hypot(bending, np.sqrt(3) * shear)
    assert stated.interval is not None
    assert stated.better == pytest.approx(exact, rel=0.005)  # shear isn't even across the width


@pytest.mark.parametrize(("divisions", "attached"), [("[8, 4, 1]", ""), ("[16, 8, 1]", ', attachment = "averaged"')])
def test_stress_by_large_elements_and_at_an_averaged_face_has_a_limit(
    tmp_path: Path, divisions: str, attached: str
) -> None:
    run = plate(tmp_path, divisions, attached)
    pair = make_coarse_pair(run)
    assert not isinstance(pair, str)
    assert find_corner_stress(pair) == []
    nominal = 6 * FORCE * LENGTH / (WIDTH * DEPTH**2)
    assert run.stress_of("plate").worst()[2] == pytest.approx(nominal, rel=0.1)

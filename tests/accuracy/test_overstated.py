"""Stated errors that say something: against true ones of runs that take in what a run leaves out."""

from pathlib import Path

import pytest

from benchmarks.true_errors import true_errors
from fmd import Pipeline, load_scene
from fmd.accuracy.details import detail_quantities
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.quantities import motion_quantities

pytestmark = pytest.mark.slow

SPIN_UP = ["body.beam.mesh.divisions=[24, 1, 1]", "simulation.duration=10 s", "simulation.output_step=50 ms"]
SWUNG = """
title = "Bar of plastic, swung by a rod"
[body.rod]
shape = "rod"
mass = "1.6769 kg"
length = "0.96129 m"
marker = { inner = { at = ["0 m", "0 m", "0 m"] }, outer = { at = ["0.96129 m", "0 m", "0 m"] } }
[body.bar]
shape = "bar"
length = "1.154 m"
depth = "0.02757 m"
width = "0.06811 m"
E = "3 GPa"
nu = 0.35
rho = "1200 kg/m^3"
mesh = { order = 1, divisions = [22, 2, 2] }
modes = { count = 6, boundary = "joint", enrich = "none" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.shoulder]
type = "revolute"
parent = "ground"
child = "rod.inner"
axis = [0.46, 1.36, 0.88]
[joint.elbow]
type = "revolute"
parent = "rod.outer"
child = "bar.root"
axis = [0.21, -1.02, -0.18]
rate = "-1.2463 rad/s"
spring = "8.2173 N m/rad"
[drive.swing]
type = "motion"
joint = "shoulder"
angle = { formula = "2.50852*sin(3.72261*t)", unit = "rad" }
[simulation]
duration = "0.882 s"
output_step = "8.82 ms"
tip = "bar.tip"
gravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]
run = [{ integrator = "auto" }]
"""


def test_large_deflection_is_stated_of_what_depends_on_it() -> None:
    # Four pieces take large deflection in; the kinetic energy of a body whose turning is given hardly depends on it.
    run = Pipeline(load_scene("spin-up", SPIN_UP))
    more = ["body.beam.pieces=4", "body.beam.modes={count=4}", "simulation.error=1e-4"]
    pieces = Pipeline(load_scene("spin-up", [*SPIN_UP, *more]), run.store.cache)
    exact = motion_quantities(pieces.motion, pieces.fine_motion)
    exact |= detail_quantities(pieces.scene, pieces.motion)
    ours = motion_quantities(run.motion, run.fine_motion) | detail_quantities(run.scene, run.motion)
    budget = state_errors(run)
    stated = {row.name: row.total for row in (*budget.rows, *budget.details)}
    compared = {name: ours[name].error(exact[name]) for name in stated if name in ours and name in exact}
    assert len(compared) > 12
    for name, true in compared.items():
        assert true <= stated[name], name
        assert stated[name] <= 50 * true, name  # 901 times it was, of the kinetic energy
    assert stated["tip, deflection"] < 8 * compared["tip, deflection"]


@pytest.mark.long
def test_a_basis_with_fast_static_responses_states_its_modes_and_not_its_own_march(tmp_path: Path) -> None:
    # The richer basis vibrates at 250,000 rad/s, which the run's own steps of 3 ms lose.
    file = tmp_path / "swung.toml"
    file.write_text(SWUNG)
    run = Pipeline(load_scene(file))
    finer = ["body.bar.modes.count=12", "body.bar.modes.enrich=inertia", "body.bar.mesh={order=2,divisions=[44,2,2]}"]
    march = 'simulation.run=[{integrator="runge-kutta", tolerance=1e-8}]'
    true = true_errors(run, Pipeline(load_scene(file, [*finer, march]), run.store.cache))
    rows = {row.name: row.numerical for row in state_errors(run).rows}
    for name in ("elbow, angle", "tip, deflection", "potential energy"):
        assert true[name] <= rows[name] <= 8 * true[name], name  # 83 times it was, of the tip

"""Estimates where a coarser mesh or a finer tolerance tells nothing: few elements from side to side, an exact march."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

from fmd import Pipeline, load_scene
from fmd.accuracy.coarse_mesh import make_coarse_pair, make_pair_across
from fmd.accuracy.error_budget import ERROR_BUDGET
from fmd.accuracy.mesh_excess import find_excess
from fmd.accuracy.quantities import match_modes
from fmd.core.cache import Cache
from fmd.core.limits.errors import SAFETY
from fmd.core.rotations import rigid_motions
from fmd.reduction.body import FlexibleBody

LENGTH, DEPTH, WIDTH, E, RHO = 1.2, 0.02, 0.06, 70e9, 2700.0
BAR = f"""
title = "Twisted bar"
[body.bar]
shape = "bar"
length = "{LENGTH} m"
depth = "{DEPTH} m"
width = "{WIDTH} m"
E = "{E} Pa"
nu = 0.3
rho = "{RHO} kg/m^3"
modes = {{ count = 1, family = "torsion", boundary = "joint" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
mesh = {{ order = ORDER, divisions = DIVISIONS }}
[joint.clamp]
type = "fixed"
parent = "ground"
child = "bar.root"
[drive.twist]
type = "point torque"
marker = "bar.tip"
direction = [1, 0, 0]
torque = "1 N m"
[simulation]
duration = "1 ms"
output_step = "0.1 ms"
tip = "bar.tip"
run = [{{ integrator = "auto" }}]
"""
PENDULUM = """
title = "Rigid pendulum with a spring"
[body.part]
shape = "rigid"
mass = "1.4 kg"
centre = ["-0.17 m", "-0.15 m", "-0.14 m"]
inertia = ["0.036 kg m^2", "0.020 kg m^2", "0.020 kg m^2"]
marker = { at = { at = ["0 m", "0 m", "0 m"] } }
[joint.hinge]
type = "revolute"
parent = "ground"
child = "part.at"
axis = [0.71, -1.48, -1.28]
spring = "3.07 N m/rad"
[simulation]
duration = "1.5 s"
output_step = "15 ms"
tip = "part.at"
gravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]
run = [{ integrator = "INTEGRATOR" }]
"""


@pytest.mark.parametrize(("order", "divisions"), [(2, [8, 1, 1]), (1, [12, 2, 2])])
def test_the_torsion_of_few_elements_from_side_to_side_is_off_by_less_than_is_stated(
    tmp_path: Path, order: int, divisions: list[int]
) -> None:
    file = tmp_path / "bar.toml"
    file.write_text(BAR.replace("ORDER", str(order)).replace("DIVISIONS", str(divisions)))
    run = Pipeline(load_scene(file))
    (stated,) = (row.total for row in ERROR_BUDGET.of(run).rows if row.name == "bar, frequency 1")
    # Saint-Venant: J = a b³ (1/3 − 64/π⁵ b/a Σ tanh(k π a / 2b) / k⁵) for sides a > b.
    odd = np.arange(1, 40, 2)
    series = (np.tanh(odd * np.pi * WIDTH / (2 * DEPTH)) / odd**5).sum()
    J = WIDTH * DEPTH**3 * (1 / 3 - 64 / np.pi**5 * DEPTH / WIDTH * series)
    polar = WIDTH * DEPTH * (WIDTH**2 + DEPTH**2) / 12
    exact = np.sqrt(E / 2.6 * J / (RHO * polar)) / (4 * LENGTH)
    true = abs(run.part.modes.frequencies_hz[0] / exact - 1)
    assert true > 0.01  # these meshes are too stiff in torsion
    assert true < stated < 5 * true


def test_the_torsion_of_a_bar_of_one_tetrahedron_across_has_the_error_that_halved_ones_tell(tmp_path: Path) -> None:
    """Recovered stress told half of it, and a coarser mesh, which has one across as well, less than nothing.

    Both told up to twice the error of bending.
    """
    file = tmp_path / "bar.toml"
    file.write_text(BAR.replace("ORDER", "2").replace("DIVISIONS", "[4, 1, 1]"))
    meshes = ('{ element = "tetrahedron", size = "23 mm" }', "{ divisions = [24, 2, 3] }")
    size = ["body.bar.length=0.3 m", "body.bar.width=45 mm", 'body.bar.modes={ count = 5, boundary = "joint" }']
    run, fine = (Pipeline(load_scene(file, [*size, f"body.bar.mesh={mesh}"]), Cache(None)) for mesh in meshes)
    part, across = run.parts["bar"], make_pair_across(run)
    excess, _ = find_excess(part, run.bodies["bar"], make_coarse_pair(run), across)
    true = 1 - (match_modes(part, fine.parts["bar"]).omega / part.modes.omega) ** 2
    stated = SAFETY * np.abs(excess) / true
    torsion = true.argmax()
    assert true[torsion] > 0.04
    assert stated[torsion] > 1.5
    assert stated.max() < 3.0


def test_time_integration_is_not_stated_exact_where_a_finer_tolerance_gives_the_same_march(tmp_path: Path) -> None:
    file = tmp_path / "pendulum.toml"
    file.write_text(PENDULUM.replace("INTEGRATOR", "auto"))
    run = Pipeline(load_scene(file))
    exact = Pipeline(load_scene(file, ['simulation.run=[{integrator="runge-kutta", tolerance=1e-12}]']))
    angle = run.motion.joint_position("hinge")
    true = np.abs(angle - exact.motion.joint_position("hinge")).max() / np.abs(angle).max()
    (stated,) = (row.total for row in ERROR_BUDGET.of(run).rows if row.name == "hinge, angle")
    assert 0 < true < stated


def test_shapes_of_static_responses_that_are_alike_on_two_meshes_differ_little() -> None:
    """Elements halved across change no such squared frequency by 5 %; round-off sets others apart, by up to 36 %."""
    run = Pipeline(load_scene("beam-paper", ["body.beam.mesh.divisions=[24, 2, 1]", "body.beam.modes.enrich=ritz"]))
    pair = make_pair_across(run)
    assert pair is not None
    excess, alike = pair.excess_of_shapes("beam")
    assert alike.sum() >= 8
    assert np.abs(excess[alike]).max() < 0.05


def test_shapes_without_a_counterpart_tell_nothing_of_the_mesh() -> None:
    """Two shapes of the coarse mesh, turned half into each other, are like none; the others stay as they were."""
    run = Pipeline(load_scene("beam-paper", ["body.beam.mesh.divisions=[24, 2, 1]", "body.beam.modes.count=5"]))
    pair = make_pair_across(run)
    assert pair is not None
    before, all_alike = pair.excess_of_shapes("beam")
    assert all_alike.all()
    body = pair.coarse.bodies["beam"]
    turn = np.eye(len(body.omega))
    turn[1:3, 1:3] = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    turned = pair.coarse.with_bodies({"beam": replace(body, shapes=body.shapes @ turn)})
    mixed = replace(pair, coarse=turned)
    excess, alike = mixed.excess_of_shapes("beam")
    assert np.flatnonzero(~alike).tolist() == [1, 2]
    np.testing.assert_allclose(excess[alike], before[alike], rtol=1e-9)
    softened, _ = mixed.soften("beam")
    np.testing.assert_allclose(softened.omega[~alike], run.bodies["beam"].omega[~alike], rtol=1e-9)


def test_a_run_softened_to_a_finer_mesh_moves_no_more_than_its_mass_as_that_mesh_stiffened_does(tmp_path: Path) -> None:
    """A clamped bar's shapes of bending move nearly its whole mass, and one element across is stiff."""
    file = tmp_path / "bar.toml"
    bar = BAR.replace("ORDER", "2").replace("DIVISIONS", "[12, 1, 1]").replace('family = "torsion", ', "")
    file.write_text(bar.replace("count = 1", "count = 8"))
    run = Pipeline(load_scene(file))
    pair = make_pair_across(run)
    assert pair is not None
    stiffened, _ = pair.at_the_same_frequencies()
    softened, _ = pair.soften("bar")
    m, finer = run.parts["bar"].fe.m, pair.coarse.parts["bar"].fe.m
    assert moved_share(stiffened.bodies["bar"], finer) > 1.0  # no mass matrix
    assert moved_share(softened, m) == pytest.approx(moved_share(run.bodies["bar"], m))
    assert moved_share(softened, m) < 1.0
    numbers, alike = pair.counterparts("bar")
    theirs = np.where(alike, pair.coarse.bodies["bar"].omega[numbers], run.bodies["bar"].omega)
    assert softened.omega == pytest.approx(np.sort(theirs))
    assert (theirs < 0.999 * run.bodies["bar"].omega).any()


def moved_share(body: FlexibleBody, m: sp.csr_array) -> float:
    """Return the largest share of a rigid motion's mass that a body's shapes of unit modal mass move."""
    rigid = rigid_motions(body.x)
    momenta = (m @ rigid.reshape(len(body.x), -1)).reshape(-1, 6)
    moved = momenta.T @ body.shapes.reshape(len(momenta), -1)
    return float(eigh(moved @ moved.T, rigid.reshape(-1, 6).T @ momenta, eigvals_only=True)[-1])

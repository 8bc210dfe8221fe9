"""Excess of frequencies by a coarser mesh, against a much finer one."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

from fmd import Pipeline, load_scene
from fmd.accuracy.coarse_mesh import Pair, make_coarse_pair, make_pair_across
from fmd.accuracy.estimators import Estimates
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError

BAR = """
title = "Free bar"
[body.bar]
shape = "bar"
length = "300 mm"
depth = "40 mm"
width = "25 mm"
E = "70 GPa"
nu = 0.3
rho = "2700 kg/m^3"
mesh = { order = ORDER, divisions = DIVISIONS }
modes = { count = 3 }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.none]
type = "free"
parent = "ground"
child = "bar.root"
[simulation]
duration = "1 ms"
output_step = "1 ms"
tip = "bar.tip"
run = [{ integrator = "auto" }]
"""


def free_bar(folder: Path, order: int, divisions: list[int]) -> Pipeline:
    file = folder / "bar.toml"
    file.write_text(BAR.replace("ORDER", str(order)).replace("DIVISIONS", str(divisions)))
    return Pipeline(load_scene(file))


def test_a_coarser_mesh_tells_the_excess_of_squared_frequencies_where_nothing_is_held(tmp_path: Path) -> None:
    """Without an edge at which stress has no limit, two meshes converge by the elements' own order."""
    run, exact = free_bar(tmp_path, 1, [24, 4, 4]), free_bar(tmp_path, 2, [16, 3, 3])
    pair = make_coarse_pair(run)
    assert not isinstance(pair, str)
    excess, alike = pair.excess_of_modes("bar")
    assert alike.all()
    true = (run.part.modes.omega / exact.part.modes.omega) ** 2 - 1
    np.testing.assert_allclose(excess, true, rtol=0.1)


def test_modes_that_a_mesh_mixes_have_the_error_of_all_that_they_are_mixed_from() -> None:
    """Of torsion and bending that ring alike on one mesh alone each has a half; the last has no mode like it."""
    random = np.random.default_rng(0)
    x, shapes = random.uniform(size=(40, 3)), np.linalg.qr(random.standard_normal((120, 5)))[0]
    turned = shapes[:, :4] @ block_diag(1.0, [[0.72, -0.694], [0.694, 0.72]], 1.0)
    turned[:, 3] = 0.3 * shapes[:, 3] + np.linalg.qr(np.c_[shapes, random.standard_normal(120)])[0][:, 5]

    def run(shapes: Array, omega: list[float]) -> Any:
        modes = SimpleNamespace(shapes=shapes.reshape(40, 3, -1), omega=np.array(omega))
        return SimpleNamespace(parts={"bar": SimpleNamespace(modes=modes, fe=SimpleNamespace(x=x, m=np.eye(40)))})

    pair = Pair(run(turned, [1.0, 6.59, 6.64, 9.0]), run(shapes, [1.0, 6.12, 6.53, 9.0, 9.5]), {"displacement": -1.0})
    excess, alike = pair.excess_of_modes("bar")
    np.testing.assert_allclose(excess[:3], [0.0, 1 - (6.12 / 6.59) ** 2, 1 - (6.12 / 6.64) ** 2])
    assert alike.tolist() == [True, True, True, False]


def test_pieces_on_a_coarser_mesh_are_cut_at_the_same_places(tmp_path: Path) -> None:
    """Of 14 elements in two pieces 7 were left, in pieces of 3 and 4, whose frequencies differ by half."""
    text = BAR.replace("{ count = 3 }", "{ count = 4 }\npieces = 2").replace('type = "free"', 'type = "fixed"')
    file = tmp_path / "bar.toml"
    file.write_text(text.replace("ORDER", "2").replace("DIVISIONS", "[14, 1, 1]"))
    run = Pipeline(load_scene(file))
    pair = make_coarse_pair(run)
    assert not isinstance(pair, str)
    for name, body in run.bodies.items():
        assert pair.coarse.bodies[name].integrals.mass == pytest.approx(body.integrals.mass)
        assert pair.coarse.bodies[name].omega[0] == pytest.approx(body.omega[0], rel=0.03)


@pytest.mark.parametrize("modes", ['{ count = 4, boundary = "interface" }', "{ count = 4 }\npieces = 2"])
def test_shapes_of_an_interface_are_no_stiffer_on_a_finer_mesh(tmp_path: Path, modes: str) -> None:
    """By Rayleigh's principle; of 7 modes and the static responses four were chosen, which had up to 28 % more."""
    text = BAR.replace("{ count = 3 }", modes).replace('type = "free"', 'type = "fixed"')
    file = tmp_path / "bar.toml"
    file.write_text(text.replace("ORDER", "2").replace("DIVISIONS", "[8, 1, 1]"))
    run = Pipeline(load_scene(file))
    pair = make_pair_across(run)
    assert pair is not None
    for name in run.parts:
        excess, alike = pair.excess_of_shapes(name)
        assert alike[:2].all()
        assert (excess[alike] > -1e-3).all()


def test_a_bar_in_free_modes_that_rings_slower_on_larger_elements_has_errors_of_all_its_motion() -> None:
    """Its modes there, changed to the run's frequencies, move more than the bar's mass: no motion had an error."""
    bar = {"shape": "bar", "length": 0.15, "depth": 0.018, "width": 0.018, "E": 206e9, "nu": 0.29, "rho": 7840.0}
    bar["mesh"] = {"element": "hexahedron", "order": 2, "divisions": [6, 1, 1]}
    bar |= {"modes": {"count": 4, "enrich": "none"}, "marker": {"root": {"face": "x-"}, "tip": {"face": "x+"}}}
    hub = {"shape": "rigid", "mass": 0.3, "inertia": [1e-4] * 3, "marker": {"at": {"at": [0, 0, 0]}}}
    float_ = {"type": "free", "parent": "ground", "child": "hub.at", "spin": [0, 0, 50.0]}
    scene: dict[str, Any] = {
        "title": "",
        "joint": {"float": float_, "hold": {"type": "fixed", "parent": "hub.at", "child": "bar.root"}},
        "simulation": {"duration": 1e-3, "output_step": 1e-4, "tip": "bar.tip", "run": [{"integrator": "auto"}]},
    }

    scene["body"] = {"hub": hub, "bar": bar}
    scene["drive"] = {"push": {"type": "point force", "marker": "bar.tip", "direction": [0, 1, 0], "force": 20.0}}
    estimates = Estimates(Pipeline(load_scene(scene)))
    pair = make_coarse_pair(estimates.run)
    assert isinstance(pair, Pair)
    with pytest.raises(AccuracyError, match="the mass matrix isn't positive definite"):
        estimates.march_beside(pair.at_the_same_frequencies()[0])
    found = estimates._changes_by_shapes(pair)
    assert {*estimates.of_motion} <= {*found}
    true = 4.7e-3  # of 24 elements along, with the same modes
    assert true < 2 * found["tip, deflection"] / pair.gains["displacement"] < 20 * true


def test_variants_on_other_meshes_keep_the_whole_energy_that_a_run_needs() -> None:
    """Without it marches lost the inertia of a motion by displacements of second order, and no row had an error."""
    bar = {"shape": "bar", "length": 0.15, "depth": 0.018, "width": 0.018, "E": 206e9, "nu": 0.29, "rho": 7840.0}
    bar["mesh"] = {"element": "hexahedron", "order": 2, "divisions": [4, 1, 1]}
    bar |= {"modes": {"count": 2}, "marker": {"root": {"face": "x-"}, "tip": {"face": "x+"}}}
    hub = {"type": "revolute", "parent": "ground", "child": "bar.root", "axis": [0, 0, 1]}
    simulation = {"duration": 1e-3, "output_step": 1e-4, "tip": "bar.tip", "run": [{"integrator": "auto"}]}
    run = Pipeline(load_scene({"title": "", "body": {"bar": bar}, "joint": {"hub": hub}, "simulation": simulation}))
    run.whole_energy = True
    pair = make_coarse_pair(run)
    assert isinstance(pair, Pair)
    for other in (pair.coarse, pair.at_the_same_frequencies()[0]):
        assert all(link.integrals.whole for link in other.mechanism.links)

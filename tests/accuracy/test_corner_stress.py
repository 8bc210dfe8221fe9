"""Stress at re-entrant edges: the L-shaped bracket's grows with each mesh, a filleted one's settles."""

import math
from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.coarse_mesh import make_coarse_pair
from fmd.accuracy.corner_stress import CornerStress, find_corner_stress, wedge_exponent
from fmd.accuracy.error_budget import Budget, state_errors
from fmd.fem.surface import reentrant_angles
from fmd.meshes.gmsh_session import gmsh_model

pytestmark = pytest.mark.slow

SCENE = """
title = "bracket"
[body.arm]
shape = "cad"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { cad = "arm.step", size = "6 mm" }
marker = { foot = { face = "ymax" }, tip = { face = "xmax" } }
modes = { count = 2, boundary = "joint", enrich = "inertia" }
[joint.foot]
type = "fixed"
parent = "ground"
child = "arm.foot"
[drive.push]
type = "point force"
marker = "arm.tip"
direction = [0.0, 1.0, 0.0]
force = { formula = "10*t/0.01", unit = "N" }
[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "arm.tip"
gravity = ["0 m/s^2", "0 m/s^2", "0 m/s^2"]
run = [{ integrator = "generalized-alpha", step = "0.1 ms" }]
"""


def write(folder: Path, fillet: float) -> Path:
    """Write the scene of an L of two legs of 20 x 20 mm, 60 mm long, with a fillet in its corner, or without."""
    with gmsh_model("arm") as gmsh:
        occ = gmsh.model.occ
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        legs = [(3, occ.addBox(0, 0, 0, 60, 20, 20))], [(3, occ.addBox(0, 0, 0, 20, 60, 20))]
        solid, _ = occ.fuse(*legs)
        if fillet:
            occ.synchronize()
            places = {tag: occ.getCenterOfMass(1, tag) for _, tag in occ.getEntities(1)}
            inner = min(places, key=lambda tag: math.dist(places[tag], (20, 20, 10)))
            occ.fillet([solid[0][1]], [inner], [fillet])
        occ.synchronize()
        gmsh.write(str(folder / "arm.step"))
    (folder / "arm.toml").write_text(SCENE)
    return folder / "arm.toml"


@pytest.fixture(scope="module")
def bracket(tmp_path_factory: pytest.TempPathFactory) -> tuple[Pipeline, list[CornerStress]]:
    run = Pipeline(load_scene(write(tmp_path_factory.mktemp("sharp"), 0.0)))
    pair = make_coarse_pair(run)
    assert not isinstance(pair, str)
    return run, find_corner_stress(pair)


def test_the_edge_of_an_l_has_three_quarters_of_a_turn_of_material(
    bracket: tuple[Pipeline, list[CornerStress]],
) -> None:
    part = bracket[0].part
    angles = reentrant_angles(part.space.x, part.surface)
    x = part.space.x[part.surface.nodes]
    on = (np.abs(x[:, :2] - 0.02) < 1e-9).all(axis=1)
    assert angles[on] == pytest.approx(1.5 * np.pi)
    assert not angles[~on].any()


def test_stress_in_a_sharp_corner_grows_as_the_theory_of_wedges_has_it(
    bracket: tuple[Pipeline, list[CornerStress]],
) -> None:
    """Williams 1952: as h^-0.4555 with 270° of material; of a crack, with 360°, as h^-½. Meshes scatter about that."""
    (corner,) = bracket[1]
    assert corner.exponent == pytest.approx(0.4555, abs=1e-4)
    assert wedge_exponent(2 * np.pi - 1e-6) == pytest.approx(0.5, abs=1e-4)
    assert corner.place[0] == pytest.approx(0.02)
    assert corner.growth == pytest.approx(0.4555, abs=0.15)
    assert "270 degrees" in corner.warning


def test_a_fillet_gives_the_stress_a_limit_and_the_mass_that_of_its_geometry(tmp_path: Path) -> None:
    """Meshes of any size have as many elements around the fillet, so that they agree in a mass that is too small."""
    run = Pipeline(load_scene(write(tmp_path, 8.0)))
    budget = state_errors(run)
    assert budget.corners == ()
    (low, high) = next(row.interval for row in budget.rows if row.name == "arm, mass")
    mass = 2700 * 0.02 * (0.06**2 - 0.04**2 + (1 - np.pi / 4) * 0.008**2)
    assert low <= mass <= high < low + 1e-4 * mass


def test_no_error_is_stated_of_stress_without_limit(bracket: tuple[Pipeline, list[CornerStress]]) -> None:
    budget: Budget = state_errors(bracket[0])
    (row,) = (row for row in budget.rows if row.name == "arm, largest von Mises stress")
    assert row.interval is None
    assert "no limit at the re-entrant edge of 270 degrees" in row.why
    assert budget.corners == tuple(bracket[1])

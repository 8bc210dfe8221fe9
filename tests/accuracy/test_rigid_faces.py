"""The mesh's error behind a rigid face, at whose edge stress has no limit, against a much finer mesh."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.coarse_mesh import make_coarse_pair
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.mesh_excess import combine_excess, energy_excess
from fmd.recovery.stress import von_mises

pytestmark = pytest.mark.slow

BAR = """
title = "clamped bar"
[body.bar]
shape = "bar"
length = "0.4 m"
depth = "20 mm"
width = "40 mm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = MESH
modes = { count = 4, boundary = "joint" }
marker = { root = { face = "x-", attachment = "rigid" }, tip = { face = "x+" } }
[joint.hub]
type = "fixed"
parent = "ground"
child = "bar.root"
[simulation]
duration = "1 ms"
output_step = "1 ms"
tip = "bar.tip"
run = [{ integrator = "auto" }]
"""


SUPPORTED = BAR.replace(', attachment = "rigid"', "").replace(
    '4, boundary = "joint" }', '4 }\nsupport = [{ face = "x-" }]'
)


def mesh(folder: Path, order: int, divisions: list[int], support: bool = False) -> Pipeline:
    file = folder / "bar.toml"
    file.write_text((SUPPORTED if support else BAR).replace("MESH", f"{{ order = {order}, divisions = {divisions} }}"))
    return Pipeline(load_scene(file))


@pytest.mark.parametrize("support", [False, True], ids=["rigid face", "support"])
def test_the_excess_of_frequencies_behind_a_held_face_is_not_what_two_meshes_tell(
    tmp_path: Path, support: bool
) -> None:
    """Against 24 x 4 x 4 quadratic elements; a coarser mesh alone tells less than half of it in the first two modes."""
    exact = mesh(tmp_path, 2, [24, 4, 4], support).part.modes.omega
    for order, divisions in ((1, [12, 2, 2]), (2, [12, 2, 2])):
        run = mesh(tmp_path, order, divisions, support)
        pair = make_coarse_pair(run)
        assert not isinstance(pair, str)
        changed, _ = pair.excess_of_modes("bar")
        stated = combine_excess(run.part, energy_excess(run.part, run.part.body)[0], changed)
        true = 0.5 * (
            (run.part.modes.omega / exact) ** 2 - 1
        )  # of the frequency, which states twice of half the excess
        assert (changed[:2] < true[:2]).all()
        assert (true < stated).all()
        assert (stated < 4 * true).all()


def test_the_largest_stress_next_to_a_rigid_face_is_stated_against_its_own_place_on_a_finer_mesh(
    tmp_path: Path,
) -> None:
    """A link as the robot's, bent by a steady force, against twice the elements each way, whose largest is the same."""
    push = """
start = "equilibrium"
[drive.push]
type = "point force"
marker = "bar.tip"
direction = [0, 1, 0]
force = "10 N"
"""
    link = (
        BAR.replace("20 mm", "30 mm")
        .replace("40 mm", "16 mm")
        .replace('face = "x+"', 'face = "x+", attachment = "rigid"')
    )
    runs = []
    for divisions in ([14, 2, 2], [28, 4, 4]):
        file = tmp_path / "link.toml"
        mesh = f"{{ order = 2, divisions = {divisions} }}"
        file.write_text(link.replace("MESH", mesh).replace("210 GPa", "70 GPa") + push)
        runs.append(Pipeline(load_scene(file)))
    run, fine = runs
    (row,) = (row for row in state_errors(run).rows if row.name == "bar, largest von Mises stress")
    _, place, worst = run.stress_of("bar").worst()
    x = run.part.space.x[run.part.surface.nodes[place]]
    there = np.linalg.norm(fine.part.space.x[fine.part.surface.nodes] - x, axis=1).argmin()
    exact = von_mises((fine.part.surface_stress[there] @ fine.motion.modal("bar")[0])[None])[0]
    true = worst / exact - 1
    assert 0.05 < true < row.numerical < 3 * true

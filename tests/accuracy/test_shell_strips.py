"""Frequencies of a strip of shells with two elements across, against those on a finer mesh."""

from pathlib import Path

import numpy as np

from fmd import Pipeline, load_scene
from fmd.accuracy.coarse_mesh import Pair, make_coarse_pair, make_pair_across
from fmd.accuracy.mesh_excess import find_excess
from fmd.accuracy.quantities import match_modes
from fmd.core.cache import Cache
from fmd.core.limits.errors import SAFETY

STRIP = """
title = "Strip"
[body.strip]
shape = "plate"
length = "150 mm"
width = "30 mm"
thickness = "2 mm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = { divisions = [10, 2] }
modes = { count = 4 }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.clamp]
type = "fixed"
parent = "ground"
child = "strip.root"
[simulation]
tip = "strip.tip"
duration = "1 ms"
output_step = "1 ms"
run = [{ integrator = "auto" }]
"""


def test_frequencies_in_torsion_have_the_error_of_few_elements_across(tmp_path: Path) -> None:
    """Recovered stress and a coarser mesh, of one element across, told a sixth of it."""
    (tmp_path / "strip.toml").write_text(STRIP)
    run, fine = (
        Pipeline(load_scene(tmp_path / "strip.toml", [f"body.strip.mesh.divisions={divisions}"]), Cache(None))
        for divisions in ([10, 2], [30, 8])
    )
    part, pair = run.parts["strip"], make_coarse_pair(run)
    assert isinstance(pair, Pair)
    excess, _ = find_excess(part, run.bodies["strip"], pair, make_pair_across(run))
    true = 1 - (match_modes(part, fine.parts["strip"]).omega / part.modes.omega) ** 2
    stated = SAFETY * np.abs(excess) / true
    assert stated.min() > 0.75
    assert 1.0 < np.median(stated) < 4.0

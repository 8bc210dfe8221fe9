"""Places on a body are given in the part's own coordinates, wherever its joint is."""

from pathlib import Path

import pytest

from fmd import load_scene, solve
from fmd.core.cache import Cache
from fmd.output.write import write_results
from fmd.reduction.body_file import load_body

# Clamped at its far end, so that the frame's origin isn't the part's.
SCENE = """
title = "Cantilever"
[body.bar]
shape = "bar"
length = "300 mm"
depth = "20 mm"
width = "10 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { divisions = [6, 2, 1] }
modes = { count = 2, boundary = "joint" }
marker = { tip = { face = "x-" }, root = { face = "x+" } }
[joint.clamp]
type = "fixed"
parent = "ground"
child = "bar.root"
[drive.push]
type = "point force"
marker = "bar.tip"
direction = [0, 1, 0]
force = "10 N"
[simulation]
duration = "20 ms"
output_step = "1 ms"
tip = "bar.tip"
[[simulation.run]]
integrator = "auto"
[[output]]
type = "export"
body = "bar"
file = "body.nc"
"""


def test_the_worst_stress_and_the_reduced_body_are_placed_in_the_parts_own_coordinates(tmp_path: Path) -> None:
    (tmp_path / "cantilever.toml").write_text(SCENE)
    result = solve(load_scene(tmp_path / "cantilever.toml"), Cache(None))
    run, summary = result.run, write_results(result, tmp_path / "out", pictures=False, budget=False)
    root = run.part.markers["root"].position
    assert root[0] == pytest.approx(0.3)  # not the frame's origin, which the old figure was counted from
    x, y, _ = summary["worst_stress"]["position_m"]
    assert x == pytest.approx(0.3)  # at the clamp, on an outer fibre: bending moments are largest there
    assert abs(y - root[1]) == pytest.approx(0.01)
    body = load_body(tmp_path / "out" / "body.nc").body
    assert body.origin == pytest.approx(root, abs=1e-15)
    assert body.origin + body.x == pytest.approx(run.part.space.x, abs=1e-15)

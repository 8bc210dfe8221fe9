"""Loads at points: the largest stress is that elsewhere, by beam theory, and the run says so."""

from pathlib import Path

import numpy as np
import pytest

from fmd import load

F, ARM, SIDE = 50.0, 0.03, 0.01
SCENE = """
title = "Force at a point"

[body.bar]
shape = "bar"
length = "100 mm"
depth = "10 mm"
width = "10 mm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = {{ divisions = [{along}, {across}, {across}] }}
modes = {{ count = 2, boundary = "joint", enrich = "inertia" }}

[body.bar.marker]
root = {{ face = "x-" }}
tip = {{ face = "x+" }}
push = {{ {place} }}

[joint.clamp]
type = "fixed"
parent = "ground"
child = "bar.root"

[drive.push]
type = "point force"
marker = "bar.push"
direction = [0, -1, 0]
force = "50 N"

[simulation]
duration = "1 us"
output_step = "1 us"
tip = "bar.tip"
start = "equilibrium"

[[simulation.run]]
integrator = "auto"
"""


@pytest.mark.parametrize("place", ['node = ["30 mm", "5 mm", "0 mm"]', 'at = ["30 mm", "5 mm", "0 mm"]'])
def test_the_largest_stress_is_not_under_a_point_load(tmp_path: Path, place: str) -> None:
    (tmp_path / "scene.toml").write_text(SCENE.format(along=20, across=2, place=place))
    result = load(tmp_path / "scene.toml")
    worst = result.summary["worst_stress"]["bar"]
    assert worst["position_m"][0] < 0.005
    assert worst["value_pa"] == pytest.approx(6 * F * ARM / SIDE**3, rel=0.1)  # bending at the root, by beam theory


def test_stress_under_a_point_grows_with_refinement_and_is_told(tmp_path: Path) -> None:
    found = []
    for along, across in ((20, 2), (40, 4)):
        (tmp_path / "scene.toml").write_text(
            SCENE.format(along=along, across=across, place='node = ["30 mm", "5 mm", "0 mm"]')
        )
        result = load(tmp_path / "scene.toml")
        stress = result.run.stress_of("bar")
        assert stress.limitless is not None
        x, part = result.run.parts["bar"].fe.x[stress.nodes], 0.5 * (0.1 * SIDE * SIDE) ** (1 / 3)
        distance = np.linalg.norm(x - [0.03, 0.005, 0.0], axis=1)
        # half the edge of a cube of the bar's volume, or as far as the elements at the point reach
        near = max(part, np.hypot(np.hypot(0.1 / along, SIDE / across), SIDE / across))
        assert stress.limitless[distance < 0.999 * part].all()
        assert not stress.limitless[distance > 1.001 * near].any()
        there = stress.von_mises(0.0)[stress.limitless].max()
        found.append((there, result.summary["worst_stress"]["bar"]["value_pa"]))
        said = [each["text"] for each in result.summary["warnings"] if each["code"] == "point-load"]
        assert bool(said) == (there > found[-1][1])
    assert found[1][0] > 1.5 * found[0][0]  # under the force
    assert found[1][1] == pytest.approx(found[0][1], rel=0.1)  # elsewhere
    assert said
    assert "bar.push" in said[0]
    assert "no limit" in said[0]

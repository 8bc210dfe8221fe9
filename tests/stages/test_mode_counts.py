"""Numbers of modes that a scene asks for: pairs stay whole, and what a mesh doesn't have is refused."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

SCENE = """
title = "Square cantilever"
[body.bar]
shape = "bar"
length = "300 mm"
depth = "20 mm"
width = "20 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { divisions = [6, 2, 2] }
modes = { count = 3, boundary = "joint" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
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
output_step = "0.1 ms"
tip = "bar.tip"
[[simulation.run]]
integrator = "auto"
"""


@pytest.fixture
def square(tmp_path: Path) -> str:
    path = tmp_path / "square.toml"
    path.write_text(SCENE)
    return str(path)


@pytest.mark.parametrize("boundary", ["free", "joint", "interface"])
def test_a_load_in_a_plane_of_symmetry_bends_a_square_bar_in_it_whatever_the_number_of_modes(
    fmd: Callable[..., int], square: str, boundary: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    modes = ["--set", f"body.bar.modes.boundary={boundary}"]  # three: one of the second pair
    assert fmd("run", square, *modes, "--no-budget", "--no-pictures", "--out", str(tmp_path), "--json") == 0
    result = json.loads(capsys.readouterr().out)
    _, y, z = result["tip"]["deflection_m"]
    assert abs(y) > 1e-6
    assert abs(z) < 1e-8 * abs(y)  # of 0 by symmetry; it was 0.4 % of y
    (warning,) = result["warnings"]
    assert (warning["code"], warning["body"]) == ("mode-pair-completed", "bar")
    assert "4 modes are taken instead of 3" in warning["text"]


def test_a_whole_pair_is_left_alone(fmd: Callable[..., int], square: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert fmd("modes", square, "--set", "body.bar.modes.count=2", "--json") == 0
    two = json.loads(capsys.readouterr().out)
    assert len(two["frequencies_hz"]) == 2
    assert two["warnings"] == []
    assert fmd("modes", square, "--set", "body.bar.modes.count=1") == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "warning: bar: mode 1 is one of a pair of equal frequency" in printed
    assert "2 modes are taken instead of 1" in printed


# 3 × 1 × 1 linear hexahedra: 16 nodes, 48 unknowns. Six are rigid motions of the free body; the joint and both
# interfaces hold six each.
@pytest.mark.parametrize(("boundary", "most"), [("free", 42), ("joint", 42), ("interface", 36)])
def test_modes_beyond_the_unknowns_are_refused_with_the_number_that_works(
    fmd: Callable[..., int], square: str, boundary: str, most: int, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--set", "body.bar.mesh={divisions=[3,1,1], order=1}", "--set", f"body.bar.modes.boundary={boundary}"]
    assert fmd("modes", square, *small, "--set", "body.bar.modes.count=100000") == 2
    said = capsys.readouterr().err
    assert f"body.bar.modes.count = 100000: at most {most} modes can be computed of this mesh" in said
    assert fmd("modes", square, *small, "--set", f"body.bar.modes.count={most}", "--json") == 0
    assert len(json.loads(capsys.readouterr().out)["frequencies_hz"]) >= most


def test_a_family_that_a_mesh_has_too_few_of_is_refused_with_the_number_that_works(
    fmd: Callable[..., int], square: str, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--set", "body.bar.mesh={divisions=[3,1,1], order=1}", "--set", "body.bar.modes.boundary=free"]
    small += ["--set", "body.bar.modes.family=torsion"]
    assert fmd("modes", square, *small, "--set", "body.bar.modes.count=20") == 2
    # a fourth of 48 unknowns is mirrored like torsion, the turn about x among them
    assert "only 11 torsion modes are among the 42 lowest; take at most 11" in capsys.readouterr().err
    assert fmd("modes", square, *small, "--set", "body.bar.modes.count=11", "--json") == 0
    assert len(json.loads(capsys.readouterr().out)["frequencies_hz"]) == 11
    assert fmd("modes", square, *small, "--set", "body.bar.modes.count=100000") == 2
    assert "at most 42 modes of all families" in capsys.readouterr().err


def test_a_large_mesh_has_no_modes_by_a_dense_solver(
    fmd: Callable[..., int], square: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fmd.reduction.eigen.MOST_DENSE", 40)
    small = [
        "--no-cache",
        "--set",
        "body.bar.mesh={divisions=[3,1,1], order=1}",
        "--set",
        "body.bar.modes.boundary=free",
    ]
    assert fmd("modes", square, *small, "--set", "body.bar.modes.count=21") == 2
    assert "at most 20 modes can be computed" in capsys.readouterr().err


def test_both_of_a_pair_are_taken_though_the_mesh_is_not_quite_symmetric(
    fmd: Callable[..., int], square: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fmd("modes", square, "--set", "body.bar.width=19.995 mm", "--set", "body.bar.modes.count=1", "--json") == 0
    first, second = json.loads(capsys.readouterr().out)["frequencies_hz"]
    assert 0 < second / first - 1 < 1e-3
    assert np.isclose(second / first, 20 / 19.995, rtol=1e-4)  # beam theory: proportional to the depth

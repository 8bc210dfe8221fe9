"""Thin walls in pieces: shells are cut as solids are, and cuts keep warping common where it is wanted."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.linalg import eigh, null_space

import fmd
from fmd import Pipeline, load_scene
from fmd.core.errors import InputError
from fmd.output.summary import _division_warnings

SCENE = """
title = "Walls"

[body.walls]
shape = "mesh"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { file = "walls.vtu", unit = "mm", shell = "2 mm" }
modes = { count = 8 }
pieces = 4
marker.root = { plane = "x = 0" }
marker.tip = { plane = "x = 400 mm" }

[joint.clamp]
type = "fixed"
parent = "ground"
child = "walls.root"

[drive.pull]
type = "point force"
marker = "walls.tip"
direction = [0.6, 0.8, 0.3]
force = "1 N"

[simulation]
duration = "1 ms"
output_step = "1 ms"
tip = "walls.tip"
run = [{ integrator = "auto" }]
"""


KINDS = ("tractions", "warping")


def walls(folder: Path, length: list[float], around: list[tuple[float, float]], *overrides: str) -> Pipeline:
    """Make shells by a line in the plane across x, at each of some places along x."""
    points = np.array([(x, y, z) for x in length for y, z in around])
    n = len(around)
    cells = [(i + j, i + n + j, i + n + j + 1, i + j + 1) for i in range(0, len(points) - n, n) for j in range(n - 1)]
    meshio.Mesh(points, [("quad", cells)]).write(folder / "walls.vtu")
    (folder / "walls.toml").write_text(SCENE)
    return Pipeline(load_scene(folder / "walls.toml", [*overrides]))


def channel(folder: Path, *overrides: str) -> Pipeline:
    """Make a channel of 80 × 40 × 2 mm, 400 mm long."""
    up, across = np.linspace(40.0, 0.0, 4), np.linspace(0.0, 80.0, 7)
    around = [(0.0, z) for z in up] + [(y, 0.0) for y in across[1:]] + [(80.0, z) for z in up[-2::-1]]
    return walls(folder, np.linspace(0.0, 400.0, 17).tolist(), around, *overrides)


def test_a_channel_in_four_pieces_warps_as_in_one(tmp_path: Path) -> None:
    """With six coordinates a cut its frequencies, free and clamped, are up to a half too low."""
    six, more = (channel(tmp_path, f"body.walls.sections='{name}'").division.divided["walls"] for name in KINDS)
    free = more.whole.model.solver.modes(6).omega / (2 * np.pi)
    assert np.abs(six.frequencies_hz[:6] / free - 1).max() > 0.3
    assert more.frequencies_hz[:6] == pytest.approx(free, rel=2e-3)
    assert (more.errors["lowest frequencies"] < 1e-3, more.errors["deflections"] < 1e-6) == (True, True), more.errors

    rest, root = more.at_rest, more.whole.markers["root"].columns(len(more.whole.fe.x), np.eye(3))
    clamped = more.whole.model.solver.modes(6, root).omega
    held = null_space(np.concatenate([rest.closing, rest.motions["root"]]))
    squares = eigh(held.T @ rest.K @ held, held.T @ rest.M @ held, eigvals_only=True)
    assert np.sqrt(squares[:6]) == pytest.approx(clamped, rel=5e-3)


def test_second_welds_are_joints_that_close_rings(tmp_path: Path) -> None:
    scene = channel(tmp_path, "body.walls.sections='warping'").division.scene
    assert len(scene.joint) == 1 + 2 * 3
    assert len(scene.closing) == 3


def test_a_cut_too_narrow_to_warp_is_warned_of(tmp_path: Path) -> None:
    strip = [0.0, 40.0, 80.0, 120.0, 160.0], [(0.0, 0.0), (20.0, 0.0)]
    narrow = ["body.walls.sections='warping'", "body.walls.pieces=2", "body.walls.marker.tip.plane='x = 160 mm'"]
    run = walls(tmp_path, *strip, *narrow)
    assert [(cut.first, cut.second) for cut in run.division.divided["walls"].unwarped_cuts] == [(0, 1)]
    texts = [each["text"] for each in _division_warnings(run)]
    assert any("fewer than six independent motions where pieces 1 and 2 meet" in text for text in texts)
    wide = channel(tmp_path, "body.walls.sections='warping'")
    assert not wide.division.divided["walls"].unwarped_cuts


def test_a_cut_along_a_fold_is_refused(tmp_path: Path) -> None:
    angle = [(0.0, 40.0), (0.0, 20.0), (0.0, 0.0), (20.0, 0.0), (40.0, 0.0)]
    run = walls(
        tmp_path,
        [0.0, 10.0],
        angle,
        "body.walls.pieces=2",
        "body.walls.marker={root={plane='y = 40 mm'}, tip={plane='z = 40 mm'}}",
    )
    with pytest.raises(InputError, match="a cut would run along a fold or a jump of the shell's thickness"):
        _ = run.division


def strip(pieces: int, support: dict[str, Any]) -> Pipeline:
    """A plate with a support beside its joint, in the middle of the first of two pieces."""
    plate = {
        "shape": "plate",
        "length": "0.6 m",
        "width": "0.2 m",
        "thickness": "5 mm",
        "mesh": {"divisions": [12, 4]},
        "E": "70 GPa",
        "nu": 0.3,
        "rho": "2700 kg/m^3",
        "modes": {"count": 12},
        "marker": {"root": {"node": ["0.1 m", "0 m", "0 m"]}, "tip": {"face": "x+"}},
        "support": [{"face": "x-"}, support],
    }
    cut = {"pieces": pieces, "sections": "warping"} if pieces > 1 else {}
    clamp = {"type": "fixed", "parent": "ground", "child": "strip.root"}
    steps = {"duration": "1 ms", "output_step": "1 ms", "tip": "strip.tip", "run": [{"integrator": "auto"}]}
    scene = {"title": "Strip", "body": {"strip": plate | cut}, "joint": {"clamp": clamp}, "simulation": steps}
    return fmd.load(scene).run


def test_a_support_of_shells_in_pieces_is_taken_on_the_first_piece() -> None:
    """At its faces, and by a point in the midsurface, whose nodes are numbered behind those of the faces."""
    near, far = ({"point": [x, "0.1 m", "0 m"], "fixed": ["z"]} for x in ("0.2 m", "0.5 m"))
    one, two = (
        eigh(K, M, eigvals_only=True)[:4] ** 0.5 for M, K in (strip(n, near).reference_matrices for n in (1, 2))
    )
    assert two == pytest.approx(one, rel=1e-4)
    with pytest.raises(InputError, match=r"body\.strip\.support: a support fixes nodes of several pieces"):
        _ = strip(2, far).division


def test_warping_is_of_modes_of_every_family(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='"warping" is of modes of every family'):
        channel(tmp_path, "body.walls.sections='warping'", "body.walls.modes.family='torsion'")

"""Bodies in pieces in scenes: what is refused, and the number of pieces that is found."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.deflection import find_deflection_error
from fmd.accuracy.refinement import choose_piece_counts
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.core.limits.errors import TOO_LARGE
from fmd.dynamics.kinematics import Kinematics
from fmd.output.summary import summarise
from tests.verification.test_large_deflection import FORCE, strip

SMALL = FORCE | {"LOAD": "1 N", "ALONG": 8}


def refused(folder: Path, pieces: str, *overrides: str) -> str:
    """Return the message by which a strip in pieces is refused."""
    strip(folder, PIECES=1, **SMALL)
    with pytest.raises(InputError) as fault:
        Pipeline(load_scene(folder / "strip.toml", [f"body.strip.pieces={pieces}", *overrides])).parts  # noqa: B018
    return str(fault.value)


@pytest.mark.parametrize(
    ("pieces", "override", "message"),
    [
        ("9", "title='x'", "body.strip.pieces = 9: the mesh has 8 elements"),
        (
            "2",
            "body.strip.marker.tip.face='y-'",
            "body.strip.marker.tip: its face extends over 2 of the body's 2 pieces",
        ),
        ("2", "body.strip.modes.boundary='joint'", "pieces are fixed at their cuts"),
        ("0", "title='x'", "body.strip.pieces = 0: must be a whole number from 1 to 1000, or 'auto'"),
        ("2", "body.strip.modes.damping=0.01", "pieces take a factor of the stiffness"),
        ("1", "body.strip.sections='rigid'", "belongs to a body in pieces"),
        ('"auto"', "title='x'", "`fmd run` finds the number"),
        ("2", "body.strip.support=[{face='z-'}]", "a support fixes nodes of several pieces"),
    ],
)
def test_what_pieces_cannot_be_is_refused(tmp_path: Path, pieces: str, override: str, message: str) -> None:
    assert message in refused(tmp_path, pieces, override)


def test_the_number_of_pieces_is_doubled_until_the_error_is_small(tmp_path: Path) -> None:
    run = choose_piece_counts(strip(tmp_path, PIECES='"auto"', **SMALL | {"LOAD": "2 N"}))
    count = len(run.pieces_of("strip"))
    assert count == 4
    assert find_deflection_error(run, "strip") < TOO_LARGE


def test_a_run_tells_that_pieces_vibrate_otherwise_than_the_part(tmp_path: Path) -> None:
    strip(tmp_path, PIECES=4, LENGTH=0.1, POISSON=0.33, **SMALL)
    whole, rigid = (
        Pipeline(load_scene(tmp_path / "strip.toml", [f"body.strip.sections={sections}"]))
        for sections in ("tractions", "rigid")
    )
    errors = whole.division.divided["strip"].errors
    assert (errors["lowest frequencies"] < 0.01, errors["deflections"] < 1e-5) == (True, True), errors
    told = [each["text"] for each in summarise(rigid, [], budget=False)["warnings"] if each["code"] == "pieces"]
    for (what, error), text in zip(rigid.division.divided["strip"].errors.items(), told, strict=True):
        assert error > 0.05
        assert f"the {what} of its 4 pieces together differ by up to {100 * error:.2g} %" in text
    assert "pieces" not in {each["code"] for each in summarise(whole, [], budget=False)["warnings"]}


FRAME = """
title = "Frame"
[body.frame]
shape = "mesh"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { file = "frame.vtu", unit = "m", order = 2 }
modes = { count = 4 }
pieces = 2
marker.root = { plane = "x = 0" }
marker.tip = { plane = "x = 0.1 m" }
marker.eye = { node = ["0.1 m", "0.06 m", "0.01 m"], rotate = ["0 deg", "0 deg", "90 deg"] }
marker.rim = { edge = [["0.1 m", "0 m", "0 m"], ["0.1 m", "0 m", "0.01 m"]] }

[joint.clamp]
type = "fixed"
parent = "ground"
child = "frame.root"

[drive.pull]
type = "point force"
marker = "frame.tip"
direction = [0.6, 0.8, 0.3]
force = "0.01 N"

[simulation]
duration = "1 ms"
output_step = "1 ms"
start = "equilibrium"
stiffening = "off"
tip = "frame.tip"
run = [{ integrator = "auto" }]
"""


def frame(folder: Path) -> Pipeline:
    """Make a rectangular frame of hexahedra around a window, in two pieces that touch on both sides of it."""
    columns = [(i, j) for i in range(10) for j in range(6) if i in (0, 9) or j in (0, 5)]
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    places = np.array([[(i + a, j + b, c) for a, b, c in corners] for i, j in columns])
    points, cells = np.unique(places.reshape(-1, 3), axis=0, return_inverse=True)
    meshio.Mesh(0.01 * points, [("hexahedron", cells.reshape(-1, 8))]).write(folder / "frame.vtu")
    (folder / "frame.toml").write_text(FRAME)
    return Pipeline(load_scene(folder / "frame.toml"))


def test_pieces_that_touch_in_two_places_are_welded_in_both(tmp_path: Path) -> None:
    """Frequencies, and places of markers of all kinds, are those of the frame in one piece."""
    run = frame(tmp_path)
    divided = run.division.divided["frame"]
    assert [cut.closes for cut in divided.cut.cuts] == [False, True]
    whole = run.variant(load_scene(tmp_path / "frame.toml", ["body.frame.pieces=1"]))
    assert divided.frequencies_hz == pytest.approx(whole.part.modes.omega[:4] / (2 * np.pi), rel=3e-3)
    interface = ["body.frame.pieces=1", "body.frame.modes.boundary=interface"]
    one = run.variant(load_scene(tmp_path / "frame.toml", interface))
    moved = [find_displacements(each, ("tip", "eye", "rim")) for each in (run, one)]
    assert np.abs(moved[0] - moved[1]).max() < 4e-3 * np.abs(moved[1]).max()  # averaged cuts are off by more


def find_displacements(run: Pipeline, markers: tuple[str, ...]) -> Array:
    """Return the displacements of markers at rest under the loads of the start, shape (n_markers, 3)."""
    rest = Kinematics(run.mechanism, np.zeros(1), run.start[0][None], run.start[1][None])
    number, placed = run.mechanism.number_of("frame"), run.wholes["frame"].markers
    root = placed["root"].position
    return np.array([rest.marker_position(number, name)[0] - placed[name].position + root for name in markers])

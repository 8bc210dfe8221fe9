"""Scenes whose bodies are supported or have an interface, and scenes of parts alone."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError

PLATE = """
title = "Plate"
[body.plate]
shape = "bar"
length = "10 m"
depth = "10 m"
width = "1 m"
E = "200 GPa"
nu = 0.3
rho = "8000 kg/m^3"
mesh = { divisions = [4, 4, 1] }
modes = { count = 7 }
marker = { left = { face = "x-" }, right = { face = "x+" } }
support = [
  { face = ["z-", "x-"], fixed = ["z"] },
  { face = ["z-", "x+"], fixed = ["z"] },
  { face = ["z-", "y-"], fixed = ["z"] },
  { edge = [["0 m", "5 m", "-0.5 m"], ["10 m", "5 m", "-0.5 m"]], fixed = ["z"] },
]
"""


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> str:
    path: Path = tmp_path_factory.mktemp("scene") / "plate.toml"
    path.write_text(PLATE)
    return str(path)


def test_a_plate_on_its_edges_has_three_rigid_modes_and_the_published_frequencies(
    fmd: Callable[..., int], plate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fmd("modes", plate, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["rigid_modes"] == 3
    # NAFEMS test FV52: a coarse mesh, against plate theory
    published = [45.897, 109.44, 109.44, 167.89, 193.59, 206.19, 206.19]
    assert result["frequencies_hz"] == pytest.approx(published, rel=0.025)
    assert fmd("mesh", plate) == 0


def test_a_support_in_a_plane_is_that_of_its_face(
    fmd: Callable[..., int], plate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    found = []
    for place in ('face="x-"', 'plane="x = 0"'):
        assert fmd("modes", plate, "--json", "--set", f"body.plate.support=[{{{place}}}]") == 0
        found.append(json.loads(capsys.readouterr().out)["frequencies_hz"])
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("run",), "simulation: is missing: without it a scene has mesh and modes alone"),
        (("modes", "--speed", "3 rad/s"), "hangs on no joint"),
        (("stability",), "simulation: is missing"),
    ],
)
def test_a_scene_of_parts_alone_has_no_motion(
    fmd: Callable[..., int], plate: str, command: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fmd(command[0], plate, *command[1:]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ('body.plate.support.0.face=["z-", "u"]', "no such face"),
        ('body.plate.support.0.face=["z-", "z+"]', "the faces have no node in common"),
        ('body.plate.support.0={fixed=["z"]}', "is missing: a face"),
        ('body.plate.support.0.point=["0 m", "0 m", "0 m"]', "can't stand beside face"),
        ("body.plate.support.0.fixed=[]", "support.0.fixed"),
        ('body.plate.support.3.edge=[["1 m","1 m","1 m"],["1 m","1 m","1 m"]]', "has no length"),
        ('body.plate.support.3.edge=[["0 m","5 m","-9 m"],["10 m","5 m","-9 m"]]', "the nearest is 8.5 m away"),
        ("body.plate.modes.boundary=joint", "can't stand beside supports"),
        ('body.plate.modes.interface=["left"]', 'belongs to boundary = "interface"'),
        ('body.plate.modes={count=3, boundary="interface", family="torsion"}', "deflections by an interface are of"),
        ('body.plate.modes={count=3, boundary="interface", interface=["middle"]}', "no such marker"),
        ("body.plate.marker.left.attachment=rigid", "a support and a rigid face share nodes"),
    ],
)
def test_a_wrong_support_or_interface_is_one_line_and_status_2(
    fmd: Callable[..., int], plate: str, override: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fmd("modes", plate, "--set", override) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert said in printed.err


def test_an_interface_without_a_marker_and_a_joint_without_a_joint_are_refused(
    fmd: Callable[..., int], plate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fmd("modes", plate, "--set", "body.plate.marker={}", "--set", "body.plate.modes.boundary=interface") == 2
    assert "has no marker to be an interface" in capsys.readouterr().err
    assert fmd("modes", plate, "--set", "body.plate.support=[]", "--set", "body.plate.modes.boundary=joint") == 2
    assert "hangs on no joint to be held at" in capsys.readouterr().err


def test_an_interface_that_is_supported_is_a_failed_check(
    fmd: Callable[..., int], plate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    clamp = ["--set", 'body.plate.support=[{face="x-"}]']
    assert fmd("modes", plate, *clamp, "--set", "body.plate.modes.boundary=interface") == 3
    assert "leave out one of them, or a support that fixes it" in capsys.readouterr().err
    only = ["--set", 'body.plate.modes={count=4, boundary="interface", interface=["right"]}']
    assert fmd("modes", plate, *clamp, *only, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["rigid_modes"], len(result["frequencies_hz"])) == (0, 4 + 6)


# In motion -------------------------------------------------------------------------------------------------------

COARSE = (
    "body.beam.mesh.divisions=[30, 1, 1]",
    "simulation.duration=8 s",
    "simulation.output_step=40 ms",
    "simulation.error=1e-5",
)
BOUNDARIES = {
    "held at the joint": (),
    "supported": ("body.beam.modes.boundary=free", 'body.beam.support=[{face="x-"}]'),
    "interface": ('body.beam.modes={count=10, boundary="interface"}',),
    "interface, enriched": ('body.beam.modes={count=6, boundary="interface", enrich="inertia"}',),
    "interface, supported": (
        'body.beam.modes={count=4, boundary="interface", interface=["tip"], enrich="inertia"}',
        'body.beam.support=[{face="x-"}]',
    ),
}


@pytest.fixture(scope="module")
def tips() -> dict[str, tuple[float, float]]:
    found = {}
    for name, overrides in BOUNDARIES.items():
        run = Pipeline(load_scene("spin-up", [*COARSE, *overrides]))
        lag = run.motion.tip_deflection[:, 1]
        found[name] = (float(np.abs(lag).max()), float(run.body.omega[0]))
    return found


@pytest.mark.parametrize("boundary", list(BOUNDARIES)[1:])
def test_a_beam_spun_up_lags_alike_whatever_its_modes_were_held_by(
    tips: dict[str, tuple[float, float]], boundary: str
) -> None:
    assert tips[boundary] == pytest.approx(tips["held at the joint"], rel=5e-4)


def test_a_supported_beam_on_a_free_hinge_rotates_without_coupling() -> None:
    """Held where the hinge turns it, and described about the hinge: the pinned frequencies of the free description."""
    both = [
        Pipeline(load_scene("beam-paper", ["body.beam.modes.enrich=inertia", *overrides]))
        for overrides in ([], ['body.beam.support=[{face="x-"}]'])
    ]
    free, supported = (run.body for run in both)
    assert supported.coupling < 1e-8
    assert supported.frequencies_hz[:3] == pytest.approx(free.frequencies_hz[:3], rel=3e-3)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (['body.beam.support=[{face="x-", fixed=["y"]}]'], "body.beam.support: leave 4 rigid-body modes"),
        (['body.beam.support=[{face="x+"}]'], "body.beam.support: must fix the whole face of the joint's marker"),
    ],
)
def test_a_body_in_motion_must_be_held_whole_and_where_its_hinge_is(overrides: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        _ = Pipeline(load_scene("beam-paper", overrides)).bodies


def test_a_support_of_a_floating_body_is_refused() -> None:
    joint = 'joint.hub={type="free", parent="ground", child="beam.root"}'
    with pytest.raises(InputError, match="holds nothing that a support could hold on to; take a fixed joint"):
        load_scene("beam-paper", [joint, "drive={}", 'body.beam.support=[{face="x-"}]'])

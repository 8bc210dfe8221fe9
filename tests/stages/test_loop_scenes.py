"""Scenes with loops: supports that are redundant, and what can't be closed, told in one message."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError
from fmd.integrators.protocol import evaluate
from fmd.output.mechanism_figures import loop_warnings

DOOR = """
title = "Door"
[body.door]
shape = "rigid"
mass = "20 kg"
centre = ["0.4 m", "0 m", "1 m"]
inertia = ["1.7 kg m^2", "2.8 kg m^2", "1.1 kg m^2"]
[body.door.marker]
low = { at = ["0 m", "0 m", "0.2 m"] }
middle = { at = ["0 m", "0 m", "1 m"] }
high = { at = ["0 m", "0 m", "1.8 m"] }
handle = { at = ["0.8 m", "0 m", "1 m"] }
[ground]
low = { at = ["0 m", "0 m", "0.2 m"] }
middle = { at = ["0 m", "0 m", "1 m"] }
high = { at = ["0 m", "0 m", "1.8 m"] }
[joint]
low = { type = "revolute", parent = "ground.low", child = "door.low", axis = [0, 0, 1], rate = "1 rad/s" }
middle = { type = "revolute", parent = "ground.middle", child = "door.middle", axis = [0, 0, 1] }
high = { type = "revolute", parent = "ground.high", child = "door.high", axis = [0, 0, 1] }
[simulation]
duration = "1 s"
output_step = "10 ms"
gravity = ["1 m/s^2", "0 m/s^2", "-9.7 m/s^2"]
tip = "door.handle"
run = [{ integrator = "runge-kutta", tolerance = 1e-10 }]
"""

PRESS: dict[str, Any] = {
    "title": "Crank press",
    "body": {
        "crank": {
            "shape": "rod",
            "mass": "0.8 kg",
            "length": "40 mm",
            "marker": {"shaft": {"at": ["0 mm", "0 mm", "0 mm"]}, "pin": {"at": ["40 mm", "0 mm", "0 mm"]}},
        },
        "rod": {
            "shape": "rod",
            "mass": "0.4 kg",
            "length": "160 mm",
            "marker": {"big": {"at": ["0 mm", "0 mm", "0 mm"]}, "small": {"at": ["160 mm", "0 mm", "0 mm"]}},
        },
        "ram": {"shape": "point", "mass": "2 kg", "marker": {"pin": {"at": ["0 mm", "0 mm", "0 mm"]}}},
    },
    "joint": {
        "shaft": {"type": "revolute", "parent": "ground", "child": "crank.shaft", "axis": [0, 0, 1]},
        "big_end": {"type": "revolute", "parent": "crank.pin", "child": "rod.big", "axis": [0, 0, 1]},
        "guide": {"type": "prismatic", "parent": "ground", "child": "ram.pin", "axis": [0, -1, 0]},
        "small_end": {"type": "revolute", "parent": "rod.small", "child": "ram.pin", "axis": [0, 0, 1]},
    },
    "drive": {"crank": {"type": "motion", "joint": "shaft", "angle": {"formula": "31.4*t", "unit": "rad"}}},
    "simulation": {
        "duration": "20 ms",
        "output_step": "1 ms",
        "tip": "rod.small",
        "run": [{"integrator": "runge-kutta"}],
    },
}

BAR = """
title = "Bar on two bearings"
[body.bar]
shape = "bar"
length = "1 m"
width = "30 mm"
depth = "20 mm"
E = "70 GPa"
nu = 0
rho = "2700 kg/m^3"
mesh = { element = "hexahedron", order = 2, divisions = [16, 1, 1] }
modes = { count = 8, family = "in-plane bending", boundary = "joint", enrich = "none" }
marker = { left = { face = "x-" }, right = { face = "x+" } }
[ground]
right = { at = ["1 m", "0 m", "0 m"] }
[joint.left]
type = "revolute"
parent = "ground"
child = "bar.left"
axis = [0, 0, 1]
[joint.right]
type = "revolute"
parent = "ground.right"
child = "bar.right"
axis = [0, 0, 1]
[simulation]
duration = "0.1 s"
output_step = "0.1 ms"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
tip = "bar.right"
run = [{ integrator = "runge-kutta", tolerance = 1e-9 }]
"""

GUIDE = 'body.slider.marker.guide={at=["0 mm", "0 mm", "0 mm"]}'
LAST = 'C = { type = "revolute", parent = "coupler.C", child = "rocker.C", axis = [0, 0, 1] }'
FOUR_BAR = """
title = "Four-bar"
[body.crank]
shape = "rod"
mass = "1 kg"
length = "1 m"
marker = { A = { at = ["0 m", "0 m", "0 m"] }, B = { at = ["1 m", "0 m", "0 m"] } }
[body.coupler]
shape = "rod"
mass = "1 kg"
length = "2 m"
marker = { B = { at = ["0 m", "0 m", "0 m"] }, C = { at = ["2 m", "0 m", "0 m"] } }
[body.rocker]
shape = "rod"
mass = "1 kg"
length = "1.5 m"
marker = { D = { at = ["0 m", "0 m", "0 m"] }, C = { at = ["1.5 m", "0 m", "0 m"] } }
[ground]
D = { at = ["2 m", "0 m", "0 m"] }
[joint]
A = { type = "revolute", parent = "ground", child = "crank.A", axis = [0, 0, 1], angle = "90 deg" }
B = { type = "revolute", parent = "crank.B", child = "coupler.B", axis = [0, 0, 1] }
D = { type = "revolute", parent = "ground.D", child = "rocker.D", axis = [0, 0, 1] }
LAST
[simulation]
duration = "0.5 s"
output_step = "10 ms"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]
tip = "coupler.C"
run = [{ integrator = "runge-kutta", tolerance = 1e-9 }]
""".replace("LAST", LAST)


MODELS = ("slider-crank", "four-bar", "stewart", "suspension")
TRACK_ENDS = 'body.track_rod.marker={inner={at=["0 m","0 m","0 m"]}, outer={at=["340 mm","0 m","0 m"]}}'
PARALLELOGRAM = ('body.rocker.length="1 m"', 'body.rocker.marker.C.at=["1 m", "0 m", "0 m"]')
PRESCRIBED = (
    FOUR_BAR.replace(', angle = "90 deg"', "").replace("1.5 m", "1 m")
    + """
[drive.one]
type = "motion"
joint = "A"
angle = { formula = "pi/2 + t", unit = "rad" }
[drive.two]
type = "motion"
joint = "D"
angle = { formula = "pi/2 - t", unit = "rad" }
"""
)


def pipeline(folder: Path, text: str, *overrides: str) -> Pipeline:
    file = folder / "scene.toml"
    file.write_text(text)
    return Pipeline(load_scene(file, overrides))


def without(text: str, *joints: str) -> str:
    """The scene without some of its joints, a line each."""
    return "\n".join(line for line in text.splitlines() if line.partition(" = ")[0] not in joints or "type" not in line)


def test_a_door_on_three_hinges_swings_as_on_one(tmp_path: Path) -> None:
    three, one = (pipeline(tmp_path, text).motion for text in (DOOR, without(DOOR, "middle", "high")))
    assert three.tip_position == pytest.approx(one.tip_position, abs=1e-10)
    assert np.ptp(one.tip_position[:, 1]) > 0.3
    assert three.constraint_residual < 1e-13


def test_a_bar_on_two_bearings_sags_as_by_beam_theory(tmp_path: Path) -> None:
    """Its ends turn by q l³ / 24 E I, and each bearing takes half its weight; the second one holds nothing along it."""
    run = pipeline(tmp_path, BAR, "simulation.start=steady", "body.bar.modes.enrich=none")
    motion: Any = run.motion
    link, q = run.mechanism.links[0], motion.trajectory.q
    turned = q[:, 0] + q[:, 1:] @ link.joint_rotation
    weight, stiffness = 2700 * 9.81 * 0.03 * 0.02, 70e9 * 0.03 * 0.02**3 / 12
    assert turned == pytest.approx(-weight / (24 * stiffness), rel=2e-3)  # shear adds what beam theory leaves out
    force = motion.closing_reactions["right"][:, 1, :3]
    assert force == pytest.approx(np.tile([0.0, weight / 2, 0.0], (len(q), 1)), abs=1e-5 * weight)
    other = motion.joint_loads.reactions["left"][:, 1]
    assert other == pytest.approx(np.tile([0.0, weight / 2, 0.0, 0.0, 0.0, 0.0], (len(q), 1)), abs=1e-5 * weight)
    assert motion.constraint_residual < 1e-13


def test_a_loop_starts_steadily_also_where_only_a_joint_that_is_given_can_follow() -> None:
    """The rod of the slider-crank is stretched at the start: the slider, which the scene places, has to give way."""
    run = Pipeline(load_scene("slider-crank", ["body.rod.modes.enrich=residual"]))
    (q, v), system, a = run.start, run.system, np.zeros(run.system.n)
    evaluate(system.parameters, 0.0, q, v, a)
    omega, modes = system.mechanism.links[1].omega, system.mechanism.modes_of(1)
    deflected = np.abs(q[modes + system.n_positions - system.n]).max()
    assert deflected > 1e-7
    assert np.abs(a[modes] / omega**2).max() < 1e-7 * deflected


def test_a_loop_that_the_scene_leaves_open_is_closed_by_the_joints_that_it_gives_no_angle(tmp_path: Path) -> None:
    run = pipeline(tmp_path, FOUR_BAR)
    q, _ = run.start
    assert q[run.mechanism.layout.position[0]] == pytest.approx(np.pi / 2, abs=1e-12)
    assert run.motion.constraint_residual < 1e-13
    kinetic, potential = run.motion.energies[:2]
    assert np.ptp(kinetic) > 0.02
    assert np.ptp(kinetic + potential) < 1e-8


@pytest.mark.parametrize(
    ("text", "overrides", "said"),
    [
        (FOUR_BAR, ['ground.D.at=["9 m", "0 m", "0 m"]'], "C"),
        (
            PRESCRIBED,
            [],
            "against each other",
        ),
        (
            "suspension",
            ['body.track_rod={shape="rod", mass="1 kg", length="340 mm"}', TRACK_ENDS],
            "nothing has inertia",
        ),
        (
            "slider-crank",
            ['body.slider.marker.pin.at=["0 mm", "0 mm", "2 mm"]', 'joint.guide.child="slider.guide"', GUIDE],
            "that leaves this free: cylindrical",
        ),
        (DOOR, ["joint.low.child_axis=[0, 0, 1]"], "joint.low.child_axis = [0, 0, 1]: has no effect"),
        (DOOR, ["joint.low.rate=0 rad/s", "joint.high.axis=[1, 0, 0]"], "nothing can move"),
        (
            FOUR_BAR,
            [*PARALLELOGRAM, "joint.A.angle=0 deg"],
            "singular",
        ),
    ],
)
def test_a_mechanism_that_cannot_be_is_refused_in_one_message(
    tmp_path: Path,
    fmd: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    text: str,
    overrides: list[str],
    said: str,
) -> None:
    file: str | Path = text if text in MODELS else tmp_path / "scene.toml"
    if isinstance(file, Path):
        file.write_text(text)
    settings = [word for override in overrides for word in ("--set", override)]
    assert fmd("run", file, "--out", tmp_path / "out", *settings) == 2
    err = capsys.readouterr().err
    print(err)
    assert said in err
    assert "Traceback" not in err


def test_a_place_that_a_mesh_gives_some_nanometres_off_is_closed_with_a_warning(tmp_path: Path) -> None:
    given = ["simulation.duration=1 ms", "simulation.start=undeformed", "body.rod.modes.enrich=none"]
    off = ['body.slider.marker.pin.at=["0 mm", "0 mm", "7e-6 mm"]', 'joint.guide.child="slider.guide"', GUIDE]
    exact, closed = (Pipeline(load_scene("slider-crank", [*given, *more])) for more in ([], off))
    assert not loop_warnings(exact)
    (warning,) = loop_warnings(closed)
    assert "joint.small_end is closed over 7e-09 m" in warning["text"]
    np.testing.assert_allclose(closed.motion.trajectory.q, exact.motion.trajectory.q, atol=1e-10)


def test_the_slider_crank_of_the_models_turns_as_a_rigid_one_but_for_its_rod(tmp_path: Path) -> None:
    """The slider's place is l₁ cos φ + √(l₂² − (l₁ sin φ)²), less what the rod shortens as it bends."""
    run = Pipeline(load_scene("slider-crank", ["body.rod.modes.enrich=none"]))
    motion: Any = run.motion
    angle = 150.0 * motion.times
    rigid = 0.15 * np.cos(angle) + np.sqrt(0.3**2 - (0.15 * np.sin(angle)) ** 2)
    assert motion.joint_position("guide") == pytest.approx(rigid, abs=1e-4)
    assert np.abs(motion.joint_position("guide") - rigid).max() > 1e-6
    assert np.abs(motion.tip_displacement[:, 1]).max() > 1e-3
    assert motion.constraint_residual < 1e-12
    first, explicit, chosen = (one.joint_position("guide") for one in run.motions.values())
    assert explicit == pytest.approx(first, abs=1e-7)
    assert chosen == pytest.approx(first, abs=1e-9)


def test_the_legs_of_the_stewart_platform_are_as_long_as_they_are_driven(tmp_path: Path) -> None:
    """From the places of the feet and of the platform's corners, of which no leg's joint knows."""
    run = Pipeline(load_scene("stewart"))
    motion: Any = run.motion
    ground, platform = run.scene.ground, run.scene.body["platform"].marker
    for k in range(1, 7):
        at, foot = np.array([platform[f"P{k}"].at]), np.array(ground[f"B{k}"].at)
        corner = np.concatenate([motion.placed("platform", at, step) for step in range(len(motion.times))])
        driven = 0.285702 + 0.05 * (1 - np.cos(2 * np.pi * motion.times))
        driven = 0.4 + driven + 0.03 * np.sin(2 * np.pi * motion.times + np.pi / 3 * (k - 1))
        assert np.linalg.norm(corner - foot, axis=1) == pytest.approx(driven, abs=1e-10)


def test_the_suspension_corner_gives_way_and_comes_back(tmp_path: Path) -> None:
    motion: Any = Pipeline(load_scene("suspension")).motion
    travel = motion.tip_position - motion.tip_position[0]
    assert 0.01 < travel[:, 2].max() < 0.2
    assert travel[:, 0].min() < -1e-4
    assert np.abs(travel[-1]).max() < 1e-5
    assert motion.constraint_residual < 1e-12


@pytest.mark.parametrize(("position", "side"), [("-120 mm", -1), ("120 mm", 1)])
def test_a_crank_press_says_in_which_ways_it_closes(position: str, side: int) -> None:
    """At its dead point it can't tell them apart: the ram is at ±√(160² − 40²) mm and the rod as far off the axis."""
    with pytest.raises(InputError, match=r"guide.position = '154.9 mm', or .*'104.5 deg' .* = '-154.9 mm'"):
        _ = Pipeline(load_scene(PRESS)).start
    run = Pipeline(load_scene(PRESS, [f"joint.guide.position={position}"]))
    assert run.start[0][1] == pytest.approx(side * np.sqrt(0.16**2 - 0.04**2), abs=1e-12)
    *_, ways = loop_warnings(run)
    assert ways["code"] == "closing-ways"
    assert re.findall(r"'(-?[\d.]+) mm'", ways["text"]) == [f"{side * 154.9:.1f}", f"{-side * 154.9:.1f}"]
    near = [f"joint.guide.position={side * 150} mm", f"joint.big_end.angle={-side * 100} deg"]
    assert "closing-ways" not in {warning["code"] for warning in loop_warnings(Pipeline(load_scene(PRESS, near)))}


def test_a_pin_some_micrometres_off_is_not_said_to_be_far_from_where_loops_close() -> None:
    """Slides at zero are measured by the size of bodies: a block 10 µm from its pin, beside a parallelogram."""

    def rod(length: str) -> dict[str, Any]:
        markers = {name: {"at": [x, "0 mm", "0 mm"]} for name, x in (("a", "0 mm"), ("b", length))}
        return {"shape": "rod", "mass": "1 kg", "length": length, "marker": markers}

    def hinge(parent: str, child: str, **angle: str) -> dict[str, Any]:
        return {"type": "revolute", "parent": parent, "child": child, "axis": [0, 0, 1]} | angle

    guide = {"type": "prismatic", "parent": "ground", "child": "ram.pin", "axis": [1, 0, 0], "position": "0 mm"}
    places = {"foot": {"at": ["90 mm", "0 mm", "0 mm"]}, "pin": {"at": ["10 um", "0 mm", "0 mm"]}}
    joints = {
        "shaft": hinge("ground", "crank.a"),
        "pin": hinge("crank.b", "coupler.a", angle="-90 deg"),
        "foot": hinge("ground.foot", "rocker.a", angle="90 deg"),
        "closing": hinge("coupler.b", "rocker.b"),
        "guide": guide,
        "held": {"type": "spherical", "parent": "ground.pin", "child": "ram.pin"},
    }
    bodies = {"crank": rod("40 mm"), "coupler": rod("90 mm"), "rocker": rod("40 mm"), "ram": PRESS["body"]["ram"]}
    drive = {"crank": {"type": "motion", "joint": "shaft", "angle": {"formula": "pi/2 + 3*t", "unit": "rad"}}}
    simulation = PRESS["simulation"] | {"tip": "crank.b"}
    scene = PRESS | {"ground": places, "body": bodies, "joint": joints, "drive": drive, "simulation": simulation}
    assert [warning["code"] for warning in loop_warnings(Pipeline(load_scene(scene)))] == ["start-moved"]


def test_what_constraints_yield_is_known_before_anything_is_compiled() -> None:
    """At two positions of the crank, against J M⁻¹ Jᵀ by the constraints' rates and the mass matrix."""
    system = Pipeline(load_scene("slider-crank", ["body.rod.mesh.divisions=[4, 1, 1]"])).system
    inputs, q = system.compiled.signal_values(0.0), np.tile(system.mechanism.rest_positions, (2, 1))
    q[1] += np.linspace(0.01, 0.1, q.shape[1])
    for found, at in zip(system.compiled.compliances(q), q, strict=True):
        J, _ = system.compiled.constraint_rates(0.0, at)
        np.testing.assert_allclose(found, J @ np.linalg.solve(system.compiled.mass_matrix(inputs, at), J.T), rtol=1e-8)

"""Axes of markers and joints: where bodies start, how they move, and what is refused; against rotations by SciPy."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.dynamics.kinematics import Kinematics
from fmd.scene.orientation import AxisDirections, Orientation
from fmd.stages.mechanism import place_joints
from fmd.stages.parent_joint import axes_in_space
from tests.scene.scenes import refused, scene_of

SIMULATION = """
[simulation]
duration = "0.3 s"
output_step = "10 ms"
gravity = ["1 m/s^2", "-9 m/s^2", "3 m/s^2"]
tip = "{}"
run = [{{ integrator = "runge-kutta", tolerance = 1e-9 }}]
"""
TURNS = np.deg2rad([[20, -35, 50], [70, 10, -40], [-15, 80, 25], [120, 30, 0], [5, 60, -70], [33, 0, 90], [0, 45, 12]])


def matrix(turn: Array) -> Array:
    return Rotation.from_rotvec(turn).as_matrix()


def vector(turn: Array) -> str:
    return str([f"{x!r} rad" for x in turn.tolist()])


def point(x: Array) -> str:
    return str([f"{a!r} m" for a in np.asarray(x, dtype=float).tolist()])


# Joints with their coordinates at the start: displacement and rotation in the joint's axes.
POSES = {
    "fixed": ("", np.zeros(3), np.eye(3)),
    "revolute": ('axis = [0, 0, 1]\nangle = "0.7 rad"', np.zeros(3), matrix([0, 0, 0.7])),
    "prismatic": ('axis = [0, 1, 0]\nposition = "0.3 m"', np.array([0, 0.3, 0]), np.eye(3)),
    "spherical": ("", np.zeros(3), np.eye(3)),
    "universal": (
        'axis = [1, 0, 0]\nchild_axis = [0, 1, 0]\nangles = ["0.4 rad", "-0.6 rad"]',
        np.zeros(3),
        matrix([0.4, 0, 0]) @ matrix([0, -0.6, 0]),
    ),
    "cylindrical": (
        'axis = [0, 0, 1]\nposition = "0.2 m"\nangle = "-0.5 rad"',
        np.array([0, 0, 0.2]),
        matrix([0, 0, -0.5]),
    ),
    "screw": ('axis = [1, 0, 0]\nlead = "10 mm"\nangle = "2 rad"', [0.01 / np.pi, 0, 0], matrix([2, 0, 0])),
}


@pytest.mark.parametrize("kind", POSES)
def test_a_joint_brings_the_childs_axes_onto_the_parents(tmp_path: Path, kind: str):
    keys, slide, turn = POSES[kind]
    place, on_parent, on_child, of_joint = TURNS[:4]
    base, end, root = np.array([0.1, -0.2, 0.3]), np.array([0.5, 0.1, 0.0]), np.array([-0.2, 0.3, 0.1])
    text = f"""
title = "Chain"
ground.base = {{ at = {point(base)}, rotate = {vector(place)} }}
[body.first]
shape = "rod"
mass = "1 kg"
length = "1 m"
marker.foot = {{ at = ["0 m", "0 m", "0 m"] }}
marker.end = {{ at = {point(end)}, rotate = {vector(on_parent)} }}
[body.second]
shape = "rod"
mass = "1 kg"
length = "1 m"
marker.root = {{ at = {point(root)}, rotate = {vector(on_child)} }}
marker.tip = {{ at = ["1 m", "0 m", "0 m"] }}
[joint.a]
type = "fixed"
parent = "ground.base"
child = "first.foot"
[joint.b]
type = "{kind}"
parent = "first.end"
child = "second.root"
rotate = {vector(of_joint)}
{keys}
"""
    run = Pipeline(scene_of(tmp_path, text + SIMULATION.format("second.tip")))
    q, v = place_joints(run.scene, run.mechanism)
    state = Kinematics(run.mechanism, np.zeros(1), q[None], v[None])
    first = matrix(place)
    joint = first @ matrix(on_parent) @ matrix(of_joint)
    second = joint @ turn @ matrix(on_child).T
    origin = base + first @ end + joint @ slide
    tip = origin + second @ (np.array([1.0, 0, 0]) - root)
    assert state.frames[1].rotation[0] == pytest.approx(second, abs=1e-12)
    assert state.marker_position(1, "tip")[0] == pytest.approx(tip, abs=1e-12)
    if kind == "fixed":
        assert axes_in_space(run.scene, "second") == pytest.approx(second, abs=1e-12)


BEAM = """
title = "Bar on a hinge"
[body.bar]
shape = "bar"
length = "300 mm"
depth = "10 mm"
width = "20 mm"
E = "7 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { divisions = [8, 1, 1] }
modes = { count = 3, family = "in-plane bending", boundary = "joint", enrich = "none" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.hinge]
type = "revolute"
parent = "ground"
child = "bar.root"
axis = [0, 0, 1]
rate = "5 rad/s"
[drive.push]
type = "point force"
marker = "bar.tip"
direction = [0, 1, 0]
following = true
force = { formula = "2*sin(40*t)", unit = "N" }
"""


def test_a_flexible_body_moves_the_same_whatever_axes_its_markers_have(tmp_path: Path):
    """Parent's and child's marker are turned alike, and directions are given in the turned axes."""
    plain = Pipeline(scene_of(tmp_path, BEAM + SIMULATION.format("bar.tip"))).motion
    T, U = matrix(TURNS[1]), matrix(TURNS[2])
    turned = Pipeline(
        scene_of(
            tmp_path,
            BEAM + SIMULATION.format("bar.tip"),
            f"ground={{p={{at=['0 m','0 m','0 m'], rotate={vector(TURNS[1])}}}}}",
            "joint.hinge.parent=ground.p",
            f"body.bar.marker.root.rotate={vector(TURNS[1])}",
            f"body.bar.marker.tip.rotate={vector(TURNS[2])}",
            f"joint.hinge.axis={T.T[:, 2].tolist()}",
            f"drive.push.direction={U.T[:, 1].tolist()}",
        )
    ).motion
    assert np.ptp(plain.tip_deflection[:, 1]) > 5e-4
    assert turned.tip_position == pytest.approx(plain.tip_position, abs=1e-7)
    assert turned.tip_deflection == pytest.approx(plain.tip_deflection, abs=1e-7)


def test_the_turn_of_a_hinge_is_its_first_pose(tmp_path: Path):
    by_angle = Pipeline(scene_of(tmp_path, BEAM + SIMULATION.format("bar.tip"), "joint.hinge.angle=40 deg")).motion
    turn = "joint.hinge.rotate=['0 deg', '0 deg', '40 deg']"
    by_turn = Pipeline(scene_of(tmp_path, BEAM + SIMULATION.format("bar.tip"), turn)).motion
    assert by_turn.tip_position == pytest.approx(by_angle.tip_position, abs=1e-7)
    shift = by_angle.joint_position("hinge") - by_turn.joint_position("hinge")
    assert shift == pytest.approx(np.deg2rad(40.0), abs=1e-7)


def test_a_free_body_starts_where_the_scene_puts_it_and_flies_by_the_closed_form(tmp_path: Path):
    """It turns about a principal axis at a constant rate, its centre falls along a parabola."""
    start, velocity, rate, tilt, own = np.array([0.3, 2.0, -1.0]), np.array([1.0, 4.0, 0.5]), 9.0, TURNS[0], TURNS[3]
    text = f"""
title = "Thrown body"
[body.rod]
shape = "rigid"
mass = "2 kg"
centre = ["0.5 m", "0 m", "0 m"]
inertia = ["0.1 kg m^2", "0.2 kg m^2", "0.25 kg m^2"]
marker.middle = {{ at = ["0.5 m", "0 m", "0 m"], rotate = {vector(own)} }}
marker.tip = {{ at = ["1 m", "0 m", "0 m"] }}
[joint.flight]
type = "free"
parent = "ground"
child = "rod.middle"
position = {point(start)}
rotate = {vector(tilt)}
velocity = {[f"{x!r} m/s" for x in velocity.tolist()]}
spin = ["0 rad/s", "0 rad/s", "{rate} rad/s"]
"""
    motion = Pipeline(scene_of(tmp_path, text + SIMULATION.format("rod.tip"))).motion
    t, g = motion.times[:, None], np.array([1.0, -9.0, 3.0])
    spun = np.stack([np.cos(rate * t[:, 0]), np.sin(rate * t[:, 0]), 0.0 * t[:, 0]], axis=1)
    arm = 0.5 * spun @ (matrix(tilt) @ matrix(own).T).T
    assert motion.tip_position == pytest.approx(start + velocity * t + 0.5 * g * t**2 + arm, abs=1e-7)


def test_a_slide_that_closes_a_loop_holds_the_axes_of_both_markers(tmp_path: Path):
    """A free body on a closing slide falls along the slide's axis, in the axes that the markers give it."""
    place, on_child, of_joint = TURNS[:3]
    text = f"""
title = "Slide"
ground.rail = {{ at = ["1 m", "0 m", "0 m"], rotate = {vector(place)} }}
[body.rod]
shape = "rigid"
mass = "2 kg"
centre = ["0.5 m", "0 m", "0 m"]
inertia = ["0.1 kg m^2", "0.2 kg m^2", "0.25 kg m^2"]
marker.end = {{ at = ["0 m", "0 m", "0 m"], rotate = {vector(on_child)} }}
marker.tip = {{ at = ["1 m", "0 m", "0 m"] }}
[joint.flight]
type = "free"
parent = "ground"
child = "rod.end"
[joint.slide]
type = "prismatic"
parent = "ground.rail"
child = "rod.end"
axis = [1, 2, 2]
rotate = {vector(of_joint)}
"""
    motion = Pipeline(scene_of(tmp_path, text + SIMULATION.format("rod.tip"))).motion
    joint = matrix(place) @ matrix(of_joint)
    axis, rod = joint @ np.array([1.0, 2.0, 2.0]) / 3, (joint @ matrix(on_child).T)[:, 0]
    start = motion.tip_position[0]
    assert np.cross(start - rod - np.array([1.0, 0.0, 0.0]), axis) == pytest.approx(np.zeros(3), abs=1e-8)
    fallen = 0.5 * (np.array([1.0, -9.0, 3.0]) @ axis) * motion.times[:, None] ** 2 * axis
    assert motion.tip_position == pytest.approx(start + fallen, abs=1e-7)


@pytest.mark.parametrize(
    ("axes", "columns"),
    [
        ({"x": [3, 4, 0], "z": [0, 0, 2]}, [[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]]),
        ({"y": [0, 0, 1], "z": [1, 0, 0]}, [[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
        ({"x": [0, 1, 0], "y": [0, 0.0005, 5]}, [[0, 1, 0], [0, 0, 1], [1, 0, 0]]),  # y nearly across x
    ],
)
def test_two_directions_give_right_handed_axes(axes: Any, columns: Any):
    R = Orientation(axes=AxisDirections(**axes)).matrix
    assert pytest.approx(np.array(columns).T, abs=1e-15) == R
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("joint.hinge.axes={z=[0, 0, 1]}", "joint.hinge.axes.x: is missing: directions of two axes are wanted"),
        ("joint.hinge.axes={x=[1, 0, 0], y=[0, 1, 0], z=[0, 0, 1]}", "axes.z = [0, 0, 1]: is one too many"),
        ("joint.hinge.axes={x=[1, 0, 0], z=[1, 0, 1]}", "axes.z = [1, 0, 1]: must be perpendicular to the other axis"),
        ("joint.hinge.axes={x=[1, 0, 0], z=[0, 0, 0]}", "has no direction"),
        (
            "joint.hinge={type='revolute', parent='ground', child='bar.root', axis=[0, 0, 1], "
            "rotate=['1 deg', '0 deg', '0 deg'], axes={x=[1, 0, 0], z=[0, 0, 1]}}",
            "joint.hinge.axes = {'x': [1, 0, 0], 'z': [0, 0, 1]}: can't stand beside rotate",
        ),
        ("body.bar.marker.root.rotate=['1 m', '0 deg', '0 deg']", "marker.root.rotate.0 = '1 m': '1 m' is a length"),
        (
            "ground={p={at=['0 m', '0 m', '0 m'], rotate=['1 deg', '0 deg', '0 deg'], "
            "rotation=['1 deg', '0 deg', '0 deg']}}",
            "ground.p.rotation = ['1 deg', '0 deg', '0 deg']: can't stand beside rotate or axes",
        ),
    ],
)
def test_faults_of_axes_are_told(tmp_path: Path, override: str, message: str):
    with refused(message):
        scene_of(tmp_path, BEAM + SIMULATION.format("bar.tip"), override)


def test_a_planar_joint_takes_no_axes_of_the_childs_marker(tmp_path: Path):
    planar = 'joint.hinge={type="planar", parent="ground", child="bar.root", axis=[0, 0, 1]}'
    turn = "body.bar.marker.root.rotate=['0 deg', '0 deg', '9 deg']"
    text = BEAM.replace("[joint.hinge]", "[joint.hinge]") + SIMULATION.format("bar.tip")
    with refused("joint.hinge.child = 'bar.root': has axes of its own, which a planar joint can't take"):
        scene_of(tmp_path, text, planar, turn)


def test_the_older_name_of_a_places_turn_is_read():
    older, turn = '{{p={{at=["0 m","0 m","0 m"], {}=["0 deg","0 deg","30 deg"]}}}}', "ground={}"
    one, other = (
        load_scene("beam-paper", [turn.format(older.format(key))]).ground["p"] for key in ("rotation", "rotate")
    )
    assert one == other

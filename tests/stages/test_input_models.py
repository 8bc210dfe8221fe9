"""The ready scenes robot and hinged-rotor: what they draw on, against kinematics, statics and a closed form."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fmd import Pipeline, load_scene
from fmd.output.summary import summarise


@pytest.fixture(scope="module")
def robot() -> Pipeline:
    coarse = ["body.upper.mesh.divisions=[10, 2, 2]", "simulation.duration='0.5 s'", "simulation.stiffening='off'"]
    few = [f"body.forearm.modes.{setting}" for setting in ("boundary='joint'", "interface=[]", "count=2")]
    return Pipeline(load_scene("robot", [*coarse, *few]))


def test_the_robot_follows_its_file(robot: Pipeline):
    table = np.genfromtxt("models/robot-motion.csv", delimiter=",", names=True, skip_header=1)
    motion = robot.motion
    for name in ("q1", "q2", "q3"):
        at_rows = np.interp(table["t"] * 1e-3, motion.times, np.rad2deg(motion.joint_position(name)))
        assert at_rows[:51] == pytest.approx(table[name][:51], abs=1e-6)
    q1, q2, q3 = (Rotation.from_rotvec(np.outer(motion.joint_position(name), axis)) for name, axis in
                  (("q1", [0, 0, 1]), ("q2", [0, 1, 0]), ("q3", [0, 1, 0])))  # fmt: skip
    upper = q1 * q2
    rigid = np.array([0, 0, 0.5]) + upper.apply([0.4, 0, 0]) + (upper * q3).apply([0.35, 0, 0])
    away = np.linalg.norm(motion.tip_position - rigid, axis=1)
    assert 1e-5 < away.max() < 3e-3  # the links bend


def test_the_robot_starts_at_rest_under_its_weight(robot: Pipeline):
    """The bending stress at the shoulder is that of a beam under the moment of all that it carries."""
    motion, g = robot.motion, 9.81
    part = robot.parts["upper"]
    place, _, height = part.mesh.points[part.mesh.cells[part.elements["root"]]].mean(axis=0)
    masses = 2700 * 0.03 * np.array([(0.4 - place) * 0.02, 0.35 * 0.016])  # of the upper link what lies beyond
    q2, q3 = np.deg2rad([-60.0, 100.0])
    elbow, forearm = (0.4 - place) * np.cos(q2), np.cos(q2 + q3)
    arms = np.array([elbow / 2, elbow + 0.175 * forearm, elbow + 0.39 * forearm])
    weights = g * np.array([*masses, 1.0])
    bending = weights @ arms * height / (0.03 * 0.02**3 / 12)
    axial = weights.sum() * np.sin(q2) / (0.03 * 0.02)  # it stands up, so that the weight presses
    (stress,) = robot.element_stress("upper.root", "xx").values()
    assert stress[0] == pytest.approx(bending + axial, rel=0.03)
    assert np.ptp(motion.tip_deflection[:3], axis=0).max() < 1e-6  # at rest


def test_the_tool_points_along_the_forearm(robot: Pipeline):
    motion = robot.motion
    numbers = {link.name: k for k, link in enumerate(motion.mechanism.links)}
    tip, flange = (motion.kinematics.marker_position(numbers["tool"], name) for name in ("tip", "flange"))
    forearm = motion.kinematics.frames[numbers["forearm"]].rotation[:, :, 0]
    assert (tip - flange) / 0.12 == pytest.approx(forearm, abs=5e-3)  # but for the forearm's bending


def test_the_worst_stress_is_the_largest_of_all_bodies(robot: Pipeline):
    worst = summarise(robot, [], budget=False)["worst_stress"]
    each = {name: robot.stress_of(name).worst()[2] for name in ("upper", "forearm")}
    assert {name: worst[name]["value_pa"] for name in each} == each
    assert worst["von_mises_pa"] == max(each.values()) == each[worst["body"]]


def test_links_and_blades_share_what_they_can(robot: Pipeline):
    assert robot.parts["forearm"].key("mesh") != robot.parts["upper"].key("mesh")
    rotor = Pipeline(load_scene("hinged-rotor"))
    one, two = rotor.parts["blade-1"], rotor.parts["blade-2"]
    assert one.key("body") == two.key("body")
    assert one.body is two.body


def test_blades_flap_at_the_frequency_of_a_rigid_blade_on_an_offset_hinge():
    """ω = Ω √(1 + 3e/2L) for a uniform blade of length L with its hinge at e; bending lowers it little.

    Johnson, Helicopter Theory, 1980, section 5-2.
    """
    stiff = ["body.blade-1.E='2000 GPa'", "body.blade-1.mesh.divisions=[8, 1, 1]", "body.blade-1.modes.count=2"]
    short = ["simulation.duration='0.22 s'", "simulation.stiffening='off'", "body.blade-1.modes.enrich='none'"]
    scene = load_scene("hinged-rotor", [*stiff, *short, "simulation.gravity=['0 m/s^2', '0 m/s^2', '0 m/s^2']"])
    motion = Pipeline(scene).motion
    flap = motion.joint_position("flap-1")
    falls = np.flatnonzero((flap[:-1] > 0) & (flap[1:] <= 0))
    zeros = motion.times[falls] + 5e-4 * flap[falls] / (flap[falls] - flap[falls + 1])
    assert 2 * np.pi / np.diff(zeros) == pytest.approx(2 * np.pi * 10 * np.sqrt(1 + 3 * 0.08 / (2 * 0.8)), rel=3e-3)
    assert np.abs(motion.joint_position("flap-2")).max() < 1e-6  # nothing lifts the other
    numbers = {link.name: k for k, link in enumerate(motion.mechanism.links)}
    tip = motion.kinematics.marker_position(numbers["blade-2"], "tip")[0]
    assert tip == pytest.approx([-0.88, 0, 0], abs=1e-6)  # opposite the first

"""Scenes from MJCF files: accelerations, places and masses as MuJoCo 4.0.0 has them, and what is named or refused."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.cli.mjcf_robot import read_mjcf
from fmd.cli.robot_scenes import write_robot_scene
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.dynamics.kinematics import Kinematics

FILES = Path(__file__).with_name("mjcf")


def scene_of(name: str, folder: Path, *more: str) -> tuple[Pipeline, str]:
    file = folder / f"{name}.toml"
    text, notes = write_robot_scene(FILES / f"{name}.xml", file)
    file.write_text(text)
    return Pipeline(load_scene(file, more)), "\n".join(notes)


# qacc, xipos and site_xpos of MuJoCo at qpos = q (+ ref) and qvel = v, without limits, equalities, armature.
ARM = ([0.7, -0.4], [1.2, -0.8], [-6.730547696629943, 156.66007182751468])
GRIPPER = (
    [0.05, 0.6, 0.3, -0.2],
    [0.1, 1.0, -2.0, 0.5],
    [-10.31895548545184, -7.58225982569391, -6.631515441067194, 16.004275849320393],
)


@pytest.mark.parametrize(("name", "state", "rtol"), [("arm", ARM, 1e-7), ("gripper", GRIPPER, 2e-5)])
def test_a_robot_is_accelerated_as_in_mujoco(
    tmp_path: Path, name: str, state: tuple[list[float], list[float], list[float]], rtol: float
) -> None:
    run, _ = scene_of(name, tmp_path, *(["coupler={}"] if name == "gripper" else []))
    q, v, expected = map(np.array, state)
    np.testing.assert_allclose(run.system.accelerations(0.0, q, v), expected, rtol=rtol)


def marker_at(run: Pipeline, q: list[float], body: str, marker: str) -> Array:
    mechanism = run.mechanism
    motion = Kinematics(mechanism, np.zeros(1), np.array([q]), np.zeros((1, mechanism.n)))
    return motion.marker_position(mechanism.number_of(body), marker)[0]


def test_bodies_and_sites_are_where_mujoco_has_them(tmp_path: Path) -> None:
    run, notes = scene_of("arm", tmp_path)
    tool = marker_at(run, ARM[0], "fore", "tool")
    np.testing.assert_allclose(tool, [0.303538073723409, 0.23935463097610526, 0.7745736985883334], atol=1e-8)
    assert run.scene.body["upper"].mass == pytest.approx(2.7720491843478356)
    assert run.scene.body["fore"].mass == pytest.approx(1.2555061496217472)
    fore = run.scene.body["fore"]
    np.testing.assert_allclose(
        sorted(fore.inertia), sorted([0.006930017823643894, 0.006748752895761202, 0.0004697937380495847]), rtol=1e-7
    )
    elbow = run.scene.joint["elbow"]
    np.testing.assert_allclose(
        np.degrees([elbow.stop.low, elbow.stop.high, elbow.rest]), [-100.0, 90.0, 20.0], rtol=1e-9
    )
    for named in ("contact of others", "armature 0.01", "<actuator> isn't read: drive", "the file's ref, 10"):
        assert named in notes


def test_joints_of_one_body_an_included_file_and_an_equality_are_taken(tmp_path: Path) -> None:
    run, notes = scene_of("gripper", tmp_path)
    assert "palm-1 stands between two joints of palm" in notes
    gear = run.scene.coupler["right"]
    assert (gear.driver, gear.ratio, gear.offset) == ("left", -1.0, 0.1)
    assert run.scene.simulation.gravity[2] == -9.80665
    floating, _ = scene_of("float", tmp_path)
    M, (hull, tail) = floating.system.mass_matrix(floating.start[0]), (4188.790204786391e-3, 0.13571680263507907)
    assert M[0, 0] == pytest.approx(hull + tail)  # the tail by the included file's class
    across = tail * (0.02**2 / 4 + 0.06**2 / 3)
    assert M[6, 6] == pytest.approx(across + tail * 0.09**2)  # about the ball, 20 mm above the body's origin
    assert M[5, 5] == pytest.approx(0.4 * hull * 0.1**2 + tail * 0.02**2 / 2)


SETTINGS = """<mujoco>
  <compiler inertiagrouprange="0 1" settotalmass="-1"/>
  <option density="1.2" wind="0 0 0"><flag gravity="disable" limit="disable" contact="disable"/></option>
  <default class="robot"><joint damping="0.5"/><geom density="2000"/></default>
  <default><joint frictionloss="0.2"/><equality active="false"/></default>
  <include file="parts/body.xml"/>
  <equality><joint joint1="y" joint2="x"/></equality>
</mujoco>"""
INERTIAL = '<inertial pos="0 0 0" mass="7" diaginertia="1 1 1"/>'
PARTS = {
    "body": """<mujocoinclude><worldbody><body name="a" gravcomp="1"><joint name="x" range="-10 10"/>
      <geom size="0.1"/><geom size="0.3" group="3"/><include file="b.xml"/></body></worldbody></mujocoinclude>""",
    "b": """<any><body name="b" zaxis="0 0 -1"><joint name="y" class="robot" margin="0.1" springdamper="0 0"/>
      <geom type="box" fromto="0 0 0 0 0 0.4" size="0.1 0.3"/></body></any>""",
}


def test_settings_are_taken_or_named(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "a.xml").write_text(SETTINGS)
    for name, text in PARTS.items():
        (tmp_path / "parts" / f"{name}.xml").write_text(text)
    robot = read_mjcf(tmp_path / "a.xml")
    assert robot.gravity == (0.0, 0.0, 0.0)
    assert robot.links["a"].mass == pytest.approx(2000 * 4 / 3 * np.pi * 0.1**3)  # without the geom of group 3
    assert robot.links["b"].mass == pytest.approx(2000 * 0.2 * 0.2 * 0.4)  # as wide as its first size
    for joint in robot.joints.values():
        assert (joint.damping, joint.friction, joint.limits, joint.mimic) == (0.5, 0.2, {}, None)
    np.testing.assert_allclose(robot.joints["y"].pose.axes, np.diag([1.0, -1.0, -1.0]), atol=1e-15)
    assert sorted(robot.notes) == [
        "body gravcomp 1 isn't taken: a",
        "equality joint isn't taken: not active",
        "geoms of the world, and contact of others, aren't taken: as in docs/contact.md",
        "joint margin 0.1 isn't taken: y",
        "option density 1.2 isn't taken: the file",
    ]


@pytest.mark.parametrize(
    ("setting", "inertial", "mass"),
    [("true", INERTIAL, 0.1), ("auto", INERTIAL, 7.0), ("auto", "", 0.1), ("false", INERTIAL, 7.0), ("false", "", 0.0)],
)
def test_inertia_is_from_geoms_where_the_compiler_says_so(
    tmp_path: Path, setting: str, inertial: str, mass: float
) -> None:
    text = BODY.format(f'{inertial}<joint/><geom size="0.1" mass="0.1"/>')
    file = tmp_path / "a.xml"
    file.write_text(text.replace("<worldbody>", f'<compiler inertiafromgeom="{setting}"/><worldbody>'))
    assert read_mjcf(file).links["a"].mass == mass


BODY = '<mujoco><worldbody><body name="a">{}</body></worldbody></mujoco>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot/>", "is no MJCF"),
        ("<mujoco/>", "has no body"),
        (BODY.format('<joint/><geom type="mesh" mesh="m"/>'), "the mesh m, which isn't there"),
        (BODY.format('<joint/><geom type="hfield" size="1"/>'), "has its inertia from a hfield"),
        (BODY.format('<joint type="screw"/><geom size="1"/>'), "screw"),
        (
            BODY.format('<joint axis="0 0 0"/><geom size="1"/>'),
            "body a: can't be read: the axis of a-joint has a vector",
        ),
        (BODY.format('<joint springdamper="0.1 1"/><geom size="1"/>'), "joint springdamper '0.1 1' isn't read"),
        (
            BODY.format('<joint damping="nan"/><geom size="1"/>'),
            "body a: can't be read: damping 'nan' is not one finite",
        ),
        (BODY.format('<joint/><geom size="1" mass="-1"/>'), "mass '-1' is below 0"),
        (BODY.format('<joint/><inertial pos="0 0 0" mass="nan" diaginertia="1 1 1"/>'), "mass 'nan' is not one finite"),
        (BODY.format('<joint/><geom type="cylinder" fromto="0 0 0 1 0 0"/>'), "body a: can't be read: a cylinder of 2"),
        (BODY.format('<joint/><geom type="box" size="1"/>'), "a box of 3 sizes above 0 has 1"),
        (BODY.format('<joint/><geom size="1" axisangle="0 0 0 1"/>'), "axisangle has a vector of no length"),
        ('<mujoco><include file="a.xml"/></mujoco>', "include = 'a.xml': is included twice, or in itself"),
        ('<mujoco><compiler boundmass="0.1"/></mujoco>', "boundmass '0.1' isn't read; save the model compiled"),
        (BODY.format('<joint class="b"/><geom size="1"/>'), "'b'"),
        (BODY.format('<joint/><geom size="1"/><replicate/>'), "<replicate> isn't read"),
        ('<mujoco><compiler coordinate="global"/></mujoco>', "save the model compiled"),
    ],
)
def test_what_is_no_robot_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(InputError) as fault:
        write_robot_scene(tmp_path / "a.xml", tmp_path / "a.toml")
    assert said in str(fault.value)


def test_of_a_polynomial_spring_or_damper_the_linear_part_is_taken_and_the_rest_named(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(
        BODY.format(
            '<joint name="j" stiffness="8 0 2" damping="0.3 0.1"/><joint name="k" axis="1 0 0" stiffness="8 0 0"/>'
            '<geom size="1"/>'
        )
    )
    robot = read_mjcf(tmp_path / "a.xml")
    assert (robot.joints["j"].spring, robot.joints["j"].damping) == (8.0, 0.3)
    assert robot.joints["k"].spring == 8.0
    assert [note.partition(":")[0] for note in robot.notes if "polynomial" in note] == [
        "stiffness of joint j is a polynomial, 8 0 2",
        "damping of joint j is a polynomial, 0.3 0.1",
    ]


def test_the_command_writes_it(tmp_path: Path, fmd, capsys) -> None:
    assert fmd("new", tmp_path / "arm.toml", "--from", FILES / "arm.xml") == 0
    assert "not in the scene: <actuator> isn't read: drive" in capsys.readouterr().out
    assert fmd("new", tmp_path / "bent.toml", "--from", FILES / "arm.xml", "--flexible", "upper") == 0
    assert 'shape = "bar"' in (tmp_path / "bent.toml").read_text()

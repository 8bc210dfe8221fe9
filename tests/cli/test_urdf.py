"""Scenes from URDF files: mass matrix and weight against the file's own numbers, put together by hand."""

import re
import tomllib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from fmd import Pipeline, load_scene
from fmd.cli.robot_scenes import _make_names, write_robot_scene
from fmd.core.arrays import Array
from fmd.dynamics.kinematics import Kinematics
from fmd.stages.visual_files import read_shape

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base_link"><inertial><mass value="4"/><inertia ixx="1" iyy="1.2" izz="1.1" ixy="0.3"/></inertial></link>
  <link name="upper">
    <inertial>
      <origin xyz="0.2 0.01 0.03" rpy="0.3 -0.2 0.5"/><mass value="2.5"/>
      <inertia ixx="0.01" iyy="0.05" izz="0.055" ixy="0.002" ixz="-0.001" iyz="0.003"/>
    </inertial>
    <visual><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.04 0.06"/></geometry></visual>
    <collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.04 0.06"/></geometry></collision>
  </link>
  <link name="fore.arm">
    <inertial><origin xyz="0.1 0 0.05"/><mass value="1.2"/><inertia ixx="0.002" iyy="0.01" izz="0.009"/></inertial>
    <visual><geometry><cylinder radius="0.02" length="0.3"/></geometry></visual>
    <visual><geometry><mesh filename="package://arm/meshes/fore.dae"/></geometry></visual>
  </link>
  <link name="tool0"/>
  <joint name="shoulder" type="revolute">
    <parent link="base_link"/><child link="upper"/>
    <origin xyz="0.1 -0.2 0.5" rpy="0.2 0.4 -0.3"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/><dynamics damping="0.7" friction="0.1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="upper"/><child link="fore.arm"/>
    <origin xyz="0.4 0 0.02" rpy="-0.5 0.1 0.9"/><axis xyz="1 0 0"/>
    <limit lower="-0.2" upper="0.3" effort="80" velocity="1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="fore.arm"/><child link="tool0"/><origin xyz="0.25 0.01 0" rpy="0 1.2 0"/>
  </joint>
  <transmission name="t"/>
</robot>
"""


def turn(*rpy: float) -> Array:
    r, p, y = rpy
    Rx, Ry, Rz = (
        Rotation.from_rotvec(angle * axis).as_matrix() for angle, axis in zip((r, p, y), np.eye(3), strict=True)
    )
    return Rz @ Ry @ Rx


def places(q: Array) -> tuple[list[tuple[Array, Array]], Array]:
    """Return centre of mass and axes of both links, and the tool's place, by the file's numbers."""
    axis = np.array([0.0, 0.6, 0.8])
    at, R = np.array([0.1, -0.2, 0.5]), turn(0.2, 0.4, -0.3) @ Rotation.from_rotvec(q[0] * axis).as_matrix()
    upper = at + R @ [0.2, 0.01, 0.03], R @ turn(0.3, -0.2, 0.5)
    Rf = R @ turn(-0.5, 0.1, 0.9)
    origin = at + R @ [0.4, 0.0, 0.02] + Rf @ [q[1], 0.0, 0.0]
    return [upper, (origin + Rf @ [0.1, 0.0, 0.05], Rf)], origin + Rf @ [0.25, 0.01, 0.0]


def tool_of(run: Pipeline) -> Array:
    """Return where the tool is at the start."""
    (q, v), mechanism = run.start, run.mechanism
    motion = Kinematics(mechanism, np.zeros(1), q[None], v[None])
    return motion.marker_position(mechanism.number_of("fore-arm"), "tool0")[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, fmd) -> Path:
    folder = tmp_path_factory.mktemp("robot")
    (folder / "arm.urdf").write_text(ARM)
    assert fmd("new", folder / "robot.toml", "--from", folder / "arm.urdf") == 0
    assert '\n# start = "equilibrium"\n' in (folder / "robot.toml").read_text()
    return folder


def test_a_robot_has_the_mass_matrix_and_the_weight_of_its_file(folder: Path) -> None:
    """Jacobians of the links by differences, at random positions."""
    run = Pipeline(
        load_scene(folder / "robot.toml", ["joint.shoulder.damper=0 N m s/rad", "joint.shoulder.friction=0 N m"])
    )
    I_upper = np.array([[0.01, 0.002, -0.001], [0.002, 0.05, 0.003], [-0.001, 0.003, 0.055]])
    inertias, masses = (I_upper, np.diag([0.002, 0.01, 0.009])), (2.5, 1.2)
    for q in np.random.default_rng(3).uniform([-1.5, -0.15], [1.5, 0.2], (4, 2)):
        M, weight = np.zeros((2, 2)), np.zeros(2)
        for k, (m, inertia) in enumerate(zip(masses, inertias, strict=True)):
            R, J, W = places(q)[0][k][1], np.zeros((3, 2)), np.zeros((3, 2))
            for j in range(2):
                (x1, R1), (x0, R0) = (places(q + side * 1e-6 * np.eye(2)[j])[0][k] for side in (1, -1))
                J[:, j] = (x1 - x0) / 2e-6
                spin = (R1 - R0) / 2e-6 @ R.T
                W[:, j] = [spin[2, 1], spin[0, 2], spin[1, 0]]
            M += m * J.T @ J + W.T @ R @ inertia @ R.T @ W
            weight += m * J.T @ [0.0, 0.0, -9.81]
        np.testing.assert_allclose(run.system.mass_matrix(q), M, atol=1e-8)
        np.testing.assert_allclose(M @ run.system.accelerations(0.0, q, np.zeros(2)), weight, atol=1e-6)


def test_a_tool_without_mass_is_a_marker_and_what_is_left_out_is_named(folder: Path, fmd, capsys) -> None:
    scene = load_scene(folder / "robot.toml", ["joint.shoulder.angle=0.4 rad", "joint.slide.position=0.1 m"])
    assert scene.simulation.tip == "fore-arm.tool0"
    np.testing.assert_allclose(tool_of(Pipeline(scene)), places(np.array([0.4, 0.1]))[1], atol=1e-9)
    assert (scene.joint["shoulder"].stop.low, scene.joint["slide"].stop.high) == (-2.0, 0.3)
    assert (scene.joint["shoulder"].damper, scene.joint["shoulder"].friction) == (0.7, 0.1)
    assert fmd("new", folder / "again.toml", "--from", folder / "arm.urdf") == 0
    said = capsys.readouterr().out
    for named in ("<transmission>", "fore.dae", "effort 50, velocity 3 of shoulder", "mass of 4 kg has no effect"):
        assert named in said


def test_frames_on_the_ground_and_a_base_without_mass_change_nothing(folder: Path) -> None:
    base = re.search(r'<link name="base_link">.*</link>', ARM)
    assert base is not None
    chain = ["base_link", *(f"pin-{k}" for k in range(4))]  # longer than the arm, whose end stays the tip
    pins = "".join(
        f'<link name="{pin}"/><joint name="at-{pin}" type="fixed"><parent link="{on}"/><child link="{pin}"/></joint>'
        for on, pin in pairwise(chain)
    )
    stand = '<link name="world"/><joint name="s" type="fixed"><parent link="world"/><child link="base_link"/></joint>'
    (folder / "pins.urdf").write_text(ARM.replace(base[0], f'<link name="base_link"/>{stand}{pins}'))
    text, _ = write_robot_scene(folder / "pins.urdf", folder / "pins.toml")
    scenes = load_scene(tomllib.loads(text)), load_scene(folder / "robot.toml")
    assert [scene.simulation.tip for scene in scenes] == ["fore-arm.tool0"] * 2
    q = np.array([0.3, -0.1])
    bare, based = (Pipeline(scene).system.accelerations(0.0, q, q) for scene in scenes)
    assert bare == pytest.approx(based, rel=1e-12)


def test_a_link_becomes_a_flexible_bar_of_its_box(folder: Path, fmd) -> None:
    assert fmd("new", folder / "bent.toml", "--from", folder / "arm.urdf", "--flexible", "upper") == 0
    run = Pipeline(load_scene(folder / "bent.toml", ["body.upper.mesh.divisions=[4,1,1]"]))
    assert run.wholes["upper"].mass == pytest.approx(2.5)
    # The bar's ends are where the box has them; the slide's place, 20 mm beside the end's middle, went there.
    moved = turn(0.2, 0.4, -0.3) @ [0.0, 0.0, 0.02]
    np.testing.assert_allclose(tool_of(run), places(np.zeros(2))[1] - moved, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "arguments", "said"),
    [
        ("<robot><link", [], "is no XML"),
        ("<mujoco/>", [], "is no URDF"),
        (ARM.replace('child link="tool0"', 'child link="tool"'), [], "is no link of the file"),
        (ARM.replace('type="prismatic"', 'type="screw"'), [], "is none of revolute"),
        (ARM.replace('value="2.5"', 'value="heavy"'), [], "link upper: can't be read"),
        (ARM.replace('joint name="slide"', 'joint name="shoulder"'), [], "two are called 'shoulder'"),
        (ARM.replace('parent link="base_link"', 'parent link="tool0"'), [], "doesn't carry: fore.arm, tool0, upper"),
        ('<robot name="ur" xmlns:xacro="http://wiki.ros.org/xacro"/>', [], "a file for xacro has none"),
        (ARM.replace('child link="fore.arm"', 'child link="upper"'), [], "carried by none: base_link, fore.arm; twice"),
        ('<robot><link name="cup"/></robot>', [], "it is no robot"),
        (ARM, ["--flexible", "elbow"], "is no moving link"),
        (ARM, ["--flexible", "fore.arm"], "has no box to make a flexible bar of (its shapes: cylinder, mesh)"),
    ],
)
def test_what_is_no_robot_is_refused(tmp_path: Path, fmd, capsys, text: str, arguments: list[str], said: str) -> None:
    (tmp_path / "arm.urdf").write_text(text)
    assert fmd("new", tmp_path / "robot.toml", "--from", tmp_path / "arm.urdf", *arguments) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "robot.toml").exists()


GRIPPER = """<robot name="gripper">
  <link name="palm"/>
  <link name="wheel"><inertial><mass value="0.3"/><inertia ixx="2e-4" iyy="2e-4" izz="4e-4"/></inertial></link>
  <link name="2"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial>
    <visual><geometry><mesh filename="jaw.dae"/></geometry></visual>
    <collision><geometry><mesh filename="package://hand/jaw.obj"/></geometry></collision></link>
  <link name="3"><inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial>
    <visual><geometry><sphere radius="0"/></geometry></visual></link>
  <link name="1"/>
  <joint name="turn" type="continuous"><parent link="palm"/><child link="wheel"/><axis xyz="0 0 1"/></joint>
  <joint name="1" type="prismatic"><parent link="palm"/><child link="2"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1"/><mimic joint="turn" multiplier="0.02" offset="0.001"/></joint>
  <joint name="2" type="prismatic"><parent link="palm"/><child link="3"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1"/><mimic joint="1" multiplier="-1"/></joint>
  <joint name="3" type="fixed"><parent link="3"/><child link="1"/><mimic joint="1"/></joint>
</robot>"""


def test_jaws_follow_a_wheel_and_each_other_and_are_drawn_by_what_there_is(tmp_path: Path, fmd, capsys) -> None:
    (tmp_path / "hand.urdf").write_text(GRIPPER)
    (tmp_path / "jaw.dae").write_text("<COLLADA/>")
    (tmp_path / "jaw.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1/1/1 2//1 3 4\nf -4 -3 -1\n")
    assert fmd("new", tmp_path / "hand.toml", "--from", tmp_path / "hand.urdf") == 0
    said = capsys.readouterr().out
    for named in ("whose files aren't .stl, .obj", "jaw.dae", "collision geometry: 2", "of no size: sphere of 3"):
        assert named in said
    run = Pipeline(load_scene(tmp_path / "hand.toml"))
    rack, slides = run.scene.coupler["joint-1"], run.scene.coupler["joint-2"]
    assert (rack.type, rack.radius, rack.offset) == ("rack", 0.02, 0.001)
    assert (slides.type, slides.driver, slides.ratio) == ("slides", "joint-1", -1.0)
    points, triangles = read_shape(run.scene, "link-2", "visual.0", run.store.cache)
    np.testing.assert_array_equal(points, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    np.testing.assert_array_equal(triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 3]])


def jaw(name: str, side: int, more: str = "") -> str:
    """Return a jaw of 15 g on a slide along the axis about which the arm falls, closed at 0."""
    return f"""<link name="{name}"><inertial><mass value="0.015"/><inertia ixx="2e-6" iyy="2e-6" izz="8e-7"/></inertial>
    </link><joint name="{name}" type="prismatic"><parent link="arm"/><child link="{name}"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 {side} 0"/><limit lower="0" upper="0.04" effort="100" velocity="0.2"/>{more}</joint>"""


FALLING = f"""<robot name="falling"><link name="base"/>
  <link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="3"/><inertia ixx="1e-3" iyy="0.04" izz="0.04"/>
    </inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="0.8" effort="80" velocity="3"/></joint>
  {jaw("left", 1)}{jaw("right", -1, '<mimic joint="left"/>')}</robot>"""


def test_a_robot_with_closed_jaws_falls_on_a_stop_by_the_scene_as_it_is_written(tmp_path: Path, fmd) -> None:
    """The jaws' round-off was compared with itself, and `auto` ended after millions of steps."""
    (tmp_path / "falling.urdf").write_text(FALLING)
    assert fmd("new", tmp_path / "falling.toml", "--from", tmp_path / "falling.urdf") == 0
    motion = Pipeline(load_scene(tmp_path / "falling.toml", ["output=[]"])).motion
    inertia, moment, k, width = 0.04 + 3 * 0.2**2 + 0.03 * 0.4**2 + 4e-6, 9.81 * (3 * 0.2 + 0.03 * 0.4), 8000.0, 0.01

    def slope(t: float, y: Array) -> list[float]:
        beyond = max(y[0] - 0.8, 0.0)
        push = k * (beyond**2 / (2 * width) if beyond < width else beyond - width / 2)
        return [y[1], (moment * np.cos(y[0]) - push) / inertia]

    exact = solve_ivp(slope, (0, 1), [0.0, 0.0], "DOP853", motion.times, rtol=1e-10, atol=1e-12)
    assert exact.y[0].max() > 0.8
    np.testing.assert_allclose(motion.joint_position("shoulder"), exact.y[0], atol=2e-3)
    np.testing.assert_allclose(motion.joint_position("left"), 0.0, atol=1e-15)
    assert motion.trajectory.evaluations < 30_000


def test_names_that_become_alike_stay_different() -> None:
    names = _make_names(["root", "a-3", "a", "a."], "link")
    assert len(set(names.values())) == 4
    assert (names["root"], names["a-3"], names["a"]) == ("root", "a-3", "a")


FRAMES = """<robot name="frames"><link name="base"/>
  <link name="arm"><inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/></joint>"""


def frame(link: str, joint: str, x: float) -> str:
    """Return a link without mass, fixed to the arm at x."""
    fixed = (
        f'<joint name="{joint}" type="fixed"><parent link="arm"/><child link="{link}"/><origin xyz="{x} 0 0"/></joint>'
    )
    return f'<link name="{link}"/>{fixed}'


def test_a_frame_never_takes_the_name_of_another_marker(tmp_path: Path, fmd) -> None:
    """Beside joints of their names, `tool` and `tool.frame` would both be `tool-frame`, over one that is called so."""
    own = [("tool", "tool"), ("tool-frame", "a"), ("tool.frame", "b"), ("origin", "c"), ("origin-frame", "d")]
    frames = "".join(frame(link, joint, k) for k, (link, joint) in enumerate(own, start=1))
    (tmp_path / "frames.urdf").write_text(f"{FRAMES}{frames}</robot>")
    assert fmd("new", tmp_path / "frames.toml", "--from", tmp_path / "frames.urdf") == 0
    markers = load_scene(tmp_path / "frames.toml").body["arm"].marker
    assert sorted(marker.at[0] for marker in markers.values()) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert markers["origin"].at[0] == 0.0


def test_moments_that_no_body_has_are_raised_to_the_least_possible(tmp_path: Path, fmd, capsys) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.replace('ixx="0.002" iyy="0.01" izz="0.009"', 'ixx="2" iyy="5" izz="10"'))
    assert fmd("new", tmp_path / "arm.toml", "--from", tmp_path / "arm.urdf") == 0
    assert "fore.arm: no body has moments of inertia of 2, 5, 10 kg m²" in capsys.readouterr().out
    # Of a plate in the plane of x and y, by its squares 6.5 and 3.5 of x and y: 10 is their sum.
    assert load_scene(tmp_path / "arm.toml").body["fore-arm"].inertia == pytest.approx((3.5, 6.5, 10.0))


def test_a_base_that_floats_falls_with_all_that_it_carries(tmp_path: Path, fmd: Callable[..., int]) -> None:
    """A torque between links turns them, and the centre of all masses falls by ``g t²/2``."""
    joint = '<joint name="float" type="floating"><parent link="world"/><child link="base_link"/></joint>'
    (tmp_path / "arm.urdf").write_text(
        ARM.replace('<link name="tool0"/>', f'<link name="tool0"/><link name="world"/>{joint}')
    )
    assert fmd("new", tmp_path / "arm.toml", "--from", tmp_path / "arm.urdf") == 0
    push = 'drive={push={type="torque", joint="shoulder", torque="5 N m"}}'
    run = Pipeline(load_scene(tmp_path / "arm.toml", [push, "simulation.duration=0.1 s", "output=[]"]))
    assert run.system.mass_matrix(run.start[0])[0, 0] == pytest.approx(4 + 2.5 + 1.2)
    fallen = run.motion.centre_of_mass - run.motion.centre_of_mass[0]
    assert run.motion.joint_position("shoulder")[-1] > 0.05
    assert fallen[-1] == pytest.approx([0, 0, -9.81 * 0.1**2 / 2], abs=1e-6)

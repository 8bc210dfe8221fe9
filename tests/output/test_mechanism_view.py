"""What pictures of a mechanism show: every body where the motion has it, joints where bodies meet, the ground."""

import struct
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import InputError
from fmd.integrators.protocol import Trajectory
from fmd.output.joint_marks import GROUND, JOINT, LOAD
from fmd.output.mechanism_view import shape_surfaces, view_mechanism
from fmd.output.picture_files import picture_key
from fmd.output.pictures import draw_mechanism
from fmd.recovery.motion import Motion
from fmd.stages.mechanism import place_joints

# Without stiffening markers move as linearly in the modal coordinates as the mesh that is drawn.
ARM = ["body.forearm.mesh.divisions=[8, 1, 1]", "simulation.duration=60 ms", "simulation.stiffening='off'"]
FRAMES = np.array([0, 15, 30])
POINTS = 'start = ["1 m", "0 m", "0 m"], end = ["1 m", "0 m", "0 m"]'
PLATE = """
title = "A plate on a cardan"
[body.plate]
shape = "rigid"
mass = "2 kg"
inertia = ["0.01 kg m^2", "0.02 kg m^2", "0.03 kg m^2"]
marker = { pin = { at = ["10 mm", "20 mm", "0 mm"] } }
VISUAL
[joint.pin]
type = "revolute"
parent = "ground"
child = "plate.pin"
axis = [0, 0, 1]
rate = "1 rad/s"
[simulation]
duration = "0.2 s"
output_step = "0.1 s"
tip = "plate.pin"
[[simulation.run]]
integrator = "runge-kutta"
"""


class Posed(Pipeline):
    """A run whose coordinates go evenly from those of the start by given differences, with nothing to integrate."""

    differences: float | np.ndarray = 0.0

    @cached_property
    def motions(self) -> dict[str, Motion]:
        times, (q0, v0) = self.output_times, place_joints(self.scene, self.mechanism)
        q = q0 + np.linspace(0, 1, len(times))[:, None] * (self.differences * np.ones(len(q0)))
        end: Any = None
        v = np.tile(v0, (len(times), 1))
        return {"posed": Motion(self.mechanism, Trajectory("", 1.0, 1, times, q, v, 0, 0, 0.0, end), "")}


@pytest.fixture(scope="module")
def arm() -> Pipeline:
    run = Posed(load_scene("arm", ARM))
    run.differences = 0.002 * np.random.default_rng(7).normal(size=run.mechanism.n_positions)
    return run


def plate(folder: Path, visual: str) -> Pipeline:
    path = folder / "plate.toml"
    path.write_text(PLATE.replace("VISUAL", f"visual = {visual}" if visual else ""))
    run = Posed(load_scene(path))
    run.differences = 0.2  # 1 rad/s
    return run


def test_rigid_bodies_are_where_their_markers_move(arm):
    view, kinematics = view_mechanism(arm, FRAMES), arm.motion.kinematics
    upper = view.shapes[0]
    ends = [
        kinematics.marker_position(arm.mechanism.number_of("upper"), name)[FRAMES] for name in ("shoulder", "elbow")
    ]
    for k in range(len(FRAMES)):
        points = upper.points(k)
        axis = (ends[1][k] - ends[0][k]) / 0.5
        along = (points - ends[0][k]) @ axis
        assert (along.min(), along.max()) == pytest.approx((0.0, 0.5), abs=1e-12)
        away = points - ends[0][k] - along[:, None] * axis
        assert np.linalg.norm(away, axis=1).max() < 0.05 * 0.5


def test_flexible_bodies_meet_their_joints_and_carry_the_stress_of_the_history(arm):
    (forearm,) = view_mechanism(arm, FRAMES).bodies
    kinematics = arm.motion.kinematics
    x = forearm.surface.points
    for name, end in (("elbow", x[:, 0].min()), ("wrist", x[:, 0].max())):
        place = kinematics.marker_position(arm.mechanism.number_of("forearm"), name)[FRAMES]
        face = np.flatnonzero(np.isclose(x[:, 0], end))
        corners = np.isclose(np.abs(x[face, 1:] - x[face, 1:].mean(axis=0)), (0.006, 0.02)).all(axis=1)
        assert (len(face), corners.sum()) == (8, 4)
        mean = np.where(corners, -1 / 12, 1 / 3)  # integrals of the shape functions over an eight-node face
        for k in range(len(FRAMES)):
            assert mean @ forearm.points(k)[face] == pytest.approx(place[k], abs=1e-8)
    assert forearm.stress == pytest.approx(arm.stress_of("forearm").measure_at(FRAMES))


def test_marks_of_joints_follow_the_bodies_and_the_ground_stays(arm):
    view, kinematics = view_mechanism(arm, FRAMES), arm.motion.kinematics
    pins = [shape for shape in view.shapes if shape.colour == JOINT]
    assert all(np.argmax(np.ptp(pin.points(0), axis=0)) == 2 for pin in pins)  # along the hinges' axis z
    names = {"shoulder": "upper.shoulder", "elbow": "forearm.elbow", "wrist": "gripper.wrist"}
    assert len(pins) == len(names)
    for pin, place in zip(pins, names.values(), strict=True):
        body, _, marker = place.partition(".")
        where = kinematics.marker_position(arm.mechanism.number_of(body), marker)[FRAMES]
        for k in range(len(FRAMES)):
            assert pin.points(k).mean(axis=0) == pytest.approx(where[k], abs=1e-12)
    (ground,) = [shape for shape in view.shapes if shape.colour == GROUND]
    assert (ground.points(0) == ground.points(2)).all()
    assert ground.points(0)[:, 1].max() > 0.01  # the arm hangs from it
    assert view.up == pytest.approx((0, 1, 0))


def test_one_body_alone_has_nothing_around_it(arm):
    view = view_mechanism(arm, FRAMES, coloured="forearm", alone=True)
    assert (len(view.bodies), view.shapes, view.lines) == (1, (), ())


def test_every_kind_of_joint_spring_and_bushing_is_drawn():
    for name, lines in (("suspension", 1), ("slider-crank", 1)):
        run = Posed(load_scene(name, ["simulation.duration=20 ms", "simulation.output_step=10 ms"]))
        view = view_mechanism(run, np.arange(2))
        held = [joint for joint in run.scene.joint.values() if joint.type not in ("free", "fixed")]
        assert len([shape for shape in view.shapes if shape.colour == JOINT]) == len(held)
        assert len(view.lines) == lines
        assert np.isfinite(view.around()).all()


def test_arrows_of_loads_end_where_these_act_and_turn_with_what_they_follow(tmp_path):
    path = tmp_path / "pushed.toml"
    on = 'marker = "plate.pin", direction = [3, 0, 0]'
    push = f'push = {{ type = "point force", {on}, force = "2 N" }}'
    twist = f'twist = {{ type = "point torque", {on}, torque = "2 N m", following = true }}'
    path.write_text(PLATE.replace("VISUAL", "") + f"[drive]\n{push}\n{twist}\n")
    run = Posed(load_scene(path))
    run.differences = 0.2
    assert not [shape for shape in view_mechanism(run, np.arange(3)).shapes if shape.colour == LOAD]
    pushed, twisted = [shape for shape in view_mechanism(run, np.arange(3), loads=True).shapes if shape.colour == LOAD]
    assert (pushed.name, twisted.name) == ("drive.push, point force", "drive.twist, point torque")
    assert len(twisted.surface.points) == len(pushed.surface.points) + 5  # a head more
    for k, t in enumerate((0.0, 0.1, 0.2)):  # the pin stays in the origin, and turns about z
        for arrow, along in ((pushed, np.array([1, 0, 0])), (twisted, np.array([np.cos(t), np.sin(t), 0]))):
            points = arrow.points(k)
            assert (points @ along).max() == pytest.approx(0.0, abs=1e-12)
            middle = points[np.argmin(points @ along)] @ along
            assert points.mean(axis=0) == pytest.approx((points.mean(axis=0) @ along) * along, abs=1e-3 * abs(middle))


def test_gravity_is_an_arrow_beside_the_mechanism_of_a_view_with_loads(tmp_path):
    path = tmp_path / "heavy.toml"
    path.write_text(
        PLATE.replace("VISUAL", "").replace(
            "[simulation]", '[simulation]\ngravity = ["0 m/s^2", "-3 m/s^2", "4 m/s^2"]'
        )
    )
    run = Posed(load_scene(path))
    view = view_mechanism(run, np.arange(3), loads=True)
    (arrow,) = [shape for shape in view.shapes if shape.colour == LOAD]
    assert arrow.name == "gravity, 5 m/s²"
    down, points = np.array([0.0, -0.6, 0.8]), arrow.points(0)
    tail, head = points[np.argmin(points @ down)], points[np.argmax(points @ down)]
    assert (head - tail) @ down == pytest.approx(np.ptp(points @ down))
    assert np.cross(points.mean(axis=0) - head, down) == pytest.approx(0.0, abs=1e-3 * np.ptp(points @ down))
    others = np.concatenate([shape.points(0) for shape in view.shapes if shape is not arrow])
    apart = np.linalg.norm(points[:, None] - others, axis=2)
    assert apart.min() > 0.1 * np.ptp(points @ down)  # it touches nothing
    assert not [s for s in view_mechanism(run, np.arange(3)).shapes if s.colour == LOAD]


def test_a_spring_leads_from_one_place_to_the_other():
    run = Posed(load_scene("suspension", ["simulation.duration=20 ms"]))
    run.differences = np.linspace(0.0, 0.01, run.mechanism.n_positions)
    (coil,) = view_mechanism(run, np.arange(5)).lines
    assert coil.points[:, 0] == pytest.approx(np.tile((0.0, 0.2, 0.42), (5, 1)))
    seat = run.motion.kinematics.marker_position(run.mechanism.number_of("lower"), "seat")[:5]
    assert coil.points[:, -1] == pytest.approx(seat)


def test_a_box_has_the_moments_of_inertia_of_its_body(tmp_path):
    ((surface, _),) = shape_surfaces(plate(tmp_path, ""), "plate", 1e-3)
    a, b, c = np.ptp(surface.points[:8], axis=0)
    assert 2 / 12 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2]) == pytest.approx(
        (0.01, 0.02, 0.03), rel=1e-2, abs=1e-5
    )


def test_a_given_shape_moves_with_its_body(tmp_path):
    run = plate(
        tmp_path, '{ type = "box", size = ["1 m", "1 m", "1 m"], at = ["1 m", "0 m", "0 m"], colour = "#112233" }'
    )
    (box,) = [shape for shape in view_mechanism(run, np.arange(3)).shapes if shape.colour == "#112233"]
    for k, t in enumerate((0.0, 0.1, 0.2)):  # the pin, at (10, 20) mm in the body, stays in the origin
        c, s = np.cos(t), np.sin(t)
        expected = (c * 0.99 + s * 0.02, s * 0.99 - c * 0.02, 0.0)
        assert box.points(k).mean(axis=0) == pytest.approx(expected, abs=1e-12)


def test_a_shape_from_an_stl_file_is_drawn_and_part_of_the_pictures_identity(tmp_path):
    corners = [(0, 0, 0), (1000, 0, 0), (0, 1000, 0), (0, 0, 1000)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    binary = b" " * 80 + struct.pack("<I", 4)
    text = "solid t\n"
    for face in faces:
        binary += struct.pack("<12fH", 0, 0, 0, *(x for k in face for x in corners[k]), 0)
        lines = "".join(f"   vertex {corners[k][0]} {corners[k][1]}e0 {corners[k][2]}\n" for k in face)
        text += f" facet normal 0 0 0\n  outer loop\n{lines}  endloop\n endfacet\n"
    keys = []
    for name, content in (("a.stl", binary), ("b.stl", (text + "endsolid t\n").encode())):
        (tmp_path / name).write_bytes(content)
        run = plate(tmp_path, f'{{ type = "file", file = "{name}", at = ["1 m", "0 m", "0 m"] }}')
        ((surface, _),) = shape_surfaces(run, "plate", 1.0)
        a, b, c = (surface.points[surface.triangles[:, k]] for k in range(3))
        assert np.einsum("ti,ti->", a, np.cross(b, c)) / 6 == pytest.approx(1 / 6)
        assert surface.points.min(axis=0) == pytest.approx((1, 0, 0))
        film = load_scene("stewart").output[-1]
        keys.append(picture_key(run, film))
        motion = Pipeline.growths.key(run)
    assert keys[0] != keys[1]
    assert Pipeline.growths.key(plate(tmp_path, "")) == motion  # the look has no effect on what is computed


@pytest.mark.parametrize(
    ("visual", "said"),
    [
        ('{ type = "file", file = "none.stl" }', "none.stl.*can't be read"),
        ('{ type = "file", file = "bad.stl" }', "is no STL file, or is cut off"),
        ('{ type = "file", file = "bad.step" }', "Gmsh"),
        ('{ type = "file", file = "bad.obj" }', "holds no faces"),
        ('{ type = "file", file = "bad.dae" }', r"must end in \.stl"),
        ('{ type = "box", size = ["1 m", "1 m"] }', "visual"),
        ('{ type = "ball" }', "visual"),
        ('{ type = "rod", radius = "1 mm", colour = "red" }', "colour"),
        ('{ type = "rod", radius = "1 mm" }', "needs two markers at different places"),
        (f'{{ type = "cylinder", {POINTS}, radius = "1 mm" }}', "is the start: a cylinder needs a length"),
    ],
)
def test_a_shape_that_there_is_not_is_refused(tmp_path, visual, said):
    for name in ("bad.stl", "bad.step", "bad.obj"):
        (tmp_path / name).write_text("nothing")
    with pytest.raises(InputError, match=f"(?s){said}"):
        shape_surfaces(plate(tmp_path, visual), "plate", 1.0)


def test_a_picture_after_the_end_is_refused(arm, tmp_path):
    (output,) = load_scene("arm", [*ARM, 'output=[{type="mechanism", file="late.png", time="1 s"}]']).output
    with pytest.raises(InputError, match=r"time = 1\.0: is after the end of the motion at 0\.06 s"):
        draw_mechanism(arm, output, tmp_path)


def test_the_pin_of_a_turned_joint_lies_along_its_axis(tmp_path):
    path = tmp_path / "tilted.toml"
    tilted = '[ground.side]\nat = ["1 m", "0 m", "0 m"]\nrotation = ["90 deg", "0 deg", "0 deg"]\n[joint.pin]'
    text = PLATE.replace("VISUAL", "").replace("[joint.pin]", tilted)
    path.write_text(text.replace('parent = "ground"', 'parent = "ground.side"'))
    view = view_mechanism(Posed(load_scene(path)), np.arange(3))
    (pin,) = [shape for shape in view.shapes if shape.colour == JOINT]
    for k in range(3):  # z of the place is -y in space
        assert np.argmax(np.ptp(pin.points(k), axis=0)) == 1
        assert pin.points(k).mean(axis=0) == pytest.approx((1, 0, 0))

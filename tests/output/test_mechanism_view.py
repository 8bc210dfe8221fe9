"""What pictures of a mechanism show: every body where the motion has it, joints where bodies meet, the ground."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from pipeline import Pipeline, load_scene
from pipeline.core.cache import Cache
from pipeline.core.errors import InputError
from pipeline.output.joint_marks import GROUND, JOINT
from pipeline.output.mechanism_view import view_mechanism
from pipeline.output.picture_files import picture_key
from pipeline.output.pictures import DRAWINGS
from pipeline.output.rigid_shapes import shape_surfaces

ARM = ["body.forearm.mesh.divisions=[8, 1, 1]", "simulation.duration=60 ms"]
ARM += ["simulation.run=[{integrator='central-difference'}]"]
FRAMES = np.array([0, 15, 30])
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


@pytest.fixture(scope="module")
def arm() -> Pipeline:
    return Pipeline(load_scene("arm", ARM), Cache(None))


def plate(folder: Path, visual: str) -> Pipeline:
    path = folder / "plate.toml"
    path.write_text(PLATE.replace("VISUAL", f"visual = {visual}" if visual else ""))
    return Pipeline(load_scene(path), Cache(None))


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
    for name, end in (("elbow", -1), ("wrist", 1)):
        place = kinematics.marker_position(arm.mechanism.number_of("forearm"), name)[FRAMES]
        x = forearm.surface.points[:, 0]
        face = np.isclose(x, x.min() if end < 0 else x.max())
        for k in range(len(FRAMES)):  # the mean of a regular face's corners and edges is its middle
            assert forearm.points(k)[face].mean(axis=0) == pytest.approx(place[k], abs=2e-5)
    assert forearm.stress == pytest.approx(arm.stress_of("forearm").measure_at(FRAMES))


def test_marks_of_joints_follow_the_bodies_and_the_ground_stays(arm):
    view, kinematics = view_mechanism(arm, FRAMES), arm.motion.kinematics
    pins = [shape for shape in view.shapes if shape.colour == JOINT]
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
    short = ["simulation.duration=20 ms", "simulation.output_step=10 ms", "simulation.run=[{integrator='runge-kutta'}]"]
    for name, lines in (("suspension", 1), ("slider-crank", 1)):
        run = Pipeline(load_scene(name, short), Cache(None))
        view = view_mechanism(run, np.arange(2))
        held = [joint for joint in run.scene.joint.values() if joint.type not in ("free", "fixed")]
        assert len([shape for shape in view.shapes if shape.colour == JOINT]) == len(held)
        assert len(view.lines) == lines
        assert np.isfinite(view.around()).all()


def test_a_spring_leads_from_one_place_to_the_other():
    short = ["simulation.duration=20 ms", "simulation.run=[{integrator='runge-kutta'}]"]
    run = Pipeline(load_scene("suspension", short), Cache(None))
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
        motion = run._key("motion")
    assert keys[0] != keys[1]
    assert plate(tmp_path, "")._key("motion") == motion  # the look has no effect on what is computed


@pytest.mark.parametrize(
    ("visual", "said"),
    [
        ('{ type = "file", file = "none.stl" }', "none.stl.*can't be read"),
        ('{ type = "file", file = "bad.stl" }', "is no STL file, or is cut off"),
        ('{ type = "file", file = "bad.step" }', "Gmsh"),
        ('{ type = "file", file = "bad.obj" }', r"must end in \.stl"),
        ('{ type = "box", size = ["1 m", "1 m"] }', "visual"),
        ('{ type = "ball" }', "visual"),
        ('{ type = "rod", radius = "1 mm", colour = "red" }', "colour"),
    ],
)
def test_a_shape_that_there_is_not_is_refused(tmp_path, visual, said):
    for name in ("bad.stl", "bad.step"):
        (tmp_path / name).write_text("nothing")
    with pytest.raises(InputError, match=f"(?s){said}"):
        shape_surfaces(plate(tmp_path, visual), "plate", 1.0)


def test_a_picture_after_the_end_is_refused(arm, tmp_path):
    (output,) = load_scene("arm", [*ARM, 'output=[{type="mechanism", file="late.png", time="1 s"}]']).output
    with pytest.raises(InputError, match=r"time = 1\.0: is after the end of the motion at 0\.06 s"):
        DRAWINGS["mechanism"].draw(arm, output, tmp_path)

"""The joint that carries a flexible body, as a scene describes it."""

import numpy as np
import pytest

from fmd import load_scene
from fmd.stages.parent_joint import read_parent_joint


def joint(*overrides: str, scene: str = "beam", body: str = "beam"):
    return read_parent_joint(load_scene(scene, overrides), body)


def test_a_driven_hinge_on_the_ground_lets_the_body_turn_about_one_coordinate_axis():
    hub = joint()
    assert (hub.marker, hub.axis, hub.free) == ("root", (0.0, 0.0, 1.0), ((0.0, 0.0, 1.0),))
    assert (hub.normal, hub.in_plane, hub.floating, hub.prescribed) == (2, True, False, False)
    assert hub.plane == pytest.approx([0.0, 0.0, 1.0])


def test_directions_in_which_the_body_turns_freely_are_unit_vectors():
    oblique = joint("joint.hub.axis=[0, 3, 4]")
    assert oblique.free_directions == pytest.approx(np.array([[0.0, 0.6, 0.8]]))
    assert oblique.normal == -1  # about no coordinate axis


@pytest.mark.parametrize(
    ("override", "differs"),
    [
        (
            'joint.hub={type="prismatic", parent="ground", child="beam.root", axis=[1, 0, 0]}',
            {"free": (), "normal": -1},
        ),
        (
            'joint.hub={type="spherical", parent="ground", child="beam.root"}',
            {"free": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "normal": -1, "in_plane": False},
        ),
        (
            'joint.hub={type="free", parent="ground", child="beam.root"}',
            {"floating": True, "free": (), "normal": -1, "in_plane": False},
        ),
    ],
)
def test_other_joints_change_what_depends_on_them(override, differs):
    one, other = joint("drive={}"), joint("drive={}", override)
    names = ("free", "floating", "prescribed", "in_plane", "normal")
    assert {name: getattr(other, name) for name in names if getattr(one, name) != getattr(other, name)} == differs


def test_a_prescribed_hinge_leaves_no_direction_free():
    hub = joint(scene="spin-up")
    assert hub.prescribed
    assert hub.free == ()


def test_loads_out_of_the_plane_of_motion_are_marked():
    push = 'drive.push={type="point force", marker="beam.tip", direction=[0, 1, 0], force="1 N"}'
    lift = 'drive.lift={type="point force", marker="beam.tip", direction=[0, 0, 1], force="1 N"}'
    twist = 'drive.twist={type="point torque", marker="beam.tip", direction=[1, 0, 0], torque="1 N m"}'
    assert joint().loaded == ()
    assert joint(push).loaded == (("tip", True),)
    assert joint(push, lift).loaded == (("tip", False),)
    assert joint(twist).loaded == (("tip", False),)


def test_gravity_and_loads_out_of_the_plane_of_the_hinges_make_a_motion_in_space():
    """A static response in the plane alone would leave out how such loads pass through a body to those it carries."""
    push = 'drive.push={type="point force", marker="beam.tip", direction=[1, 1, 0], force="1 N"}'
    lift = 'drive.lift={type="point force", marker="beam.tip", direction=[0, 0, 1], force="1 N"}'
    weight = "simulation.gravity=['0 m/s^2', '0 m/s^2', '-9.81 m/s^2']"
    assert joint(push).in_plane
    assert not joint(lift).in_plane
    assert not joint(weight).in_plane


def test_a_scene_of_parts_alone_has_a_floating_body():
    part = read_parent_joint(load_scene("beam-paper").model_copy(update={"joint": {}}), "beam")
    assert part.marker == ""
    assert part.floating

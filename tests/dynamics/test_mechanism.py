"""What a mechanism refuses: links out of order, names that don't fit, joints that can't be fast."""

import re

import numpy as np
import pytest

from fmd.dynamics.force_laws import ForceLaw
from fmd.dynamics.links import Link, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.scene.joints.fixed import FIXED
from fmd.scene.joints.free import FREE
from fmd.scene.joints.prismatic import PRISMATIC
from fmd.scene.joints.revolute import REVOLUTE
from fmd.scene.joints.spherical import SPHERICAL
from fmd.scene.joints.universal import UNIVERSAL

POINT = rigid_integrals(1.0, np.zeros(3), np.eye(3))


@pytest.mark.parametrize("parent", [-2, 1, 2])
def test_a_link_comes_after_its_parent(parent: int) -> None:
    links = [Link("first", POINT, FREE), Link("second", POINT, REVOLUTE, parent)]
    with pytest.raises(ValueError, match=re.escape("link second comes before its parent")):
        Mechanism(links)


def test_a_link_does_not_carry_itself() -> None:
    with pytest.raises(ValueError, match=re.escape("link first comes before its parent")):
        Mechanism([Link("first", POINT, FREE, parent=0)])


@pytest.mark.parametrize("joint", [FIXED, SPHERICAL, FREE])
def test_only_a_joint_of_one_coordinate_can_be_fast(joint: int) -> None:
    message = "the joint of ball can't be fast: it has no one coordinate"
    with pytest.raises(ValueError, match=re.escape(message)):
        Mechanism([Link("ball", POINT, joint)], fast_joints=["ball"])


@pytest.mark.parametrize("joint", [REVOLUTE, PRISMATIC])
def test_a_joint_of_one_coordinate_can_be_fast(joint: int) -> None:
    assert Mechanism([Link("ball", POINT, joint)], fast_joints=["ball"]).n_slow == 0


@pytest.mark.parametrize(
    ("links", "fast", "said"),
    [
        ([], [], "one link at least"),
        (["a", "a"], [], "names of their own"),
        (["a"], ["b"], "no link is named b"),
    ],
)
def test_names_that_do_not_fit_are_refused(links: list[str], fast: list[str], said: str) -> None:
    integrals = rigid_integrals(1.0, np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match=said):
        Mechanism([Link(name, integrals, REVOLUTE) for name in links], fast)


def test_an_axis_without_direction_is_refused() -> None:
    integrals = rigid_integrals(1.0, np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match="the axis of a has no direction"):
        Mechanism([Link("a", integrals, REVOLUTE, axis=np.zeros(3))])


def test_axes_of_a_place_that_are_no_rotation_are_refused() -> None:
    integrals = rigid_integrals(1.0, np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match="the axes of the place that carries a are not orthonormal"):
        Mechanism([Link("a", integrals, REVOLUTE, place_axes=2.0 * np.eye(3))])


def test_force_laws_that_are_not_one_for_each_rate_are_refused() -> None:
    integrals = rigid_integrals(1.0, np.zeros(3), np.eye(3))
    with pytest.raises(ValueError, match="the joint of a has 2 rates and 1 force laws"):
        Mechanism([Link("a", integrals, UNIVERSAL, laws=(ForceLaw(),))])

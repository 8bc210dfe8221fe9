"""Joints of any kind in a scene file; the key ``type`` says which kind a table is."""

from collections.abc import Callable, Mapping
from typing import Annotated, get_args

from fmd.core.joint_kinds import JointKind
from fmd.scene.joints.constant_velocity import ConstantVelocity
from fmd.scene.joints.cylindrical import Cylindrical
from fmd.scene.joints.distance import Distance
from fmd.scene.joints.fixed import Fixed
from fmd.scene.joints.free import Free
from fmd.scene.joints.joint import JointTable
from fmd.scene.joints.planar import Planar
from fmd.scene.joints.point_on_line import PointOnLine
from fmd.scene.joints.prismatic import Prismatic
from fmd.scene.joints.revolute import Revolute
from fmd.scene.joints.screw import Screw
from fmd.scene.joints.spherical import Spherical
from fmd.scene.joints.universal import Universal
from fmd.scene.kinds import KindBy

Joint = Annotated[
    Revolute
    | Prismatic
    | Fixed
    | Spherical
    | Free
    | Universal
    | ConstantVelocity
    | Cylindrical
    | Planar
    | Screw
    | Distance
    | PointOnLine,
    KindBy("type"),
]

JOINTS: tuple[type[JointTable], ...] = get_args(get_args(Joint)[0])
"""Every kind of joint, in the order of the page about scenes."""


def kinds_that(fit: Callable[[JointKind], bool]) -> tuple[str, ...]:
    """Return the names of the kinds of joints that fit."""
    return tuple(joint.kind.name for joint in JOINTS if joint.carries and fit(joint.kind))


def closing_joints(joints: Mapping[str, Joint]) -> tuple[str, ...]:
    """Return the names of the joints that close loops: of two that hold a body, the first carries it."""
    carried, closing = set[str](), list[str]()
    for name, joint in joints.items():
        child = joint.child.partition(".")[0]
        if child == "ground" or child in carried or not joint.carries:
            closing.append(name)
        else:
            carried.add(child)
    return tuple(closing)

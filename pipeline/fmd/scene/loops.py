"""Joints that close loops: they carry no body, or one that hangs on another joint already."""

from __future__ import annotations

from collections.abc import Mapping

from fmd.scene.joints import Joint

OF_COORDINATES = (
    *("angle", "angles", "position", "rate", "rates", "spin", "velocity"),
    *("spring", "springs", "rest", "rests", "damper", "dampers", "stop", "friction"),
    *("turning_spring", "rest_angle", "turning_damper"),
)

"""Keys of a joint that speak of its coordinates, of which a joint that closes a loop has none."""


def closing_joints(joints: Mapping[str, Joint]) -> tuple[str, ...]:
    """Return the names of the joints that close loops: of two that hold a body, the first carries it."""
    carried, closing = set[str](), list[str]()
    for name, joint in joints.items():
        child = joint.child.partition(".")[0]
        if child == "ground" or child in carried or joint.type in ("distance", "point-on-line"):
            closing.append(name)
        else:
            carried.add(child)
    return tuple(closing)

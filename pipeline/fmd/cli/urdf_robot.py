"""A robot from a URDF file: links with inertia and shapes, joints, and what of it a scene can't hold.

The file's conventions are those of its specification (wiki.ros.org/urdf/XML): SI units, a link's frame in the joint
that carries it, rotations by roll, pitch and yaw about fixed axes, moments of inertia about the centre of mass.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from fmd.cli.robot import Pose, Robot, RobotJoint, RobotLink, Shape, naming, read_number, read_numbers, read_robot_xml
from fmd.core.errors import InputError

Part = TypeVar("Part", RobotLink, RobotJoint)
KNOWN = {"robot", "link", "joint", "material"}


def read_urdf(path: Path) -> Robot:
    """Read a URDF file.

    Raises
    ------
    InputError
        It can't be read, is no URDF, or its joints are no tree of its links.
    """
    top = read_robot_xml(path, "robot", "URDF")
    links, joints = _read_each(path, top, "link", _read_link), _read_each(path, top, "joint", _read_joint)
    if not links:
        raise InputError(str(path), "link", None, "is missing: a file for xacro has none until that has run")
    carried = [joint.child for joint in joints.values()]
    for joint in joints.values():
        for end in (joint.parent, joint.child):
            if end not in links:
                raise InputError(str(path), f"joint {joint.name}", end, "is no link of the file")
    roots = [name for name in links if name not in carried]
    if len(roots) != 1 or len(set(carried)) != len(carried):
        twice = sorted({name for name in carried if carried.count(name) > 1})
        found = f"carried by none: {', '.join(roots) or 'no link'}" + (f"; twice: {', '.join(twice)}" if twice else "")
        raise InputError(str(path), "joint", None, f"a robot's joints carry every link but one, once each; {found}")
    reached = {roots[0]}
    while further := {joint.child for joint in joints.values() if joint.parent in reached} - reached:
        reached |= further
    if lost := sorted(set(links) - reached):
        raise InputError(
            str(path), "joint", None, f"joints in a loop, which {roots[0]} doesn't carry: {', '.join(lost)}"
        )
    others = tuple(f"<{tag}> isn't read" for tag in sorted({child.tag for child in top} - KNOWN))
    return Robot(top.get("name", path.stem), links, joints, roots[0], others)


def _read_each(
    path: Path, top: ElementTree.Element, tag: str, read: Callable[[ElementTree.Element], Part]
) -> dict[str, Part]:
    parts: dict[str, Part] = {}
    for element in top.findall(tag):
        name = element.get("name", "")
        with naming(path, f"{tag} {name}"):
            if name in parts:
                raise ValueError(f"two are called {name!r}")
            parts[name] = read(element)
    return parts


def _read_pose(element: ElementTree.Element) -> Pose:
    origin = element.find("origin")
    if origin is None:
        return Pose()
    rpy = read_numbers(origin.get("rpy"), "0 0 0")
    return Pose(read_numbers(origin.get("xyz"), "0 0 0"), Rotation.from_euler("xyz", rpy).as_matrix())


def _read_link(element: ElementTree.Element) -> RobotLink:
    mass, centre, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    given = element.find("inertial")
    if given is not None:
        pose, at = _read_pose(given), given.find("inertia")
        weight = given.find("mass")
        mass = 0.0 if weight is None else read_number(weight.attrib, "value", least=0.0)
        moments = (
            {key: read_number(at.attrib, key, "0") for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
            if at is not None
            else {}
        )
        if moments:
            own = np.diag([moments["ixx"], moments["iyy"], moments["izz"]])
            own[0, 1] = own[1, 0] = moments["ixy"]
            own[0, 2] = own[2, 0] = moments["ixz"]
            own[1, 2] = own[2, 1] = moments["iyz"]
            inertia = pose.axes @ own @ pose.axes.T
        centre = pose.at
    visuals, collisions = (tuple(map(_read_shape, element.findall(what))) for what in ("visual", "collision"))
    return RobotLink(element.attrib["name"], mass, centre, inertia, visuals, collisions)


def _read_shape(element: ElementTree.Element) -> Shape:
    geometry = element.find("geometry")
    given = None if geometry is None else next(iter(geometry), None)
    if given is None:
        raise ValueError("a shape without geometry")
    pose = _read_pose(element)
    if given.tag == "box":
        return Shape("box", pose, tuple(read_numbers(given.get("size"), "1 1 1")))
    if given.tag == "cylinder":
        return Shape("cylinder", pose, (read_number(given.attrib, "radius"), read_number(given.attrib, "length")))
    if given.tag == "sphere":
        return Shape("sphere", pose, (read_number(given.attrib, "radius"),))
    scale = tuple(read_numbers(given.get("scale"), "1 1 1"))
    return Shape(given.tag, pose, file=given.get("filename", ""), scale=scale)


def _read_end(joint: ElementTree.Element, end: str) -> str:
    found = joint.find(end)
    if found is None:
        raise ValueError(f"joint {joint.get('name')} has no {end}")
    return found.attrib["link"]


def _read_joint(element: ElementTree.Element) -> RobotJoint:
    parent, child = (_read_end(element, end) for end in ("parent", "child"))
    axis, limit = element.find("axis"), element.find("limit")
    found, mimic = element.find("dynamics"), element.find("mimic")
    dynamics = {} if found is None else found.attrib
    follows = None
    if mimic is not None:
        follows = (
            mimic.attrib["joint"],
            read_number(mimic.attrib, "multiplier", "1"),
            read_number(mimic.attrib, "offset", "0"),
        )
    return RobotJoint(
        element.attrib["name"],
        element.attrib["type"],
        parent,
        child,
        pose=_read_pose(element),
        axis=read_numbers(None if axis is None else axis.get("xyz"), "1 0 0"),
        limits={} if limit is None else {key: read_number(limit.attrib, key) for key in limit.attrib},
        damping=read_number(dynamics, "damping", "0", least=0.0),
        friction=read_number(dynamics, "friction", "0", least=0.0),
        mimic=follows,
    )

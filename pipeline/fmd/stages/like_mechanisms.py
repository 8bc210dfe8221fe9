"""Mechanisms of scenes that differ from others in springs, rests and dampers of joints alone: built once for all."""

from collections.abc import Mapping
from dataclasses import replace

from fmd.core.data_classes import with_values
from fmd.core.joint_kinds import JOINT_CONSTANTS
from fmd.dynamics.compiler.digest import share_digest
from fmd.dynamics.mechanism import Mechanism
from fmd.reduction.body import FlexibleBody
from fmd.scene.scene import Scene
from fmd.scene.variants import without_joint_numbers
from fmd.stages.mechanism import build_mechanism

Built = tuple["Scene", Mapping[str, FlexibleBody], Mechanism]
"""A scene without numbers of joints, its reduced bodies, and its mechanism."""


def build_like(built: list[Built], scene: Scene, bodies: Mapping[str, FlexibleBody], lifted: bool = False) -> Mechanism:
    """Return the mechanism of a scene as `build_mechanism` does; raises as that does.

    That of a scene with the same bodies, and all else the same but numbers of joints, is taken with these changed. Of
    the scene that was built last, and of those like it, ``built`` keeps one for each choice of bodies.
    """
    bare = without_joint_numbers(scene)
    for other, theirs, mechanism in () if scene.closing else built:
        same = theirs.keys() == bodies.keys() and all(theirs[name] is body for name, body in bodies.items())
        if same and other == bare and mechanism.lifted is lifted:
            return with_joint_numbers(mechanism, scene)
    if built and built[0][0] != bare:
        built.clear()
    mechanism = replace(build_mechanism(scene, bodies), lifted=lifted)
    built.append((bare, bodies, mechanism))
    return mechanism


def with_joint_numbers(mechanism: Mechanism, scene: Scene) -> Mechanism:
    """Return a mechanism with the springs, rests and dampers that the joints of a scene have.

    Where none of these begins or ceases to be 0 the equations are the same, and so is their digest.
    """
    links, alike = list(mechanism.links), True
    for number, link in enumerate(links):
        if link.joint_name in scene.joint and link.unit:
            (along,) = scene.joint[link.joint_name].along
            pairs = [(getattr(link, key), getattr(along, key)) for key in JOINT_CONSTANTS]
            alike = alike and all(bool(before) == bool(now) for before, now in pairs)
            if any(before != now for before, now in pairs):
                links[number] = with_values(link, spring=along.spring, rest=along.rest, damper=along.damper)
    found = with_values(mechanism, links=links)  # what is checked of a mechanism stays as it is
    found.share_structure(mechanism)
    if alike:
        share_digest(found, mechanism)
    if "rigid" in vars(mechanism):
        vars(found)["rigid"] = with_joint_numbers(mechanism.rigid, scene)
    return found

"""From the scene's rigid bodies and joints to an open chain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.checks import Array
from pipeline.dynamics.tree import FIXED, FREE, PRISMATIC, REVOLUTE, SPHERICAL, Link, Tree, rigid_gram
from pipeline.reduction.gram import InertiaGram

if TYPE_CHECKING:
    from pipeline.scene import Scene

_JOINTS = {"fixed": FIXED, "revolute": REVOLUTE, "prismatic": PRISMATIC, "spherical": SPHERICAL, "free": FREE}


@dataclass(frozen=True)
class Chain:
    """A chain as a scene describes it.

    Attributes
    ----------
    tree : Tree
        The mechanism.
    q0, v0 : ndarray, shapes (n_positions,) and (n,)
        Positions and rates at the start.
    tip : tuple of str and ndarray, shape (3,)
        Body and place on it, in its frame [m], whose motion is reported.
    joints : dict of str to str
        The body that each revolute or prismatic joint carries.
    units : dict of str to str
        Unit of each such joint's position: ``rad`` or ``m``.
    """

    tree: Tree
    q0: Array
    v0: Array
    tip: tuple[str, Array]
    joints: dict[str, str]
    units: dict[str, str]


def chain_of(scene: Scene) -> Chain:
    """Build the chain of a scene of rigid bodies; each body's frame sits at the marker of the joint that carries it."""
    carried = {joint.child.partition(".")[0]: name for name, joint in scene.joint.items()}
    inboard = {body: _marker(scene, scene.joint[name].child) for body, name in carried.items()}
    order: list[str] = []

    def place_after_parent(body: str) -> None:
        parent = scene.joint[carried[body]].parent.partition(".")[0]
        if parent != "ground" and parent not in order:
            place_after_parent(parent)
        if body not in order:
            order.append(body)

    for body in carried:
        place_after_parent(body)
    links = [_link(scene, body, carried[body], order, inboard) for body in order]
    fast = [scene.joint[name].child.partition(".")[0] for name in scene.simulation.fast]
    tree = Tree(links, fast)
    q0, v0 = tree.rest_positions, np.zeros(tree.n)
    joints, units = {}, {}
    rates, positions = tree.layout[:2]
    for k, body in enumerate(order):
        joint = scene.joint[carried[body]]
        if joint.type in ("revolute", "prismatic"):
            joints[carried[body]] = body
            units[carried[body]] = "rad" if joint.type == "revolute" else "m"
            q0[positions[k]] = joint.angle if joint.type == "revolute" else joint.position
            v0[rates[k]] = joint.rate
    tip = scene.simulation.tip.partition(".")[0]
    return Chain(tree, q0, v0, (tip, _marker(scene, scene.simulation.tip) - inboard[tip]), joints, units)


def _marker(scene: Scene, place: str) -> Array:
    body, _, name = place.partition(".")
    marker: Any = scene.body[body].marker[name]
    return np.array(marker.at, dtype=float)


def _link(scene: Scene, body: str, name: str, order: list[str], inboard: dict[str, Array]) -> Link:
    joint = scene.joint[name]
    parent = joint.parent.partition(".")[0]
    settings: dict[str, Any] = {}
    if joint.type in ("revolute", "prismatic"):
        settings = {"spring": joint.spring, "rest": joint.rest, "damper": joint.damper, "load": _load(scene, name)}
        settings["axis"] = np.array(joint.axis, dtype=float)
    if parent != "ground":
        settings |= {"parent": order.index(parent), "place": _marker(scene, joint.parent) - inboard[parent]}
    return Link(body, _gram(scene.body[body], inboard[body]), _JOINTS[joint.type], **settings)


def _gram(part: Any, origin: Array) -> InertiaGram:
    """Inertia of a rigid body about a place in its frame."""
    match part.shape:
        case "rod":
            across = part.mass * part.length**2 / 12
            centre, inertia = np.array([part.length / 2, 0.0, 0.0]), np.diag([0.0, across, across])
        case "point":
            centre, inertia = np.zeros(3), np.zeros((3, 3))
        case _:
            centre, inertia = np.array(part.centre), np.diag(part.inertia)
    return rigid_gram(part.mass, centre - origin, inertia)


def _load(scene: Scene, joint: str) -> float:
    """Constant torque or force on a joint."""
    total = 0.0
    for drive in scene.drive.values():
        if drive.joint == joint and drive.type in ("torque", "force"):
            total += drive.torque if drive.type == "torque" else drive.force
    return total

"""From the scene's bodies, joints and drives to a mechanism that can be integrated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.core.arrays import Array
from pipeline.core.formula import parse_formula
from pipeline.dynamics.links import FIXED, FREE, PRISMATIC, REVOLUTE, SPHERICAL, Link, PointLoad, rigid_gram
from pipeline.dynamics.mechanism import Mechanism
from pipeline.dynamics.rotor.rotor import PlanarRotor, TorquePulse
from pipeline.dynamics.signals.signal import (
    Signal,
    constant,
    formula,
    half_sine,
    linear_table,
    smooth_table,
    total,
)
from pipeline.reduction.body import FlexibleBody, MarkerShapes
from pipeline.reduction.inertia import InertiaGram

if TYPE_CHECKING:
    from pipeline.scene.scene import Scene
    from pipeline.scene.time_functions import TimeFunction

_JOINTS = {"fixed": FIXED, "revolute": REVOLUTE, "prismatic": PRISMATIC, "spherical": SPHERICAL, "free": FREE}


@dataclass(frozen=True)
class Chain:
    """A chain as a scene describes it.

    Attributes
    ----------
    tree : Mechanism
        The mechanism.
    q0, v0 : ndarray, shapes (n_positions,) and (n,)
        Positions and rates at the start.
    tip : tuple of str and MarkerShapes
        The body whose motion is reported, and where on it.
    joints : dict of str to str
        The body that each revolute or prismatic joint carries.
    units : dict of str to str
        Unit of each such joint's position: ``rad`` or ``m``.
    """

    tree: Mechanism
    q0: Array
    v0: Array
    tip: tuple[str, MarkerShapes]
    joints: dict[str, str]
    units: dict[str, str]


def is_rotor(scene: Scene) -> bool:
    """Whether a scene is one flexible body on a hinge that at most a torque pulse drives: the kernels of `planar`."""
    (body, *others), (joint, *_) = scene.body, scene.joint.values()
    drives = list(scene.drive.values())
    plain = len(drives) <= 1 and all(drive.type == "torque pulse" for drive in drives)
    plain = plain and scene.simulation.start == "undeformed"
    hinge = joint.type == "revolute" and not (joint.spring or joint.damper)
    undamped = body in scene.flexible and not scene.flexible[body].modes.damping
    split = any(getattr(run, "split", "joints") != "joints" for run in scene.simulation.run)
    return not others and plain and hinge and undamped and not split and not any(scene.simulation.gravity)


def rotor_of(scene: Scene, body: FlexibleBody) -> PlanarRotor:
    """Build the mechanism of a scene for which `is_rotor` holds."""
    pulse = TorquePulse(0.0, 1.0, 0.0)
    for drive in scene.drive.values():
        assert drive.type == "torque pulse"  # is_rotor
        pulse = TorquePulse(drive.start, drive.duration, _peak(drive, body.inertia_about_joint))
    return PlanarRotor(body, pulse)


def chain_of(
    scene: Scene,
    bodies: Mapping[str, FlexibleBody],
    fast_joints: Sequence[str] | None = None,
    slow_modes: Mapping[str, int] | None = None,
) -> Chain:
    """Build the chain of a scene; each body's frame sits at the marker of the joint that carries it.

    Parameters
    ----------
    bodies : mapping of str to FlexibleBody
        The scene's flexible bodies, reduced.
    fast_joints, slow_modes
        As in `Mechanism`; by default the joints that the scene lists as fast, and no mode slow.
    """
    places = _Places(scene, bodies)
    order = places.order
    links = [_link(scene, places, body) for body in order]
    if fast_joints is None:
        fast_joints = [scene.joint[name].child.partition(".")[0] for name in scene.simulation.fast]
    loads = _point_loads(scene, places)
    tree = Mechanism(links, fast_joints, np.array(scene.simulation.gravity), loads, slow_modes or {})
    q0, v0 = tree.rest_positions, np.zeros(tree.n)
    joints, units = {}, {}
    for k, body in enumerate(order):
        joint = scene.joint[places.carried[body]]
        if joint.type in ("revolute", "prismatic"):
            joints[places.carried[body]] = body
            units[places.carried[body]] = "rad" if joint.type == "revolute" else "m"
            if links[k].n_rates:
                q0[tree.layout.position[k]] = joint.angle if joint.type == "revolute" else joint.position
                v0[tree.layout.rate[k]] = joint.rate
        elif joint.type in ("spherical", "free"):
            rates = [*getattr(joint, "velocity", ()), *joint.spin]
            v0[tree.layout.rate[k] : tree.layout.rate[k] + len(rates)] = rates
    if scene.simulation.start == "steady":
        q0 = tree.steady(q0, v0)
    tip = scene.simulation.tip
    return Chain(tree, q0, v0, (tip.partition(".")[0], places.marker(tip)), joints, units)


class _Places:
    """Where the scene's markers are in the frames of their bodies."""

    def __init__(self, scene: Scene, bodies: Mapping[str, FlexibleBody]) -> None:
        self.scene, self.bodies = scene, bodies
        self.carried = {joint.child.partition(".")[0]: name for name, joint in scene.joint.items()}
        self.order: list[str] = []
        for body in self.carried:
            self._after_parent(body)

    def parent(self, body: str) -> str:
        return self.scene.joint[self.carried[body]].parent.partition(".")[0]

    def _after_parent(self, body: str) -> None:
        parent = self.parent(body)
        if parent != "ground" and parent not in self.order:
            self._after_parent(parent)
        if body not in self.order:
            self.order.append(body)

    def marker(self, place: str) -> MarkerShapes:
        body, _, name = place.partition(".")
        if body in self.bodies:
            return self.bodies[body].markers[name]
        inboard = self.scene.joint[self.carried[body]].child.partition(".")[2]
        markers: Any = self.scene.body[body].marker
        nothing = np.zeros((3, 0))
        return MarkerShapes(np.subtract(markers[name].at, markers[inboard].at), nothing, nothing)

    def inboard(self, body: str) -> Array:
        markers: Any = self.scene.body[body].marker
        return np.array(markers[self.scene.joint[self.carried[body]].child.partition(".")[2]].at)


def _link(scene: Scene, places: _Places, body: str) -> Link:
    name = places.carried[body]
    joint = scene.joint[name]
    settings: dict[str, Any] = {}
    if body in places.bodies:
        reduced, damping = places.bodies[body], scene.flexible[body].modes.damping
        gram = reduced.gram
        settings = {"omega": reduced.omega, "damping": np.full(len(reduced.omega), damping)}
    else:
        gram = _gram(scene.body[body], places.inboard(body))
    if joint.type in ("revolute", "prismatic"):
        settings |= {"spring": joint.spring, "rest": joint.rest, "damper": joint.damper}
        settings |= {"axis": np.array(joint.axis, dtype=float), "motion": _motion(scene, name)}
        settings["load"] = _load(scene, name, gram, np.array(joint.axis, dtype=float))
        if joint.type == "revolute" and body in places.bodies and settings["motion"] is None:
            settings["joint_rotation"] = places.bodies[body].joint_rotation
    parent = places.parent(body)
    if parent != "ground":
        at = places.marker(joint.parent)
        settings |= {"parent": places.order.index(parent), "place": at.position}
        settings |= {"place_shapes": at.translation, "place_rotations": at.rotation}
    return Link(body, gram, _JOINTS[joint.type], **settings)


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


def _load(scene: Scene, joint: str, gram: InertiaGram, axis: Array) -> Signal:
    """Torque or force on a joint; a pulse that is given by a speed is sized by the body that the joint carries."""
    loads = []
    for drive in scene.drive.values():
        if drive.type == "torque" and drive.joint == joint:
            loads.append(signal_of(drive.torque))
        elif drive.type == "force" and drive.joint == joint:
            loads.append(signal_of(drive.force))
        elif drive.type == "torque pulse" and drive.joint == joint:
            e = axis / np.linalg.norm(axis)
            inertia = float(e @ gram.inertia(np.eye(1, gram.G.shape[-1])[0]) @ e)
            loads.append(half_sine(drive.start, drive.duration, _peak(drive, inertia)))
    return total(loads) if loads else constant(0.0)


def _peak(drive: Any, inertia: float) -> float:
    """Largest torque of a pulse whose impulse gives an inertia [kg m²] the wanted rate [N m]."""
    return float(drive.torque) if drive.speed is None else np.pi / 2 * inertia * drive.speed / drive.duration


def _motion(scene: Scene, joint: str) -> Signal | None:
    for drive in scene.drive.values():
        if drive.type == "motion" and drive.joint == joint:
            moves = drive.angle or drive.position
            assert moves is not None  # the scene's own check
            return signal_of(moves)
    return None


def _point_loads(scene: Scene, places: _Places) -> list[PointLoad]:
    loads = []
    for drive in scene.drive.values():
        if drive.type in ("point force", "point torque"):
            at = places.marker(drive.marker)
            size = signal_of(drive.force if drive.type == "point force" else drive.torque)
            direction = np.array(drive.direction, dtype=float)
            body, turns = drive.marker.partition(".")[0], drive.type == "point torque"
            place = {"place": at.position, "shapes": at.translation, "rotations": at.rotation}
            loads.append(PointLoad(body, direction, size, turns, drive.following, **place))
    return loads


def signal_of(given: TimeFunction) -> Signal:
    """Make the signal of a scene's quantity over time, in SI units."""
    if given.constant is not None:
        return constant(given.constant)
    if given.formula is not None:
        return formula(parse_formula(given.formula), given.factor)
    times, values = np.array(given.times), given.factor * np.array(given.values)
    return smooth_table(times, values) if given.smooth else linear_table(times, values)

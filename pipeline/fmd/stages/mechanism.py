"""From a scene's bodies, joints and drives to the mechanism that its runs integrate."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, as_input_error
from fmd.dynamics.closures import Closure, Constraint, Coupler, Place, close_joint, fixed_place
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.compiled_system.steady import find_steady_state
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.controllers import LinearLaw, SampledController
from fmd.dynamics.links import Link, PointLoad, rigid_integrals
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.signals.signal import Signal, constant, half_sine, total
from fmd.dynamics.state_functions import HeldValue, Quantity
from fmd.reduction.body import FlexibleBody, MarkerShapes
from fmd.reduction.inertia import InertiaIntegrals
from fmd.scene.loads import JointDrive, MarkerLoad, find_motion
from fmd.scene.modes import damping_ratios
from fmd.scene.scene import Scene
from fmd.stages.assembly import assemble, close_start, following_joints, start_controllers
from fmd.stages.controllers import add_controllers
from fmd.stages.division import part_of
from fmd.stages.equilibrium import find_closed_steady_state, find_equilibrium, rest_without_friction
from fmd.stages.force_elements import add_elements, joint_laws
from fmd.stages.loop_closing import given_joints
from fmd.stages.parent_joint import ground_place, joint_axes, place_axes, read_parent_joint
from fmd.stages.signals import require_sound_drives, signal_of
from fmd.stages.state_functions import FunctionBuilder, require_values_at_start


def build_mechanism(scene: Scene, bodies: Mapping[str, FlexibleBody]) -> Mechanism:
    """Build the mechanism of a scene with its reduced bodies; each one's frame sits at its joint's marker.

    Raises
    ------
    InputError
        A prescribed motion jumps, or a load or motion has no finite value at some time of the scene.
    """
    require_sound_drives(scene)
    places = _Places(scene, bodies)
    fast_joints = [scene.joint[name].child.partition(".")[0] for name in scene.simulation.fast]
    functions = FunctionBuilder(scene, places.on_either)
    states, sampled = add_controllers(functions)
    links = [*(_link(scene, places, functions, body) for body in places.order), *states]
    gravity, loads = np.array(scene.simulation.gravity), _point_loads(scene, places, functions)
    closures: list[Constraint] = [*(_closure(scene, places, name) for name in scene.closing), *_couplers(scene)]
    with as_input_error(scene.file, "drive"):
        mechanism = Mechanism(
            links,
            fast_joints,
            gravity,
            loads,
            horizon=scene.simulation.duration,
            closures=closures,
            controllers=sampled,
        )
    mechanism = assemble(scene, mechanism) if closures else mechanism
    if mechanism.functions:
        require_values_at_start(scene, mechanism, place_joints(scene, mechanism)[0])
    return add_elements(scene, mechanism, places.on_either, place_joints)


def add_observer(
    scene: Scene,
    bodies: Mapping[str, FlexibleBody],
    mechanism: Mechanism,
    formulas: Sequence[str],
    known: Callable[[Quantity], Quantity] | None = None,
) -> Mechanism:
    """Return a scene's mechanism with one more controller, the last one, which measures some formulas of the motion.

    Of a mechanism whose own controllers are left out, ``known`` gives what they put out as functions of time.

    Raises
    ------
    InputError
        A formula isn't one, or names what the scene doesn't have.
    """
    functions = FunctionBuilder(scene, _Places(scene, bodies).on_either)
    add_controllers(functions)
    found = tuple(functions.of_text(text) for text in formulas)
    found = tuple(function.with_variables(known) for function in found) if known else found
    law = LinearLaw((), (), (), (0.0,) * len(found), (), ())
    observer = SampledController("observation", np.inf, found, HeldValue(len(mechanism.held)), law)
    return replace(mechanism, controllers=[*mechanism.controllers, observer])


def find_start(scene: Scene, system: CompiledSystem) -> tuple[Array, Array]:
    """Find positions (n_positions,) and rates (n,) of a scene's mechanism at the start.

    Joints are where the scene has them, the bodies undeformed or, on a steady start, at rest in their frames; or all is
    at rest under the loads of the start.

    Raises
    ------
    AccuracyError
        There is no steady state, or no equilibrium.
    """
    q0, v0 = place_joints(scene, system.mechanism)
    if scene.simulation.start == "equilibrium":
        v0 = np.zeros(system.n)
        try:
            q0 = find_equilibrium(system, q0)
        except AccuracyError:
            if (turned := rest_without_friction(system, q0)) is None:
                raise
            q0 = find_equilibrium(system, turned)
        return (q0, close_start(scene, system, q0, v0)[1]) if system.mechanism.closures else (q0, v0)
    if scene.simulation.start == "periodic":
        periodic: Any = import_module("fmd.stages.periodic")
        found = periodic.find_periodic_start(scene, system)
        return found.q, found.v
    if scene.simulation.start == "steady" and system.mechanism.closures:
        return find_closed_steady_state(system, q0, v0, following_joints(scene, system.mechanism))
    return (find_steady_state(system, q0, v0), v0) if scene.simulation.start == "steady" else (q0, v0)


def place_joints(scene: Scene, mechanism: Mechanism) -> tuple[Array, Array]:
    """Return positions (n_positions,) and rates (n,) of the undeformed mechanism, its joints where the scene starts.

    Loops close: joints whose position or rate the scene leaves open move first.
    """
    q0, v0 = given_joints(scene, mechanism)
    q0, v0 = close_start(scene, share_system(mechanism), q0, v0) if mechanism.closures else (q0, v0)
    return q0, start_controllers(mechanism, q0, v0)


class _Places:
    """Places of a scene's markers in the frames of their bodies."""

    def __init__(self, scene: Scene, bodies: Mapping[str, FlexibleBody]) -> None:
        self.scene, self.bodies = scene, bodies
        self.carried = scene.carrying
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

    def on_either(self, place: str) -> tuple[Place, Array]:
        """A marker of a body, or a place on the ground, and its axes in those of the body."""
        body = place.partition(".")[0]
        if body == "ground":
            position, axes = ground_place(self.scene, place)
            return fixed_place(position), axes
        return Place(body, self.marker(place)), place_axes(self.scene, place)

    def marker(self, place: str) -> MarkerShapes:
        body, _, name = place.partition(".")
        return self.markers(body)[name]

    def markers(self, body: str) -> Mapping[str, MarkerShapes]:
        """All markers of a body by their names."""
        if body in self.bodies:
            return self.bodies[body].markers
        given: Any = self.scene.body[body].marker
        origin = self.origin(body)
        return {name: MarkerShapes(np.subtract(at.at, origin)) for name, at in given.items()}

    def origin(self, body: str) -> Array:
        """Place of a rigid body's joint, the origin of its frame, in the scene's coordinates of the body [m]."""
        given: Any = self.scene.body[body].marker
        return np.array(given[self.joint_marker(body)].at)

    def joint_marker(self, body: str) -> str:
        return self.scene.joint[self.carried[body]].child.partition(".")[2]


def _link(scene: Scene, places: _Places, functions: FunctionBuilder, body: str) -> Link:
    name = places.carried[body]
    joint = scene.joint[name]
    axes = joint_axes(scene, joint)
    settings: dict[str, Any] = {"joint_name": name, "markers": places.markers(body), "place_axes": axes.of_child}
    settings["part"] = part_of(body)
    if body in places.bodies:
        reduced, damping = places.bodies[body], scene.flexible[body].modes.damping
        integrals = reduced.integrals
        if not (places.parent(body) != "ground" or joint.kind.slides or any(scene.simulation.gravity)):
            # A frame that isn't accelerated takes no force by it; its joint's reaction does, by the whole inertia.
            integrals = replace(integrals, displacement2=np.zeros((3, 0, 0)))
        given = reduced.damping.size and not damping  # by the file that holds the body
        settings |= {
            "omega": reduced.omega,
            "damping": reduced.damping if given else np.array(damping_ratios(damping, reduced.omega.tolist())),
        }
        settings["section"] = _section(scene, places, body)
    else:
        integrals = _integrals(scene.body[body], places.origin(body))
    axis = axes.axis_in_child(joint.direction("axis"))
    motion = _motion(scene, name)
    settings |= {"axis": axis, "other_axis": axes.axis_in_child(joint.direction("child_axis", "axis"))}
    settings |= {"lead": joint.lead_per_angle, "laws": joint_laws(joint) if motion is None else ()}
    if joint.kind.unit:
        (along,) = joint.along
        settings |= {"spring": along.spring, "rest": along.rest, "damper": along.damper}
        settings |= {"motion": motion, "load": _load(scene, name, integrals, axis)}
        settings["effort"] = functions.of_joint(name)
    if joint.kind.is_hinge and body in places.bodies and motion is None:
        settings |= {"joint_rotation": reduced.joint_rotation, "joint_displacement2": reduced.joint_displacement2}
    parent = places.parent(body)
    if parent != "ground":
        settings |= {"parent": places.order.index(parent), "place": places.marker(joint.parent)}
    else:
        settings["place"] = MarkerShapes(ground_place(scene, joint.parent)[0])
    return Link(body, integrals, joint.kind, **settings)


def _closure(scene: Scene, places: _Places, name: str) -> Closure:
    joint = scene.joint[name]
    first, second = (places.on_either(place)[0] for place in (joint.parent, joint.child))
    if joint.kept_distance:
        return Closure(name, first, second, distance=joint.kept_distance)
    axes = joint_axes(scene, joint)
    axis, other = joint.direction("axis"), joint.direction("child_axis", "axis")
    return close_joint(joint.kind, name, first, second, axis, other, axes.in_parent, axes.in_child)


def _couplers(scene: Scene) -> list[Coupler]:
    """Gears and racks, as relations of the joints' coordinates."""
    bodies = {name: joint.child.partition(".")[0] for name, joint in scene.joint.items()}
    return [
        Coupler(name, [bodies[getattr(one, key)] for key, _ in one.ends], (1.0, -one.multiple), one.offset)
        for name, one in scene.coupler.items()
    ]


def _section(scene: Scene, places: _Places, body: str) -> str:
    """Marker on the section from which a body's deflections are seen; none where supports fix the body in its frame.

    A supported body on a free hinge turns with the face there that its supports fix.
    """
    supported = bool(scene.flexible[body].support) and not read_parent_joint(scene, body).free
    return "" if supported else places.joint_marker(body)


def _integrals(part: Any, origin: Array) -> InertiaIntegrals:
    """Inertia integrals of a rigid body about a place in its frame."""
    match part.shape:
        case "rod":
            across = part.mass * part.length**2 / 12
            centre, inertia = np.array([part.length / 2, 0.0, 0.0]), np.diag([0.0, across, across])
        case "point":
            centre, inertia = np.zeros(3), np.zeros((3, 3))
        case _:
            centre, inertia = np.array(part.centre), np.diag(part.inertia)
    return rigid_integrals(part.mass, centre - origin, inertia)


def _load(scene: Scene, joint: str, integrals: InertiaIntegrals, axis: Array) -> Signal:
    """Torque or force on a joint; a pulse that is given by a speed is sized by the body that the joint carries."""
    loads = []
    for drive in scene.drive.values():
        if not isinstance(drive, JointDrive) or drive.joint != joint:
            continue
        e = axis / np.linalg.norm(axis)
        inertia = float(e @ integrals.inertia(np.eye(1, integrals.G.shape[-1])[0]) @ e)
        if drive.load is not None:
            loads.append(signal_of(drive.load, scene.simulation.duration))
        elif (pulse := drive.pulse(inertia)) is not None:
            loads.append(half_sine(*pulse))
    return total(loads) if loads else constant(0.0)


def _motion(scene: Scene, joint: str) -> Signal | None:
    found = find_motion(scene.drive, joint)
    return None if found is None else signal_of(found[1].motion, scene.simulation.duration)


def _point_loads(scene: Scene, places: _Places, functions: FunctionBuilder) -> list[PointLoad]:
    loads = []
    for drive in scene.drive.values():
        if isinstance(drive, MarkerLoad):
            at = places.marker(drive.marker)
            size = signal_of(drive.size, scene.simulation.duration)
            effort = functions.of_drive(drive)
            direction = np.array(drive.direction, dtype=float)
            if drive.following:
                direction = place_axes(scene, drive.marker) @ direction
            body = drive.marker.partition(".")[0]
            loads.append(PointLoad(body, direction, size, drive.turns, drive.following, at, effort))
    return loads

"""Kinematics of a mechanism's frames: how joints and the markers that they sit on place, turn and move bodies.

Every frame's quantities are in its body's own axes. Accelerations come in pairs (a, α) of a frame's origin and of its
rotation. The marker that carries body b, on its parent p, and the frame of b itself accelerate by

    x_marker = B x_p + T η_p + β        x_b = shift(Rᵀ x_marker, d) + S q̈ + γ

with B the shift along the arm, T = (Φ, A(θ) Ψ) the marker's motion for unit modal accelerations η of p, R the rotation
from the axes of b into the parent's, S the joint's free directions, and β, γ what velocities alone bring about.
"""

from __future__ import annotations

from dataclasses import field

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import EXACT
from fmd.dynamics.compiler.algebra import (
    Matrix,
    Vector3,
    Vector6,
    add,
    constants,
    cross,
    identity,
    product,
    scale,
    shift_matrix,
    times,
    transpose,
)
from fmd.dynamics.compiler.cleaning import InertiaForms, clean_direction, clean_marker, inertia_forms, rigid_constants
from fmd.dynamics.compiler.coordinates import Coordinates
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector
from fmd.dynamics.compiler.marker import MarkerMotion, rotation, trace_marker
from fmd.dynamics.links import Link
from fmd.reduction.body import MarkerShapes


@dataclass
class MovingFrame:
    """A body's frame and the joint that carries it; see this module's equations."""

    number: int
    link: Link
    parent: MovingFrame | None
    q: Vector  # modal coordinates
    v: Vector  # modal rates
    spin: Vector3
    R: Matrix  # from the body's axes into its parent's
    beta: Vector6  # bias acceleration of the marker, in the parent's axes
    gamma: Vector6  # bias acceleration of the joint
    B: Matrix  # shift of accelerations from the parent's origin to the marker
    marker: MarkerMotion  # where the joint sits
    shift: Vector3  # from the joint to the body's origin, in the body's axes
    directions: list[Vector6]
    velocity: Vector3
    forms: InertiaForms
    rigid: RigidInertia  # of the undeformed body
    children: list[MovingFrame] = field(default_factory=list)
    _world: tuple[Vector3, Matrix] | None = None

    @property
    def world(self) -> tuple[Vector3, Matrix]:
        """Origin and rotation in space; computed where something needs it."""
        if self._world is None:
            if self.parent is None:
                R = self.R
                origin = add(self.marker.arm, times(R, self.shift))
            else:
                above, R_above = self.parent.world
                R = product(R_above, self.R)
                origin = add(above, times(R_above, self.marker.arm), times(R, self.shift))
            self._world = origin, R
        return self._world

    def carry(self, above: Vector6, of_modes: Vector6 | None = None) -> Vector6:
        """Carry an acceleration of the parent's frame, and of its modes at the marker, on to this frame, for q̈ = 0."""
        at_marker = add(times(self.B, above), self.beta)
        if of_modes is not None:
            at_marker = add(at_marker, of_modes)
        a, alpha = (times(transpose(self.R), part) for part in (at_marker[:3], at_marker[3:]))
        return add(add(a, cross(alpha, self.shift)) + alpha, self.gamma)

    def marker_motion(self, eta: Vector) -> Vector6:
        """Return ``T η``: how the modes of the parent accelerate the marker."""
        turns = [row.dot(eta) for row in self.marker.turns]
        return [row.dot(eta) for row in self.marker.slopes] + times(self.marker.A, turns)

    def move(self, accelerations: list[Scalar]) -> Vector6:
        """Return ``S q̈``."""
        out = [self.spin[0].graph.number(0.0)] * 6
        for direction, value in zip(self.directions, accelerations, strict=True):
            out = add(out, scale(value, direction))
        return out


@dataclass(frozen=True)
class RigidInertia:
    """Mass, first moment and inertia tensor of an undeformed body, of which the lower triangle by rows."""

    mass: Scalar
    S: Vector3
    J: Matrix


def trace_rigid_inertia(inputs: Coordinates, body: int, forms: InertiaForms) -> RigidInertia:
    """Trace a body's rigid inertia from its constants."""
    mass, S, J = rigid_constants(forms)
    first = [inputs.number(body, f"S {a}", S[a]) for a in range(3)]
    tensor = [[inputs.number(body, f"J {a} {b}", J[a, b]) for b in range(a + 1)] for a in range(3)]
    return RigidInertia(inputs.number(body, "mass", mass), first, tensor)


def trace_frames(inputs: Coordinates) -> list[MovingFrame]:
    """Trace the frames of a mechanism's bodies, each after its parent's."""
    frames: list[MovingFrame] = []
    for number, link in enumerate(inputs.mechanism.links):
        inputs.graph.mark()
        parent = frames[link.parent] if link.parent >= 0 else None
        frame = _trace_frame(inputs, number, link, parent)
        if parent is not None:
            parent.children.append(frame)
        frames.append(frame)
    return frames


def _trace_frame(inputs: Coordinates, number: int, link: Link, parent: MovingFrame | None) -> MovingFrame:
    graph = inputs.graph
    zero3 = constants(graph, [0.0] * 3)
    n_parent = len(parent.link.omega) if parent else 0
    none = graph.zeros(0)
    q, v, spin = (parent.q, parent.v, parent.spin) if parent else (none, none, zero3)
    marker = trace_marker(graph, clean_marker(link.place, n_parent, inputs.threshold), q, v)
    beta = marker_bias(spin, marker)
    motion = _trace_joint(inputs, number, link, marker)
    w = times(transpose(motion.R), add(spin, marker.turned))  # of the joint's frame on the parent, in the body's axes
    swept = add(cross(w, motion.shift), scale(2.0, motion.sliding))
    gamma = add(cross(w, swept), motion.slide_acceleration) + add(cross(w, motion.turning), motion.turn_acceleration)
    above = parent.velocity if parent else zero3
    at_marker = add(above, cross(spin, marker.arm), scale(0.5, marker.moving))
    velocity = add(times(transpose(motion.R), at_marker), cross(w, motion.shift), motion.sliding)
    forms = inertia_forms(link, inputs.threshold)
    return MovingFrame(
        number,
        link,
        parent,
        inputs.modal_positions(number),
        inputs.modal_rates(number),
        add(w, motion.turning),
        motion.R,
        beta,
        gamma,
        shift_matrix(marker.arm),
        marker,
        motion.shift,
        motion.directions,
        velocity,
        forms,
        trace_rigid_inertia(inputs, number, forms),
    )


def trace_place_on_body(inputs: Coordinates, frame: MovingFrame, at: MarkerShapes) -> MarkerMotion:
    """Trace the motion of a marker of a body, in its axes."""
    return trace_marker(inputs.graph, clean_marker(at, len(frame.link.omega), inputs.threshold), frame.q, frame.v)


def marker_bias(spin: Vector3, marker: MarkerMotion) -> Vector6:
    """Return how velocities alone accelerate a marker and its section on a body that spins."""
    swept = add(cross(spin, marker.arm), marker.moving)
    return add(cross(spin, swept), marker.bending) + add(cross(spin, marker.turned), marker.turning)


@dataclass
class _JointMotion:
    """Motion of a joint between its marker and its body, in the body's axes."""

    R: Matrix  # from the body's axes into the parent's: rotations of the marker, of the place's axes and of the joint
    shift: Vector3
    sliding: Vector3
    slide_acceleration: Vector3
    turning: Vector3
    turn_acceleration: Vector3
    directions: list[Vector6]


def _trace_joint(inputs: Coordinates, number: int, link: Link, marker: MarkerMotion) -> _JointMotion:
    graph, kind = inputs.graph, link.joint
    zero3 = constants(graph, [0.0] * 3)
    s, ds, dds = inputs.joint_positions(number), inputs.joint_rates(number), constants(graph, [0.0] * link.n_scalars)
    if link.motion is not None:
        s, ds, dds = ([value] for value in inputs.signal(link.motion, derivatives=2))
    R, turn, about = _trace_turns(graph, link, marker, s)
    motion = _JointMotion(R, zero3, zero3, zero3, zero3, zero3, [])
    slides, turns = ([zero3] * len(kind.units) for _ in range(2))
    for step in kind.slides:
        axis = scale(link.share(step), constants(graph, clean_direction(link.direction(step))))
        if turn is not None and not kind.shifts_along_turns:
            axis = times(transpose(turn), axis)
        k = step.coordinate
        slides[k] = axis
        motion.shift = add(motion.shift, scale(s[k], axis))
        motion.sliding = add(motion.sliding, scale(ds[k], axis))
        motion.slide_acceleration = add(motion.slide_acceleration, scale(dds[k], axis))
    for k, axis in about:
        turns[k] = add(turns[k], axis)
        rate = scale(ds[k], axis)
        swept = cross(motion.turning, rate)  # as those before it turn on
        motion.turn_acceleration = add(motion.turn_acceleration, scale(dds[k], axis), swept)
        motion.turning = add(motion.turning, rate)
    if link.motion is None:
        motion.directions = [slide + of_turn for slide, of_turn in zip(slides, turns, strict=True)]
    if kind.turns_in_space:
        motion.turning = ds[-3:]
        motion.directions += [zero3 + row for row in identity(graph, 3)]
    return motion


def _trace_turns(
    graph: Graph, link: Link, marker: MarkerMotion, s: list[Scalar]
) -> tuple[Matrix, Matrix | None, list[tuple[int, Vector3]]]:
    """Return the body's rotation in its parent and on its place, and the axis of each step in the body's axes.

    The axes are those for unit rates of the steps' coordinates, whose numbers stand beside them.
    """
    kind, turned = link.joint, (link.place_axes != np.eye(3)).any()
    R = product(marker.R, [constants(graph, row) for row in link.place_axes]) if turned else marker.R
    if kind.turns_in_space:
        turn = _quaternion_rotation(s[-4:])
        return product(R, turn), turn, []
    after: Matrix | None = None
    about: list[tuple[int, Vector3]] = []
    steps = [
        (step, clean_direction(link.direction(step)), s[step.coordinate] * link.share(step)) for step in kind.turns
    ]
    for number, (_, unit, angle) in enumerate(steps):
        of_marker = number == 0 and not turned
        R = _turn_about(graph, marker, unit, angle) if of_marker else product(R, rotation(graph, unit, angle))
    for step, unit, angle in reversed(steps):
        axis = scale(link.share(step), constants(graph, unit))
        about.insert(0, (step.coordinate, axis if after is None else times(transpose(after), axis)))
        own = rotation(graph, unit, angle)
        after = own if after is None else product(own, after)
    return R, after, about


def _turn_about(graph: Graph, marker: MarkerMotion, axis: Array, angle: Scalar) -> Matrix:
    """Rotation of the marker and of a hinge on it: one rotation if both have the same axis."""
    if marker.angle is not None:
        marker_axis, marker_angle = marker.angle
        along = float(marker_axis @ axis)
        if abs(abs(along) - 1.0) < EXACT:
            return rotation(graph, axis, angle + marker_angle * float(np.sign(along)))
    return product(marker.R, rotation(graph, axis, angle))


def _quaternion_rotation(e: list[Scalar]) -> Matrix:
    """Rotation of a unit quaternion, scalar part last."""
    x, y, z, w = e
    return [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]

"""Kinematics of a mechanism's frames: how joints and the markers that they sit on place, turn and move bodies.

Every frame's quantities are in its body's own axes. Accelerations come in pairs (a, α) of a frame's origin and of its
rotation. The marker that carries body b, on its parent p, and the frame of b itself accelerate by

    x_marker = B x_p + T η_p + β        x_b = shift(Rᵀ x_marker, d) + S q̈ + γ

with B the shift along the arm, T = (Φ, A(θ) Ψ) the marker's motion for unit modal accelerations η of p, R the rotation
from the axes of b into the parent's, S the joint's free directions, and β, γ what velocities alone bring about.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.core.arrays import Array
from pipeline.dynamics.compiler.algebra import (
    Matrix,
    Vector3,
    Vector6,
    add,
    constants,
    cross,
    dot,
    identity,
    product,
    scale,
    shift_matrix,
    tilde,
    times,
    transpose,
)
from pipeline.dynamics.compiler.cleaning import clean_direction, clean_place, clean_shapes
from pipeline.dynamics.compiler.coordinates import Coordinates
from pipeline.dynamics.compiler.graph import Graph, Scalar, Vector
from pipeline.dynamics.links import FREE, PRISMATIC, REVOLUTE, SPHERICAL, Link

_PARALLEL = 1e-14


@dataclass
class MarkerMotion:
    """Motion of the place on a body where a joint sits, in the body's axes.

    Attributes
    ----------
    arm, moving : Vector3
        Its place, and twice the rate at which the modes move it.
    R : Matrix
        ``exp(θ̃)``: its rotation by the modes.
    A : Matrix
        Its rotation rate is ``A θ̇``.
    turned, turning : Vector3
        That rate, and its derivative while θ̇ doesn't change.
    angle : tuple of ndarray and Scalar, optional
        Axis and angle, of a rotation about one axis only.
    """

    arm: Vector3
    moving: Vector3
    R: Matrix
    A: Matrix
    turned: Vector3
    turning: Vector3
    angle: tuple[Array, Scalar] | None = None


@dataclass
class MovingFrame:
    """A body's frame and the joint that carries it; see this module's equations.

    Attributes
    ----------
    number : int
        The body's.
    q, v : Vector
        Modal coordinates and rates.
    spin : Vector3
        Angular velocity.
    R : Matrix
        From the body's axes into its parent's.
    beta, gamma : Vector6
        Bias accelerations of the marker, in the parent's axes, and of the joint.
    B : Matrix
        Shift of accelerations from the parent's origin to the marker.
    marker : MarkerMotion
        Where the joint sits.
    place_shapes, place_rotations : ndarray, shape (3, n_parent)
        Φ and Ψ of the marker.
    shift : Vector3
        From the joint to the body's origin, in the body's axes.
    directions : list of Vector6
        Columns of S.
    velocity : Vector3
        Of the origin.
    children : list of MovingFrame
        Bodies that this one carries.
    """

    number: int
    link: Link
    parent: MovingFrame | None
    q: Vector
    v: Vector
    spin: Vector3
    R: Matrix
    beta: Vector6
    gamma: Vector6
    B: Matrix
    marker: MarkerMotion
    place_shapes: Array
    place_rotations: Array
    shift: Vector3
    directions: list[Vector6]
    velocity: Vector3
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
        graph = self.spin[0].graph
        shapes = [graph.array(row).dot(eta) for row in self.place_shapes]
        turns = [graph.array(row).dot(eta) for row in self.place_rotations]
        return shapes + times(self.marker.A, turns)

    def move(self, accelerations: list[Scalar]) -> Vector6:
        """Return ``S q̈``."""
        out = [self.spin[0].graph.number(0.0)] * 6
        for direction, value in zip(self.directions, accelerations, strict=True):
            out = add(out, scale(value, direction))
        return out


def trace_frames(inputs: Coordinates) -> list[MovingFrame]:
    """Trace the frames of a mechanism's bodies, each after its parent's."""
    frames: list[MovingFrame] = []
    for number, link in enumerate(inputs.mechanism.links):
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
    Phi, Psi = clean_shapes(link.place_shapes, n_parent), clean_shapes(link.place_rotations, n_parent)
    none = graph.zeros(0)
    q, v, spin = (parent.q, parent.v, parent.spin) if parent else (none, none, zero3)
    marker = trace_marker(graph, clean_place(link), Phi, Psi, q, v)
    swept = add(cross(spin, marker.arm), marker.moving)
    beta = cross(spin, swept) + add(cross(spin, marker.turned), marker.turning)
    motion = _trace_joint(inputs, number, link, marker)
    w = times(transpose(motion.R), add(spin, marker.turned))  # of the joint's frame on the parent, in the body's axes
    swept = add(cross(w, motion.shift), scale(2.0, motion.sliding))
    gamma = add(cross(w, swept), motion.slide_acceleration) + add(cross(w, motion.turning), motion.turn_acceleration)
    above = parent.velocity if parent else zero3
    at_marker = add(above, cross(spin, marker.arm), scale(0.5, marker.moving))
    velocity = add(times(transpose(motion.R), at_marker), cross(w, motion.shift), motion.sliding)
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
        Phi,
        Psi,
        motion.shift,
        motion.directions,
        velocity,
    )


def trace_marker(graph: Graph, place: Array, Phi: Array, Psi: Array, q: Vector, v: Vector) -> MarkerMotion:
    """Trace the motion of a point of a body, with its section, for the body's modal coordinates and rates."""
    zero3 = constants(graph, [0.0] * 3)
    if q.size == 0:
        unit = identity(graph, 3)
        return MarkerMotion(constants(graph, place), zero3, unit, unit, zero3, zero3)
    arm = [graph.array(row).dot(q) + float(x) for row, x in zip(Phi, place, strict=True)]
    moving = [graph.array(2.0 * row).dot(v) for row in Phi]
    if not Psi.any():
        unit = identity(graph, 3)
        return MarkerMotion(arm, moving, unit, unit, zero3, zero3)
    axes, sizes, _ = np.linalg.svd(Psi, full_matrices=False)
    if np.sum(sizes > 1e-12 * sizes[0]) == 1:
        axis = axes[:, 0] * np.sign(axes[np.abs(axes[:, 0]).argmax(), 0])
        axis = clean_direction(axis)
        row = graph.array(axis @ Psi)
        angle, rate = row.dot(q), row.dot(v)
        R, turned = rotation(graph, axis, angle), [rate * float(x) for x in axis]
        return MarkerMotion(arm, moving, R, identity(graph, 3), turned, zero3, (axis, angle))
    R, A, turned, turning = _turn_by_vector(graph, [graph.array(row) for row in Psi], q, v)
    return MarkerMotion(arm, moving, R, A, turned, turning)


def _turn_by_vector(graph: Graph, Psi: list[Vector], q: Vector, v: Vector) -> tuple[Matrix, Matrix, Vector3, Vector3]:
    """Rotation by θ = Ψ q, A(θ), A θ̇ and its derivative for constant θ̇.

    With Stumpff functions c_k of x = |θ|², ``exp(θ̃) = c₀ + c₁ θ̃ + c₂ θ θᵀ`` and ``A = 1 + c₂ θ̃ + c₃ θ̃²``.
    """
    t, dt = [row.dot(q) for row in Psi], [row.dot(v) for row in Psi]
    x, t_dt, dt2 = dot(t, t), dot(t, dt), dot(dt, dt)
    c4, c5 = x.apply("stumpff4"), x.apply("stumpff5")
    c2, c3 = 0.5 - x * c4, 1.0 / 6.0 - x * c5
    c0, c1 = 1.0 - x * c2, 1.0 - x * c3
    d2, d3 = c4 * 2.0 - c3, c5 * 3.0 - c4  # twice the slopes of c₂ and c₃
    turn, unit = tilde(t), identity(graph, 3)
    R = [[unit[i][j] * c0 + c1 * turn[i][j] + c2 * (t[i] * t[j]) for j in range(3)] for i in range(3)]
    one = 1.0 - c3 * x
    A = [[unit[i][j] * one + c2 * turn[i][j] + c3 * (t[i] * t[j]) for j in range(3)] for i in range(3)]
    across = cross(t, dt)
    twice = [a * t_dt - b * x for a, b in zip(t, dt, strict=True)]  # θ̃² θ̇
    turned = add(dt, scale(c2, across), scale(c3, twice))
    curl = [a * dt2 - b * t_dt for a, b in zip(t, dt, strict=True)]
    turning = add(scale(c3, curl), scale(d3 * t_dt, twice), scale(d2 * t_dt, across))
    return R, A, turned, turning


def rotation(graph: Graph, axis: Array, angle: Scalar) -> Matrix:
    """Return the rotation about a constant unit axis (Rodrigues' formula)."""
    c, s = angle.apply("cos"), angle.apply("sin")
    outer, across = np.outer(axis, axis), np.cross(np.eye(3), axis)
    return [
        [c * float((i == j) - outer[i, j]) + s * float(across[i, j]) + float(outer[i, j]) for j in range(3)]
        for i in range(3)
    ]


@dataclass
class _JointMotion:
    """Motion of a joint between its marker and its body, in the body's axes."""

    R: Matrix  # from the body's axes into the parent's: the marker's rotation and the joint's
    shift: Vector3
    sliding: Vector3
    slide_acceleration: Vector3
    turning: Vector3
    turn_acceleration: Vector3
    directions: list[Vector6]


def _trace_joint(inputs: Coordinates, number: int, link: Link, marker: MarkerMotion) -> _JointMotion:
    graph = inputs.graph
    zero3 = constants(graph, [0.0] * 3)
    motion = _JointMotion(marker.R, zero3, zero3, zero3, zero3, zero3, [])
    s, ds = inputs.joint_positions(number), inputs.joint_rates(number)
    if link.joint in (REVOLUTE, PRISMATIC):
        unit = clean_direction(link.axis)
        axis = constants(graph, unit)
        known = [*s, *ds, graph.number(0.0)]
        if link.motion is not None:
            known = inputs.signal(link.motion, derivatives=2)
        along, rate, acceleration = (scale(value, axis) for value in known)
        if link.joint == REVOLUTE:
            motion.R = _turn_about(graph, marker, unit, known[0])
            motion.turning, motion.turn_acceleration = rate, acceleration
            motion.directions = [zero3 + axis]
        else:
            motion.shift, motion.sliding, motion.slide_acceleration = along, rate, acceleration
            motion.directions = [axis + zero3]
        if link.motion is not None:
            motion.directions = []
    elif link.joint in (SPHERICAL, FREE):
        turn = _quaternion_rotation(s[-4:])
        motion.R, motion.turning = product(marker.R, turn), ds[-3:]
        into_body = transpose(turn)
        if link.joint == FREE:
            motion.shift, motion.sliding = times(into_body, s[:3]), times(into_body, ds[:3])
            motion.directions = [list(row) + zero3 for row in turn]
        motion.directions = motion.directions + [zero3 + row for row in identity(graph, 3)]
    return motion


def _turn_about(graph: Graph, marker: MarkerMotion, axis: Array, angle: Scalar) -> Matrix:
    """Rotation of the marker and of a hinge on it: one rotation if both have the same axis."""
    if marker.angle is not None:
        marker_axis, marker_angle = marker.angle
        along = float(marker_axis @ axis)
        if abs(abs(along) - 1.0) < _PARALLEL:
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

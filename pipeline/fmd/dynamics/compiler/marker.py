"""Motion of a marker on a deforming body: its place, and the rotation of its section.

For modal coordinates q a marker is at ``x + Φ q + ½ qᵀ displacement2 q``, and its section has turned by ``exp(θ̃)``
with the rotation vector ``θ = Ψ q + ½ qᵀ displacement2 q``; their terms of second order are those of
`MarkerShapes.displacement2`.
"""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import SUMMED
from fmd.dynamics.compiler.algebra import Matrix, Vector3, add, constants, cross, dot, identity, scale, tilde, times
from fmd.dynamics.compiler.cleaning import clean_direction
from fmd.dynamics.compiler.graph import Graph, Scalar, Vector, combine, total
from fmd.reduction.body import MarkerShapes


@dataclass
class MarkerMotion:
    """Motion of a marker, in the axes of its body."""

    arm: Vector3  # its place
    moving: Vector3  # twice the rate at which the modes move it
    R: Matrix  # ``exp(θ̃)``: its rotation by the modes
    A: Matrix  # its rotation rate is ``A θ̇``
    turned: Vector3  # that rate
    turning: Vector3  # its derivative while the modal rates don't change
    bending: Vector3  # acceleration of its place at constant modal rates
    shapes: MarkerShapes
    slopes: list[Vector]  # derivatives of its place by the modal coordinates
    turns: list[Vector]  # derivatives of θ by the modal coordinates
    angle: tuple[Array, Scalar] | None = None  # axis and angle, of a rotation about one axis only


def trace_marker(graph: Graph, at: MarkerShapes, q: Vector, v: Vector) -> MarkerMotion:
    """Trace the motion of a marker for the modal coordinates and rates of its body."""
    zero3, unit = constants(graph, [0.0] * 3), identity(graph, 3)
    constant = [graph.array(row) for row in np.concatenate([at.translation, at.rotation])]
    if q.size == 0:
        arm = constants(graph, at.position)
        return MarkerMotion(arm, zero3, unit, unit, zero3, zero3, zero3, at, constant[:3], constant[3:])
    slopes = [
        row + q.multiplied_by(displacement2) for row, displacement2 in zip(constant, at.displacement2, strict=True)
    ]
    halves = [combine([(0.5, row), (0.5, slope)]) for row, slope in zip(constant, slopes, strict=True)]
    bending = [v.multiplied_by(displacement2).dot(v) for displacement2 in at.displacement2]
    arm = [row.dot(q) + float(x) for row, x in zip(halves[:3], at.position, strict=True)]
    moving = [row.dot(v) * 2.0 for row in slopes[:3]]
    motion = MarkerMotion(arm, moving, unit, unit, zero3, zero3, bending[:3], at, slopes[:3], slopes[3:])
    axis = _only_axis(at)
    if axis is not None:
        angle, rate, turning = (
            total(x * float(along) for x, along in zip(values, axis, strict=True))
            for values in ([row.dot(q) for row in halves[3:]], [row.dot(v) for row in slopes[3:]], bending[3:])
        )
        motion.R, motion.angle = rotation(graph, axis, angle), (axis, angle)
        motion.turned, motion.turning = ([x * float(along) for along in axis] for x in (rate, turning))
    elif at.rotation.any() or at.displacement2[3:].any():
        angles, rates = [row.dot(q) for row in halves[3:]], [row.dot(v) for row in slopes[3:]]
        motion.R, motion.A, motion.turned, own = _turn_by_vector(graph, angles, rates)
        motion.turning = add(own, times(motion.A, bending[3:]))
    return motion


def _only_axis(at: MarkerShapes) -> Array | None:
    """Unit vector that every rotation of a marker is about, or ``None``."""
    n = at.rotation.shape[1]
    rotations = np.concatenate([at.rotation, at.displacement2[3:].reshape(3, n * n)], axis=1)
    if not rotations.any():
        return None
    axes, sizes, _ = np.linalg.svd(rotations, full_matrices=False)
    if np.sum(sizes > SUMMED * sizes[0]) > 1:
        return None
    return clean_direction(axes[:, 0] * np.sign(axes[np.abs(axes[:, 0]).argmax(), 0]), SUMMED)


def _turn_by_vector(graph: Graph, t: Vector3, dt: Vector3) -> tuple[Matrix, Matrix, Vector3, Vector3]:
    """Rotation by a vector θ, A(θ), A θ̇ and its derivative for constant θ̇.

    With Stumpff functions c_k of x = |θ|², ``exp(θ̃) = c₀ + c₁ θ̃ + c₂ θ θᵀ`` and ``A = 1 + c₂ θ̃ + c₃ θ̃²``.
    """
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
    rotation2 = [a * dt2 - b * t_dt for a, b in zip(t, dt, strict=True)]
    turning = add(scale(c3, rotation2), scale(d3 * t_dt, twice), scale(d2 * t_dt, across))
    return R, A, turned, turning


def rotation(graph: Graph, axis: Array, angle: Scalar) -> Matrix:
    """Return the rotation about a constant unit axis (Rodrigues' formula)."""
    c, s = angle.apply("cos"), angle.apply("sin")
    outer, across = np.outer(axis, axis), np.cross(np.eye(3), axis)
    return [
        [c * float((i == j) - outer[i, j]) + s * float(across[i, j]) + float(outer[i, j]) for j in range(3)]
        for i in range(3)
    ]

"""Rotations and frames of bodies at many states: matrices, rotation vectors and quaternions by NumPy."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import EPSILON, Array
from fmd.core.limits.mechanism import SMALL_ANGLE


class BodyFrame(NamedTuple):
    """A body's frame at each state: origin and rotation in space, velocity of the origin and angular velocity."""

    origin: Array  # (n_times, 3) [m]
    rotation: Array  # (n_times, 3, 3)
    velocity: Array  # (n_times, 3) [m/s]
    spin: Array  # (n_times, 3) [rad/s]


def displaced(shapes: Array, displacement2: Array, q: Array) -> Array:
    """Return displacements of second order ``Φ q + ½ qᵀ B q`` (n_times, k): Φ (k, n), B (k, n, n), q (n_times, n)."""
    place = q @ shapes.T if shapes.size else np.zeros((len(q), len(shapes)))
    if displacement2.size:
        slope = (displacement2.reshape(-1, q.shape[1]) @ q.T).reshape(*displacement2.shape[:2], -1)  # (k, n, n_times)
        place = place + 0.5 * (slope * q.T).sum(axis=1).T
    return np.asarray(place)


def turned(rotation: Array, vectors: Array) -> Array:
    """Turn one vector by each rotation: (n, 3, 3) and (n, 3) give (n, 3)."""
    return np.asarray(np.einsum("tij,tj->ti", rotation, vectors))


def rotation_matrix(angle: Array) -> Array:
    """Rotation by each of the vectors ``angle``, (n, 3) [rad]: ``exp(θ̃)``, shape (n, 3, 3)."""
    square = (angle**2).sum(axis=1)
    one, two = _coefficients(square)
    sine = (1.0 - square * two)[:, None, None]
    skew = _skew(angle)
    return np.asarray(np.eye(3) + sine * skew + one[:, None, None] * (skew @ skew))


def rotation_by(vector: Sequence[float] | Array) -> Array:
    """Rotation by one vector (3,) [rad], shape (3, 3)."""
    return np.asarray(rotation_matrix(np.array([vector], dtype=float))[0])


def _coefficients(square: Array) -> tuple[Array, Array]:
    """``(1 − cos θ)/θ²`` and ``(θ − sin θ)/θ³`` for the squares of angles."""
    size = np.sqrt(np.maximum(square, SMALL_ANGLE**2))
    one, two = (1.0 - np.cos(size)) / size**2, (size - np.sin(size)) / size**3
    small = square <= SMALL_ANGLE**2
    one = np.where(small, 0.5 - square / 24 + square**2 / 720 - square**3 / 40320, one)
    return one, np.where(small, 1 / 6 - square / 120 + square**2 / 5040 - square**3 / 362880, two)


def _skew(a: Array) -> Array:
    """Matrices of the cross products with each vector: ``skew(a) @ b = a × b``, shape (n, 3, 3)."""
    return np.asarray(-np.einsum("abc,tc->tab", EPSILON, a))


def matrix_of_quaternion(e: Array) -> Array:
    """Rotations of unit quaternions (n, 4), scalar part last, shape (n, 3, 3)."""
    skew = _skew(e[:, :3])
    return np.asarray(np.eye(3) + 2.0 * (e[:, 3, None, None] * skew + skew @ skew))


def quaternion_of_matrix(R: Array) -> Array:
    """Unit quaternions (n, 4), scalar part last, of rotations (n, 3, 3) in a row; their signs go on without a jump."""
    # The 4 × 4 matrix 4 e eᵀ: its row of the largest diagonal is e itself but for its size (Shepperd 1978).
    K = np.empty((len(R), 4, 4))
    trace = np.trace(R, axis1=1, axis2=2)
    K[:, :3, :3] = R + R.swapaxes(1, 2) + (1.0 - trace)[:, None, None] * np.eye(3)
    K[:, :3, 3] = K[:, 3, :3] = np.einsum("abc,tcb->ta", EPSILON, R)
    K[:, 3, 3] = 1.0 + trace
    e = K[np.arange(len(R)), np.argmax(np.einsum("tii->ti", K), axis=1)]
    e /= np.linalg.norm(e, axis=1)[:, None]
    flips = np.where((e[1:] * e[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(e * np.cumprod(np.r_[1.0, flips])[:, None])


RIGID_MOTIONS = tuple(f"{how} {axis}" for how in ("moved along", "turned about") for axis in "xyz")
"""The motions of `rigid_motions`, in words."""


def rigid_motions(x: Array) -> Array:
    """Three translations and three linearised rotations about the origin of points at x (n, 3), shape (n, 3, 6)."""
    turns = np.cross(np.eye(3), x[:, None]).swapaxes(1, 2)
    return np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), turns], axis=2)


def move_loads(arm: Array) -> Array:
    """Return the forces and torques, (6, 6), of unit ones that act at an arm (3,) [m] from there."""
    moved = np.eye(6)
    moved[3:, :3] = np.cross(arm, np.eye(3)).T
    return moved

"""Velocity and acceleration of markers in space, at states whose accelerations are known."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.core.rotations import moved, turned
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.reactions import JointLoads


def marker_velocity(motion: Kinematics, body: int, name: str) -> Array:
    """Return the velocity of a marker in space, ``V + ω × R r + R u̇`` [m/s], shape (n_times, 3)."""
    frame, (arm, moving) = motion.frames[body], _arm(motion, body, name)
    return np.asarray(frame.velocity + np.cross(frame.spin, arm) + moving)


def marker_acceleration(motion: Kinematics, loads: JointLoads, body: int, name: str) -> Array:
    """Return the acceleration of a marker in space [m/s²], shape (n_times, 3).

    ``A + α × R r + ω × (ω × R r) + 2 ω × R u̇ + R ü`` with ``u = Φ q + ½ qᵀ bow q``.

    Parameters
    ----------
    loads : JointLoads
        Accelerations at the states of the motion.
    """
    body = motion.mechanism.find_marker(body, name)
    frame, at = motion.frames[body], motion.mechanism.links[body].markers[name]
    arm, moving = _arm(motion, body, name)
    q, rates = motion.modal_coordinates(body), motion.modal_rates(body)
    accelerations = loads.accelerations[:, motion.mechanism.modes_of(body)]
    bending = moved(at.translation, at.bow[:3], q, accelerations)[1]
    if at.bow.size:
        bending = bending + np.einsum("ajk,tj,tk->ta", at.bow[:3], rates, rates)
    origin, turning = loads.frames[:, body, :3], loads.frames[:, body, 3:]
    swept = np.cross(frame.spin, np.cross(frame.spin, arm) + 2.0 * moving)
    return np.asarray(origin + np.cross(turning, arm) + swept + turned(frame.rotation, bending))


def _arm(motion: Kinematics, body: int, name: str) -> tuple[Array, Array]:
    """Return the way from a body's origin to a marker, and the rate of its displacement in the body, in space."""
    body = motion.mechanism.find_marker(body, name)
    frame, at = motion.frames[body], motion.mechanism.links[body].markers[name]
    bent, moving = moved(at.translation, at.bow[:3], motion.modal_coordinates(body), motion.modal_rates(body))
    return turned(frame.rotation, at.position + bent), turned(frame.rotation, moving)

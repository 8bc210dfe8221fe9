"""Accelerations, and forces and moments of all joints, over a motion: those of the tree and those that close loops."""

from collections.abc import Mapping, Sequence

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.dynamics.compiled_system.shared import share_system
from fmd.dynamics.mechanism import Mechanism


@dataclass(frozen=True)
class JointLoads:
    """Accelerations of a mechanism's bodies over a motion, and the forces and moments of its joints."""

    accelerations: Array  # (n_times, n): of the coordinates, in the order of rates
    # (n_times, n_bodies, 6): acceleration of each body's origin [m/s²] and angular acceleration of its frame [rad/s²],
    # in space
    frames: Array
    # (n_times, 2, 6): Force [N] and moment [N m] of each joint on its parent and on its child, in space, about the
    # joint's place on each, by the joints' names. They hold all that the joint transmits, its spring, damper and drive
    # included.
    reactions: Mapping[str, Array]


def joint_loads(
    mechanism: Mechanism, whole: Mechanism, times: Array, q: Array, v: Array, pushes: Sequence[Array] = ()
) -> JointLoads:
    """Compute accelerations, and force and moment of every joint, at states of a mechanism that close the loops.

    They follow from the equations of motion at each state alone (recursive Newton–Euler), not from differences between
    output times: times (n_times,) [s], positions (n_times, n_positions) and rates (n_times, n). ``whole`` is the
    mechanism with the whole inertia of each body: one that turns about a fixed axis moves without that along the axis,
    but its joint holds the moments of its products of inertia. Pushes are those of contacts, on the bodies' frames, in
    their axes, and on modes, (n_times, n_bodies, 6) and (n_times, n); none without contacts.

    Raises
    ------
    ValueError
        A body of ``whole`` lacks its inertia along an axis.
    """
    lacking = [link.name for link in whole.links if link.integrals.normal >= 0]
    if lacking:
        raise ValueError(f"the joint of {lacking[0]} bears moments that take the body's inertia along its axis, too")
    accelerations, multipliers = _accelerate(mechanism, times, q, v, pushes)
    frames, loads = share_system(whole).compiled.joint_loads(times, q, v, accelerations, multipliers, pushes)
    of_tree = {link.joint_name: loads[:, number] for number, link in enumerate(mechanism.links)}
    return JointLoads(accelerations, frames, of_tree | _closing_reactions(mechanism, times, q, v, multipliers))


def _accelerate(mechanism: Mechanism, times: Array, q: Array, v: Array, pushes: Sequence[Array]) -> tuple[Array, Array]:
    """Return accelerations (n_times, n) and the smallest Lagrange multipliers (n_times, n_rows) at each state."""
    compiled = share_system(mechanism).compiled
    q, v = q.copy(), v.copy()  # places of read-only arrays take four times as long to find
    found = [
        compiled.constrained_accelerations(float(t), q[k], v[k], pushes=[own[k] for own in pushes])
        for k, t in enumerate(times)
    ]
    accelerations = np.reshape([a for a, _ in found], (len(times), mechanism.n))
    return accelerations, np.reshape([f for _, f in found], (len(times), len(compiled.rows)))


def _closing_reactions(mechanism: Mechanism, times: Array, q: Array, v: Array, multipliers: Array) -> dict[str, Array]:
    compiled, joints = share_system(mechanism).compiled, mechanism.closing_joints
    if not (joints and compiled.rows):
        return {joint.name: np.zeros((len(times), 2, 6)) for joint in joints}
    wrenches = compiled.reactions(times, q, v, multipliers)
    return {joint.name: wrenches[:, k] for k, joint in enumerate(joints)}


def closing_reactions(
    mechanism: Mechanism, times: Array, q: Array, v: Array, pushes: Sequence[Array] = ()
) -> dict[str, Array]:
    """Compute force [N] and moment [N m] of each joint that closes a loop on its parent and child, (n_times, 2, 6).

    They are in space, about the joint's place on each, by the joints' names. Where constraints are redundant, no motion
    tells how joints share their load; the smallest multipliers are taken. Positions (n_times, n_positions) and rates
    (n_times, n) at times [s] close the loops; contacts push bodies' frames, in their axes, and modes: ``pushes``,
    (n_times, n_bodies, 6) and (n_times, n).
    """
    multipliers = np.zeros((len(times), 0))
    if mechanism.closing_joints:
        _, multipliers = _accelerate(mechanism, times, q, v, pushes)
    return _closing_reactions(mechanism, times, q, v, multipliers)


def constraint_residual(mechanism: Mechanism, times: Array, q: Array, v: Array) -> float:
    """Return the largest residual of a mechanism's loops over a motion [m, or rad]; 0 without loops."""
    if not mechanism.closures:
        return 0.0
    compiled = share_system(mechanism).compiled
    return max(float(np.abs(compiled.residuals(float(t), q[k], v[k])[0]).max(initial=0.0)) for k, t in enumerate(times))

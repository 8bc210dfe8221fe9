"""Loops of a mechanism that are closed by moving its joints, from the positions that a scene gives them."""

from collections.abc import Sequence

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits import newton as limits
from fmd.core.newton import Tolerance, largest, solve
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.linear_forces import gather_linear_forces
from fmd.dynamics.mechanism import Mechanism
from fmd.integrators.protocol import move_positions
from fmd.scene.joints.joint import POSITION_KEYS, RATE_KEYS
from fmd.scene.scene import Scene
from fmd.stages.parent_joint import joint_axes

_CLOSING = Tolerance(limits.CLOSING_CORRECTIONS, residual=limits.CLOSED, stalled=limits.OPEN)


def given_joints(scene: Scene, mechanism: Mechanism) -> tuple[Array, Array]:
    """Return positions (n_positions,) and rates (n,) of the undeformed mechanism, its joints as the scene has them."""
    q0, v0 = mechanism.rest_positions, np.zeros(mechanism.n)
    for k, link in enumerate(mechanism.links):
        at, first = mechanism.layout.position[k], mechanism.layout.rate[k]
        if isinstance(link.state, float):
            v0[first] = link.state
        elif link.motion is None and link.state is None:
            joint = scene.joint[link.joint_name]
            positions, rates = joint.start(joint_axes(scene, joint).in_child)
            q0[at : at + len(positions)] = positions
            v0[first : first + len(rates)] = rates
    return q0, v0


def loose_rates(scene: Scene, mechanism: Mechanism, what: str) -> IntArray:
    """Rates of the joints whose ``position`` or ``rate`` the scene leaves open."""
    keys = POSITION_KEYS if what == "position" else {*RATE_KEYS}
    parts = [
        np.arange(at, at + link.n_rates)
        for link, at in zip(mechanism.links, mechanism.layout.rate, strict=True)
        if link.state is None and not keys & scene.joint[link.joint_name].given_keys
    ]
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def joint_rates(mechanism: Mechanism) -> IntArray:
    """Rates of all joints."""
    parts = [np.arange(at, at + link.n_rates) for link, at in zip(mechanism.links, mechanism.layout.rate, strict=True)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def close_loops(system: CompiledSystem, q: Array, groups: Sequence[IntArray], t: float = 0.0) -> Array:
    """Close the residuals by the first group of coordinates that can; else return where the last one leaves them."""
    closed, weights = q, flexibility(system)
    for columns in groups:
        closed = close_by(system, q, columns, weights, t)
        if open_residual(system, closed, t) <= limits.OPEN:
            return closed
    return closed


def close_pose(system: CompiledSystem, t: float, q: Array, kept: int | None = None) -> Array | None:
    """Return positions near q (n_positions,) at which all loops are closed at a time [s]; ``None`` if there are none.

    Bodies deform only where joints alone can't do it. The coordinate of the rate ``kept`` stays as it is.
    """
    if not system.mechanism.closures:
        return q
    fixed = [] if kept is None else [kept]
    groups = [np.setdiff1d(columns, fixed) for columns in (joint_rates(system.mechanism), np.arange(system.n))]
    closed = close_loops(system, q, groups, t)
    return closed if open_residual(system, closed, t) <= limits.OPEN else None


def close_by(system: CompiledSystem, q: Array, columns: IntArray, weights: Array, t: float = 0.0) -> Array:
    """Move some coordinates by Newton's method, the least motion first, in halved steps where a residual would grow."""

    def correction(q: Array, left: Array) -> Array:
        J = system.compiled.constraint_jacobian(t, q)[:, columns] * weights[columns]
        change = np.zeros(system.n)
        change[columns] = -weights[columns] * np.linalg.lstsq(J, left, rcond=limits.DEPENDENT_DIRECTION)[0]
        return change

    return solve(
        q,
        lambda q: residuals(system, q, t),
        correction,
        lambda q, change: move_positions(system.parameters, q, change),
        _CLOSING,
        accepts=lambda trial: largest(trial.after) < largest(trial.before),
    ).state


def flexibility(system: CompiledSystem) -> Array:
    """Return how readily coordinates move to close residuals: joints at once, modes by their static compliance."""
    stiffness = np.maximum(gather_linear_forces(system.mechanism.links, system.mechanism.layout).own, 0.0)
    weights = np.ones(system.n)
    for k, link in enumerate(system.mechanism.links):
        modes = system.mechanism.modes_of(k)
        weights[modes] = link.omega.min(initial=np.inf) / np.sqrt(np.maximum(stiffness[modes], 1e-300))
    return weights


def residuals(system: CompiledSystem, q: Array, t: float = 0.0) -> Array:
    """Return the residuals of the constraints [m or rad] at positions q and a time [s]."""
    return system.compiled.residuals(t, q, np.zeros(system.n))[0]


def open_residual(system: CompiledSystem, q: Array, t: float = 0.0) -> float:
    """Return the largest residual of the constraints [m or rad] at positions q and a time [s]."""
    return largest(residuals(system, q, t))

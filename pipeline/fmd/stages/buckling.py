"""Buckling of bodies that loops or force elements hold: by the stiffness of the mechanism, not of each body alone.

A column whose end is guided bears many times what it does with a free end. Of all small motions that keep the loops
closed, those count in which bodies deform, without what joints do alone. Their stiffness is that of modes, springs and
elements, with the geometric stiffness of each body under its loads, and the work that these do as a body turns::

    −F · (½ φ × (φ × r) + φ × u)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space

from fmd.core.arrays import Array
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT
from fmd.dynamics.compiled_system.system import CompiledSystem
from fmd.dynamics.kinematics import Kinematics
from fmd.dynamics.mechanism import Mechanism
from fmd.dynamics.transmitted_loads import ELEMENT, BodyLoads, geometric_stiffness_over, loaded_places
from fmd.stages.assembly import undeformed_positions


@dataclass(frozen=True)
class HeldStiffness:
    """Lowest stiffness of a mechanism's elastic motions under loads.

    Attributes
    ----------
    lowest : float
        Lowest stiffness over mass [1/s²].
    buckling : float
        Load as a part of the buckling load; 0 if nothing softens.
    """

    lowest: float
    buckling: float


def held_stiffness(
    system: CompiledSystem, loads: Mapping[int, BodyLoads], k: int, t: float, rigid_positions: Array
) -> HeldStiffness:
    """Find the lowest stiffness of a mechanism with loops or force elements at a moment of its rigid motion.

    Parameters
    ----------
    system : CompiledSystem
        The mechanism's, with stiffened bodies.
    loads : mapping of int to BodyLoads
        Loads on its bodies over the motion, by their numbers.
    k, t : int, float
        The moment: its number among those of the loads, and its time [s].
    rigid_positions : ndarray
        Positions of the mechanism with all bodies rigid at that moment.
    """
    mechanism = system.mechanism
    q = undeformed_positions(mechanism, mechanism.rigid, rigid_positions)
    elastic, geometric = system.linear_forces.K, np.zeros((mechanism.n, mechanism.n))
    turns = _turns_at_unit_rates(mechanism, t, q)
    for body, own in loads.items():
        now = _at(own, k)
        modes = mechanism.modes_of(body)
        if len(modes):
            geometric[np.ix_(modes, modes)] += geometric_stiffness_over(mechanism, body, now)[0]
        geometric += _work_of_turning(mechanism, body, now, turns[body])
    ways = _elastic_ways(system, t, q)
    if not ways.shape[1]:
        return HeldStiffness(np.inf, 0.0)
    K, K_G, M = (ways.T @ A @ ways for A in (elastic, geometric, system.mass_matrix(q, t)))
    parts = eigh(K_G, K, eigvals_only=True)
    return HeldStiffness(float(eigh(K + K_G, M, eigvals_only=True)[0]), float(max(-parts[0], 0.0)))


def _at(loads: BodyLoads, k: int) -> BodyLoads:
    """Return loads at one moment alone."""
    now = slice(k, k + 1)
    return BodyLoads(
        loads.spin[now],
        loads.turning[now],
        loads.acceleration[now],
        loads.wrenches[:, now],
        loads.joint[now],
        loads.open,
    )


def _turns_at_unit_rates(mechanism: Mechanism, t: float, q: Array) -> list[Array]:
    """Return how each body's frame turns with each coordinate, in its own axes, shapes (3, n)."""
    n = mechanism.n
    rates = np.concatenate([np.eye(n), np.zeros((1, n))])
    motion = Kinematics(mechanism, np.full(n + 1, t), np.tile(q, (n + 1, 1)), rates)
    return [frame.rotation[0].T @ (frame.spin[:-1] - frame.spin[-1]).T for frame in motion.frames]


def _work_of_turning(mechanism: Mechanism, body: int, loads: BodyLoads, turns: Array) -> Array:
    """Return the stiffness (n, n) by loads that keep their direction in space while the body turns."""
    link, modes = mechanism.links[body], mechanism.modes_of(body)
    carried, points, held = loaded_places(mechanism, body)
    places = [(mechanism.links[k].place, mechanism.links[k].place_shapes, False) for k in carried]
    places += [(at.place, at.shapes, at.following) for at in points]
    # A joint pulls on in its direction as the body turns; a force element turns with it.
    places += [(at.position, at.translation, key.startswith(ELEMENT)) for key, _, at in held]
    forces = [(wrench[0, :3], *at) for wrench, at in zip(loads.wrenches, places, strict=True)]
    forces.append((-loads.acceleration[0], link.integrals.S[:, 0], link.integrals.S[:, 1:], False))
    K = np.zeros((mechanism.n, mechanism.n))
    for F, r, shapes, following in forces:
        if following:
            continue
        K += turns.T @ ((F @ r) * np.eye(3) - 0.5 * (np.outer(F, r) + np.outer(r, F))) @ turns
        if shapes.size:
            coupling = turns.T @ np.cross(F, shapes, axisb=0, axisc=0)
            K[:, modes] += coupling
            K[modes] += coupling.T
    return K


def _elastic_ways(system: CompiledSystem, t: float, q: Array) -> Array:
    """Return a basis (n, k) of the motions that keep loops closed, less those in which joints alone move."""
    n = system.n
    J = system.compiled.constraint_jacobian(t, q) if system.compiled.rows else np.zeros((0, n))
    joints = np.setdiff1d(
        np.arange(n), np.concatenate([system.mechanism.modes_of(k) for k in range(len(system.mechanism.links))])
    )
    ways = null_space(J, rcond=DEPENDENT_CONSTRAINT) if len(J) else np.eye(n)
    alone = np.zeros((n, 0))
    if len(joints):
        of_joints = null_space(J[:, joints], rcond=DEPENDENT_CONSTRAINT) if len(J) else np.eye(len(joints))
        alone = np.zeros((n, of_joints.shape[1]))
        alone[joints] = of_joints
    across = alone.T @ system.mass_matrix(q, t) @ ways
    return np.asarray(ways @ null_space(across, rcond=DEPENDENT_CONSTRAINT)) if len(across) else ways

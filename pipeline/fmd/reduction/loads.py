"""Nodal loads that the motion of a body puts on it, and the enrichment of a modal basis by the responses to them.

Low free modes carry almost none of the stretch under centrifugal load, so stress from them alone is wrong however
many bending modes are kept. Load-dependent vectors mend it (MacNeal 1971, Wilson, Yuan & Dickens 1982).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh, null_space

from fmd.core.arrays import Array
from fmd.core.limits.modes import SOFTER
from fmd.core.limits.rank import NEW_RESPONSE
from fmd.reduction.modes import Modes, separate_modes

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver

PRODUCTS = tuple((a, b) for a in range(3) for b in range(a, 3))
"""Axes a ≤ b of the six products of two angular rates, in the order of `centrifugal_fields`."""


def motion_loads(
    fe: FEModel, marker: Marker, axis: Array | None, outboard: Sequence[tuple[Marker, Array | None]] = ()
) -> Array:
    """Centrifugal loads of unit rates, and unit forces and torques at the body's joints, (n_nodes, 3, n_loads).

    Forces and torques are spread over the markers' faces: that of the joint that carries the body, and ``outboard``
    where other bodies are attached or loads act, with the normal of the plane to which those keep. Loads of linear and
    angular acceleration are left out: a free body balances them by itself, and what bends it is the reaction of its
    joint. With the normal (3,) of the plane to which all motion keeps, there is one centrifugal load, two forces and
    one torque at each marker; else the six products of two rates, and three forces and three torques at each marker.
    """
    fields = centrifugal_fields(fe.x - marker.position, axis)
    reactions = []
    in_plane = axis is not None and all(normal is not None for _, normal in outboard)
    for at, normal in ((marker, axis if in_plane else None), *outboard):  # the joint answers to every load
        forces, torques = _directions(normal)
        columns = at.columns(len(fe.x), torques)
        reactions += [columns[:, :, :3] @ forces.T, columns[:, :, 3:]]
    return np.concatenate([inertia_of(fe, fields), *reactions], axis=-1)


def acceleration_loads(fe: FEModel, centre: Array, axis: Array | None) -> Array:
    """Inertia loads (n_nodes, 3, n_loads) of unit accelerations of a support, linear ones and angular ones.

    Angular ones are about its centre [m]. A free body balances them by itself, a supported one bends. If all motion
    keeps to a plane, by its normal (3,), there are two linear accelerations and one angular, without it three of each.
    """
    r = fe.x - centre
    moves, turns = _directions(axis)
    return inertia_of(fe, [np.tile(e, (len(r), 1)) for e in moves] + [np.cross(e, r) for e in turns])


def centrifugal_fields(r: Array, axis: Array | None) -> list[Array]:
    """Acceleration fields of unit products of two angular rates, at places r (n_nodes, 3) from the centre.

    A plane motion about an axis (3,) has the one field across it; without, there are all six of `PRODUCTS`. Their
    inertia pulls outwards.
    """
    if axis is not None:
        return [r - np.outer(r @ axis, axis) / (axis @ axis)]
    unit = np.eye(3)
    return [(np.outer(r[:, b], unit[a]) + np.outer(r[:, a], unit[b])) / 2 for a, b in PRODUCTS]


def inertia_of(fe: FEModel, fields: Sequence[Array]) -> Array:
    """Nodal loads ``M a`` of acceleration fields a (n_nodes, 3), shape (n_nodes, 3, n_fields)."""
    return np.stack([fe.m @ field for field in fields], axis=-1)


def _directions(normal: Array | None) -> tuple[Array, Array]:
    """Directions of forces and of torques, as rows, that keep to a plane; all of them without a plane."""
    if normal is None:
        return np.eye(3), np.eye(3)
    e = normal / np.linalg.norm(normal)
    return np.linalg.svd(np.eye(3) - np.outer(e, e))[0].T[:2], e[None]


def enrich_modes(
    modes: Modes,
    fe: FEModel,
    solver: FreeBodySolver,
    loads: Array,
    constraints: Array | None = None,
    generations: int = 1,
    least: float = NEW_RESPONSE,
) -> tuple[Array, Array]:
    """Add the static responses to loads (n_nodes, 3, n_loads) to a modal basis; orthonormalise and diagonalise again.

    Eigenvectors come back unchanged in front of the new ones. Responses are moved as rigid bodies until they meet
    ``constraints`` (n_nodes, 3, k), those of the modes, too. Each generation beyond the first adds responses to the
    inertia of the one before. ``least`` is the part of a response's norm outside the modes from which on it is added,
    `NEW_RESPONSE` or `NEW_RESIDUAL_VECTOR`. Returned are ω (n,) [rad/s], ``Φᵀ K Φ = diag(ω²)``, n ≤ n_modes +
    generations · n_loads, and shapes (n_nodes, 3, n) with unit modal mass.
    """
    Phi = modes.shapes.reshape(fe.K.shape[0], -1)
    B = None if constraints is None else constraints.reshape(fe.K.shape[0], -1)
    basis, response = Phi, solver.remembered_response(loads)
    for generation in range(generations):
        U = (solver.inertia_response(response) if generation else response).reshape(fe.K.shape[0], -1)
        U = _new_part(basis, U if B is None else _constrained_fields(U, fe, B), fe, least)
        basis, response = np.concatenate([basis, U], axis=1), U.reshape(len(fe.x), 3, -1)
        if not generation:
            first = U.shape[1]
    U = basis[:, Phi.shape[1] :]
    K = U.T @ (fe.products @ U)
    softest = eigh(K[:first, :first], eigvals_only=True)[:1].min(initial=np.inf)
    omega2, turn = eigh(K)
    U, n = U @ turn[:, omega2 >= SOFTER**2 * softest], Phi.shape[1]
    both = np.concatenate([Phi, U], axis=1)
    stiffness = np.diag(np.concatenate([modes.omega**2, np.zeros(both.shape[1] - n)]))
    stiffness[:, n:] = both.T @ fe.forces(both[:, n:])
    stiffness[n:, :n] = stiffness[:n, n:].T
    omega2, turn = separate_modes(stiffness, both.T @ (fe.M @ both))
    both[:, n:] = both @ turn[:, n:]
    return np.concatenate([modes.omega, np.sqrt(omega2[n:])]), both.reshape(len(fe.x), 3, -1)


def _new_part(basis: Array, U: Array, fe: FEModel, least: float) -> Array:
    """M-orthonormal columns of U's part outside an M-orthonormal basis."""
    U = U[:, U.any(axis=0)]
    U = U / np.sqrt(np.einsum("ij,ij->j", U, fe.M @ U))
    for _ in range(2):  # twice is enough (Parlett)
        U = U - basis @ (basis.T @ (fe.M @ U))
    weight, turn = eigh(U.T @ (fe.M @ U))
    new = weight > least**2
    return np.asarray(U @ (turn[:, new] / np.sqrt(weight[new])))


def _constrained_fields(U: Array, fe: FEModel, B: Array) -> Array:
    """Add rigid motions until ``Bᵀ U = 0`` and U is M-orthogonal to the rigid motions that B leaves."""
    R = fe.rigid_modes
    U = U - R @ np.linalg.lstsq(B.T @ R, B.T @ U, rcond=None)[0]
    left = R @ null_space(B.T @ R)
    if left.shape[1]:
        U = U - left @ np.linalg.solve(left.T @ (fe.M @ left), left.T @ (fe.M @ U))
    return np.asarray(U)

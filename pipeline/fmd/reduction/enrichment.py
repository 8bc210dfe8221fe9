"""Enrichment of a truncated modal basis by static responses to the loads that its scene can produce.

Low free modes carry almost none of the stretch under centrifugal load, so stress from them alone is wrong however
many bending modes are kept. Load-dependent vectors mend it (MacNeal 1971, Wilson, Yuan & Dickens 1982).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh, null_space

from fmd.core.arrays import Array
from fmd.core.limits.modes import SOFTER
from fmd.core.limits.rank import NEW_RESPONSE
from fmd.reduction.modes import Modes

if TYPE_CHECKING:
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver


def enrich_modes(
    modes: Modes,
    fe: FEModel,
    solver: FreeBodySolver,
    loads: Array,
    held: Array | None = None,
    generations: int = 1,
    least: float = NEW_RESPONSE,
) -> tuple[Array, Array]:
    """Add the static responses to loads to a modal basis; orthonormalise and diagonalise again.

    Parameters
    ----------
    modes : Modes
        Eigenvectors; they come back unchanged in front of the new ones.
    fe : FEModel
        The finite element model.
    solver : FreeBodySolver
        Solves with the stiffness of ``fe``.
    loads : ndarray, shape (n_nodes, 3, n_loads)
        Nodal loads, as `fmd.reduction.loads` gives them.
    held : ndarray, shape (n_nodes, 3, k), optional
        Columns that hold the body in its modes; the responses are moved as rigid bodies until these hold them too.
    generations : int
        1 for the responses to the loads; each further one adds those to the inertia of the one before.
    least : float
        Part of a response's norm outside the modes from which on it is added, `NEW_RESPONSE` or `NEW_RESIDUAL_VECTOR`.

    Returns
    -------
    omega : ndarray, shape (n,)
        Angular frequencies of the enlarged basis [rad/s], ``Φᵀ K Φ = diag(ω²)``; n ≤ n_modes + generations · n_loads.
    shapes : ndarray, shape (n_nodes, 3, n)
        With unit modal mass [kg^-1/2].
    """
    Phi = modes.shapes.reshape(fe.K.shape[0], -1)
    B = None if held is None else held.reshape(fe.K.shape[0], -1)
    basis, response = Phi, solver.static_response(loads)
    for generation in range(generations):
        U = (solver.inertia_response(response) if generation else response).reshape(fe.K.shape[0], -1)
        U = _new_part(basis, U if B is None else _held_fields(U, fe, B), fe, least)
        basis, response = np.concatenate([basis, U], axis=1), U.reshape(len(fe.x), 3, -1)
        if not generation:
            softest = eigh(U.T @ (fe.K @ U), eigvals_only=True)[:1].min(initial=np.inf)
    U = basis[:, Phi.shape[1] :]
    omega2, turn = eigh(U.T @ (fe.K @ U))
    excited = omega2 >= SOFTER**2 * softest
    shapes = np.concatenate([Phi, U @ turn[:, excited]], axis=1).reshape(len(fe.x), 3, -1)
    return np.concatenate([modes.omega, np.sqrt(omega2[excited])]), shapes


def _new_part(basis: Array, U: Array, fe: FEModel, least: float) -> Array:
    """M-orthonormal columns of U's part outside an M-orthonormal basis."""
    U = U[:, U.any(axis=0)]
    U = U / np.sqrt(np.einsum("ij,ij->j", U, fe.M @ U))
    for _ in range(2):  # twice is enough (Parlett)
        U = U - basis @ (basis.T @ (fe.M @ U))
    weight, turn = eigh(U.T @ (fe.M @ U))
    new = weight > least**2
    return np.asarray(U @ (turn[:, new] / np.sqrt(weight[new])))


def _held_fields(U: Array, fe: FEModel, B: Array) -> Array:
    """Add rigid motions until ``Bᵀ U = 0`` and U is M-orthogonal to the rigid motions that B leaves."""
    R = fe.rigid_modes
    U = U - R @ np.linalg.lstsq(B.T @ R, B.T @ U, rcond=None)[0]
    left = R @ null_space(B.T @ R)
    if left.shape[1]:
        U = U - left @ np.linalg.solve(left.T @ (fe.M @ left), left.T @ (fe.M @ U))
    return np.asarray(U)

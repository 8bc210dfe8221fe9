"""Static responses that truncated free modes lack: to inertia loads and to the reaction at the joint.

Low free modes carry almost none of the stretch under centrifugal load, so stress from them alone is wrong however
many bending modes are kept. Load-dependent vectors mend it (MacNeal 1971, Wilson, Yuan & Dickens 1982).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from pipeline.checks import Array
from pipeline.reduction.modes import Modes

if TYPE_CHECKING:
    from pipeline.fem.marker import Marker
    from pipeline.fem.model import FEModel
    from pipeline.reduction.eigen import FreeBodySolver

# A static response with less than this part of its norm outside the modes adds nothing but round-off.
_NEW = 1e-4


def inertia_loads(fe: FEModel, marker: Marker, axis: Array) -> Array:
    """Loads that a spin about ``axis`` through the marker puts on the body, shape (n_nodes, 3, 4).

    The centrifugal load of unit rate, and what the joint can answer with: unit forces in the plane of motion and
    a unit torque about the axis, spread over the marker's face. The Euler load of an angular acceleration is not
    among them: in a free body it is balanced by itself, what it bends comes from the torque.
    """
    e = axis / np.linalg.norm(axis)
    r = fe.x - marker.position
    in_plane = np.eye(3) - np.outer(e, e)
    loads = np.zeros((len(fe.x), 3, 4))
    loads[:, :, 0] = fe.m @ (r @ in_plane)
    first, second = np.linalg.svd(in_plane)[0].T[:2]
    loads[marker.nodes, :, 1] = marker.translation_weights[:, None] * first
    loads[marker.nodes, :, 2] = marker.translation_weights[:, None] * second
    loads[marker.nodes, :, 3] = np.tensordot(e, marker.rotation_weights, axes=1)
    return loads


def enriched(modes: Modes, fe: FEModel, solver: FreeBodySolver, loads: Array) -> tuple[Array, Array]:
    """Add the static responses to ``loads`` to a modal basis; orthonormalise and diagonalise again.

    Parameters
    ----------
    modes : Modes
        Eigenvectors; they come back unchanged in front of the new ones.
    loads : ndarray, shape (n_nodes, 3, n_loads)

    Returns
    -------
    omega : ndarray, shape (n,)
        Angular frequencies of the enlarged basis [rad/s], ``Φᵀ K Φ = diag(ω²)``; n ≤ n_modes + n_loads.
    shapes : ndarray, shape (n_nodes, 3, n)
        With unit modal mass [kg^-1/2].
    """
    U = solver.static_response(loads).reshape(fe.K.shape[0], -1)
    Phi = modes.shapes.reshape(fe.K.shape[0], -1)
    U = U[:, U.any(axis=0)]
    U /= np.sqrt(np.einsum("ij,ij->j", U, fe.M @ U))
    for _ in range(2):  # twice is enough (Parlett)
        U -= Phi @ (Phi.T @ (fe.M @ U))
    weight, turn = eigh(U.T @ (fe.M @ U))
    new = weight > _NEW**2
    U = U @ (turn[:, new] / np.sqrt(weight[new]))
    omega2, turn = eigh(U.T @ (fe.K @ U))
    U = U @ turn
    shapes = np.concatenate([Phi, U], axis=1).reshape(len(fe.x), 3, -1)
    return np.concatenate([modes.omega, np.sqrt(omega2)]), shapes

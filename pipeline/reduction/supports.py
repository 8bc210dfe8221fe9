"""Supports: unknowns of a body that are held, what they leave of its rigid motion, and the loads they answer to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import null_space

from pipeline.core.arrays import Array, IntArray

if TYPE_CHECKING:
    from pipeline.fem.model import FEModel

# Rows of the rigid motions below this part of the largest are round-off of the nodes' positions.
_HELD = 1e-9


def rigid_motions_left(fe: FEModel, fixed: IntArray) -> Array:
    """Rigid motions, to first order, in which no held unknown moves.

    Six less the rank of the rigid motions' rows at the held unknowns: what the supports say, by statics alone, that the
    modes must bring forth again at zero frequency.

    Parameters
    ----------
    fixed : ndarray of int
        Held unknowns; ``3 i + a`` is node i along axis a.

    Returns
    -------
    ndarray, shape (3 n_nodes, k)
        Zero at the held unknowns.
    """
    x = fe.x - fe.x.mean(axis=0)
    turns = np.cross(np.eye(3), x[:, None]).swapaxes(1, 2) / np.ptp(x, axis=0).max()  # displacements of like size
    R = np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), turns], axis=2).reshape(-1, 6)
    left = np.asarray(R @ null_space(R[fixed], rcond=_HELD))
    left[fixed] = 0.0
    return left


def without(T: Any, fixed: IntArray, n_rigid_faces: int) -> sp.csr_array:
    """Take the held unknowns out of a transformation ``u = T u_r``, whose last columns move rigid faces.

    Raises
    ------
    ValueError
        A rigid face is held at a node: its other nodes would be held too.
    """
    columns = np.unique(T[fixed].indices)
    if columns.size and columns[-1] >= T.shape[1] - 6 * n_rigid_faces:
        raise ValueError("a support and a rigid face share nodes; make the attachment 'averaged'")
    return sp.csr_array(T[:, np.setdiff1d(np.arange(T.shape[1]), columns)])


def acceleration_loads(fe: FEModel, centre: Array, axis: Array | None) -> Array:
    """Inertia loads of a support that is moved, shape (n_nodes, 3, n_loads).

    Unit linear accelerations and unit angular accelerations about a centre (3,) [m]: three of each, or the two and the
    one that keep to the plane with normal ``axis``. A free body balances them by itself, a supported one bends.
    """
    r = fe.x - centre
    if axis is None:
        moves, turns = np.eye(3), np.eye(3)
    else:
        e = axis / np.linalg.norm(axis)
        moves, turns = np.linalg.svd(np.eye(3) - np.outer(e, e))[0].T[:2], e[None]
    fields = [np.tile(e, (len(r), 1)) for e in moves] + [np.cross(e, r) for e in turns]
    return np.stack([fe.m @ field for field in fields], axis=-1)

"""Rigid pieces of a body: how its independent unknowns move where some of its points move as one."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fmd.core.arrays import Array, IntArray
from fmd.core.rotations import rigid_motions


def rigid_unknowns(T: sp.csr_array, x: Array, nodes: IntArray, at: Array) -> tuple[IntArray, Array]:
    """Return the unknowns that move nodes, and their values for the motions of a rigid piece.

    Parameters
    ----------
    T : sparse array, shape (3 n_points, n)
        How points move by the unknowns.
    x : ndarray, shape (n_points, 3)
        Positions of the points [m].
    nodes : ndarray, shape (k,)
        Points of the rigid piece. If other unknowns than their own displacements move them, as those of a shell's
        nodes, all points that these move belong to the piece.
    at : ndarray, shape (3,)
        Its reference point [m].

    Returns
    -------
    unknowns : ndarray, shape (m,)
    values : ndarray, shape (m, 6)
        By displacement and rotation of the reference.
    """
    rows = sp.csr_array(T[(3 * nodes[:, None] + np.arange(3)).ravel()])
    if len(rows.indices) == rows.shape[0] and (rows.data == 1.0).all():
        return rows.indices, rigid_motions(x[nodes] - at).reshape(-1, 6)
    unknowns = np.unique(rows.indices)
    points, part = moved_points(T, unknowns)
    rigid = part.T @ rigid_motions(x[points] - at).reshape(-1, 6)
    return unknowns, np.asarray(splu(sp.csc_array(part.T @ part)).solve(rigid))


def moved_points(T: sp.csr_array, unknowns: IntArray) -> tuple[IntArray, sp.csr_array]:
    """Return the points (k,) that unknowns (m,) move, and the rows and columns of both in T, shape (3 k, m)."""
    moved = sp.csc_array(T[:, unknowns])
    points = np.unique(moved.indices // 3)
    return points, sp.csr_array(sp.csr_array(moved)[(3 * points[:, None] + np.arange(3)).ravel()])


def arms_of_unknowns(T: sp.csr_array, unknowns: IntArray, values: Array) -> tuple[IntArray, Array]:
    """Return the points that a rigid piece moves by its unknowns, and the arm (k, 3) by which each turns with it.

    A shell's node whose displacement alone belongs to the piece carries its points on its own arm.
    """
    points, part = moved_points(T, unknowns)
    turned = (part @ values[:, 3:]).reshape(-1, 3, 3)  # θ × r, a column for each axis
    skew = 0.5 * (turned - turned.swapaxes(1, 2))
    return points, np.stack([skew[:, 1, 2], skew[:, 2, 0], skew[:, 0, 1]], axis=1)

"""Rigid pieces of a body: how its independent unknowns move where some of its points move as one."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.rotations import rigid_motions
from fmd.fem.constraints import rows_of


def rigid_unknowns(T: sp.csr_array, x: Array, nodes: IntArray, at: Array) -> tuple[IntArray, Array]:
    """Return the unknowns (m,) that move nodes, and their values (m, 6) for the motions of a rigid piece.

    Points at x (n_points, 3) [m] move by the unknowns as T (3 n_points, n) has it. If other unknowns than their own
    displacements move the piece's points, as those of a shell's nodes, all points that these alone move belong to the
    piece. Values are by displacement and rotation of its reference point ``at`` [m].
    """
    rows = sp.csr_array(T[rows_of(nodes)])
    if len(rows.indices) == rows.shape[0] and (rows.data == 1.0).all():
        return rows.indices, rigid_motions(x[nodes] - at).reshape(-1, 6)
    unknowns = np.unique(rows.indices)
    points, part = moved_points(T, unknowns)
    rigid = part.T @ rigid_motions(x[points] - at).reshape(-1, 6)
    return unknowns, np.asarray(splu(sp.csc_array(part.T @ part)).solve(rigid))


def moved_points(T: sp.csr_array, unknowns: IntArray) -> tuple[IntArray, sp.csr_array]:
    """Return the points (k,) that unknowns (m,) alone move, and the rows and columns of both in T, shape (3 k, m)."""
    touched = np.unique(sp.csc_array(T[:, unknowns]).indices // 3)
    rows = sp.csr_array(T[rows_of(touched)])
    others = np.ones(T.shape[1])
    others[unknowns] = 0.0
    alone = (abs(rows) @ others).reshape(-1, 3).max(axis=1) == 0.0
    points = touched[alone]
    return points, sp.csr_array(rows[np.repeat(alone, 3)][:, unknowns])


@dataclass(frozen=True)
class CarriedPoints:
    """Points that a rigid piece carries."""

    points: IntArray  # (k,)
    arms: Array  # (k, 3): arm by which each turns with the piece [m]
    beside: IntArray  # (l,): points that it moves together with other unknowns, as those inside of beams
    second: Array  # (k + l, 3, 3, 3): displacement of second order of all as the piece turns, as `Arms` has it [m]


def carried_points(
    T: sp.csr_array, unknowns: IntArray, values: Array, second_of: Callable[[Array], Array]
) -> CarriedPoints:
    """Return the points that a rigid piece moves by its unknowns, given their values by its motions.

    A shell's node whose displacement alone belongs to the piece carries its points on its own arm. ``second_of`` arms
    from the piece's reference, (k, 3) [m], is their ``second`` of `Arms`.
    """
    points, part = moved_points(T, unknowns)
    turned = (part @ values[:, 3:]).reshape(-1, 3, 3)  # θ × r, a column for each axis
    skew = 0.5 * (turned - turned.swapaxes(1, 2))
    arms = np.stack([skew[:, 1, 2], skew[:, 2, 0], skew[:, 0, 1]], axis=1)
    of_unknowns = np.zeros((len(unknowns), 9))
    own = np.flatnonzero((np.diff(part.indptr) == 1) & (abs(part).max(axis=1).toarray().ravel() == 1.0))
    second = second_of(arms)
    of_unknowns[part[own].indices] = second.reshape(-1, 9)[own]
    all_moved = np.unique(sp.csc_array(T[:, unknowns]).indices // 3)
    beside = np.setdiff1d(all_moved, points)
    rows = sp.csr_array(T[rows_of(beside)])[:, unknowns]
    inside = np.asarray(rows @ of_unknowns).reshape(-1, 3, 3, 3)
    return CarriedPoints(points, arms, beside, np.concatenate([second, inside]))

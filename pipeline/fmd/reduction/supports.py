"""Constraints on a body's unknowns: supports that fix some of them, and faces that move as rigid pieces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import null_space

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.round_off import SOLVED
from fmd.core.rotations import rigid_motions

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel


def remaining_rigid_motions(fe: FEModel, fixed: IntArray) -> Array:
    """Rigid motions of a supported body, to first order, in which none of the fixed unknowns moves.

    There are six less the rank of the rigid motions' rows at the fixed unknowns: by statics alone the number of modes
    that must come out with zero frequency.

    Parameters
    ----------
    fixed : ndarray of int
        Fixed unknowns; ``3 i + a`` is node i along axis a.

    Returns
    -------
    ndarray, shape (3 n_nodes, k)
        Zero at the fixed unknowns.
    """
    x = fe.x - fe.x.mean(axis=0)
    R = rigid_motions(x).reshape(-1, 6)
    R[:, 3:] /= np.ptp(x, axis=0).max()  # displacements of like size
    left = np.asarray(R @ null_space(R[fixed], rcond=SOLVED))
    left[fixed] = 0.0
    return left


def tie_rigid_faces(fe: FEModel, markers: Sequence[Marker]) -> sp.csr_array:
    """Make the transformation ``u = T u_r`` that lets each marker's face move as one rigid piece.

    Parameters
    ----------
    markers : sequence of Marker
        Their faces have no node in common.

    Returns
    -------
    sparse array, shape (3 n_nodes, n)
        Columns: the unknowns of all other nodes, those of links, then displacement and rotation of each marker.

    Raises
    ------
    ValueError
        Two faces share nodes, or a face and a link.
    """
    tied = np.concatenate([marker.nodes for marker in markers])
    if len(np.unique(tied)) < len(tied):
        raise ValueError("two rigid faces share nodes; make one of the attachments 'averaged'")
    own = (3 * tied[:, None] + np.arange(3)).ravel()
    n = fe.K.shape[0]
    if fe.T is not None:
        rows, n = sp.csr_array(fe.T[own]), fe.T.shape[1]
        own = rows.indices
        if len(own) != rows.shape[0] or (rows.data != 1.0).any():
            raise ValueError("a rigid face and a link share nodes; make the attachment 'averaged'")
    others = np.setdiff1d(np.arange(n), own)
    blocks = [sp.csr_array((np.ones(len(others)), (others, np.arange(len(others)))), (n, len(others)))]
    first = 0
    for marker in markers:
        moves = rigid_motions(fe.x[marker.nodes] - marker.position)
        rows = np.repeat(own[first : first + 3 * len(moves)], 6)
        columns = np.tile(np.arange(6), 3 * len(moves))
        blocks.append(sp.csr_array((moves.ravel(), (rows, columns)), (n, 6)))
        first += 3 * len(moves)
    tie = sp.csr_array(sp.hstack(blocks))
    return tie if fe.T is None else sp.csr_array(fe.T @ tie)


def remove_fixed_unknowns(T: Any, fixed: IntArray, n_linked: int) -> sp.csr_array:
    """Take the fixed unknowns out of a transformation ``u = T u_r``, whose last columns move rigid faces and links.

    Parameters
    ----------
    T : sparse array, shape (3 n_nodes, n)
        Transformation as `tie_rigid_faces` or `fmd.fem.links` makes it, or the identity.
    fixed : ndarray of int
        Fixed unknowns; ``3 i + a`` is node i along axis a.
    n_linked : int
        Number of the last columns that move rigid faces and links.

    Raises
    ------
    ValueError
        A rigid face, or another node that a link moves, is fixed: what moves with it would be fixed too.
    """
    rows = sp.csr_array(T[fixed])
    columns = np.unique(rows.indices)
    alone = len(rows.indices) == len(fixed) and bool((rows.data == 1.0).all())
    if columns.size and (columns[-1] >= T.shape[1] - n_linked or not alone):
        raise ValueError("a support and a rigid face share nodes; make the attachment 'averaged'")
    return sp.csr_array(T[:, np.setdiff1d(np.arange(T.shape[1]), columns)])

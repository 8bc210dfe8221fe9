"""Constraints on a body's unknowns: supports that fix some of them, and faces that move as rigid pieces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import null_space
from scipy.sparse.csgraph import connected_components

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.round_off import SOLVED
from fmd.core.rotations import rigid_motions
from fmd.fem.rigid_pieces import rigid_unknowns

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel


def remaining_rigid_motions(fe: FEModel, fixed: IntArray) -> Array:
    """Rigid motions (3 n_nodes, k) of a supported body, to first order, in which none of the fixed unknowns moves.

    There are six less the rank of the rigid motions' rows at the fixed unknowns, where ``3 i + a`` is node i along axis
    a: by statics alone the number of modes that must come out with zero frequency.
    """
    x = fe.x - fe.x.mean(axis=0)
    R = rigid_motions(x).reshape(-1, 6)
    R[:, 3:] /= np.ptp(x, axis=0).max()  # displacements of like size
    left = np.asarray(R @ null_space(R[fixed], rcond=SOLVED))
    left[fixed] = 0.0
    return left


def tie_rigid_faces(fe: FEModel, markers: Sequence[Marker]) -> sp.csr_array:
    """Make the transformation ``u = T u_r`` that lets each marker's face move as one rigid piece.

    Faces have no node in common. Columns of T are the unknowns of all other nodes, those of links, then displacement
    and rotation of each marker.

    Raises
    ------
    ValueError
        Two faces share nodes, or a face and a link.
    """
    tied = np.concatenate([marker.nodes for marker in markers])
    if len(np.unique(tied)) < len(tied):
        raise ValueError("two rigid faces share nodes; make one of the attachments 'averaged'")
    n = fe.K.shape[0] if fe.T is None else fe.T.shape[1]
    T = sp.csr_array(sp.eye_array(n, format="csr")) if fe.T is None else fe.T
    moved = [_moved_rigidly(fe, T, marker) for marker in markers]
    own = np.concatenate([unknowns for unknowns, _ in moved])
    if len(np.unique(own)) < len(own):
        raise ValueError("two rigid faces share nodes; make one of the attachments 'averaged'")
    others = np.setdiff1d(np.arange(n), own)
    blocks = [sp.csr_array((np.ones(len(others)), (others, np.arange(len(others)))), (n, len(others)))]
    for unknowns, moves in moved:
        place = np.repeat(unknowns, 6), np.tile(np.arange(6), len(unknowns))
        blocks.append(sp.csr_array((moves.ravel(), place), (n, 6)))
    tie = sp.csr_array(sp.hstack(blocks))
    return tie if fe.T is None else sp.csr_array(fe.T @ tie)


def _moved_rigidly(fe: FEModel, T: sp.csr_array, marker: Marker) -> tuple[IntArray, Array]:
    """Return the unknowns (n,) that move a marker's nodes, and their values (n, 6) for the motions of a rigid face.

    Raises
    ------
    ValueError
        A link moves some of the nodes.
    """
    unknowns, values = rigid_unknowns(T, fe.x, marker.nodes, marker.position)
    if unknowns.max() >= T.shape[1] - fe.link_unknowns:
        raise ValueError("a rigid face and a link share nodes; make the attachment 'averaged'")
    return unknowns, values


def remove_fixed_unknowns(T: Any, fixed: IntArray, n_linked: int) -> sp.csr_array:
    """Take fixed unknowns out of a transformation ``u = T u_r``: `tie_rigid_faces`, `fmd.fem.links`, or the identity.

    Unknown ``3 i + a`` is node i along axis a; the last ``n_linked`` columns of T move rigid faces and links.

    Raises
    ------
    ValueError
        A rigid face, or a node that a link moves, is fixed: what moves with it would be fixed too.
    """
    rows = sp.csr_array(T[fixed])
    columns = np.unique(rows.indices)
    if columns.size and columns[-1] >= T.shape[1] - n_linked:
        raise ValueError("a support and a rigid face share nodes; make the attachment 'averaged'")
    kept = sp.csr_array(T[:, np.setdiff1d(np.arange(T.shape[1]), columns)])
    if len(rows.indices) == len(fixed) and (rows.data == 1.0).all():
        return kept
    left = _motions_left(sp.csr_array(rows[:, columns]))
    link = T.shape[1] - n_linked
    n_before = int(np.searchsorted(np.setdiff1d(np.arange(T.shape[1]), columns), link))
    return sp.csr_array(sp.hstack([kept[:, :n_before], T[:, columns] @ left, kept[:, n_before:]]))


def _motions_left(C: sp.csr_array) -> sp.csr_array:
    """Return a basis of the unknowns with ``C u = 0``, node by node, shape (n, n_left)."""
    n_rows, n = C.shape
    row, column = C.nonzero()
    graph = sp.coo_array((np.ones(len(row)), (row, n_rows + column)), shape=2 * [n_rows + n])
    label = connected_components(graph, directed=False)[1]
    blocks, rows, columns, first = [], [], [], 0
    order = np.argsort(label[n_rows:], kind="stable")
    for own in np.split(order, np.flatnonzero(np.diff(label[n_rows:][order])) + 1):
        part = C[np.flatnonzero(label[:n_rows] == label[n_rows + own[0]])][:, own].toarray()
        basis = null_space(part, rcond=SOLVED)
        place = np.indices(basis.shape)
        blocks.append(basis.ravel())
        rows.append(own[place[0]].ravel())
        columns.append(first + place[1].ravel())
        first += basis.shape[1]
    data = np.concatenate(blocks), (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array(data, shape=(n, first))

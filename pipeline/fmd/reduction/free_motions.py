"""Shapes without stiffness that are more or fewer than a body's rigid motions, which points move so, and its pieces."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.core.limits.modes import MOVES_FREELY, NAMED_AT_MOST, ROBUST_FITS
from fmd.fem.model import FEModel
from fmd.reduction.inertia_relief import THIN


def wrong_count(
    fe: FEModel, shapes: Array, rigid: Array, expected: int, eigenvalues: Array, limits: tuple[float, float]
) -> AccuracyError:
    """Return the fault that shapes (n_nodes, 3, n) without stiffness aren't as many as the rigid motions of a body.

    ``limits`` are the eigenvalue below which one counts as zero, and what round-off alone leaves [rad²/s²].
    """
    zero, rounded = limits
    lowest = ", ".join(f"{value:.1e}" for value in eigenvalues[:8])
    whole = "a free body" if expected == 6 else "the body with its constraints"
    why = f"; round-off alone leaves {rounded:.0e} rad²/s², {THIN}" if rounded > zero else ""
    if not why and shapes.shape[2] > expected:
        why = f"; what moves or turns freely beside the rest: {_free_points(fe, shapes, rigid)}"
    return AccuracyError(
        f"found {shapes.shape[2]} rigid-body modes, {whole} has {expected}; the lowest eigenvalues are {lowest} "
        f"rad²/s², of which those below {zero:.1e} count as zero{why}"
    )


def _free_points(fe: FEModel, shapes: Array, rigid: Array) -> str:
    """Name the points that move in shapes (n_nodes, 3, n) beyond rigid motions (3 n_nodes, r)."""
    flat = shapes.reshape(len(rigid), -1)
    moved = np.linalg.norm(flat.reshape(len(fe.x), -1), axis=1)
    for _ in range(ROBUST_FITS if rigid.size else 0):
        # Weighted so that the sum of distances is least, and most points don't move.
        weighted = rigid.T / np.repeat(np.maximum(moved, MOVES_FREELY**2 * moved.max()), 3)
        beyond = flat - rigid @ (np.linalg.pinv(weighted @ rigid) @ (weighted @ flat))
        moved = np.linalg.norm(beyond.reshape(len(fe.x), -1), axis=1)
    free = np.flatnonzero(moved > MOVES_FREELY * moved.max())
    names = list(dict.fromkeys(fe.name_point(k) for k in free[np.argsort(-moved[free], kind="stable")]))
    more = f" and {len(names) - NAMED_AT_MOST} more" if len(names) > NAMED_AT_MOST else ""
    return ", ".join(names[:NAMED_AT_MOST]) + more


def count_pieces(K: sp.csr_array, T: sp.csr_array | None = None) -> int:
    """Count the pieces of a body that its stiffness matrix leaves unconnected.

    Masses say nothing of it: lumped ones connect no node with another. K has three unknowns a node and a symmetric
    pattern; independent unknowns, by which the nodes move by T (3 n_nodes, n), connect them, too.
    """
    if T is not None:
        entries, n_points = sp.coo_array(T), K.shape[0]
        extended = sp.coo_array(K)
        rows = [extended.coords[0], entries.coords[0], np.arange(0, n_points, 3), np.arange(0, n_points, 3)]
        columns = [extended.coords[1], n_points + entries.coords[1], *(np.arange(k, n_points, 3) for k in (1, 2))]
        place = np.concatenate(rows), np.concatenate(columns)
        graph = sp.coo_array((np.ones(len(place[0])), place), shape=(sum(T.shape),) * 2)
        return int(connected_components(graph, directed=False, return_labels=False))
    # Strongly connected parts are connected ones where the pattern is symmetric, and take no transpose. One piece by
    # motions along x alone is one in any case.
    if connected_components(K[::3, ::3], directed=True, connection="strong", return_labels=False) == 1:
        return 1
    _, piece = connected_components(K, directed=True, connection="strong")
    x, y, z = piece.reshape(-1, 3).T
    n = int(piece.max()) + 1
    within = sp.coo_array((np.ones(2 * len(x)), (np.r_[x, x], np.r_[y, z])), shape=(n, n))
    return int(connected_components(within, directed=False, return_labels=False))

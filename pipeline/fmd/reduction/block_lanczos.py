"""Lanczos' method with blocks of vectors, for factors that solve for some loads in the time of one.

References
----------
Grimes, Lewis & Simon, A shifted block Lanczos algorithm for solving sparse symmetric generalized eigenproblems, SIAM
Journal on Matrix Analysis and Applications 15, 1994. Wu & Simon, Thick-restart Lanczos method for large symmetric
eigenvalue problems, SIAM Journal on Matrix Analysis and Applications 22, 2000.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.core.limits.modes import BLOCK_RESTARTS, DEPENDENT, EVEN, LANCZOS_RESIDUAL, LEFT, NEARLY_CONVERGED, PASSES


def largest_pairs(
    inverse: Callable[[Array], Array], M: Any, Z: Array, count: int, size: int, start: Array
) -> tuple[Array, Array, Array]:
    """Find the largest eigenvalues of ``A⁻¹ M`` outside known eigenvectors Z (n, k), ``Zᵀ M Z = 1``.

    Vectors are M-orthogonal to all others by two projections or more. They begin with ``start`` (n, block); a full
    basis of ``size`` is cut to its best Ritz vectors, with which the last block goes on. ``inverse`` is ``A⁻¹`` of
    loads (n, k), and M (n, n) sparse. Returned are ``count`` eigenvalues, descending, and vectors (n, count), ``Φᵀ M Φ
    = 1``, and further ones (n, k) that have nearly converged beside them.

    Raises
    ------
    AccuracyError
        Not all have converged after many restarts.
    """
    (n, block), known = start.shape, Z.shape[1]
    Q, MQ = np.empty((2, known + size + block, n))  # vectors in rows
    Q[:known], MQ[:known] = Z.T, (M @ Z).T
    H = np.zeros((size + block, size + block))
    filled, restarts = known, 0
    q, Mq, c, R = orthonormal_rows(inverse(M @ start).T, M, (Q[:known], MQ[:known]))
    while True:
        last, filled = filled, filled + len(q)
        Q[last:filled], MQ[last:filled] = q, Mq
        q, Mq, c, R = orthonormal_rows(inverse(Mq.T).T, M, (Q[:filled], MQ[:filled]))
        new, end = slice(last - known, filled - known), filled - known
        H[new, :end] = c[:, known:]
        H[:end, new] = c[:, known:].T
        if end < min(count, size - len(q) + 1) and len(q):
            continue
        theta, S = np.linalg.eigh(H[:end, :end])
        theta, S = theta[::-1], S[:, ::-1]
        defects = np.linalg.norm(R.T @ S[new], axis=0)
        converged = defects[:count] < LANCZOS_RESIDUAL * theta[:count]
        if (converged.all() and end >= count) or not len(q):
            near = count + np.flatnonzero(defects[count:] < NEARLY_CONVERGED * theta[count:])
            found, others = (np.ascontiguousarray((S[:, own].T @ Q[known:filled]).T) for own in (slice(count), near))
            return theta[:count], found, others
        if end + len(q) > size:
            if restarts == BLOCK_RESTARTS:
                raise AccuracyError(
                    f"{np.count_nonzero(converged)} of {count} modes have converged after {restarts} restarts of "
                    "Lanczos' method; ask for fewer modes"
                )
            kept = (count + size) // 2
            for basis in (Q, MQ):
                basis[known : known + kept] = S[:, :kept].T @ basis[known:filled]
            H[:] = 0.0
            H[range(kept), range(kept)] = theta[:kept]
            filled, restarts = known + kept, restarts + 1


def orthonormal_rows(W: Array, M: Any, *bases: tuple[Array, Array]) -> tuple[Array, Array, Array, Array]:
    """Write rows as ``W = c Q + R q`` with ``q M qᵀ = 1``; returns q, ``q M``, the last basis' c, and R.

    Q are the rows of all bases, each given with ``Q M``. q has fewer rows where W depends on Q. One pass does where it
    leaves enough of all rows; else the first goes by the Euclidean norm, and what has no mass by M is left out.
    """
    c, R, whole = np.zeros((len(W), len(bases[-1][0]))), np.eye(len(W)), np.einsum("ij,ij->i", W, W).max()
    for taken in range(PASSES):
        taken_off = 0.0
        for Q, MQ in bases:
            part = W @ MQ.T
            W = W - part @ Q
            taken_off = max(taken_off, np.einsum("ij,ij->i", part, part).max())
        c += R @ part
        MW = np.ascontiguousarray((M @ W.T).T)
        squares, V = np.linalg.eigh(W @ MW.T)
        is_even = squares[0] > max(EVEN * squares[-1], LEFT * taken_off)
        if not taken and not is_even:
            MW = W
            squares, V = np.linalg.eigh(W @ MW.T)
        kept = squares > (DEPENDENT**2 * whole if taken == 0 else -np.inf)
        if taken == PASSES - 1:
            kept = squares > 0.5 * squares[-1]
        sizes = np.sqrt(np.maximum(squares, np.finfo(float).eps * squares[-1]))[kept]
        turn = V[:, kept] / sizes
        W, MW, R = turn.T @ W, turn.T @ MW, R @ (V[:, kept] * sizes)
        if taken == 1:  # what has no mass is no more than round-off by M
            kept = np.linalg.norm(R, axis=0) > DEPENDENT * np.hypot(np.linalg.norm(c), np.linalg.norm(R))
            W, MW, R = W[kept], MW[kept], R[:, kept]
        if not len(W) or is_even:
            break
    return W, MW, c, R

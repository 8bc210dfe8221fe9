"""Small motions that the loops of a mechanism leave free in its reference state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.rank import DEPENDENT_CONSTRAINT


class FreeMotion(NamedTuple):
    """Mass, stiffness and damping (n, n) of the motions that are free, the slow ones first, and their number."""

    M: Array
    K: Array
    C: Array
    n_slow: int


def free_motion(M: Array, K: Array, C: Array, n_slow: int, J: Array) -> FreeMotion:
    """Reduce matrices (n, n) to the motions that constraints ``J v = 0``, (n_rows, n), leave free.

    These are the motions of slow coordinates alone, and those of fast ones to which the slow ones react at once, by
    their inertia and by the constraints: ``M_LL D + J_Lᵀ μ = M_LS``, ``J_L D = J_S``. The two don't couple by the mass.
    Without constraints the matrices stay as they are.
    """
    if not len(J):
        return FreeMotion(M, K, C, n_slow)
    slow, fast = slice(0, n_slow), slice(n_slow, None)
    alone = _null_space(J[:, slow])
    D = np.linalg.pinv(J[:, slow], rcond=DEPENDENT_CONSTRAINT) @ J[:, fast]
    if alone.shape[1]:
        left = alone.T @ (M[slow, fast] - M[slow, slow] @ D)
        D = D + alone @ np.linalg.solve(alone.T @ M[slow, slow] @ alone, left)
    answered = _null_space(J[:, fast] - J[:, slow] @ D)  # constraints that no slow coordinate can keep
    T = np.block([[alone, -D @ answered], [np.zeros((len(M) - n_slow, alone.shape[1])), answered]])
    return FreeMotion(T.T @ M @ T, T.T @ K @ T, T.T @ C @ T, alone.shape[1])


def _null_space(A: Array) -> Array:
    """Return an orthonormal basis (n, k) of what a matrix (m, n) takes to zero."""
    if not A.size:
        return np.eye(A.shape[1])
    _, sizes, directions = np.linalg.svd(A)
    rank = int((sizes > DEPENDENT_CONSTRAINT * max(1.0, float(sizes.max()))).sum())
    return np.asarray(directions[rank:].T)

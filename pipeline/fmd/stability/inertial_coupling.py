"""Inertial coupling of slow and fast coordinates, apart from stability limits, which a run may not need."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array


def inertial_coupling(M: Array, n_slow: int) -> float:
    """Return the largest canonical correlation of slow and fast coordinates in a mass matrix: 0 if they don't couple.

    It is the largest ``x_Lᵀ M_LS x_S`` for ``x_Lᵀ M_LL x_L = x_Sᵀ M_SS x_S = 1``, and always below 1.
    """
    if not 0 < n_slow < len(M):
        return 0.0
    L, S = (np.linalg.cholesky(M[part, part]) for part in (slice(0, n_slow), slice(n_slow, None)))
    return float(np.linalg.norm(np.linalg.solve(L, np.linalg.solve(S, M[n_slow:, :n_slow]).T), 2))

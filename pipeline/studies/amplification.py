"""What one major cycle of sub-cycling does to a linear system: Miao et al. (2008), eqs. (8)–(11)."""

from __future__ import annotations

import numpy as np

from pipeline.checks import Array


def amplification_matrix(M: Array, K: Array, n_slow: int, step: float, substeps: int) -> Array:
    """Map of positions and half-step-late rates over one major cycle of ``M q̈ + K q = 0``, shape (2n, 2n).

    Parameters
    ----------
    M, K : ndarray, shape (n, n)
        Mass and stiffness, slow coordinates first.
    n_slow : int
        Number of slow coordinates.
    step : float
        Fast step [s].
    substeps : int
        Fast steps to a major cycle.
    """
    n, L, S = len(M), slice(0, n_slow), slice(n_slow, None)
    q, v = np.eye(n, 2 * n), np.eye(n, 2 * n, n)
    a = -np.linalg.solve(M, K @ q)
    held = K[S, L] @ q[L] + M[S, L] @ a[L]
    v[L] += substeps * step * a[L]
    q[L] += substeps * step * v[L]
    fast = a[S]
    for _ in range(substeps):
        v[S] += step * fast
        q[S] += step * v[S]
        fast = -np.linalg.solve(M[S, S], K[S, S] @ q[S] + held)
    return np.concatenate([q, v])


def growth(M: Array, K: Array, n_slow: int, step: float, substeps: int) -> float:
    """Spectral radius of `amplification_matrix`."""
    return float(np.abs(np.linalg.eigvals(amplification_matrix(M, K, n_slow, step, substeps))).max())

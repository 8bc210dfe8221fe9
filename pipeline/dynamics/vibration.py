"""Angular frequencies of ``M q̈ + K q = 0``, from which all limits of explicit steps follow."""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import Array


def frequencies(M: Array, K: Array) -> Array:
    """Return the angular frequencies of an undamped system, ascending.

    Parameters
    ----------
    M, K : ndarray, shape (n, n)
        Mass, positive definite, and stiffness.

    Returns
    -------
    ndarray, shape (n,)
        [rad/s]; 0 where a vibration has no stiffness, or a negative one.
    """
    if not len(M):
        return np.zeros(0)
    L = np.linalg.cholesky(M)
    scaled = np.linalg.solve(L, np.linalg.solve(L, K).T)  # L⁻¹ K L⁻ᵀ
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(0.5 * (scaled + scaled.T)), 0.0)))


def highest_frequency(M: Array, K: Array) -> float:
    """Return the highest angular frequency of an undamped system [rad/s]; never 0, for steps divide by it."""
    return float(frequencies(M, K).max(initial=1e-150))

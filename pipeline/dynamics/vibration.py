"""Angular frequencies of ``M q̈ + K q = 0``, from which all limits of explicit steps follow."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

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
    return np.sqrt(np.maximum(eigh(K, M, eigvals_only=True), 0.0)) if len(M) else np.zeros(0)


def highest_frequency(M: Array, K: Array) -> float:
    """Return the highest angular frequency of an undamped system [rad/s]; never 0, for steps divide by it."""
    return float(frequencies(M, K).max(initial=1e-150))

"""Frequencies of ``M q̈ + K q = 0``: every limit of a step rests on them."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from pipeline.core.arrays import Array


def frequencies(M: Array, K: Array) -> Array:
    """Angular frequencies [rad/s] of a mass and a stiffness matrix (n, n), ascending; 0 where nothing pulls back."""
    return np.sqrt(np.maximum(eigh(K, M, eigvals_only=True), 0.0)) if len(M) else np.zeros(0)


def highest_frequency(M: Array, K: Array) -> float:
    """The highest of them; all but 0, so that steps may be divided by it, if there is none."""
    return float(frequencies(M, K).max(initial=1e-150))

"""Amplification matrix of one major cycle of sub-cycling: Miao et al. (2008), eqs. (8)–(11).

The state is what an explicit march keeps: positions, rates half a step behind them, and the last accelerations, which
predict the rates that damping and gyroscopic terms are taken at.
"""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array


def amplification_matrix(M: Array, K: Array, n_slow: int, step: float, substeps: int, C: Array | None = None) -> Array:
    """Return the map (3n, 3n) of positions, rates and accelerations over one major cycle of ``M q̈ + C q̇ + K q = 0``.

    Slow coordinates of the matrices (n, n) are first; the step is the fast one [s].
    """
    n, L, S = len(M), slice(0, n_slow), slice(n_slow, None)
    C = np.zeros_like(K) if C is None else C
    q, v, a = np.eye(3 * n).reshape(3, n, 3 * n)
    lag = np.full((n, 1), 0.5 * step)
    lag[L] *= substeps
    now = v + lag * a
    a[:] = -np.linalg.solve(M, K @ q + C @ now)
    frozen = K[S, L] @ q[L] + C[S, L] @ now[L] + M[S, L] @ a[L]
    v[L] += substeps * step * a[L]
    q[L] += substeps * step * v[L]
    for k in range(substeps):
        if k:
            now[S] = v[S] + 0.5 * step * a[S]
            a[S] = -np.linalg.solve(M[S, S], K[S, S] @ q[S] + C[S, S] @ now[S] + frozen)
        v[S] += step * a[S]
        q[S] += step * v[S]
    return np.concatenate([q, v, a])


def cycle_growth(M: Array, K: Array, n_slow: int, step: float, substeps: int, C: Array | None = None) -> float:
    """Return the spectral radius of `amplification_matrix`: the largest growth of a vibration over a major cycle."""
    return spectral_radius(amplification_matrix(M, K, n_slow, step, substeps, C))


def spectral_radius(A: Array) -> float:
    """Return the largest modulus of the eigenvalues of a matrix of shape (n, n)."""
    return float(np.abs(np.linalg.eigvals(A)).max())

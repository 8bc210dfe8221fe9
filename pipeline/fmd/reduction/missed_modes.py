"""A check that a search for the lowest modes has missed none of them.

A single vector that Lanczos starts from can miss one of several modes of equal frequency, and single vectors are what
SciPy's `eigsh` works with. With all modes known so far taken out, a new random vector meets a missed one as the lowest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import eigh_tridiagonal

from fmd.core.arrays import Array
from fmd.core.limits.modes import EQUAL_EIGENVALUES, FEWEST_STEPS, MOST_STEPS, TOUCHING


def missed_eigenvalue(
    M: Any, Phi: Array, inverse: Callable[[Array], Array], shift: float, highest: float
) -> float | None:
    """Return an eigenvalue below the highest known one that belongs to none of the known modes.

    Parameters
    ----------
    M : sparse array, shape (n, n)
        Mass matrix.
    Phi : ndarray, shape (n, k)
        Known modes, rigid-body modes included, ``Φᵀ M Φ = 1``.
    inverse : callable
        ``(K − σ M)⁻¹``, symmetric.
    shift : float
        σ [rad²/s²].
    highest : float
        Highest eigenvalue of the known modes [rad²/s²].

    Returns
    -------
    float or None
        Upper bound of the missed eigenvalue [rad²/s²]; ``None`` if no mode is missing.
    """
    missed = shift + 1.0 / _largest_remaining(M, Phi, inverse, 1.0 / (highest - shift))
    return missed if missed < highest * (1 - EQUAL_EIGENVALUES) else None


def _largest_remaining(M: Any, Phi: Array, inverse: Callable[[Array], Array], known: float) -> float:
    """Largest Ritz value of ``A⁻¹ M`` by Lanczos' method among the fields that are M-orthogonal to Φ.

    The search ends as soon as the value, or its error bound, has passed ``known``, the smallest that belongs to Φ.
    """
    MPhi = M @ Phi

    def outside(u: Array) -> Array:
        return np.asarray(u - Phi @ (MPhi.T @ u))

    q = outside(inverse(M @ np.random.default_rng(1).standard_normal(len(Phi))))
    q /= np.sqrt(q @ (M @ q))
    Q, MQ = [q], [M @ q]
    diagonal: list[float] = []
    beside: list[float] = []
    theta = 0.0
    for step in range(min(MOST_STEPS, len(Phi) - Phi.shape[1])):
        w = outside(inverse(MQ[-1]))
        diagonal.append(float(MQ[-1] @ w))
        for _ in range(2):  # orthogonalised twice against all vectors: no value comes twice by round-off
            w = outside(w)
            for old, M_old in zip(Q, MQ, strict=True):
                w -= (M_old @ w) * old
        size = float(np.sqrt(w @ (M @ w)))
        values, vectors = eigh_tridiagonal(diagonal, beside)
        theta, error = float(values[-1]), size * abs(float(vectors[-1, -1]))
        gap = theta - values[-2] if len(values) > 1 else 0.0
        bound = theta + (error**2 / gap if gap > error else error)
        converged = step >= FEWEST_STEPS and bound < known * (1 + TOUCHING)
        if converged or theta > known * (1 + TOUCHING) or not size > 0.0:
            break
        beside.append(size)
        Q.append(w / size)
        MQ.append(M @ Q[-1])
    return theta

"""A second look for modes that a first search has missed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import eigh_tridiagonal

from pipeline.core.arrays import Array

_FEWEST_STEPS, _MOST_STEPS = 10, 60  # a Ritz value settles on what is there only after some
_TOUCHING = 1e-6


def largest_outside(M: Any, Z: Array, inverse: Callable[[Array], Array], known: float) -> float:
    """Largest eigenvalue θ of ``A⁻¹ M`` among the fields that are M-orthogonal to Z, if it is above ``known``.

    A single vector that Lanczos starts from can miss one of several modes of equal frequency, and single vectors are
    what `eigsh` works with. With all that it found taken out, a new random vector meets a missed mode as the largest.

    Parameters
    ----------
    M : sparse array, shape (n, n)
        Mass matrix.
    Z : ndarray, shape (n, k)
        Fields found before, ``Zᵀ M Z = 1``.
    inverse : callable
        ``A⁻¹``, symmetric.
    known : float
        The smallest eigenvalue that belongs to Z.

    Returns
    -------
    float
        A Ritz value, never above θ. The search ends as soon as the value, or its error bound, has passed ``known``.
    """
    MZ = M @ Z

    def outside(u: Array) -> Array:
        return np.asarray(u - Z @ (MZ.T @ u))

    q = outside(inverse(M @ np.random.default_rng(1).standard_normal(len(Z))))
    q /= np.sqrt(q @ (M @ q))
    Q, MQ = [q], [M @ q]
    diagonal: list[float] = []
    beside: list[float] = []
    theta = 0.0
    for step in range(min(_MOST_STEPS, len(Z) - Z.shape[1])):
        w = outside(inverse(MQ[-1]))
        diagonal.append(float(MQ[-1] @ w))
        for _ in range(2):
            w = outside(w)
            for old, M_old in zip(Q, MQ, strict=True):
                w -= (M_old @ w) * old
        size = float(np.sqrt(w @ (M @ w)))
        values, vectors = eigh_tridiagonal(diagonal, beside)
        theta, error = float(values[-1]), size * abs(float(vectors[-1, -1]))
        gap = theta - values[-2] if len(values) > 1 else 0.0
        settled = step >= _FEWEST_STEPS and theta + (error**2 / gap if gap > error else error) < known * (1 + _TOUCHING)
        if settled or theta > known * (1 + _TOUCHING) or not size > 0.0:
            break
        beside.append(size)
        Q.append(w / size)
        MQ.append(M @ Q[-1])
    return theta

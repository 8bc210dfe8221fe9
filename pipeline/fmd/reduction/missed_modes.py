"""A check that a search for the lowest modes has missed none of them.

A single vector that Lanczos starts from can miss one of several modes of equal frequency, and single vectors are what
SciPy's `eigsh` works with. With all modes known so far taken out, new random vectors meet a missed one as the lowest.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.modes import EQUAL_EIGENVALUES, FEWEST_BLOCKS, FEWEST_STEPS, MOST_STEPS, SEED, TOUCHING
from fmd.reduction.block_lanczos import orthonormal_rows


def missed_eigenvalue(
    M: Any, Phi: Array, inverse: Callable[[Array], Array], shift: float, highest: float, block: int = 1
) -> float | None:
    """Return an eigenvalue below the highest known one that belongs to none of the known modes.

    That is an upper bound of it [rad²/s²], or ``None`` if no mode is missing. Known modes (n, k), rigid-body modes
    included, have ``Φᵀ M Φ = 1`` and eigenvalues up to ``highest`` [rad²/s²], or higher ones. At the ``shift`` σ
    [rad²/s²] ``inverse`` is ``(K − σ M)⁻¹``, symmetric, and takes ``block`` vectors at a time. The search, Lanczos'
    method among fields that are M-orthogonal to Φ, ends as soon as its largest Ritz value, or the bound of that,
    decides.
    """
    known = (1 + TOUCHING) / (highest - shift)
    n, first = Phi.shape
    start = M @ np.random.default_rng(SEED).standard_normal((n, block))
    modes, H = (Phi.T, (M @ Phi).T), np.zeros((0, 0))
    Q, MQ = np.zeros((2, 0, n))
    q, Mq, _, _ = orthonormal_rows(inverse(start).T, M, modes)
    theta, fewest = 0.0, FEWEST_STEPS if block == 1 else FEWEST_BLOCKS
    for step in range(min(MOST_STEPS, (n - first) // block)):
        if not len(q):
            break
        Q, MQ = np.concatenate([Q, q]), np.concatenate([MQ, Mq])
        q, Mq, c, R = orthonormal_rows(inverse(Mq.T).T, M, modes, (Q, MQ))
        H = np.block([[H, c[:, : len(H)].T], [c]])
        values, vectors = np.linalg.eigh(H)
        theta, error = float(values[-1]), float(np.linalg.norm(R.T @ vectors[-len(c) :, -1]))
        gap = theta - values[-2] if len(values) > 1 else 0.0
        bound = theta + (error**2 / gap if gap > error else error)
        if theta > known or (step >= fewest and bound < known):
            break
    missed = shift + 1.0 / theta if theta > 0.0 else np.inf
    return missed if missed < highest * (1 - EQUAL_EIGENVALUES) else None

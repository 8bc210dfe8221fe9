"""Euler's beam under tension by cubic elements, an independent reference for stiffened bodies."""

import numpy as np

from fmd.core.arrays import Array


def beam_matrices(n: int, h: float, EI: float, mass: float, tension: Array) -> tuple[Array, Array]:
    """K and M of n elements of length h [m] with tensions (n,) [N]: deflection and slope at n + 1 points."""
    K, M = np.zeros((2, 2 * n + 2, 2 * n + 2))
    bend = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]) * EI / h**3
    pull = np.array([[36, 3, -36, 3], [3, 4, -3, -1], [-36, -3, 36, -3], [3, -1, -3, 4]]) / (30 * h)
    own = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) * mass * h / 420
    turns = np.outer([1, h, 1, h], [1, h, 1, h])
    for k in range(n):
        at = slice(2 * k, 2 * k + 4)
        K[at, at] += (bend + tension[k] * pull) * turns
        M[at, at] += own * turns
    return K, M

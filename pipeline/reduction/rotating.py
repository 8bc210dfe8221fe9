"""Frequencies of a body on a hub that turns at a constant rate."""

from __future__ import annotations

import numpy as np

from pipeline.core.arrays import EPSILON, Array
from pipeline.reduction.body import FlexibleBody


def rotating_frequencies(body: FlexibleBody, axis: Array, rate: float, hub_is_free: bool = False) -> Array:
    """Angular frequencies of small vibrations of a body that turns at a constant rate about its joint [rad/s].

    The equations are linearised about the undeformed state: with ``D = Σ (δ_ab − e_a e_b) G[a, b]`` and
    ``A = ε_abc e_a G[b, c]``, ``M̂ ẍ − 2 Ω A ẋ + (diag(ω²) − Ω² D) x = 0``. A stiffened body has its geometric stiffness
    in D. A frequency is the imaginary part of an eigenvalue, whatever its real part.

    Parameters
    ----------
    body : FlexibleBody
        Reduced body; its joint lies on the axis.
    axis : ndarray, shape (3,)
        Axis of rotation in the body's frame.
    rate : float
        Ω [rad/s].
    hub_is_free : bool
        Whether the hub may vibrate about the axis too; its rotation then is one more coordinate.

    Returns
    -------
    ndarray, shape (n,)
        Frequencies above zero, ascending.
    """
    e, G = axis / np.linalg.norm(axis), body.gram.G
    D = np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), G)
    A = np.einsum("a,abc,bcij->ij", e, EPSILON, G)
    M, K, C = np.eye(len(D)), -(rate**2) * D, -2.0 * rate * A
    M[0, 0], M[0, 1:], M[1:, 0] = D[0, 0], A[0, 1:], A[0, 1:]
    K[1:, 1:] += np.diag(body.omega**2)
    K[0], K[:, 0] = 0.0, 0.0  # turning the hub stores nothing …
    C[0], C[:, 0] = 2.0 * rate * D[0], -2.0 * rate * D[0]  # … but shifts the centrifugal load
    C[0, 0] = 0.0
    first = 0 if hub_is_free else 1
    M, K, C = M[first:, first:], K[first:, first:], C[first:, first:]
    n = len(M)
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    imaginary = np.linalg.eigvals(system).imag
    scale = float(body.omega.max())
    return np.sort(imaginary[imaginary > 1e-7 * scale])

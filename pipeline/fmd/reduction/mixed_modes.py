"""Modes without what round-off of the stiffness matrix has mixed of one another."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.modes import ROUNDED_PAIR


def separate_modes(Phi: Array, MPhi: Array, KPhi: Array) -> tuple[Array, Array]:
    """Return ω² (n,) and modes (n_unknowns, n), M-orthonormal, each without what it has of the others.

    Phi are nearly modes, MPhi and KPhi their inertia and their elastic forces, of a like shape. Round-off of K mixes
    them and moves ω², of slender bodies by 1e-9 to 1e-7; forces by strain show by how much, which is so little that its
    first order does. Modes of one frequency stay as they are.
    """
    one = np.eye(Phi.shape[1])
    normed = 1.5 * one - 0.5 * (Phi.T @ MPhi)
    K = normed.T @ (Phi.T @ KPhi) @ normed
    squares = np.diag(K)
    apart = squares[None] - squares[:, None]
    mixed = np.abs(apart) > ROUNDED_PAIR * squares
    mixing = np.where(mixed, 0.5 * (K + K.T) / np.where(mixed, apart, 1.0), 0.0)
    return squares, np.asarray(Phi @ (normed @ (one + mixing)))

"""Modes without what round-off of the stiffness matrix has mixed of one another."""

from __future__ import annotations

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.modes import ROUNDED_PAIR
from fmd.fem.model import FEModel


def separate_modes(fe: FEModel, Phi: Array) -> tuple[Array, Array]:
    """Return ω² (n,) and modes Phi (3 n_nodes, n), M-orthonormal, each without what it has of the others.

    Round-off of K mixes them and moves ω², of slender bodies by 1e-9 to 1e-7; strain shows by how much, which is so
    little that its first order does. Modes of one frequency stay as they are.
    """
    Phi = Phi @ (1.5 * np.eye(Phi.shape[1]) - 0.5 * (Phi.T @ (fe.M @ Phi)))
    K = fe.stiffness_of(Phi)
    squares = np.diag(K)
    apart = squares[None] - squares[:, None]
    mixed = np.abs(apart) > ROUNDED_PAIR * squares
    return squares, np.asarray(Phi + Phi @ np.where(mixed, K / np.where(mixed, apart, 1.0), 0.0))

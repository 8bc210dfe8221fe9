"""Modal mass of displacements of second order, which keeps a stiffened body's kinetic energy positive.

A body whose points move by ``Φ q + Γ(q)``, Γ quadratic in q, has of Γ̇ what is linear in it: its momenta ``F_a q · q̇``,
by which it couples frame and modes. They alone make a kinetic energy that can be negative. The square of Γ̇ and its
product with ``Φ q̇`` are missing. Both are known for the rigid part of Γ̇, the rigid motion ``τ q̇`` that has its momenta,
``M₀ τ = F q``. They add the modal mass

    W₀ᵀ τ + τᵀ W₀ + τᵀ M₀ τ = Σ_a (g_a f_aᵀ + f_a g_aᵀ) + Σ_ab N_ab f_a f_bᵀ      f_a = F_a q, g = M₀⁻¹ W₀, N = M₀⁻¹

with the inertia M₀ of the undeformed frame and its coupling W₀ with the modes. Since ``f_a · q̇`` is the rate of
``½ qᵀ F_a q``, Lagrange's equations have no forces of it but this mass times the accelerations, and
``Σ_a β_a (g_a + Σ_b N_ab f_b)`` with ``β_a = q̇ᵀ F_a q̇``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.mechanism import NO_MASS_LEFT


@dataclass(frozen=True)
class SecondOrderMass:
    """Constants of the modal mass that displacements of second order bring, by the momenta that they have.

    Attributes
    ----------
    F : ndarray, shape (k, n, n)
        Momenta ``q̇ᵀ F_a q`` of displacements of second order, those that aren't 0.
    g : ndarray, shape (k, n)
        Rows of ``M₀⁻¹ W₀``.
    N : ndarray, shape (k, k)
        Rows and columns of ``M₀⁻¹``.
    """

    F: Array
    g: Array
    N: Array

    def matrix(self, q: Array) -> Array:
        """Return the modal mass at modal coordinates q (n,), shape (n, n)."""
        f = self.F @ q
        return np.asarray(self.g.T @ f + f.T @ self.g + f.T @ self.N @ f)


def second_order_mass(
    mass: float, c: Array, J: Array, W: Array, displacement2: Array, rotation2: Array, normal: int = -1
) -> SecondOrderMass | None:
    """Return a body's modal mass by displacements of second order; ``None`` if they have no momenta.

    Parameters
    ----------
    mass, c, J : float, ndarray, shapes (3,) and (3, 3)
        Mass, first moment and inertia tensor of the undeformed body.
    W : ndarray, shape (6, n)
        Coupling of its frame, translation and rotation, with the modes.
    displacement2, rotation2 : ndarray, shape (3, n, n) or (3, 0, 0)
        Linear and angular momenta of displacements of second order.
    normal : int
        Number of the only axis that the body turns about, across which it moves; -1 if it moves anyhow.
    """
    n = W.shape[1]
    F = np.concatenate([forms if forms.size else np.zeros((3, n, n)) for forms in (displacement2, rotation2)])
    moves = np.arange(6) if normal < 0 else np.r_[np.delete(np.arange(3), normal), 3 + normal]
    kept = [int(a) for a in moves if F[a].any()]
    if not kept:
        return None
    across = np.cross(np.eye(3), c)
    M = np.block([[mass * np.eye(3), across.T], [across, J]])[np.ix_(moves, moves)]
    sizes = np.sqrt(M.diagonal())
    sizes[sizes == 0.0] = 1.0
    inverse = np.zeros((6, 6))
    inverse[np.ix_(moves, moves)] = np.linalg.pinv(M / np.outer(sizes, sizes), NO_MASS_LEFT, hermitian=True)
    inverse[np.ix_(moves, moves)] /= np.outer(sizes, sizes)
    return SecondOrderMass(F[kept], inverse[kept] @ W, inverse[np.ix_(kept, kept)])

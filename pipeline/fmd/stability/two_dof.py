"""Stability of the two-degree-of-freedom system of Miao et al. (2008), Figs. 2 and 3, with inertial coupling.

Two unit masses, one slow and one fast, coupled through the mass matrix by β and each on a spring:
``M = [[1, β], [β, 1]]``, ``K = diag(ω_L², ω_S²)``. The spectral radius of a major cycle depends on the Courant numbers
``Ω_S = ω_S h`` and ``Ω_L = ω_L m h``, on m and on β alone.
"""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.round_off import SOLVED
from fmd.core.limits.stability import HIGHEST_COURANT, SLOWNESS

# What the law of the weak instability is fitted to: values of β and of Ω_S in all pairs, and ω_L over ω_S.
_COUPLINGS = np.array([0.01, 0.03, 0.1, 0.3, 0.77])
_COURANT = np.array([1e-3, 2e-3, 5e-3])


@dataclass(frozen=True)
class StabilityMap:
    """Spectral radii of a major cycle over the Courant numbers of both coordinates."""

    substeps: int  # fast steps to a major cycle
    coupling: float  # β
    omega_s: Array  # (n,): Courant numbers of the fast coordinate
    omega_l: Array  # (n,): Courant numbers of the slow coordinate
    rho: Array  # (n, n): spectral radius; rows go with ``omega_l``

    @property
    def unstable(self) -> Array:
        """Map of 1 where the spectral radius exceeds 1 and 0 elsewhere, shape (n, n)."""
        return (self.rho > 1 + SOLVED).astype(float)


def stability_map(substeps: int, coupling: float, resolution: int) -> StabilityMap:
    """Compute the spectral radius on a grid of both Courant numbers, with ``resolution`` points each way."""
    omega = HIGHEST_COURANT * np.arange(1, resolution + 1) / resolution
    return StabilityMap(
        substeps, coupling, omega, omega, two_dof_growth(omega[None], omega[:, None], coupling, substeps)
    )


def two_dof_growth(omega_s: Array, omega_l: Array, coupling: float, substeps: int) -> Array:
    """Compute the spectral radius of a major cycle at Courant numbers that broadcast against each other.

    Without coupling the amplification matrix falls into two of size 2.
    """
    A = two_dof_map(omega_s, omega_l, coupling, substeps)
    if coupling == 0.0:
        return np.maximum(_radius(A[..., ::2, ::2]), _radius(A[..., 1::2, 1::2]))
    return np.asarray(np.abs(np.linalg.eigvals(A)).max(axis=-1))


def two_dof_map(omega_s: Array, omega_l: Array, coupling: float, substeps: int) -> Array:
    """Return the amplification matrices of the state (q_L, q_S, v_L, v_S), shape (…, 4, 4), for a fast step of 1."""
    omega_s, omega_l = np.broadcast_arrays(np.asarray(omega_s, dtype=float), np.asarray(omega_l, dtype=float))
    k_s, k_l = omega_s[..., None] ** 2, (omega_l[..., None] / substeps) ** 2
    q_l, q_s, v_l, v_s = (np.broadcast_to(row, (*omega_s.shape, 4)) for row in np.eye(4))
    # M a = −K q, solved for both at the common update
    over = 1.0 / (1.0 - coupling**2)
    a_l = over * (coupling * k_s * q_s - k_l * q_l)
    a_s = over * (coupling * k_l * q_l - k_s * q_s)
    v_l = v_l + substeps * a_l
    q_l = q_l + substeps * v_l
    for step in range(substeps):
        if step:
            a_s = -k_s * q_s - coupling * a_l
        v_s = v_s + a_s
        q_s = q_s + v_s
    return np.stack([q_l, q_s, v_l, v_s], axis=-2)


def _radius(A: Array) -> Array:
    """Return the spectral radii of matrices of shape (…, 2, 2)."""
    half, det = 0.5 * np.trace(A, axis1=-2, axis2=-1), np.linalg.det(A)
    root = np.sqrt(half**2 - det + 0j)
    return np.asarray(np.maximum(np.abs(half + root), np.abs(half - root)))


@dataclass(frozen=True)
class GrowthLaw:
    """Law ``ρ − 1 = c β^b Ω_S^s / (1 − β²)`` of the weak instability, fitted to computed radii."""

    substeps: int  # m
    factor: float  # c
    coupling_power: float  # b
    courant_power: float  # s
    misfit: float  # largest relative difference of a radius's excess from the law


def fit_growth_law(substeps: int) -> GrowthLaw:
    """Fit the law of the weak instability to the spectral radii at small steps for one ratio."""
    beta, omega = np.meshgrid(_COUPLINGS, _COURANT, indexing="ij")
    excess = np.array([two_dof_growth(_COURANT, SLOWNESS * substeps * _COURANT, b, substeps) - 1 for b in _COUPLINGS])
    left = np.log(excess * (1 - beta**2)).ravel()
    terms = np.stack([np.ones(left.size), np.log(beta).ravel(), np.log(omega).ravel()], axis=1)
    (constant, b, s), *_ = np.linalg.lstsq(terms, left, rcond=None)
    misfit = float(np.abs(np.exp(terms @ (constant, b, s) - left) - 1).max())
    return GrowthLaw(substeps, float(np.exp(constant)), float(b), float(s), misfit)

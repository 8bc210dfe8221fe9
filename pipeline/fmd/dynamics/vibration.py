"""Angular frequencies of ``M q̈ + K q = 0``, inertial coupling, and the limit of explicit steps with dampers."""

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InertiaError


def inertial_coupling(M: Array, n_slow: int) -> float:
    """Return the largest canonical correlation of slow and fast coordinates in a mass matrix: 0 if they don't couple.

    It is the largest ``x_Lᵀ M_LS x_S`` for ``x_Lᵀ M_LL x_L = x_Sᵀ M_SS x_S = 1``, and always below 1.
    """
    if not 0 < n_slow < len(M):
        return 0.0
    L, S = (np.linalg.cholesky(M[part, part]) for part in (slice(0, n_slow), slice(n_slow, None)))
    return float(np.linalg.norm(np.linalg.solve(L, np.linalg.solve(S, M[n_slow:, :n_slow]).T), 2))


def frequencies(M: Array, K: Array) -> Array:
    """Return the angular frequencies (n,) of an undamped system, mass positive definite, ascending [rad/s].

    They are 0 where a vibration has no stiffness, or a negative one. Raises as `stiffness_over_mass` does.
    """
    return np.asarray(np.sqrt(np.maximum(stiffness_over_mass(M, K), 0.0)))


def stiffness_over_mass(M: Array, K: Array) -> Array:
    """Return the eigenvalues (n,) of ``K x = λ M x`` of symmetric matrices, ascending [1/s²].

    Raises
    ------
    InertiaError
        The mass isn't positive definite.
    """
    if not len(M):
        return np.zeros(0)
    L = _cholesky(M)
    scaled = np.linalg.solve(L, np.linalg.solve(L, K).T)  # L⁻¹ K L⁻ᵀ
    return np.asarray(np.linalg.eigvalsh(0.5 * (scaled + scaled.T)))


def _cholesky(M: Array) -> Array:
    try:
        return np.asarray(np.linalg.cholesky(M))
    except np.linalg.LinAlgError:
        least, largest = np.linalg.eigvalsh(M)[[0, -1]]
        message = f"the mass matrix isn't positive definite: it is {least:.2g} at least, and {largest:.2g} at most"
        raise InertiaError(message) from None


def highest_frequency(M: Array, K: Array) -> float:
    """Return the highest angular frequency of an undamped system [rad/s]; never 0, for steps divide by it."""
    return float(frequencies(M, K).max(initial=1e-150))


def largest_leapfrog_step(M: Array, K: Array, C: Array) -> float:
    """Return the longest stable step of the leapfrog method for ``M q̈ + C q̇ + K q = 0`` [s], (n, n) each.

    The method takes rates half a step ahead by the last acceleration. A vibration of mass m, damping c and stiffness k
    goes by ``(z − 1)² z + κ z² + γ (z − 1)(3 z − 1)/2 = 0`` with κ = h² k/m and γ = h c/m, which has all ``|z| ≤ 1``
    for ``κ + 4 γ ≤ 4`` and nowhere else (Jury's conditions). So does every vibration of symmetric matrices with its own
    m, c and k: the limit is where ``4 M − 4 h C − h² K`` becomes singular, ``h = 2/μ`` with the largest eigenvalue μ of
    ``μ² M − 2 μ C − K``. Without dampers it is ``2/ω_max``. It is never infinite: a system without forces has a step
    that is longer than any duration.
    """
    if not np.any(C):
        return 2.0 / highest_frequency(M, K)
    L = _cholesky(M)
    scaled_K, scaled_C = (np.linalg.solve(L, np.linalg.solve(L, A).T) for A in (K, C))
    squares, shapes = np.linalg.eigh(0.5 * (scaled_K + scaled_K.T))
    root = shapes * np.sqrt(np.maximum(squares, 0.0))  # root rootᵀ = L⁻¹ K L⁻ᵀ
    linear = np.block([[scaled_C + scaled_C.T, root], [root.T, np.zeros_like(root)]])
    return 2.0 / max(float(np.linalg.eigvalsh(linear)[-1]), 1e-150)

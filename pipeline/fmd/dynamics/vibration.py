"""Vibrations ``M q̈ + K q = 0``: frequencies, inertial coupling, limits of explicit steps, and the fastest part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.errors import InertiaError
from fmd.dynamics.linear_forces import LinearForces, gather_linear_forces, linearise_forces

if TYPE_CHECKING:
    from fmd.dynamics.compiled_system.reference_state import ReferenceState
    from fmd.dynamics.mechanism import Mechanism


@dataclass(frozen=True)
class FastestPart:
    """Stiffness or damper that sets the shortest time in a mechanism's reference state."""

    name: str
    damps: bool  # true if it is a damper that stops a motion, false if it is a stiffness that makes a vibration
    # Angular frequency of that vibration, or one over the time in which the motion falls to 37 % [rad/s or 1/s].
    rate: float


def find_fastest_part(system: ReferenceState) -> FastestPart | None:
    """Find the part with the largest share in the fastest vibration or the fastest decay, with all end stops touched.

    Loops are left open. None stands for a mechanism without stiffness and dampers.
    """
    M, K, C = system.stiffest_matrices
    if not len(M) or not (K.any() or C.any()):
        return None
    (squared, swings), (decay, stops) = _largest(K, M), _largest(C, M)
    omega = float(np.sqrt(max(squared, 0.0)))
    damps = decay > 2.0 * omega
    shape = stops if damps else swings
    shares = {name: abs(float(shape @ (part[1] if damps else part[0]) @ shape)) for name, part in _parts(system)}
    return FastestPart(max(shares, key=lambda name: shares[name]), damps, decay if damps else omega)


def _largest(A: Array, M: Array) -> tuple[float, Array]:
    """Return the largest eigenvalue of ``A x = λ M x`` and its vector."""
    from scipy.linalg import eigh

    values, shapes = eigh(0.5 * (A + A.T), M)
    return float(values[-1]), np.asarray(shapes[:, -1])


def _parts(system: ReferenceState) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Yield each joint, each body and each force element by its name, with its stiffness and damping (n, n)."""
    mechanism = system.mechanism
    links = list(mechanism.links)
    whole = gather_linear_forces(links, mechanism.layout)
    for k, link in enumerate(links):
        loose = [*links[:k], replace(link, spring=0.0, damper=0.0, laws=()), *links[k + 1 :]]
        without = gather_linear_forces(loose, mechanism.layout)
        yield f"joint '{link.joint_name or link.name}'", _difference(whole, without)
        modes, own = mechanism.modes_of(k), np.zeros((2, mechanism.n, mechanism.n))
        own[0, modes, modes] = link.omega**2
        own[1, modes, modes] = 2.0 * link.damping * link.omega if len(link.damping) else 0.0
        yield f"the modes of body '{link.part or link.name}'", (own[0], own[1])
    yield from _elements(mechanism, whole)


def _elements(mechanism: Mechanism, without: LinearForces) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Yield each force element by its name, with its stiffness and damping."""
    for element in mechanism.elements:
        yield (
            f"{element.title} '{element.name}'",
            _difference(linearise_forces(replace(mechanism, elements=[element])), without),
        )


def _difference(a: LinearForces, b: LinearForces) -> tuple[Array, Array]:
    """Return by how much stiffness and damping differ, with end stops."""
    return a.K + a.stop_K - b.K - b.stop_K, a.C + a.stop_C - b.C - b.stop_C


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

"""Static responses of bodies that may move freely, and the round-off that is left of equilibrium.

Their own inertia balances the loads (inertia relief). Much round-off is left where elements are far stiffer than the
part that they make up.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import qr

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.core.limits.modes import (
    CONVERGED_RESIDUAL,
    GRADIENT_ROUNDS,
    GRADIENT_STEPS,
    OF_ROUND_OFF,
    ROUND_GAIN,
    ROUNDED_STATIC_RESIDUAL,
    STATIC_RESIDUAL,
)
from fmd.core.limits.round_off import SUMMED
from fmd.core.progress import Advance

THIN = (
    "since elements are so thin (shorter elements, or a thicker part, have less of it) or hardly anything resists a "
    "motion, as of parts that turn on hinges"
)


def rounded_defect(K: Any, u: Array) -> Array:
    """Return a defect as round-off may leave it of ``K u``, of random signs: forces of the shape of u [N].

    Each is the machine epsilon times what the terms of its row add up to without their signs.
    """
    signs = np.random.default_rng(0).choice([-1.0, 1.0], u.shape)
    return np.asarray(np.finfo(float).eps * signs * (abs(K) @ np.abs(u)))


def solve_balanced(
    K: Any,
    M: Any,
    R: Array,
    inverse: Callable[[Array], Array],
    f: Array,
    advance: Advance = lambda done: None,
    forces: Callable[[Array], Array] | None = None,
) -> Array:
    """Solve ``K u = f − M R a``, the rigid acceleration a being the one that the loads f (n, n_loads) [N] cause.

    Conjugate gradients with ``inverse``, ``(K − σ M)⁻¹``, σ < 0, take a few steps. They start anew on what is left of
    the load, balanced again: K doesn't see rigid-body round-off, which would spoil a long run. R (n, n_rigid) are the
    rigid-body modes, to which u (n, n_loads) [m] is M-orthogonal. ``advance`` takes the part that is done, by the
    digits of the residual that are gone; ``forces`` gives ``K u`` with less round-off than K has, once that counts.

    Raises
    ------
    AccuracyError
        The residual stayed above `STATIC_RESIDUAL` and what round-off explains; the message names the load.
    """
    MR = M @ R
    rigid_mass = R.T @ MR

    def balance(load: Array) -> Array:
        return np.asarray(load - MR @ np.linalg.solve(rigid_mass, R.T @ load))

    def elastic(load: Array) -> Array:
        u = inverse(load)
        return np.asarray(u - R @ np.linalg.solve(rigid_mass, MR.T @ u))

    loads = balance(f)
    zero = np.linalg.norm(loads, axis=0) <= SUMMED * np.linalg.norm(f, axis=0)
    loads[:, zero] = 0.0
    defect, answer = loads, elastic(loads)
    size = np.where(zero, 1.0, _energy_norm(defect, answer))
    if not size.all():
        raise _lost(int(size.argmin()))
    u, largest, exact = np.zeros_like(loads), np.inf, None

    def tell(left: Array) -> None:
        advance(float(np.log(np.clip((left / size).max(), CONVERGED_RESIDUAL, 1.0)) / np.log(CONVERGED_RESIDUAL)))

    for _ in range(GRADIENT_ROUNDS):
        step, left = _conjugate_gradients(K, defect, answer, elastic, tell)
        u, residual, before = u + step, np.maximum(left / size, largest**2), largest
        if exact is not None and residual.max() < CONVERGED_RESIDUAL:  # K's part of round-off, at most what was left,
            break  # of a step of that size
        exact = forces if (left / size).max() ** 2 < CONVERGED_RESIDUAL else None
        defect = balance(loads - (K @ u if exact is None else exact(u)))
        answer = elastic(defect)
        residual = _energy_norm(defect, answer) / size  # in which round-off of stiff elements counts little
        largest = residual.max()
        if largest < CONVERGED_RESIDUAL or 0.1 * before < largest < STATIC_RESIDUAL:
            break
    worst = int(residual.argmax())
    if not residual[worst] < STATIC_RESIDUAL:
        defect = balance(rounded_defect(K, u[:, [worst]]))
        _require_round_off(worst, residual[worst], (_energy_norm(defect, inverse(defect)) / size[worst]).item())
    return u


def _require_round_off(number: int, residual: float, rounded: float) -> None:
    """Raise ``AccuracyError`` unless a load's residual is explained by that of round-off alone."""
    if rounded > 1.0:
        raise _lost(number)
    if not residual < min(OF_ROUND_OFF * rounded, ROUNDED_STATIC_RESIDUAL):
        raise AccuracyError(
            f"static response {number}: residual {residual:.1e} exceeds {STATIC_RESIDUAL:.0e}"
            + (f"; round-off alone leaves {rounded:.0e}, {THIN}" if rounded > 0.1 * ROUNDED_STATIC_RESIDUAL else "")
        )


def held_stiffness(K: Any, R: Array) -> Any:
    """Return K with springs at as many unknowns as it has rigid-body modes R (n, n_rigid), so that it is definite.

    Loads in equilibrium press on none of these springs: what such loads do follows from its inverse exactly.
    """
    held = qr(R.T, mode="r", pivoting=True)[1][: R.shape[1]]
    return K + sp.csr_array((K.diagonal()[held], (held, held)), K.shape)


def flexibility_at(K: Any, M: Any, R: Array, inverse: Callable[[Array], Array], f: Array) -> Array | None:
    """Return the answers ``u`` of `solve_balanced` by the exact inverse of `held_stiffness`, one solution a load.

    A random combination of the loads is checked in place of each; None if round-off leaves too much of it.
    """
    rows = np.linalg.solve(R.T @ (M @ R), (M @ R).T) if R.shape[1] else R.T
    loads = f - rows.T @ (R.T @ f)
    mixed = np.random.default_rng(0).choice([-1.0, 1.0], f.shape[1])
    u = inverse(loads)
    u -= R @ (rows @ u)
    left = loads @ mixed - K @ (u @ mixed)
    left -= rows.T @ (R.T @ left)
    energies = np.einsum("ij,ij->j", loads, u)[loads.any(axis=0)]  # what a support takes whole moves nothing
    least = np.sqrt(max(energies.min(initial=np.inf), 0.0))
    return u if np.sqrt(abs(left @ inverse(left[:, None])[:, 0])) < STATIC_RESIDUAL * least else None


def _lost(load: int) -> AccuracyError:
    return AccuracyError(f"static response {load}: round-off is larger than the response, {THIN}")


def _energy_norm(load: Array, answer: Array) -> Array:
    """Return the roots of the products of loads and answers to them, (n,); round-off may make a product negative."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->j", load, answer), 0.0)))


def _conjugate_gradients(
    K: Any, f: Array, z: Array, inverse: Callable[[Array], Array], tell: Callable[[Array], None]
) -> tuple[Array, Array]:
    """Solve ``K u = f`` to about four digits, preconditioned by ``inverse``, from its z.

    All columns step in the space of all (O'Leary, Linear Algebra Appl 29, 1980): a few loads hold the lowest modes, in
    which ``inverse`` is far from that of K. ``tell`` takes the energy norms that are left, which are returned with u.
    """
    u, r, p, left = np.zeros_like(f), f.copy(), z, _energy_norm(f, z)
    enough = ROUND_GAIN * left
    for _ in range(GRADIENT_STEPS):
        Kp = K @ p
        energies = p.T @ Kp
        if not np.isfinite(energies).all():  # beyond double precision, which the residual will tell
            break
        solve = _inverse_of(energies)
        step = solve @ (p.T @ r)
        u += p @ step
        r -= Kp @ step
        z = inverse(r)
        left = _energy_norm(r, z)
        tell(left)
        if not (left > enough).any():
            break
        p = z - p @ (solve @ (Kp.T @ z))
    return u, left


def _inverse_of(A: Array) -> Array:
    """Return the inverse of a semidefinite matrix (n, n) in the directions in which it is above round-off."""
    sizes = np.sqrt(np.maximum(A.diagonal(), 0.0))
    scale = np.divide(1.0, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * (0.5 * (A + A.T)) * scale)
    whole = values > SUMMED * values.max(initial=0.0)
    V = scale[:, None] * vectors[:, whole]
    return np.asarray(V / values[whole] @ V.T)


def constrained_inverse(inverse: Callable[[Array], Array], B: Array) -> Callable[[Array], Array]:
    """Inverse of A among the fields with ``Bᵀu = 0``: ``f → A⁻¹f − A⁻¹B (BᵀA⁻¹B)⁻¹ BᵀA⁻¹f``."""
    Z = inverse(B)
    weights = np.linalg.solve(B.T @ Z, Z.T)

    def solve(f: Array) -> Array:
        # The reaction is taken off the load first, and off the result again: A⁻¹ alone is large in rigid motions,
        # which would have to cancel.
        x = inverse(f - B @ (weights @ f))
        return np.asarray(x - weights.T @ (B.T @ x))

    return solve

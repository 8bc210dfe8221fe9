"""Inertia of a deforming body as far as points of known motion tell it, where only a reduced mass matrix is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import nnls

from fmd.core.arrays import Array
from fmd.core.limits.files import EVEN_MASS, FITTED_MODES, LEAST_STRAIN, SEEN_MASS
from fmd.core.rotations import rigid_motions


def affine_products(K: Array, M: Array, V: Array, U: Array, r: Array, second: Array) -> Array:
    """Return ``∫ r_a ψ_b = ∫ r_b ψ_a`` of free modes, (3, 3, n), through the mass matrix and evenly strained points.

    The field ``r_a e_b`` is nearly that of the unknowns y by which the points move so, and which strain the body least;
    then ``∫ ψ · (r_a e_b) dm`` is ``ψᵀ M y``: to all digits where a bar is stretched. Of two directions, in principal
    axes, r is taken along the one in which the body is thinner, where the field is smaller.

    Of the free modes V (n_unknowns, n) and points U (n_points, 3, n_unknowns), the latter are at r (n_points, 3) from
    the centre of mass [m], about which ``second`` (3, 3) are the body's second moments [kg m²].
    """
    Q = np.linalg.eigh(second)[1]
    pairs = np.array([(a, b) for a in range(3) for b in range(a, 3)])  # moments ascend
    flat = U.reshape(-1, len(K))
    fields = np.einsum("ip,cp->icp", (r @ Q)[:, pairs[:, 0]], Q[:, pairs[:, 1]]).reshape(len(flat), -1)
    pull = flat.T @ flat
    y = np.linalg.lstsq(pull + LEAST_STRAIN * np.trace(pull) / np.trace(K) * K, flat.T @ fields, rcond=None)[0]
    H = np.zeros((3, 3, V.shape[1]))
    H[pairs[:, 0], pairs[:, 1]] = H[pairs[:, 1], pairs[:, 0]] = (V.T @ (M @ y)).T
    return np.asarray(np.einsum("ac,bd,cdj->abj", Q, Q, H))


def directional_mass(
    points: Sequence[tuple[Array, Array]], omega2: Array, mass: float, centre: Array, second: Array
) -> tuple[Array, str]:
    """Return ``∫ ψ_ja ψ_kb`` of free modes, shape (3, 3, n, n), as points of known motion tell it, and how well.

    Masses of the points are fitted to what is known: mass [kg], centre of mass (3,) [m] and second moments about it (3,
    3) [kg m²]. Of the lowest modes, as many as they have masses of, shapes are combined so that all modal masses are
    exact. The others have their points' directions, and no coupling. Points have a place (3,) and displacements (3, n)
    by each mode, of unit modal mass and ascending ω² (n,).
    """
    n = len(omega2)
    x, shapes = (np.array(column) for column in zip(*points, strict=True))
    r, few = x - centre, min(n, FITTED_MODES)
    lower = np.sqrt(omega2[0] / omega2[:few])  # the lower a mode, the more it counts
    pair, upper = np.triu_indices(few), np.triu_indices(3)
    products = np.einsum("iaj,iak->jki", shapes[:, :, :few] * lower, shapes[:, :, :few] * lower)[pair]
    moments, spread = np.einsum("ia,ib->abi", r, r)[upper], float(np.trace(second))
    rows = np.concatenate([np.ones((1, len(r))) / mass, r.T / np.sqrt(mass * spread), moments / spread, products])
    wanted = np.concatenate([[1.0], np.zeros(3), second[upper] / spread, np.diag(lower**2)[pair]])
    w = nnls(rows, wanted)[0]
    exact = np.diag([mass, 0.0, 0.0, 0.0])
    exact[1:, 1:] = second + 1e-9 * spread * np.eye(3)
    functions = np.concatenate([np.ones((len(r), 1)), r], axis=1)
    w = w / max(1.0, float(eigh((functions.T * w) @ functions, exact, eigvals_only=True)[-1]))  # no more than there is
    R, each = rigid_motions(r).reshape(-1, 6), np.sqrt(np.repeat(w, 3))[:, None]
    flat = shapes.reshape(len(R), n)
    flat = flat - R @ np.linalg.lstsq(each * R, each * flat, rcond=None)[0]
    T, shapes = (flat * each).T @ (flat * each), flat.reshape(shapes.shape)
    k = next((k for k in range(n, 0, -1) if np.linalg.eigvalsh(T[:k, :k])[0] > SEEN_MASS), 0)
    own = np.einsum("i,iaj,ibj->jab", w, shapes, shapes)
    own[~own.any(axis=(1, 2))] = np.eye(3)
    C = np.zeros((3, 3, n, n))
    C[:, :, np.arange(n), np.arange(n)] = (own / np.einsum("jaa->j", own)[:, None, None]).transpose(1, 2, 0)
    shown, axes = np.linalg.eigh(T[:k, :k])
    low = shapes[:, :, :k] @ ((axes / np.sqrt(shown)) @ axes.T)
    C[:, :, :k, :k] = np.einsum("i,iaj,ibk->abjk", w, low, low)
    C = (1.0 - EVEN_MASS) * C + EVEN_MASS / 3 * np.einsum("ab,jk->abjk", np.eye(3), np.eye(n))
    error = float(np.abs(T.diagonal()[:k] - 1.0).max(initial=0.0))
    return C, f"of {k} of {n} shapes from {len(r)} points, which have their masses to {error:.1e}"


def within_schwarz(H: Array, C: Array, second: Array) -> Array:
    """Return ``∫ r_(a ψ_b)`` no larger than second moments and modal masses allow, in the body's principal axes."""
    moments, Q = np.linalg.eigh(second)
    turned = np.einsum("ac,bd,abj->cdj", Q, Q, H)
    masses = np.einsum("ac,bc,abjj->cj", Q, Q, C)
    most = np.sqrt(np.maximum(moments, 0.0)[:, None, None] * masses[None])
    most = np.minimum(most, most.swapaxes(0, 1))
    return np.asarray(np.einsum("ac,bd,cdj->abj", Q, Q, np.clip(turned, -most, most)))

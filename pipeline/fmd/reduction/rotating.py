"""Vibrations of a body on a hub that turns at a constant rate."""

from typing import NamedTuple

import numpy as np

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.limits.responses import RIGID_DRIFT, RIGID_POLE
from fmd.reduction.body import FlexibleBody


class WhirlingModes(NamedTuple):
    """Vibrations at one rate of rotation, by ascending frequency.

    Where a vibration has turned into two motions that grow or decay without oscillating, the one that decays least
    stands at its place; the other ones follow last.
    """

    frequencies_hz: Array  # (n,) [Hz]
    growth: Array  # (n,): real parts of the poles [1/s]: positive for a vibration that grows
    # (n,): circulation about the axis, between -1 and 1: positive for points that go round in the sense of the
    # rotation, 0 for a motion to and fro
    whirl: Array

    @property
    def damping(self) -> Array:
        """Damping ratios ``−Re s / |s|``, negative for a vibration that grows; 0 for what stands still."""
        size = np.hypot(self.growth, 2 * np.pi * self.frequencies_hz)
        return np.divide(-self.growth, size, out=np.zeros(len(size)), where=size > 0.0)


def order_poles(poles: Array, frequencies: Array) -> IntArray:
    """Return the numbers of the poles that move, one of each conjugate pair, in the order of `WhirlingModes`.

    Poles (n,) are eigenvalues of a real state matrix [1/s], listed by frequencies (n,).
    """
    fastest = float(poles.imag.max(initial=0.0)) or float(np.abs(poles).max(initial=0.0))
    oscillating = np.flatnonzero(poles.imag > RIGID_POLE * fastest)
    real = np.flatnonzero((np.abs(poles.imag) <= RIGID_POLE * fastest) & (np.abs(poles.real) > RIGID_DRIFT * fastest))
    real = real[np.argsort(-poles.real[real])]
    half = (len(real) + 1) // 2
    first = np.concatenate([oscillating, real[:half]])
    return np.concatenate([first[np.argsort(frequencies[first], kind="stable")], real[half:]])


def rotating_modes(
    body: FlexibleBody, axis: Array, rate: float, hub_is_free: bool = False, ratios: Array | None = None
) -> WhirlingModes:
    """Return the small vibrations of a body that turns at a constant rate about its joint, as the hub sees them.

    The joint lies on the axis (3,), in the body's frame, and Ω [rad/s] is the rate; a hub that is free may vibrate
    about the axis too, by one more coordinate. Modes have damping ratios (n,). The equations are linearised about the
    undeformed state: with ``D = Σ (δ_ab − e_a e_b) G[a, b]`` and ``A = ε_abc e_a G[b, c]``, ``M̂ ẍ + (diag(2 ζ ω) − 2 Ω
    A) ẋ + (diag(ω²) − Ω² D) x = 0``. A stiffened body has its geometric stiffness in D. With the same matrices a
    complex vibration x has the circulation ``−Im(xᴴ A x) / xᴴ D' x``, D' without geometric stiffness.
    """
    e, G = axis / np.linalg.norm(axis), body.integrals.G
    D = np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), G)
    A = np.einsum("a,abc,bcij->ij", e, EPSILON, G)
    M, K, C = np.eye(len(D)), -(rate**2) * D, -2.0 * rate * A
    M[0, 0], M[0, 1:], M[1:, 0] = D[0, 0], A[0, 1:], A[0, 1:]
    K[1:, 1:] += np.diag(body.omega**2)
    if ratios is not None:
        C[1:, 1:] += np.diag(2.0 * ratios * body.omega)
    K[0], K[:, 0] = 0.0, 0.0  # turning the hub stores nothing …
    C[0], C[:, 0] = 2.0 * rate * D[0], -2.0 * rate * D[0]  # … but shifts the centrifugal load
    C[0, 0] = 0.0
    first = 0 if hub_is_free else 1
    M, K, C = M[first:, first:], K[first:, first:], C[first:, first:]
    n = len(M)
    system = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    poles, vectors = np.linalg.eig(system)
    kept = order_poles(poles, poles.imag)
    poles, x = poles[kept], vectors[n - len(body.omega) : n, kept]
    turning = -np.einsum("im,ij,jm->m", x.conj(), A[1:, 1:], x).imag
    size = np.einsum("im,ij,jm->m", x.conj(), _moments_across(body, e)[1:, 1:], x).real
    whirl = np.divide(turning, size, out=np.zeros(len(size)), where=size > 1e-12 * np.abs(x).max(initial=0.0) ** 2)
    return WhirlingModes(poles.imag / (2 * np.pi), poles.real, whirl)


def _moments_across(body: FlexibleBody, e: Array) -> Array:
    """Second moments across an axis without the geometric stiffness that a stiffened body has in them."""
    G = body.integrals.G
    D = np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), G)
    if body.integrals.stiffening.size:
        D[1:, 1:] += np.einsum("ab,abij->ij", np.eye(3) - np.outer(e, e), body.integrals.stiffening)
    return np.asarray(D)

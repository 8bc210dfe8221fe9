"""Vibrations of what turns about an axis: their frequencies, damping, and the way in which they whirl."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.responses import ACROSS_AXIS, NO_ENTRY, POLARISED, RIGID_POLE
from fmd.core.limits.round_off import SOLVED


class WhirlingModes(NamedTuple):
    """Vibrations at one rate of rotation, by ascending frequency.

    Attributes
    ----------
    frequencies_hz : ndarray, shape (n,)
        [Hz]
    damping : ndarray, shape (n,)
        Damping ratios; negative for a vibration that grows.
    whirl : ndarray, shape (n,)
        Circulation about the axis: 1 for points that go round in the sense of the rotation, -1 against it, 0 for a
        motion to and fro.
    """

    frequencies_hz: Array
    damping: Array
    whirl: Array


def find_circulation(first: Array, second: Array) -> Array:
    """Return the circulation of vibrations ``Re(u exp(iωt))`` of points, between -1 and 1.

    Parameters
    ----------
    first, second : ndarray, shape (n_points, n)
        Complex displacements of each vibration along two axes that make a right-handed system with the axis.

    Returns
    -------
    ndarray, shape (n,)
        ``−2 Σ Im(ū₁ u₂) / Σ (|u₁|² + |u₂|²)``; 0 where nothing moves.
    """
    size = (np.abs(first) ** 2 + np.abs(second) ** 2).sum(axis=0)
    turning = -2.0 * (first.conj() * second).imag.sum(axis=0)
    return np.asarray(np.divide(turning, size, out=np.zeros(len(size)), where=size > 0.0))


def whirling_modes(A: Array, across: tuple[Array, Array], along: Array, rate: float) -> WhirlingModes:
    """Return the vibrations in space of a rotor whose equations are those of its turning frame.

    A vibration of frequency ω that whirls in the turning frame has the frequency ``Ω + ω`` in space if it runs ahead,
    ``Ω − ω`` if it lags, which is backwards where it is negative; one to and fro, as of torsion, keeps its own.

    Parameters
    ----------
    A : ndarray, shape (n, n)
        State matrix in the turning frame.
    across : tuple of ndarray, shape (n_points, n) each
        Displacements of points along two axes across that of rotation, for unit states.
    along : ndarray, shape (n_points, n)
        Displacements along the axis.
    rate : float
        Ω [rad/s].
    """
    poles, vectors = _eigen(A)
    kept = poles.imag > RIGID_POLE * np.abs(poles).max(initial=0.0)
    poles, vectors = poles[kept], vectors[:, kept]
    first, second, third = (C @ vectors for C in (*across, along))
    circulation = find_circulation(first, second)
    transverse = (np.abs(first) ** 2 + np.abs(second) ** 2).sum(axis=0)
    whirls = (np.abs(circulation) > POLARISED) & (transverse > ACROSS_AXIS * (np.abs(third) ** 2).sum(axis=0))
    omega = np.where(whirls, rate + np.sign(circulation) * poles.imag, poles.imag)
    whirl = np.where(whirls, np.sign(omega) * np.abs(circulation), 0.0)
    size = np.hypot(poles.real, omega)
    damping = np.divide(-poles.real, size, out=np.zeros(len(size)), where=size > 0.0)
    order = np.argsort(np.abs(omega))
    return WhirlingModes(np.abs(omega[order]) / (2 * np.pi), damping[order], whirl[order])


def hub_modes(A: Array, across: tuple[Array, Array], hub: Sequence[int]) -> WhirlingModes:
    """Return the vibrations of what turns on a hub, as the hub sees them.

    Parameters
    ----------
    A : ndarray, shape (n, n)
        State matrix of small motions.
    across : tuple of ndarray, shape (n_points, n) each
        Displacements of points along two axes across that of rotation, for unit states.
    hub : sequence of int
        States that turn the hub itself.
    """
    poles, vectors = _eigen(A)
    kept = np.flatnonzero(poles.imag > RIGID_POLE * np.abs(poles).max(initial=0.0))
    kept = kept[np.argsort(poles.imag[kept])]
    poles, seen = poles[kept], vectors[:, kept].copy()
    seen[list(hub)] = 0.0
    first, second = (C @ seen for C in across)
    size = np.abs(vectors[:, kept]).max(axis=0, initial=0.0) * max(float(np.abs(C).max(initial=0.0)) for C in across)
    moves = np.sqrt((np.abs(first) ** 2 + np.abs(second) ** 2).sum(axis=0)) > SOLVED * size
    whirl = np.where(moves, find_circulation(first, second), 0.0)
    return WhirlingModes(poles.imag / (2 * np.pi), -poles.real / np.abs(poles), whirl)


def _eigen(A: Array) -> tuple[Array, Array]:
    """Return eigenvalues and vectors of a state matrix, positions before rates, each position times its frequency.

    Round-off is taken out: by what has no stiffness, LAPACK would scale the rest to nothing.
    """
    n = len(A) // 2
    scale = np.ones(len(A))
    scale[:n] = np.sqrt(np.maximum(np.abs(A[n:, :n].diagonal()), 1.0))
    scaled = scale[:, None] * A / scale
    scaled[np.abs(scaled) < NO_ENTRY * np.abs(scaled).max(initial=0.0)] = 0.0
    poles, vectors = np.linalg.eig(scaled)
    return poles, vectors / scale[:, None]

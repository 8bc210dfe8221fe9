"""Vibrations of what turns about an axis: their frequencies, damping, and the way in which they whirl."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.limits.responses import ACROSS_AXIS, NO_ENTRY
from fmd.core.limits.round_off import SOLVED
from fmd.reduction.rotating import WhirlingModes, order_poles


def find_circulation(first: Array, second: Array) -> Array:
    """Return the circulation of vibrations ``Re(u exp(iωt))`` of points, between -1 and 1, (n,).

    It is ``−2 Σ Im(ū₁ u₂) / Σ (|u₁|² + |u₂|²)`` by complex displacements (n_points, n) along two axes that make a
    right-handed system with the axis, and 0 where nothing moves.
    """
    size = (np.abs(first) ** 2 + np.abs(second) ** 2).sum(axis=0)
    turning = -2.0 * (first.conj() * second).imag.sum(axis=0)
    return np.asarray(np.divide(turning, size, out=np.zeros(len(size)), where=size > 0.0))


@dataclass(frozen=True)
class SpaceView:
    """How vibrations about a turning frame are seen from space.

    A vibration of frequency ω that bends the axis has, in space, the frequency ``Ω + ω`` if it runs ahead in the
    turning frame, ``Ω − ω`` if it lags, which is backwards where it is negative; of one to and fro, which has both,
    that of its larger part. A shape that grows or decays in the turning frame without oscillating is carried round at
    Ω. What doesn't bend the axis, as torsion or waves around a tube, keeps its frequency: where a mesh isn't the same
    all around it moves the axis, too, but little beside the points' rotation about it.
    """

    # (n_points, n) each, for unit states: displacements of points on the axis along two axes across it
    across: tuple[Array, Array]
    tilts: tuple[Array, Array]  # rotations of points about these two, times the rotor's size
    along: tuple[Array, Array]  # displacements along the axis, and rotations about it times the size
    rate: float  # Ω [rad/s]

    def look(self, poles: Array, vectors: Array) -> tuple[Array, Array, Array]:
        """Return frequencies, below 0 for backward whirl [rad/s], how each grows with its pole's, and circulations.

        Poles (n_poles,) are complex in the turning frame [1/s], and have states (n, n_poles).
        """
        bent, straight = (_squares(motions, vectors) for motions in ((*self.across, *self.tilts), self.along))
        moved = bent + straight
        reach = _reach(vectors, (*self.across, *self.tilts, *self.along))
        bends = (bent > ACROSS_AXIS * moved) & (moved > (SOLVED * reach) ** 2)
        first, second = (C @ vectors for C in self.across)
        circulation = find_circulation(first, second)
        sense = np.where(bends & (circulation < 0.0), -1.0, 1.0)
        omega = np.where(bends, self.rate, 0.0) + sense * poles.imag
        carried = bends & (poles.imag == 0.0)
        whirl = np.where(carried, 1.0, np.where(bends, np.sign(omega) * np.abs(circulation), 0.0))
        return omega, sense, whirl


class SolvedVibrations(NamedTuple):
    """Vibrations in space, with the eigenvalues and vectors of the turning frame that they are."""

    seen: WhirlingModes  # from space
    poles: Array  # (n_modes,) [1/s], complex
    vectors: Array  # (n, n_modes): states, complex


def whirling_modes(A: Array, view: SpaceView) -> SolvedVibrations:
    """Return the vibrations in space of a rotor whose state matrix (n, n) is that of its turning frame."""
    poles, vectors = scaled_eigen(A)
    omega, _, whirl = view.look(poles, vectors)
    kept = order_poles(poles, np.abs(omega))
    seen = WhirlingModes(np.abs(omega[kept]) / (2 * np.pi), poles.real[kept], whirl[kept])
    return SolvedVibrations(seen, poles[kept], vectors[:, kept])


def _squares(motions: Sequence[Array], vectors: Array) -> Array:
    """Return the squared motions of all points in each vibration, added up, (n,)."""
    return np.asarray(sum((np.abs(C @ vectors) ** 2).sum(axis=0) for C in motions))


def _reach(vectors: Array, displacements: Sequence[Array]) -> Array:
    """Return how far the states of each vibration could move a point, (n,)."""
    return np.asarray(np.abs(vectors).max(axis=0, initial=0.0)) * max(
        float(np.abs(C).max(initial=0.0)) for C in displacements
    )


def hub_modes(A: Array, across: tuple[Array, Array], hub: Sequence[int]) -> WhirlingModes:
    """Return the vibrations of what turns on a hub, as the hub sees them.

    A (n, n) is the state matrix of small motions; ``across`` has displacements (n_points, n) for unit states along two
    axes across that of rotation; the states ``hub`` turn the hub itself.
    """
    poles, vectors = scaled_eigen(A)
    kept = order_poles(poles, poles.imag)
    poles, seen = poles[kept], vectors[:, kept].copy()
    seen[list(hub)] = 0.0
    first, second = (C @ seen for C in across)
    size = _reach(vectors[:, kept], across)
    moves = np.sqrt((np.abs(first) ** 2 + np.abs(second) ** 2).sum(axis=0)) > SOLVED * size
    whirl = np.where(moves, find_circulation(first, second), 0.0)
    return WhirlingModes(poles.imag / (2 * np.pi), poles.real, whirl)


def scaled_eigen(A: Array) -> tuple[Array, Array]:
    """Return eigenvalues and vectors of a state matrix, positions before rates, each position times its frequency.

    Round-off is taken out: by what has no stiffness, LAPACK would scale the rest to nothing.
    """
    scale = state_scale(A)
    scaled = scale[:, None] * A / scale
    scaled[np.abs(scaled) < NO_ENTRY * np.abs(scaled).max(initial=0.0)] = 0.0
    poles, vectors = np.linalg.eig(scaled)
    return poles, vectors / scale[:, None]


def state_scale(A: Array) -> Array:
    """Return the sizes of a state matrix's states, positions before rates: of each position its frequency [rad/s]."""
    n = len(A) // 2
    scale = np.ones(len(A))
    scale[:n] = np.sqrt(np.maximum(np.abs(A[n:, :n].diagonal()), 1.0))
    return scale

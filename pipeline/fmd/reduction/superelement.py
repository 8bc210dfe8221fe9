"""Superelements: a body's stiffness and mass for the motions of its interface and its fixed-interface modes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.core.limits.modes import ELASTIC_FREQUENCY
from fmd.reduction.craig_bampton import constraint_modes, interface_columns
from fmd.reduction.mode_families import complete_pairs

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver


@dataclass(frozen=True)
class Superelement:
    """Matrices of a body in coordinates of its interface, six a marker, and of its fixed-interface modes.

    Attributes
    ----------
    K, M, D : ndarray, shape (6 k + n, 6 k + n)
        Stiffness, mass and damping. Each marker has displacements along x, y and z, then rotations about them; the
        modes, of unit modal mass, come last. Interface and modes are not coupled in K.
    origins : mapping of str to ndarray, shape (3,)
        The markers' positions in the part's own coordinates, by name [m].
    omega : ndarray, shape (n,)
        Angular frequencies of the fixed-interface modes [rad/s].
    weight : ndarray, shape (6 k + n, 3)
        Generalised forces of unit gravity along x, y and z.
    """

    K: Array
    M: Array
    D: Array
    origins: Mapping[str, Array]
    omega: Array
    weight: Array

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies of the superelement, its rigid motions among them [Hz], shape (6 k + n,)."""
        from scipy.linalg import eigh

        omega2 = eigh(self.K, self.M, eigvals_only=True)
        return np.asarray(np.sqrt(np.maximum(omega2, 0.0)) / (2 * np.pi))


def make_superelement(
    fe: FEModel,
    solver: FreeBodySolver,
    markers: Mapping[str, Marker],
    count: int,
    damping: Callable[[Array], Array] = np.zeros_like,
) -> Superelement:
    """Reduce a body to its interface by Hurty, Craig & Bampton's method.

    Parameters
    ----------
    fe : FEModel
        The finite element model.
    solver : FreeBodySolver
        Solves for the body, which may be supported.
    markers : mapping of str to Marker
        The interface.
    count : int
        Number of fixed-interface modes; what completes the group of equal frequency of the highest comes on top.
    damping : callable
        Damping ratios of the superelement's elastic modes by their angular frequencies [rad/s], ascending; its rigid
        motions have none.

    Raises
    ------
    TooManyModesError
        The mesh has fewer modes.
    AccuracyError
        The markers can't move apart from one another.
    """
    B = interface_columns(fe, list(markers.values()))
    Psi = constraint_modes(fe, solver, B)
    held = complete_pairs(solver, count, B)
    V = np.concatenate([Psi, held.shapes.reshape(len(Psi), -1)], axis=1)
    K, M = (np.asarray(V.T @ (A @ V)) for A in (fe.K, fe.M))
    K, M, k = 0.5 * (K + K.T), 0.5 * (M + M.T), Psi.shape[1]
    # Both are so by theory, up to the solver's round-off.
    K[:k, k:], K[k:, :k] = 0.0, 0.0
    K[k:, k:], M[k:, k:] = np.diag(held.omega**2), np.eye(len(held.omega))
    gravity = np.zeros((len(fe.x), 3, 3))
    gravity[:, np.arange(3), np.arange(3)] = (fe.m @ np.ones(len(fe.x)))[:, None]
    weight = np.asarray(V.T @ gravity.reshape(len(V), 3))
    origins = {name: marker.position for name, marker in markers.items()}
    return Superelement(K, M, modal_damping(K, M, damping), origins, held.omega, weight)


def modal_damping(K: Array, M: Array, damping: Callable[[Array], Array]) -> Array:
    """Damping matrix by which the elastic modes of K and M have damping ratios, shape (n, n)."""
    from scipy.linalg import eigh

    omega2, V = eigh(K, M)
    omega = np.sqrt(np.maximum(omega2, 0.0))
    elastic = omega >= ELASTIC_FREQUENCY * omega[-1]
    MV = M @ V[:, elastic]
    return np.asarray((MV * (2 * damping(omega[elastic]) * omega[elastic])) @ MV.T)

"""Craig–Bampton basis and superelement: fixed-interface modes, and static responses to the interface's motion.

Bampton & Craig, AIAA Journal 6 (1968) 1313–1319. An interface is a set of markers; each has six coordinates, its mean
displacement and its mean rotation, or those of its rigid face.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError
from fmd.core.limits.modes import INTERFACE_DEFECT, RIGID_DEFECT, RIGID_REST, ZERO_EIGENVALUE
from fmd.core.limits.rank import NEW_SHAPE
from fmd.reduction.mode_families import classify_by_parity, complete_pairs, modes_of_family
from fmd.reduction.modes import Modes

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from fmd.core.data_classes import dataclass
from fmd.core.limits.modes import ELASTIC_FREQUENCY

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel
    from fmd.reduction.eigen import FreeBodySolver


def interface_columns(fe: FEModel, markers: Sequence[Marker]) -> Array:
    """Columns B of an interface: ``Bᵀ u`` are its coordinates, ``B f`` are nodal loads; (n_nodes, 3, 6 n_markers)."""
    return np.concatenate([marker.columns(len(fe.x), np.eye(3)) for marker in markers], axis=2)


def craig_bampton_modes(fe: FEModel, solver: FreeBodySolver, markers: Sequence[Marker], count: int) -> Modes:
    """Modes of a body in the space of its fixed-interface modes and constraint modes.

    The space holds every rigid motion that the supports leave, and every deformation by loads at the interface,
    exactly. Its rigid motions are counted and left out; the rest is orthonormalised, ``Φᵀ M Φ = 1``, ``Φᵀ K Φ = ω²``.
    There are ``count`` fixed-interface modes, with the rest of the highest one's group of equal frequency, and six for
    each marker. Frequencies are upper bounds (Rayleigh); the residual is that of the fixed-interface modes.

    Raises
    ------
    TooManyModesError
        The mesh has fewer fixed-interface modes.
    AccuracyError
        The constraint modes don't move the interface as they should, or the space holds another number of rigid motions
        than the supports leave; the message gives the figure.
    """
    B = interface_columns(fe, markers)
    Psi = constraint_modes(fe, solver, B)
    fixed = complete_pairs(solver, count, B)
    n_rigid, omega, shapes = _modes_between(fe, solver, fixed.shapes, Psi)
    numbers, n_completing = tuple(range(1, len(omega) + 1)), len(fixed.omega) - count
    return Modes(omega, shapes, n_rigid, fixed.residual, numbers, n_completing=n_completing)


def craig_bampton_modes_of_family(
    fe: FEModel, solver: FreeBodySolver, markers: Sequence[Marker], count: int, family: str, normal: Array
) -> Modes:
    """Modes of one family in the space of fixed-interface modes and constraint modes, by their symmetry.

    The fixed-interface modes are of the family, too, as in `modes_of_family`; the normal (3,) of the plane of motion is
    that of a plane of symmetry of the body and its interface.

    Raises
    ------
    AccuracyError
        The body or its interface isn't symmetric; or as `craig_bampton_modes`.
    TooManyModesError
        The mesh has fewer fixed-interface modes of the family.
    """
    B = interface_columns(fe, markers)
    Psi = constraint_modes(fe, solver, B)
    fixed = modes_of_family(solver, fe, count, family, normal, B)
    n_rigid, omega, shapes = _modes_between(fe, solver, fixed.shapes, Psi)
    found, shapes = classify_by_parity(fe, omega, shapes, normal)
    kept = [k for k, name in enumerate(found) if name == family]
    if "other" in found:
        raise AccuracyError(
            f"{found.count('other')} of the deflections by the interface have no symmetry, so they are of no family: "
            'its markers lie askew; use family = "any"'
        )
    return Modes(omega[kept], shapes[:, :, kept], n_rigid, fixed.residual, tuple(k + 1 for k in kept))


def _modes_between(fe: FEModel, solver: FreeBodySolver, fixed: Array, Psi: Array) -> tuple[int, Array, Array]:
    """Return the number of rigid motions, and omega and shapes of the rest, of both kinds of modes."""
    V = np.concatenate([fixed.reshape(len(Psi), -1), Psi], axis=1)
    n_rigid = _count_rigid_motions(fe, solver.rigid_modes, V, ZERO_EIGENVALUE * solver.bound)
    return n_rigid, *rayleigh_ritz(fe, _elastic(fe, solver.rigid_modes, V, V.shape[1] - n_rigid))


def constraint_modes(fe: FEModel, solver: FreeBodySolver, B: Array) -> Array:
    """Static deflections Ψ (3 n_nodes, k) by a unit of each interface coordinate, the others fixed, ``Bᵀ Ψ = 1``.

    ``K Ψ = B F``, with forces that are in equilibrium in all rigid motions R: ``Rᵀ B F = 0``. So Ψ consists of the
    responses G to unit forces (inertia relief takes nothing off forces in equilibrium) and of rigid motions. The
    columns B (n_nodes, 3, k) are as `interface_columns` gives them.

    Raises
    ------
    AccuracyError
        ``Bᵀ Ψ`` is off by more than `INTERFACE_DEFECT`: markers that can't move apart from one another.
    """
    G = solver.static_response(B).reshape(len(fe.x) * 3, -1)
    flat, R = B.reshape(len(G), -1), solver.rigid_modes
    k, n = flat.shape[1], R.shape[1]
    # Forces and torques, displacements and rotations differ in size by the body's extent.
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("ij,ij->j", flat, G), np.finfo(float).tiny))
    flat, G = flat * scale, G * scale
    BR = flat.T @ R
    system = np.block([[flat.T @ G, BR], [BR.T, np.zeros((n, n))]])
    solution = np.linalg.lstsq(system, np.concatenate([np.eye(k), np.zeros((n, k))]), rcond=None)[0]
    Psi = G @ solution[:k] + R @ solution[k:]
    off = float(np.abs(flat.T @ Psi - np.eye(k)).max())
    if not off < INTERFACE_DEFECT:
        raise AccuracyError(
            f"constraint modes move the interface by {off:.1e} of a unit where they should not: its markers can't move "
            "apart from one another; leave out one of them, or a support that fixes it"
        )
    return np.asarray(Psi * scale)


def rayleigh_ritz(fe: FEModel, V: Array) -> tuple[Array, Array]:
    """Diagonalise K and M in the space of columns V (3 n_nodes, n) by Rayleigh and Ritz.

    Returns angular frequencies (n,) [rad/s] and shapes (n_nodes, 3, n) of unit modal mass.
    """
    omega2, turn = eigh(fe.stiffness_of(V), V.T @ (fe.M @ V))
    return np.sqrt(omega2), (V @ turn).reshape(len(fe.x), 3, -1)


def _count_rigid_motions(fe: FEModel, R: Array, V: Array, zero: float) -> int:
    """Count the motions of a space with an eigenvalue below ``zero``; they must be the body's rigid motions R."""
    V = _independent(fe, V)
    omega2, turn = eigh(V.T @ (fe.K @ V), V.T @ (fe.M @ V))
    expected = R.shape[1]
    found = int(np.count_nonzero(omega2 < zero))
    if found != expected:
        raise AccuracyError(
            f"the Craig–Bampton space holds {found} rigid motions, the supports leave {expected}; its lowest "
            f"eigenvalues are {', '.join(f'{value:.1e}' for value in omega2[: expected + 2])} rad²/s²"
        )
    rest = R - V @ (turn[:, :found] @ (turn[:, :found].T @ (V.T @ (fe.M @ R))))
    size = np.einsum("ij,ij->j", R, fe.M @ R)
    off = float(np.sqrt(np.max(np.einsum("ij,ij->j", rest, fe.M @ rest) / size, initial=0.0)))
    if not off < RIGID_DEFECT:
        raise AccuracyError(f"the Craig–Bampton space misses {off:.1e} of a rigid motion, above {RIGID_DEFECT:.0e}")
    return found


def _elastic(fe: FEModel, R: Array, V: Array, n: int) -> Array:
    """Take the rigid motions R out of a space V; n M-orthonormal columns are left."""
    if R.shape[1]:
        MR, sizes = fe.M @ R, np.sqrt(np.einsum("ij,ij->j", V, fe.M @ V))
        for _ in range(2):
            V = V - R @ np.linalg.solve(R.T @ MR, MR.T @ V)
        # What is left of a rigid motion, as of each static shape of a body with one marker, is round-off.
        V = V[:, np.sqrt(np.einsum("ij,ij->j", V, fe.M @ V)) > RIGID_REST * sizes]
    return _independent(fe, V, n)


def _independent(fe: FEModel, V: Array, n: int | None = None) -> Array:
    """M-orthonormal columns that span V: n of them, or all that are independent."""
    V = V / np.sqrt(np.einsum("ij,ij->j", V, fe.M @ V))
    weight, turn = eigh(V.T @ (fe.M @ V))
    keep = np.flatnonzero(weight > NEW_SHAPE**2) if n is None else np.arange(len(weight) - n, len(weight))
    if n is not None and not weight[keep[0]] > NEW_SHAPE**2:
        raise AccuracyError(f"the Craig–Bampton shapes depend on one another: {weight[keep[0]]:.1e} of 1 is left")
    return np.asarray(V @ (turn[:, keep] / np.sqrt(weight[keep])))


@dataclass(frozen=True)
class Superelement:
    """Matrices of a body in coordinates of its interface, six a marker, and of its fixed-interface modes."""

    # (6 k + n, 6 k + n): Stiffness. Each marker has displacements along x, y and z, then rotations about them; the
    # modes, of unit modal mass, come last. Interface and modes are not coupled in it.
    K: Array
    M: Array  # (6 k + n, 6 k + n): mass in the same order
    D: Array  # (6 k + n, 6 k + n): damping in the same order
    origins: Mapping[str, Array]  # (3,): the markers' positions in the part's own coordinates, by name [m]
    omega: Array  # (n,): angular frequencies of the fixed-interface modes [rad/s]
    weight: Array  # (6 k + n, 3): generalised forces of unit gravity along x, y and z

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

    To ``count`` fixed-interface modes comes what completes the highest one's group of equal frequency. Damping gives
    the ratios of elastic modes by their frequencies [rad/s], ascending; rigid motions have none.

    Raises
    ------
    TooManyModesError
        The mesh has fewer modes.
    AccuracyError
        The markers can't move apart from one another.
    """
    B = interface_columns(fe, list(markers.values()))
    Psi = constraint_modes(fe, solver, B)
    fixed = complete_pairs(solver, count, B)
    V = np.concatenate([Psi, fixed.shapes.reshape(len(Psi), -1)], axis=1)
    K, M, k = fe.stiffness_of(V), np.asarray(V.T @ (fe.M @ V)), Psi.shape[1]
    M = 0.5 * (M + M.T)
    # Both are so by theory, up to the solver's round-off.
    K[:k, k:], K[k:, :k] = 0.0, 0.0
    K[k:, k:], M[k:, k:] = np.diag(fixed.omega**2), np.eye(len(fixed.omega))
    gravity = np.zeros((len(fe.x), 3, 3))
    gravity[:, np.arange(3), np.arange(3)] = (fe.m @ np.ones(len(fe.x)))[:, None]
    weight = np.asarray(V.T @ gravity.reshape(len(V), 3))
    origins = {name: marker.position for name, marker in markers.items()}
    return Superelement(K, M, modal_damping(K, M, damping), origins, fixed.omega, weight)


def modal_damping(K: Array, M: Array, damping: Callable[[Array], Array]) -> Array:
    """Damping matrix by which the elastic modes of K and M have damping ratios, shape (n, n)."""
    from scipy.linalg import eigh

    omega2, V = eigh(K, M)
    omega = np.sqrt(np.maximum(omega2, 0.0))
    elastic = omega >= ELASTIC_FREQUENCY * omega[-1]
    MV = M @ V[:, elastic]
    return np.asarray((MV * (2 * damping(omega[elastic]) * omega[elastic])) @ MV.T)

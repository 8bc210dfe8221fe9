"""The lowest modes of a free body, found by shift-invert Lanczos and verified before anyone sees them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh, null_space
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import AccuracyError
from pipeline.reduction.factor.factor import Factor, factorised, superlu
from pipeline.reduction.lanczos import largest_outside
from pipeline.reduction.modes import EigenPairs
from pipeline.reduction.supports import rigid_motions_left, without

if TYPE_CHECKING:
    from pipeline.fem.markers import Marker
    from pipeline.fem.model import FEModel

RESIDUAL_LIMIT = 1e-6
ORTHONORMALITY_LIMIT = 1e-8
STATIC_RESIDUAL_LIMIT = 1e-6  # in the energy norm, as that of modes
_BALANCED = 1e-12  # what is left below this part of a load is round-off: the body balances it by itself
_MAX_RESTARTS = 6
_STEP_GAIN = 1e-4
_MOST_STEPS = 100
# Lanczos stops at this residual: an eigenvalue is then good to its square, a shape to itself over the gap. It must stay
# below 1e-8, where single vectors have been seen to lose one of a pair.
_TOLERANCE = 1e-9
_TRIES = 3
_SAME = 1e-5  # part of the highest eigenvalue, within which another one is its equal
# An eigenvalue below this part of the shift is zero: Lanczos leaves about 1e-12, an elastic mode about 1.
_ZERO = 1e-6


class FreeBodySolver:
    """Solves with the stiffness of a free body through one factorisation of ``K − σ M``, σ < 0.

    K alone is singular for a free body, so a shift of zero would return garbage; a negative shift makes the
    matrix positive definite. It is scaled to the problem: a third of an upper bound of the lowest elastic
    eigenvalue.

    Parameters
    ----------
    fe : FEModel
        A body in one piece.
    rigid : sequence of Marker
        Markers whose faces are held rigid; they have no node in common.
    fixed : ndarray of int, optional
        Unknowns that supports hold; ``3 i + a`` is node i along axis a.
    factorise : callable
        Makes a `Factor` of a symmetric positive definite matrix.

    Attributes
    ----------
    rigid_modes : ndarray, shape (3 n_nodes, 6 or less)
        Rigid motions that the supports leave.
    shift : float
        σ [rad²/s²].

    Raises
    ------
    AccuracyError
        The mesh is in several unconnected pieces.
    TooLargeError
        The factor wouldn't fit into memory.
    """

    def __init__(
        self,
        fe: FEModel,
        rigid: Sequence[Marker] = (),
        fixed: IntArray | None = None,
        factorise: Callable[[Any], Factor] = factorised,
    ) -> None:
        n_pieces, _ = connected_components(fe.m, directed=False)
        if n_pieces > 1:
            raise AccuracyError(
                f"the mesh is in {n_pieces} unconnected pieces, so it has {6 * n_pieces} rigid-body modes "
                "instead of 6; join the pieces"
            )
        self._fe, self._factorise = fe, factorise
        self._T = rigid_faces(fe, rigid) if rigid else None
        self.rigid_modes, self._supported = fe.rigid_modes, fixed is not None
        if fixed is not None:
            T = sp.eye_array(fe.K.shape[0], format="csr") if self._T is None else self._T
            self._T, self.rigid_modes = without(T, fixed, len(rigid)), rigid_motions_left(fe, fixed)
        self._K, self._M, self._R = fe.K, fe.M, self.rigid_modes
        if self._T is not None:
            self._K, self._M = (sp.csr_array(self._T.T @ A @ self._T) for A in (fe.K, fe.M))
            self._R = self._reduced(self._R)
        self.shift, self._factor = self._factorised()
        self._inverse = self._factor.solve

    def _factorised(self) -> tuple[float, Factor]:
        """The shift σ and ``A⁻¹`` for ``A = K − σ M``."""
        shift = -0.3 * self._lowest_bound()
        return shift, self._factorise(self._K - shift * self._M)

    def _reduced(self, u: Array) -> Array:
        """Unknowns of fields u (3 n_nodes, k), in the mean where a face would have to bend."""
        return u if self._T is None else np.asarray(splu(sp.csc_array(self._T.T @ self._T)).solve(self._T.T @ u))

    def _expanded(self, u: Array) -> Array:
        """Nodal fields (n_nodes, 3, k) of unknowns u (n, k)."""
        return np.asarray(u if self._T is None else self._T @ u).reshape(len(self._fe.x), 3, -1)

    def _lowest_bound(self) -> float:
        """Upper bound of the lowest elastic eigenvalue [rad²/s²]: Rayleigh–Ritz on all quadratic displacements."""
        x = self._fe.x - self._fe.x.mean(axis=0)
        x = x / np.ptp(x, axis=0).max()
        terms = [np.ones(len(x)), *x.T, *(x[:, a] * x[:, b] for a in range(3) for b in range(a, 3))]
        V, K, M = np.kron(np.stack(terms, axis=1), np.eye(3)), self._K, self._M
        if self._supported:  # polynomials would break at the supports; the free body is softer in any case
            K, M = self._fe.K, self._fe.M
        else:
            V = self._reduced(V)
        V = np.linalg.qr(V)[0]
        return float(eigh(V.T @ (K @ V), V.T @ (M @ V), eigvals_only=True)[6])

    def modes(self, count: int, held: Array | None = None) -> EigenPairs:
        """Return the ``count`` lowest elastic modes.

        Parameters
        ----------
        held : ndarray, shape (n_nodes, 3, k), optional
            Columns B that hold the body, ``Bᵀ φ = 0``: ``K φ = ω² M φ + B μ``; without, the body is free.

        Raises
        ------
        AccuracyError
            Residual or M-orthonormality exceed their limits, or there are not as many rigid-body modes as the holding
            leaves, six of a free body; the message gives the figure.
        """
        K, M = self._K, self._M
        n = K.shape[0]
        B = np.zeros((n, 0)) if held is None else held.reshape(-1, held.shape[-1])
        if self._T is not None and B.shape[1]:
            B = self._T.T @ B
        inverse = held_inverse(self._inverse, B) if B.shape[1] else self._inverse
        Z = self._rigid_left(B)
        count = min(count, n - B.shape[1] - Z.shape[1])
        ncv = max(2 * count, count + 20)
        if ncv + Z.shape[1] < n - B.shape[1]:
            eigenvalues, Phi = self._elastic(count, ncv, Z, inverse)
            eigenvalues = np.concatenate([np.einsum("ij,ij->j", Z, K @ Z), eigenvalues])
            Phi = np.concatenate([Z, Phi], axis=1)
        else:  # a mesh of a few elements
            N = null_space(B.T) if B.shape[1] else np.eye(n)
            eigenvalues, Phi = eigh(N.T @ (K @ N), N.T @ (M @ N), subset_by_index=(0, count + Z.shape[1] - 1))
            Phi = N @ Phi
        order = np.argsort(eigenvalues)
        eigenvalues, Phi = eigenvalues[order], Phi[:, order]
        return self._checked(eigenvalues, Phi, Z.shape[1], inverse)

    def _rigid_left(self, B: Array) -> Array:
        """Rigid-body modes that a holding B leaves, ``Zᵀ M Z = 1``."""
        R = self._R @ null_space(B.T @ self._R) if B.shape[1] and self._R.shape[1] else self._R
        Z = np.linalg.qr(R)[0]
        return np.linalg.solve(np.linalg.cholesky(Z.T @ (self._M @ Z)), Z.T).T

    def _elastic(self, count: int, ncv: int, Z: Array, inverse: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Lowest eigenpairs among the fields that are M-orthogonal to the rigid-body modes Z.

        Those are known from geometry; left in, they would be the first that Lanczos finds, and cost solves.
        """
        for attempt in range(_TRIES):
            size = min(ncv << attempt, len(Z))
            if self._factor.lowest is not None and inverse is self._inverse:
                theta, Phi = self._factor.lowest(self._M, count, size, Z)
                values = theta + self.shift
            else:
                values, Phi = self._lanczos(count, size, Z, inverse, attempt)
            found = np.concatenate([Z, Phi], axis=1)
            outside = largest_outside(self._M, found, inverse, 1.0 / (values.max() - self.shift))
            missed = self.shift + 1.0 / outside
            if not missed < values.max() * (1 - _SAME):
                return values, Phi
        raise AccuracyError(
            f"Lanczos missed a mode at {np.sqrt(max(missed, 0.0)) / 2 / np.pi:.6g} Hz, below its highest, {_TRIES} "
            "times; ask for a few modes more or less"
        )

    def _lanczos(
        self, count: int, ncv: int, Z: Array, inverse: Callable[[Array], Array], seed: int
    ) -> tuple[Array, Array]:
        MZ = self._M @ Z

        def solve(f: Array) -> Array:
            x = inverse(f)
            return np.asarray(x - Z @ (MZ.T @ x))

        start = np.random.default_rng(seed).standard_normal(len(Z))
        start -= Z @ (MZ.T @ start)
        operator = LinearOperator(self._K.shape, matvec=solve, dtype=float)
        values, Phi = eigsh(self._K, count, self._M, self.shift, OPinv=operator, v0=start, ncv=ncv, tol=_TOLERANCE)
        return values, Phi

    def _checked(self, eigenvalues: Array, Phi: Array, expected: int, inverse: Callable[[Array], Array]) -> EigenPairs:
        """Count the rigid-body modes, verify the others and give each its sign."""
        n_rigid = int(np.count_nonzero(eigenvalues < _ZERO * -self.shift))
        if n_rigid != expected:
            lowest = ", ".join(f"{value:.1e}" for value in eigenvalues[:8])
            whole = "a free body" if expected == 6 else "the body as it is held"
            raise AccuracyError(
                f"found {n_rigid} rigid-body modes, {whole} has {expected}; the lowest eigenvalues are {lowest} "
                f"rad²/s², of which those below {_ZERO * -self.shift:.1e} count as zero"
            )
        residual = _verified(self._K, self._M, eigenvalues, Phi, n_rigid, inverse, self.shift)
        shapes = self._expanded(Phi[:, n_rigid:])
        flat = shapes.reshape(-1, shapes.shape[2])
        shapes = shapes * np.sign(flat[np.abs(flat).argmax(axis=0), np.arange(flat.shape[1])])
        return EigenPairs(np.sqrt(eigenvalues[n_rigid:]), shapes, n_rigid, residual, factor=self._factor.figures)

    def inertia_response(self, u: Array) -> Array:
        """``(K − σ M)⁻¹ M u``: what the inertia of fields u (n_nodes, 3, k) bends; their rigid parts are left out."""
        R, flat = self.rigid_modes, u.reshape(self._fe.K.shape[0], -1)
        MR = self._fe.M @ R
        rigid_mass = R.T @ MR
        load = self._fe.M @ flat - MR @ np.linalg.solve(rigid_mass, MR.T @ flat)
        found = self._expanded(self._inverse(load if self._T is None else self._T.T @ load)).reshape(flat.shape)
        return np.asarray(found - R @ np.linalg.solve(rigid_mass, MR.T @ found)).reshape(u.shape)

    def static_response(self, f: Array) -> Array:
        """Solve ``K u = f`` for loads in equilibrium with the rigid acceleration they cause (inertia relief).

        Parameters
        ----------
        f : ndarray, shape (n_nodes, 3, n_loads)
            Nodal loads [N]; what accelerates the body as a whole is balanced by its inertia.

        Returns
        -------
        ndarray, shape (n_nodes, 3, n_loads)
            Displacements [m], M-orthogonal to the rigid-body modes.

        Raises
        ------
        AccuracyError
            The residual stayed above `STATIC_RESIDUAL_LIMIT`.
        """
        K, R, MR = self._K, self._R, self._M @ self._R
        rigid_mass = R.T @ MR
        given = f.reshape(-1, f.shape[-1]) if self._T is None else self._T.T @ f.reshape(-1, f.shape[-1])

        def balanced(load: Array) -> Array:
            return np.asarray(load - MR @ np.linalg.solve(rigid_mass, R.T @ load))

        def energy(load: Array) -> Array:
            return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->j", load, self._inverse(load)), 0.0)))

        loads = balanced(given)
        nothing = np.linalg.norm(loads, axis=0) <= _BALANCED * np.linalg.norm(given, axis=0)
        loads[:, nothing] = 0.0
        size = np.where(nothing, 1.0, energy(loads))
        u, before = np.zeros_like(loads), np.inf
        # Conjugate gradients with the shifted factor take a few steps. They start anew on what is left of the load,
        # balanced again: K does not see rigid-body round-off, which would spoil a long run.
        for _ in range(_MAX_RESTARTS):
            defect = balanced(loads - K @ u)
            residual = energy(defect) / size  # in which round-off of stiff elements counts little
            if residual.max() < 1e-12 or (residual.max() < STATIC_RESIDUAL_LIMIT and residual.max() > 0.1 * before):
                break
            before = residual.max()
            u += _conjugate_gradients(K, defect, self._inverse)
            u -= R @ np.linalg.solve(rigid_mass, MR.T @ u)
        if not residual.max() < STATIC_RESIDUAL_LIMIT:
            raise AccuracyError(
                f"static response {residual.argmax()}: residual {residual.max():.1e} "
                f"exceeds {STATIC_RESIDUAL_LIMIT:.0e}"
            )
        return self._expanded(u)


def held_inverse(inverse: Callable[[Array], Array], B: Any) -> Callable[[Array], Array]:
    """``f → A⁻¹f − A⁻¹B (BᵀA⁻¹B)⁻¹ BᵀA⁻¹f``: the inverse among the fields with ``Bᵀu = 0``."""
    Z = inverse(B)
    weights = np.linalg.solve(B.T @ Z, Z.T)

    def solve(f: Array) -> Array:
        # The reaction is taken off the load first, and off the result again: A⁻¹ alone is large in rigid motions,
        # which would have to cancel.
        x = inverse(f - B @ (weights @ f))
        return np.asarray(x - weights.T @ (B.T @ x))

    return solve


def _conjugate_gradients(K: Any, f: Array, inverse: Callable[[Array], Array]) -> Array:
    """Solve ``K u = f``, all columns side by side, to about four digits, preconditioned by ``inverse``."""
    u, r = np.zeros_like(f), f.copy()
    z = inverse(r)
    p, product = z.copy(), np.einsum("ij,ij->j", r, z)
    enough = _STEP_GAIN**2 * product
    for _ in range(_MOST_STEPS):
        going = product > enough
        if not going.any():
            break
        Kp = K @ p
        step = np.where(going, product, 0.0) / np.where(going, np.einsum("ij,ij->j", p, Kp), 1.0)
        u += step * p
        r -= step * Kp
        z = inverse(r)
        before, product = product, np.where(going, np.einsum("ij,ij->j", r, z), 0.0)
        p = z + product / np.where(going, before, 1.0) * p
    return u


def rigid_faces(fe: FEModel, markers: Sequence[Marker]) -> sp.csr_array:
    """Transformation ``u = T u_r`` that lets the nodes of each marker's face move as one rigid piece.

    Parameters
    ----------
    markers : sequence of Marker
        Their faces have no node in common.

    Returns
    -------
    sparse array, shape (3 n_nodes, n)
        Unknowns: those of all other nodes, then displacement and rotation of each marker.

    Raises
    ------
    ValueError
        Two faces share nodes.
    """
    slaves = np.concatenate([marker.nodes for marker in markers])
    if len(np.unique(slaves)) < len(slaves):
        raise ValueError("two rigid faces share nodes; make one of the attachments 'averaged'")
    others = np.setdiff1d(np.arange(len(fe.x)), slaves)
    unknowns = (3 * others[:, None] + np.arange(3)).ravel()
    kept = sp.csr_array((np.ones(len(unknowns)), (unknowns, np.arange(len(unknowns)))), (fe.K.shape[0], len(unknowns)))
    blocks = [kept]
    for marker in markers:
        r = fe.x[marker.nodes] - marker.position
        moves = np.concatenate([np.tile(np.eye(3), (len(r), 1, 1)), np.cross(np.eye(3), r[:, None]).swapaxes(1, 2)], 2)
        rows = np.repeat((3 * marker.nodes[:, None] + np.arange(3)).ravel(), 6)
        columns = np.tile(np.arange(6), 3 * len(r))
        blocks.append(sp.csr_array((moves.ravel(), (rows, columns)), (fe.K.shape[0], 6)))
    return sp.csr_array(sp.hstack(blocks))


def modes_below(fe: FEModel, omega: float) -> int:
    """Count the modes below ``omega`` [rad/s], rigid-body modes included, by Sylvester's law of inertia.

    The number of negative pivots of ``K − ω² M`` equals the number of eigenvalues below ω²; the count is
    independent of any iteration, so it shows a mode that Lanczos has skipped.
    """
    factor = superlu(fe.K - omega**2 * fe.M)
    if not np.array_equal(factor.perm_r, factor.perm_c):
        raise AccuracyError("the factorisation left the diagonal: its pivots don't show the inertia")
    return int(np.count_nonzero(factor.U.diagonal() < 0))


def _verified(
    K: Any, M: Any, eigenvalues: Array, Phi: Array, n_rigid: int, inverse: Callable[[Array], Array], shift: float
) -> float:
    """Largest residual of the elastic pairs, in the energy norm: that of the eigenvalue is about its square.

    ``r = K φ − λ M φ`` is weighed by the inverse of ``K − σ M``, in which round-off of the stiffest element motions
    counts little and what holds the body may answer with any force.
    """
    MPhi = M @ Phi
    lack = float(np.abs(Phi.T @ MPhi - np.eye(len(eigenvalues))).max())
    if not lack < ORTHONORMALITY_LIMIT:
        raise AccuracyError(f"modes are not M-orthonormal: error {lack:.1e} exceeds {ORTHONORMALITY_LIMIT:.0e}")
    elastic = eigenvalues[n_rigid:]
    defects = K @ Phi[:, n_rigid:] - elastic * MPhi[:, n_rigid:]
    energies = np.einsum("ij,ij->j", defects, inverse(defects))
    residuals = np.sqrt(np.maximum(energies, 0.0) / (elastic - shift))
    if not residuals.max() < RESIDUAL_LIMIT:
        worst = int(residuals.argmax())
        raise AccuracyError(
            f"mode {worst + 1} at {np.sqrt(elastic[worst]) / 2 / np.pi:.6g} Hz has a residual of "
            f"{residuals[worst]:.1e}, above {RESIDUAL_LIMIT:.0e}"
        )
    return float(residuals.max())

"""The lowest modes of a free body, found by shift-invert Lanczos and verified before anyone sees them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, cg, eigsh, splu

from pipeline.checks import AccuracyError, Array
from pipeline.reduction.modes import EigenPairs

if TYPE_CHECKING:
    from pipeline.fem.model import FEModel

RESIDUAL_LIMIT = 1e-6
ORTHONORMALITY_LIMIT = 1e-8
STATIC_RESIDUAL_LIMIT = 1e-8
_BALANCED = 1e-12  # what is left below this part of a load is round-off: the body balances it by itself
_MAX_RESTARTS = 6
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

    Raises
    ------
    AccuracyError
        The mesh is in several unconnected pieces.
    """

    def __init__(self, fe: FEModel) -> None:
        n_pieces, _ = connected_components(fe.m, directed=False)
        if n_pieces > 1:
            raise AccuracyError(
                f"the mesh is in {n_pieces} unconnected pieces, so it has {6 * n_pieces} rigid-body modes "
                "instead of 6; join the pieces"
            )
        self._fe = fe
        self.shift = -0.3 * lowest_eigenvalue_bound(fe)
        self._factor = splu(
            sp.csc_array(fe.K - self.shift * fe.M),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def modes(self, count: int) -> EigenPairs:
        """Return the ``count`` lowest elastic modes.

        Raises
        ------
        AccuracyError
            Residual or M-orthonormality exceed their limits, or there are not six rigid-body modes; the message
            gives the figure.
        """
        K, M = self._fe.K, self._fe.M
        n = K.shape[0]
        count = min(count, n - 6)
        ncv = max(2 * (count + 6) + 1, 40)
        if ncv < n:
            eigenvalues, Phi = eigsh(
                K,
                k=count + 6,
                M=M,
                sigma=self.shift,
                OPinv=LinearOperator(K.shape, matvec=self._factor.solve, dtype=float),
                v0=np.random.default_rng(0).standard_normal(n),
                ncv=ncv,
            )
        else:  # a mesh of a few elements
            eigenvalues, Phi = eigh(K.toarray(), M.toarray(), subset_by_index=(0, count + 5))
        order = np.argsort(eigenvalues)
        eigenvalues, Phi = eigenvalues[order], Phi[:, order]
        n_rigid = int(np.count_nonzero(eigenvalues < _ZERO * -self.shift))
        if n_rigid != 6:
            lowest = ", ".join(f"{value:.1e}" for value in eigenvalues[:8])
            raise AccuracyError(
                f"found {n_rigid} rigid-body modes, a free body has 6; the lowest eigenvalues are {lowest} rad²/s², "
                f"of which those below {_ZERO * -self.shift:.1e} count as zero"
            )
        residual = _verified(K, M, eigenvalues, Phi)
        Phi = Phi[:, 6:] * np.sign(Phi[np.abs(Phi[:, 6:]).argmax(axis=0), np.arange(6, Phi.shape[1])])
        return EigenPairs(np.sqrt(eigenvalues[6:]), Phi.reshape(-1, 3, count), n_rigid, residual)

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
        fe = self._fe
        R, MR = fe.rigid_modes, fe.M @ fe.rigid_modes
        rigid_mass = R.T @ MR

        def balanced(load: Array) -> Array:
            return np.asarray(load - MR @ np.linalg.solve(rigid_mass, R.T @ load))

        loads = balanced(f.reshape(-1, f.shape[-1]))
        size = np.linalg.norm(loads, axis=0)
        nothing = size <= _BALANCED * np.linalg.norm(f.reshape(loads.shape), axis=0)
        loads[:, nothing], size[nothing] = 0.0, 1.0
        u = np.zeros_like(loads)
        solve = LinearOperator(fe.K.shape, matvec=self._factor.solve, dtype=float)
        # Conjugate gradients with the shifted factor take a few steps. They start anew on what is left of the load,
        # balanced again: K does not see rigid-body round-off, which would spoil a long run.
        for _ in range(_MAX_RESTARTS):
            defect = balanced(loads - fe.K @ u)
            residual = np.linalg.norm(defect, axis=0) / size
            if residual.max() < 1e-12:
                break
            for k, part in enumerate(defect.T):
                u[:, k] += cg(fe.K, part, rtol=1e-4, maxiter=100, M=solve)[0]
            u -= R @ np.linalg.solve(rigid_mass, MR.T @ u)
        if not residual.max() < STATIC_RESIDUAL_LIMIT:
            raise AccuracyError(
                f"static response {residual.argmax()}: residual {residual.max():.1e} "
                f"exceeds {STATIC_RESIDUAL_LIMIT:.0e}"
            )
        return np.asarray(u.reshape(f.shape))


def lowest_eigenvalue_bound(fe: FEModel) -> float:
    """Upper bound of the lowest elastic eigenvalue [rad²/s²]: Rayleigh–Ritz on all quadratic displacement fields."""
    x = (fe.x - fe.x.mean(axis=0)) / np.ptp(fe.x, axis=0).max()
    terms = [np.ones(len(x)), *x.T, *(x[:, a] * x[:, b] for a in range(3) for b in range(a, 3))]
    V = np.kron(np.stack(terms, axis=1), np.eye(3))
    V = np.linalg.qr(V)[0]
    return float(eigh(V.T @ (fe.K @ V), V.T @ (fe.M @ V), eigvals_only=True)[6])


def modes_below(fe: FEModel, omega: float) -> int:
    """Count the modes below ``omega`` [rad/s], rigid-body modes included, by Sylvester's law of inertia.

    The number of negative pivots of ``K − ω² M`` equals the number of eigenvalues below ω²; the count is
    independent of any iteration, so it shows a mode that Lanczos has skipped.
    """
    factor = splu(
        sp.csc_array(fe.K - omega**2 * fe.M),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    if not np.array_equal(factor.perm_r, factor.perm_c):
        raise AccuracyError("the factorisation left the diagonal: its pivots don't show the inertia")
    return int(np.count_nonzero(factor.U.diagonal() < 0))


def _verified(K: Any, M: Any, eigenvalues: Array, Phi: Array) -> float:
    MPhi = M @ Phi
    lack = float(np.abs(Phi.T @ MPhi - np.eye(len(eigenvalues))).max())
    if not lack < ORTHONORMALITY_LIMIT:
        raise AccuracyError(f"modes are not M-orthonormal: error {lack:.1e} exceeds {ORTHONORMALITY_LIMIT:.0e}")
    elastic = eigenvalues[6:] * MPhi[:, 6:]
    residuals = np.linalg.norm(K @ Phi[:, 6:] - elastic, axis=0) / np.linalg.norm(elastic, axis=0)
    if not residuals.max() < RESIDUAL_LIMIT:
        worst = int(residuals.argmax())
        raise AccuracyError(
            f"mode {worst + 1} at {np.sqrt(eigenvalues[6 + worst]) / 2 / np.pi:.6g} Hz has a residual of "
            f"{residuals[worst]:.1e}, above {RESIDUAL_LIMIT:.0e}"
        )
    return float(residuals.max())

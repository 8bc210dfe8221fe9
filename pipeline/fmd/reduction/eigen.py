"""The lowest modes of a body by shift-invert Lanczos, each result verified before it is handed on."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh, null_space
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from fmd.core.arrays import Array, IntArray, read_only
from fmd.core.errors import AccuracyError
from fmd.core.limits.contact import COLUMNS_AT_ONCE
from fmd.core.limits.memory import BYTES_FOR_RESPONSES
from fmd.core.limits.modes import (
    BASIS_BLOCKS,
    DENSE_FROM,
    LANCZOS_RESIDUAL,
    LANCZOS_TRIES,
    LARGEST_OVERLAP,
    LARGEST_RESIDUAL,
    MOST_DENSE,
    OF_ROUND_OFF,
    ROUNDED_RESIDUAL,
    SHIFT,
    ZERO_EIGENVALUE,
)
from fmd.core.progress import Advance
from fmd.fem.products import SparseProducts
from fmd.reduction.block_lanczos import largest_pairs
from fmd.reduction.factor.factor import Factor, factorise, refuse_large_search, refuse_too_large
from fmd.reduction.free_motions import count_pieces, wrong_count
from fmd.reduction.inertia_relief import (
    THIN,
    constrained_inverse,
    flexibility_at,
    held_stiffness,
    rounded_defect,
    solve_balanced,
)
from fmd.reduction.missed_modes import missed_eigenvalue
from fmd.reduction.modes import EigenPairs, separate_modes
from fmd.reduction.supports import remaining_rigid_motions, remove_fixed_unknowns, tie_rigid_faces

if TYPE_CHECKING:
    from fmd.fem.markers import Marker
    from fmd.fem.model import FEModel


Inverse = Callable[[Array], Array]


class FreeBodySolver:
    """Modes and static responses of a body in one piece from one factorisation of ``K − σ M``, σ < 0.

    K alone is singular for a body that can move, so a shift of zero would return garbage; a negative shift makes the
    matrix positive definite. It is scaled to the problem: a part of ``bound``, an upper bound of the lowest elastic
    eigenvalue [rad²/s²], 0 if supports hold the whole body. Faces of ``rigid`` markers have no node in common;
    ``fixed`` are the unknowns that supports fix, ``3 i + a`` of node i along axis a. ``rigid_modes`` (3 n_nodes, 6 or
    less) are the motions that these leave, ``shift`` is σ [rad²/s²].

    Raises
    ------
    AccuracyError
        The mesh is in several unconnected pieces.
    TooLargeError
        The factor wouldn't fit into memory.
    ValueError
        Rigid faces share nodes, with one another or with a support.
    """

    _part = SHIFT  # of the bound, which the shift is

    def __init__(
        self,
        fe: FEModel,
        rigid: Sequence[Marker] = (),
        fixed: IntArray | None = None,
        factorise: Callable[[Any], Factor] = factorise,
    ) -> None:
        n_pieces = count_pieces(fe.K, fe.T)
        if n_pieces > 1:
            raise AccuracyError(
                f"the mesh is in {n_pieces} unconnected pieces, so it has {6 * n_pieces} rigid-body modes "
                "instead of 6; join the pieces"
            )
        self._fe, self._factorise = fe, factorise
        self._T = tie_rigid_faces(fe, rigid) if rigid else fe.T
        self.rigid_modes, self._supported = fe.rigid_modes, fixed is not None
        if fixed is not None:
            T = sp.eye_array(fe.K.shape[0], format="csr") if self._T is None else self._T
            self._T = remove_fixed_unknowns(T, fixed, 6 * len(rigid) + fe.link_unknowns)
            self.rigid_modes = remaining_rigid_motions(fe, fixed)
        self._K, self._M, self._R = fe.K, fe.M, self.rigid_modes
        if self._T is not None:
            self._K, self._M = (sp.csr_array(self._T.T @ A @ self._T) for A in (fe.K, fe.M))
            self._R = _unknowns_of(self._R, self._T)
        self._products = fe.products if self._T is None else SparseProducts(self._K)
        self._mass_products = SparseProducts(self._M)
        self.bound = self._lowest_bound() if self.rigid_modes.shape[1] else 0.0
        self.shift = -self._part * self.bound
        self._factor = self._shifted_factor()
        self._inverse = self._factor.solve
        self._responses: dict[bytes, Array] = {}
        self._advance: Advance = lambda done: None

    @contextmanager
    def telling(self, advance: Advance) -> Iterator[None]:
        """Tell ``advance`` the part of modes or static responses that is done, 0 as their solutions begin."""
        before, self._advance = self._advance, advance
        try:
            yield
        finally:
            self._advance = before

    def modes(self, count: int, constraints: Array | None = None, known: EigenPairs | None = None) -> EigenPairs:
        """Return the ``count`` lowest elastic modes, or all that a small mesh has.

        With columns B (n_nodes, 3, k) of constraints ``Bᵀ φ = 0`` they have ``K φ = ω² M φ + B μ``; without, the body
        is free. ``known`` are the lowest of them, beside which a large body's others are sought.

        Raises
        ------
        AccuracyError
            Residual or M-orthonormality exceed their limits, or there are not as many rigid-body modes as the holding
            leaves, six of a free body; the message gives the figure.
        TooLargeError
            The search wouldn't fit into memory.
        """
        n, B = self._K.shape[0], self._constraint_columns(constraints)
        inverse = constrained_inverse(self._inverse, B) if B.shape[1] else self._inverse
        Z = self._rigid_modes_left(B)
        room = n - B.shape[1] - Z.shape[1]
        count, before = min(count, room), np.zeros((n, 0))
        if known is not None and count <= len(known.omega):
            return known
        n_vectors = max(2 * count, count + 20)
        if n_vectors < (DENSE_FROM * room if self.shift < 0.0 and n <= MOST_DENSE else room):  # without, K has hinges
            refuse_large_search(self._factor, n, count)
            if known is not None:
                before = _unknowns_of(known.shapes.reshape(self._fe.K.shape[0], -1), self._T)
                count -= before.shape[1]
            eigenvalues, Phi = self._elastic_pairs(count, room, np.concatenate([Z, before], axis=1), inverse)
        else:
            known = None
            held = np.concatenate([B, self._M @ Z], axis=1)
            N = null_space((held / np.linalg.norm(held, axis=0)).T) if held.shape[1] else np.eye(n)
            mass, last = N.T @ (self._M @ N), N.shape[1] - 1
            shifted = N.T @ (self._K @ N) - self.shift * mass  # definite, which light parts may leave no mass matrix
            theta, Phi = eigh(mass, shifted, subset_by_index=(last + 1 - count, last))
            eigenvalues, Phi = 1.0 / theta + self.shift, N @ Phi / np.sqrt(theta)
        eigenvalues = np.concatenate([np.einsum("ij,ij->j", Z, self._K @ Z), eigenvalues])
        Phi = np.concatenate([Z, Phi], axis=1)
        order = np.argsort(eigenvalues)
        found = self._verified_pairs(eigenvalues[order], Phi[:, order], Z.shape[1], inverse, before)
        return found if known is None else known.with_others(found)

    def most_modes(self, constraints: Array | None = None) -> int:
        """Return how many elastic modes `modes` can compute: all of a small mesh, not quite half of a large one's.

        More than that takes a dense solver, whose time grows with the third power of the number of unknowns.
        Constraints have columns (n_nodes, 3, k).
        """
        n, B = self._K.shape[0], self._constraint_columns(constraints)
        n_elastic: int = n - B.shape[1] - self._rigid_modes_left(B).shape[1]
        return n_elastic if n <= MOST_DENSE else (n_elastic - 1) // 2

    def static_response(self, f: Array) -> Array:
        """Solve ``K u = f`` for loads in equilibrium with the rigid acceleration they cause (inertia relief).

        Nodal loads [N] and displacements [m] are (n_nodes, 3, n_loads); what accelerates the body as a whole is
        balanced by its inertia, and displacements are M-orthogonal to the rigid-body modes.

        Raises
        ------
        AccuracyError
            The residual stayed above its limit.
        """
        self._advance(0.0)
        given = self._inverse, self._loads(f), self._advance, self._forces
        return self._nodal(solve_balanced(self._products, self._mass_products, self._R, *given))

    def flexibility(self, nodes: IntArray) -> Array:
        """Return displacements of nodes by unit forces, ``Bᵀ K⁺ B`` (3 n, 3 n) [m/N], K⁺ `static_response`."""
        size, most, respond = 3 * len(nodes), COLUMNS_AT_ONCE, self.responder()
        units = (np.eye(size, min(most, size - k), -k) for k in range(0, size, most))
        G = np.concatenate([respond(nodes, f) for f in units], axis=1)
        return np.asarray(0.5 * (G + G.T))

    def responder(self) -> Callable[[IntArray, Array], Array]:
        """Return what finds displacements of nodes by forces on them, (3 n, k) each, one solution a column."""
        inverse = self._factorise(held_stiffness(self._K, self._R)).solve if self._R.shape[1] else self._inverse

        def respond(nodes: IntArray, forces: Array) -> Array:
            f = np.zeros((len(self._fe.x), 3, forces.shape[1]))
            f[nodes] = forces.reshape(len(nodes), 3, -1)
            u = flexibility_at(self._K, self._M, self._R, inverse, self._loads(f))
            return (self.static_response(f) if u is None else self._nodal(u))[nodes].reshape(forces.shape)

        return respond

    def remembered_response(self, f: Array) -> Array:
        """Return `static_response` of loads, of which only those are solved for that it hasn't had before.

        A basis and its stiffening, and those of bases with more modes, are bent by the same loads. They are refused
        with `TooLargeError` before anything is solved if they don't fit into memory.
        """
        rows = f.reshape(f.shape[0] * f.shape[1], -1).T + 0.0 if f.size else ()  # negative zeros are other bytes
        names = [blake2b(row.tobytes()).digest() for row in rows]
        new = {name: k for k, name in enumerate(names) if name not in self._responses}
        if new:
            unknowns = f.shape[0] * f.shape[1]
            what = f"the static responses of its {unknowns} unknowns to {len(new)} loads need"
            refuse_too_large(BYTES_FOR_RESPONSES * unknowns * len(new), what, remedy=", or take fewer loads")
            found = self.static_response(f[:, :, list(new.values())])
            self._responses |= {name: read_only(found[:, :, k].copy()) for k, name in enumerate(new)}
        return np.stack([self._responses[name] for name in names], axis=2) if names else np.zeros_like(f)

    def inertia_response(self, u: Array) -> Array:
        """Deflections ``(K − σ M)⁻¹ M u`` by the inertia of fields u (n_nodes, 3, k), without any rigid motion."""
        R, flat = self.rigid_modes, u.reshape(self._fe.K.shape[0], -1)
        rigid_mass = R.T @ (MR := self._fe.M @ R)
        load = self._fe.M @ flat - MR @ np.linalg.solve(rigid_mass, MR.T @ flat)
        bent = self._nodal(self._inverse(load if self._T is None else self._T.T @ load)).reshape(flat.shape)
        return np.asarray(bent - R @ np.linalg.solve(rigid_mass, MR.T @ bent)).reshape(u.shape)

    def _shifted_factor(self) -> Factor:
        """Factorise ``K − σ M``."""
        return self._factorise(self._K - self.shift * self._M)

    def _forces(self, u: Array) -> Array:
        """Elastic forces on the unknowns (n, k) by unknowns u (n, k), with less round-off than K has."""
        return self._loads(self._fe.forces(self._nodal(u).reshape(self._fe.K.shape[0], -1)))

    def _loads(self, f: Array) -> Array:
        """Loads on the unknowns (n, k) of nodal loads f (n_nodes, 3, k)."""
        flat = f.reshape(-1, f.shape[-1])
        return flat if self._T is None or not flat.shape[1] else np.asarray(self._T.T @ flat)

    def _constraint_columns(self, constraints: Array | None) -> Array:
        """Columns B (n, k) of the constraints on the unknowns; none if the body is free."""
        return np.zeros((self._K.shape[0], 0)) if constraints is None else self._loads(constraints)

    def _nodal(self, u: Array) -> Array:
        """Nodal fields (n_nodes, 3, k) of unknowns u (n, k)."""
        return np.asarray(u if self._T is None else self._T @ u).reshape(len(self._fe.x), 3, -1)

    def _lowest_bound(self) -> float:
        """Upper bound of the lowest elastic eigenvalue [rad²/s²]: Rayleigh–Ritz on all quadratic displacements."""
        x = self._fe.x - self._fe.x.mean(axis=0)
        x = x / np.ptp(x, axis=0).max()
        terms = [np.ones(len(x)), *x.T, *(x[:, a] * x[:, b] for a in range(3) for b in range(a, 3))]
        Q, K, M, T = np.linalg.qr(np.stack(terms, axis=1))[0], self._K, self._M, self._T
        V = np.kron(Q, np.eye(3))
        if self._supported:  # polynomials would break at the supports; the free body is softer in any case
            K, M, T = self._fe.K, self._fe.M, self._fe.T
            if T is not None:
                K, M = T.T @ K @ T, T.T @ M @ T
        if T is None:
            m = np.kron(Q.T @ (self._fe.m @ Q), np.eye(3))
        else:
            V = np.linalg.qr(_unknowns_of(V, T))[0]
            m = V.T @ (M @ V)
        k = V.T @ (K @ V)
        scale = float(np.trace(k) / np.trace(m))
        theta = eigh(m, k + scale * m, eigvals_only=True)  # 1 / (λ + scale), which is 0 of what carries no mass
        return float(1.0 / theta[-7] - scale)

    def _rigid_modes_left(self, B: Array) -> Array:
        """Rigid-body modes that constraints B leave, ``Zᵀ M Z = 1``."""
        R = self._R @ null_space(B.T @ self._R) if B.shape[1] and self._R.shape[1] else self._R
        Z = np.linalg.qr(R)[0]
        return np.linalg.solve(np.linalg.cholesky(Z.T @ (self._M @ Z)), Z.T).T

    def _elastic_pairs(self, count: int, room: int, Z: Array, inverse: Inverse) -> tuple[Array, Array]:
        """Lowest eigenpairs among the fields that are M-orthogonal to known modes Z, of ``room`` dimensions with these.

        Rigid-body modes are known from geometry; left in, they would be the first that Lanczos finds, and cost solves.
        So are the modes of a search before, which may have missed one: of equal frequencies a start has no more than it
        has vectors.
        """
        values, Phi, known = np.zeros(0), np.zeros((len(Z), 0)), Z
        for attempt in range(LANCZOS_TRIES):
            size = min(max(2 * count, count + 20), room - Phi.shape[1] - 1)
            more, near = min(count, size // 2), np.zeros((len(Z), 0))
            if self._factor.lowest is not None and inverse is self._inverse:
                theta, new = self._factor.lowest(self._M, more, size, known)
                found = theta + self.shift
            elif self._factor.at_once > 1:
                found, new, near = self._block_lanczos(more, size, known, inverse, attempt)
            else:
                found, new = self._lanczos(more, size, known, inverse, attempt)
            values, Phi = np.concatenate([values, found]), np.concatenate([Phi, new], axis=1)
            lowest = np.argsort(values)[:count]
            values, Phi = values[lowest], Phi[:, lowest]
            known = np.concatenate([Z, Phi], axis=1)
            apart = np.concatenate([known, near], axis=1)
            missed = missed_eigenvalue(
                self._mass_products, apart, inverse, self.shift, values.max(), self._factor.at_once
            )
            if missed is None and len(values) == count:
                return values, Phi
            hertz = np.sqrt(max(missed or values.max(), 0.0)) / 2 / np.pi
        raise AccuracyError(
            f"Lanczos missed a mode at {hertz:.6g} Hz, below its highest, {LANCZOS_TRIES} times; ask for a few "
            "modes more or less"
        )

    def _lanczos(self, count: int, n_vectors: int, Z: Array, inverse: Inverse, seed: int) -> tuple[Array, Array]:
        MZ, solve = self._M @ Z, self._counted(inverse, 2 * n_vectors - count)  # solutions, if it restarts once
        start = np.random.default_rng(seed).standard_normal(len(Z))
        start -= Z @ (MZ.T @ start)

        def outside(f: Array) -> Array:
            x = solve(f)
            return np.asarray(x - Z @ (MZ.T @ x))

        operator = LinearOperator(self._K.shape, matvec=outside, dtype=float)
        values, Phi = eigsh(
            self._K, count, self._M, self.shift, OPinv=operator, v0=start, ncv=n_vectors, tol=LANCZOS_RESIDUAL
        )
        return values, Phi

    def _block_lanczos(
        self, count: int, n_vectors: int, Z: Array, inverse: Inverse, seed: int
    ) -> tuple[Array, Array, Array]:
        block = self._factor.at_once
        size = max(n_vectors, count + BASIS_BLOCKS * block)
        start = np.random.default_rng(seed).standard_normal((len(Z), block))
        solve = self._counted(inverse, 2 * size / block)
        theta, Phi, near = largest_pairs(solve, self._mass_products, Z, count, size, start)
        return 1.0 / theta + self.shift, Phi, near

    def _counted(self, inverse: Inverse, expected: float) -> Inverse:
        """Return an inverse that tells which part of the expected solutions is done."""
        solved = itertools.count(1)
        self._advance(0.0)

        def solve(f: Array) -> Array:
            x = inverse(f)
            self._advance(min(next(solved) / expected, 1.0))
            return x

        return solve

    def _verified_pairs(
        self, eigenvalues: Array, Phi: Array, expected: int, inverse: Inverse, before: Array | None = None
    ) -> EigenPairs:
        """Count the rigid-body modes, verify the others, beside the elastic ones ``before``, and give each its sign."""
        n_rigid = int(np.count_nonzero(eigenvalues < ZERO_EIGENVALUE * self.bound))
        if n_rigid != expected:  # round-off of stiff, thin elements leaves more of a rigid mode's eigenvalue
            sizes = np.abs(Phi)
            rounded = float(np.finfo(float).eps * (sizes * (abs(self._K) @ sizes)).sum(axis=0).max())
            n_rigid = int(np.count_nonzero(eigenvalues < min(OF_ROUND_OFF * rounded, ROUNDED_RESIDUAL * self.bound)))
        if n_rigid != expected:
            limits = ZERO_EIGENVALUE * self.bound, rounded
            raise wrong_count(self._fe, self._nodal(Phi[:, :n_rigid]), self.rigid_modes, expected, eigenvalues, limits)
        known = Phi[:, :n_rigid] if before is None else np.concatenate([Phi[:, :n_rigid], before], axis=1)
        residual, squares, Phi = self._refine(eigenvalues[n_rigid:], Phi[:, n_rigid:], known, inverse)
        flat = self._nodal(Phi).reshape(self._fe.K.shape[0], -1)
        flat = flat * np.sign(flat[np.abs(flat).argmax(axis=0), np.arange(flat.shape[1])])
        order = np.argsort(squares)
        shapes = flat[:, order].reshape(len(self._fe.x), 3, -1)
        return EigenPairs(np.sqrt(squares[order]), shapes, n_rigid, residual, factor=self._factor.figures)

    def _refine(self, squares: Array, Phi: Array, known: Array, inverse: Inverse) -> tuple[float, Array, Array]:
        """Return the largest residual of elastic pairs in the energy norm, and refined ω² and modes.

        ``r = K φ − ω² M φ`` is weighed by the inverse of ``K − σ M``, in which round-off of the stiffest element
        motions counts little and the reactions of constraints may be of any size. Modes are refined by what the
        response ``u`` to r has outside all modes, known ones too, and by their forces on one another.
        """
        MPhi, first = self._M @ Phi, known.shape[1]
        overlaps = np.concatenate([known.T @ MPhi, Phi.T @ MPhi])
        error = float(np.abs(overlaps - np.eye(len(overlaps), len(squares), -first)).max())
        if not error < LARGEST_OVERLAP:
            raise AccuracyError(f"modes are not M-orthonormal: error {error:.1e} exceeds {LARGEST_OVERLAP:.0e}")
        energies, u, stiffness = np.empty_like(squares), np.empty_like(Phi), np.empty((len(squares),) * 2)
        for begin in range(0, len(energies), COLUMNS_AT_ONCE):
            some = slice(begin, begin + COLUMNS_AT_ONCE)
            defects = self._forces(Phi[:, some])
            stiffness[:, some] = Phi.T @ defects
            defects -= squares[some] * MPhi[:, some]
            u[:, some] = inverse(defects)
            energies[some] = np.einsum("ij,ij->j", defects, u[:, some])
        residuals = np.sqrt(np.maximum(energies, 0.0) / (squares - self.shift))
        worst = int(residuals.argmax())
        if not residuals[worst] < LARGEST_RESIDUAL:
            defect = rounded_defect(self._K, Phi[:, worst])  # what round-off leaves by itself
            rounded = float(np.sqrt(defect @ inverse(defect) / (squares[worst] - self.shift)))
            if not residuals[worst] < min(OF_ROUND_OFF * rounded, ROUNDED_RESIDUAL):
                thin = rounded > 0.1 * ROUNDED_RESIDUAL
                raise AccuracyError(
                    f"mode {worst + 1} at {np.sqrt(squares[worst]) / 2 / np.pi:.6g} Hz has a residual of "
                    f"{residuals[worst]:.1e}, above {LARGEST_RESIDUAL:.0e}"
                    + (f"; round-off alone leaves {rounded:.0e}, {THIN}" if thin else "")
                )
        if first:
            u -= known @ ((self._M @ known).T @ u)  # in which lower modes' round-off would be larger
        u -= Phi @ (MPhi.T @ u)
        squares, turn = separate_modes(stiffness, overlaps[first:])
        return float(residuals[worst]), squares, np.subtract(Phi, u, out=u) @ turn


def _unknowns_of(u: Array, T: sp.csr_array | None) -> Array:
    """Return the unknowns of fields u (3 n_nodes, k), in the mean where a face would have to bend."""
    return u if T is None else np.asarray(splu(sp.csc_array(T.T @ T)).solve(T.T @ u))

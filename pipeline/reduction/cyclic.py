"""Modes and static responses of a cyclic body from one of its sectors.

A body that a turn by 2π/N carries into itself has modes of harmonic index h: from one sector to the next a field turns
with the body and gains the phase ``μ = 2π h/N`` (Thomas, Int J Num Meth Eng 14, 1979). With z the complex field of the
first sector, ``z_high = e^{iμ} R z_low`` on its two cuts; each 0 < h < N/2 has its modes in pairs, Re and Im of the
same z. One real factorisation of the sector's inside serves all harmonics: it is condensed to its cuts, and only
their few unknowns know of the phase.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import LinearOperator, eigs, eigsh
from scipy.spatial import cKDTree

from pipeline.core.arrays import Array, IntArray
from pipeline.core.errors import AccuracyError
from pipeline.fem.assembly import assemble
from pipeline.fem.mesh import SolidMesh
from pipeline.fem.model import FEModel
from pipeline.reduction.eigen import FreeBodySolver
from pipeline.reduction.factor.factor import Factor, factorise
from pipeline.reduction.modes import EigenPairs

_SAME_PLACE = 1e-6  # of the body's extent
_SPARE = 3  # modes of each harmonic beyond its share


@dataclass(frozen=True)
class Sector:
    """One sector of a cyclic body.

    Attributes
    ----------
    fe : FEModel
        The sector, its cuts free.
    images : ndarray, shape (N, n_nodes)
        Node of the whole body where each turn carries each of the sector's nodes.
    low, high : ndarray, shape (n_cut,)
        The sector's nodes on its cuts; a turn carries ``low`` onto ``high``.
    """

    fe: FEModel
    images: IntArray
    low: IntArray
    high: IntArray

    @property
    def count(self) -> int:
        """N."""
        return len(self.images)

    def paired(self, harmonic: int) -> bool:
        """Whether a harmonic's modes come in pairs."""
        return 0 < 2 * harmonic < self.count

    def turned(self, u: Array, k: int) -> Array:
        """Turn fields u (n_nodes, 3, …) by k sectors about z."""
        return np.asarray(np.einsum("ab,ib...->ia...", _turn(2 * np.pi * k / self.count), u))

    def expanded(self, z: Array, harmonic: int) -> Array:
        """Real parts of the whole body's fields, (n_all, 3, n), of fields z (n_nodes, 3, n) of one harmonic."""
        own = np.setdiff1d(np.arange(len(z)), self.high)
        whole = np.empty((self.images.max() + 1, *z.shape[1:]))
        for k, image in enumerate(self.images):
            phase = np.exp(2j * np.pi * harmonic * k / self.count)
            whole[image[own]] = self.turned((phase * z[own]).real, k)
        return whole

    def harmonic_part(self, f: Array, harmonic: int) -> Array:
        """Load on the sector (n_nodes, 3, n), complex, of one harmonic of a load f (n_all, 3, n).

        A node on both cuts has its load on the lower.
        """
        part = np.zeros((self.images.shape[1], *f.shape[1:]), dtype=complex)
        for k, image in enumerate(self.images):
            part += np.exp(-2j * np.pi * harmonic * k / self.count) * self.turned(f[image], -k)
        part[self.high] = 0.0
        return part / self.count


def first_sector(fe: FEModel, sectors: int) -> Sector:
    """Cut the first of a number of sectors off a cyclic body: the first cells of each of its parts.

    Raises
    ------
    ValueError
        There are fewer than three: two have both cuts in common.
    AccuracyError
        Turning the sector doesn't give the body.
    """
    if sectors < 3:
        raise ValueError(f"a cyclic body needs at least 3 sectors, not {sectors}")
    mesh, x = fe.discretisation.mesh, fe.x
    cells = np.concatenate([numbers[: len(numbers) // sectors] for numbers in mesh.parts.values()])
    points, corners = np.unique(mesh.cells[cells], return_inverse=True)
    own = SolidMesh(mesh.points[points], corners.reshape(len(cells), -1), mesh.cell_type, {}, {})
    sector = assemble(own, fe.discretisation.order, fe.material)
    tree = cKDTree(x)
    found = [tree.query(sector.x @ _turn(2 * np.pi * k / sectors).T) for k in range(sectors)]
    images = np.stack([image for _, image in found])
    distance = max(float(away.max()) for away, _ in found) / np.ptp(x, axis=0).max()
    place = np.full(len(x), -1)
    place[images[1]] = np.arange(len(sector.x))
    high = np.flatnonzero(place[images[0]] >= 0)
    whole = len(np.unique(images)) == len(x) == sectors * (len(sector.x) - len(high))
    if not (whole and distance < _SAME_PLACE):
        raise AccuracyError(
            f"{sectors} turns of the mesh's first sector don't make the mesh: a node is {distance:.1e} of its size off "
            "its image"
        )
    return Sector(sector, images, place[images[0][high]], high)


class CyclicSolver(FreeBodySolver):
    """Solves for a cyclic body by solves for one sector; free modes are found harmonic by harmonic.

    Parameters
    ----------
    fe : FEModel
        The body.
    sectors : int
        How many turns carry it into itself.
    factorise : callable
        Makes a `Factor` of a symmetric positive definite matrix, here of the sector's inside.
    """

    def __init__(self, fe: FEModel, sectors: int, factorise: Callable[[Any], Factor] = factorise) -> None:
        self._sector = first_sector(fe, sectors)
        super().__init__(fe, factorise=factorise)

    def _shifted_factor(self) -> tuple[float, Factor]:
        """A shift far below the lowest eigenvalue, whose bound may be ten times too high: held cuts keep A stiff."""
        shift = -0.002 * self._lowest_bound()
        self._harmonics = _CyclicInverse(self._sector, shift, self._factorise)
        return shift, Factor(self._harmonics, self._harmonics.figures)

    def modes(self, count: int, held: Array | None = None) -> EigenPairs:
        """Return the ``count`` lowest elastic modes as `FreeBodySolver.modes` does; those of a held body as a whole."""
        n, n_sectors = self._sector.fe.K.shape[0], self._sector.count
        if held is not None or 4 * (count + 6) > n:
            return super().modes(count, held)
        found: list[tuple[float, int, Array]] = []
        highest = np.inf  # below it, no harmonic has a mode that wasn't found
        for harmonic in range(n_sectors // 2 + 1):
            paired = self._sector.paired(harmonic)
            values, z = self._harmonics.modes(harmonic, (count + 6) // n_sectors + _SPARE)
            highest = min(highest, float(values[-1]))
            for value, field in zip(values, z.T / np.sqrt(n_sectors / (1 + paired)), strict=True):
                found += [(value, harmonic, field), (value, harmonic, -1j * field)][: 1 + paired]
        found = sorted(found, key=lambda mode: mode[0])[: count + 6]
        eigenvalues = np.array([value for value, _, _ in found])
        if len(found) < count + 6 or not eigenvalues[-1] <= highest:
            return super().modes(count)
        shapes = [self._sector.expanded(z.reshape(-1, 3), harmonic).ravel() for _, harmonic, z in found]
        return self._verified_pairs(eigenvalues, np.stack(shapes, axis=1), 6, self._inverse)


class _CyclicInverse:
    """``A⁻¹`` of the whole body, ``A = K − σ M``, by static condensation of one sector to its cuts.

    The sector's inside is factorised once, with its cuts held; only the few unknowns of a cut differ between harmonics.
    """

    def __init__(self, sector: Sector, shift: float, factorise: Callable[[Any], Factor]) -> None:
        self._sector, self._shift = sector, shift
        self._K, self._M = sector.fe.K, sector.fe.M
        cut = (3 * np.concatenate([sector.low, sector.high])[:, None] + np.arange(3)).ravel()
        inside = np.setdiff1d(np.arange(self._K.shape[0]), cut)
        A = sp.csr_array(self._K - shift * self._M)
        self._cut, self._inside = cut, inside
        factor = factorise(A[inside][:, inside])
        self._inverse, self.figures = factor.solve, factor.figures
        self._from_inside = A[cut][:, inside]
        self._Z = self._inverse(self._from_inside.T.toarray())  # the inside follows the cuts by −Z
        S = A[cut][:, cut].toarray() - self._from_inside @ self._Z
        self._moves = [self._move(harmonic) for harmonic in range(sector.count // 2 + 1)]
        self._condensed = [cho_factor(T.conj().T @ S @ T) for T in self._moves]

    def _move(self, harmonic: int) -> Array:
        """How both cuts move with the lower one, shape (6 n_cut, 3 n_cut)."""
        n = len(self._sector.low)
        phase = np.exp(2j * np.pi * harmonic / self._sector.count)
        return np.concatenate([np.eye(3 * n), phase * np.kron(np.eye(n), _turn(2 * np.pi / self._sector.count))])

    def solve_harmonic(self, harmonic: int, f: Array) -> Array:
        """Solve for sector loads f (3 n_nodes, k), complex, of one harmonic."""
        T, z = self._moves[harmonic], np.empty(f.shape, dtype=complex)
        alone = _apart(self._inverse, f[self._inside])
        load = T.conj().T @ (f[self._cut] - _on_complex(self._from_inside, alone))
        z[self._cut] = T @ cho_solve(self._condensed[harmonic], load)
        z[self._inside] = alone - _on_complex(self._Z, z[self._cut])
        return z

    def __call__(self, f: Array) -> Array:
        """Solve for loads f on the whole body, (3 n_all,) or (3 n_all, k)."""
        sector = self._sector
        loads = f.reshape(-1, 3, f[0].size)
        u = np.zeros(loads.shape)
        for harmonic in range(len(self._moves)):
            part = sector.harmonic_part(loads, harmonic)
            z = self.solve_harmonic(harmonic, part.reshape(-1, f[0].size))
            u += (1 + sector.paired(harmonic)) * sector.expanded(z.reshape(part.shape), harmonic)
        return u.reshape(f.shape)

    def modes(self, harmonic: int, count: int) -> tuple[Array, Array]:
        """Eigenvalues (count,), ascending, and fields z (3 n_nodes, count) of one harmonic, ``zᴴ M z = 1``."""
        n = self._K.shape[0]
        start = np.random.default_rng(0).standard_normal(n)
        settings: dict[str, Any] = {"k": count, "sigma": self._shift, "v0": start, "ncv": max(2 * count + 1, 20)}
        if not self._sector.paired(harmonic):
            inverse = LinearOperator((n, n), lambda f: self.solve_harmonic(harmonic, f.reshape(n, 1)).real, dtype=float)
            values, Z = eigsh(self._K, M=self._M, OPinv=inverse, **settings)
            order = np.argsort(values)
            return values[order], Z[:, order]

        def operator(apply: Callable[[Array], Array]) -> LinearOperator:
            return LinearOperator((n, n), lambda u: apply(u.reshape(n, 1)), dtype=complex)

        K, M = (operator(lambda u, A=A: _on_complex(A, u)) for A in (self._K, self._M))  # type: ignore[misc]
        settings["v0"] = start.astype(complex)
        values, Z = eigs(K, M=M, OPinv=operator(lambda f: self.solve_harmonic(harmonic, f)), **settings)
        order = np.argsort(values.real)
        Z = Z[:, order]
        # Orthonormal where eigenvalues are equal too, as those of rigid-body modes are.
        weights = np.linalg.cholesky(Z.conj().T @ _on_complex(self._M, Z))
        return values.real[order], np.linalg.solve(weights, Z.conj().T).conj().T


def _turn(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _apart(operation: Callable[[Array], Array], z: Array) -> Array:
    """Apply a real operation to complex columns (n, k): to real and imaginary parts side by side."""
    both = operation(np.concatenate([z.real, z.imag], axis=1))
    return np.asarray(both[:, : z.shape[1]] + 1j * both[:, z.shape[1] :])


def _on_complex(A: Any, z: Array) -> Array:
    return _apart(lambda columns: A @ columns, z)

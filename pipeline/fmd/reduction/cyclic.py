"""Modes and static responses of a cyclic body from one of its sectors.

A body that a turn by 2π/N carries into itself has modes of harmonic index h: from one sector to the next a field turns
with the body and gains the phase ``μ = 2π h/N`` (Thomas, Int J Num Meth Eng 14, 1979). With z the complex field of the
first sector, ``z_high = e^{iμ} R z_low`` on its two cuts; each 0 < h < N/2 has its modes in pairs, Re and Im of the
same z. One real factorisation of the sector's inside serves all harmonics: it is condensed to its cuts, and only
their few unknowns know of the phase.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import LinearOperator, eigs, eigsh
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError
from fmd.core.limits.mesh import SAME_PLACE
from fmd.core.limits.modes import SHIFT_OF_CYCLIC, SPARE_MODES
from fmd.fem.assembly import assemble
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.space import Discretisation
from fmd.reduction.eigen import FreeBodySolver
from fmd.reduction.factor.factor import Factor, factorise
from fmd.reduction.modes import EigenPairs


@dataclass(frozen=True)
class Sector:
    """One sector of a cyclic body."""

    fe: FEModel  # the sector, its cuts free
    images: IntArray  # (N, n_nodes): node of the whole body to which each turn carries each node of the sector
    low: IntArray  # (n_cut,): the sector's nodes on its first cut
    high: IntArray  # (n_cut,): those on its second cut, onto which a turn carries ``low``

    @property
    def count(self) -> int:
        """Number N of sectors in the whole body."""
        return len(self.images)

    def is_paired(self, harmonic: int) -> bool:
        """Return true if the modes of a harmonic come in pairs of equal frequency."""
        return 0 < 2 * harmonic < self.count

    def phases(self, harmonic: int) -> NDArray[Any]:
        """Return the factor of each sector's field over the first one's, shape (N,); real unless paired."""
        if self.is_paired(harmonic):
            return np.asarray(np.exp(2j * np.pi * harmonic * np.arange(self.count) / self.count))
        return np.where(harmonic * np.arange(self.count) % self.count, -1.0, 1.0)

    def turn(self, u: Array, k: int) -> Array:
        """Turn fields u (n_nodes, 3, …) by k sectors about z."""
        return np.asarray(np.einsum("ab,ib...->ia...", rotation_about_z(2 * np.pi * k / self.count), u))

    def expand(self, z: Array, harmonic: int) -> Array:
        """Expand fields z (n_nodes, 3, n) of one harmonic to the whole body; real parts (n_all, 3, n)."""
        own = np.setdiff1d(np.arange(len(z)), self.high)
        whole = np.empty((self.images.max() + 1, *z.shape[1:]))
        for k, (phase, image) in enumerate(zip(self.phases(harmonic), self.images, strict=True)):
            whole[image[own]] = self.turn((phase * z[own]).real, k)
        return whole

    def harmonic_part(self, f: Array, harmonic: int) -> Array:
        """Part of one harmonic in loads f (n_all, 3, n), as loads on the sector (n_nodes, 3, n), real unless paired.

        Loads on the cuts stand on the lower one.
        """
        phases = self.phases(harmonic).conj()
        part = np.zeros((self.images.shape[1], *f.shape[1:]), dtype=phases.dtype)
        for k, (phase, image) in enumerate(zip(phases, self.images, strict=True)):
            part += phase * self.turn(f[image], -k)
        part[self.high] = 0.0
        return part / self.count


def cut_first_sector(fe: FEModel, sectors: int) -> Sector:
    """Cut the first of a number of sectors off a cyclic body, whose cells come sector by sector.

    Raises
    ------
    ValueError
        There are fewer than three sectors: two have both cuts in common.
    AccuracyError
        Turns of the sector don't make up the body.
    """
    if sectors < 3:
        raise ValueError(f"a cyclic body needs at least 3 sectors, not {sectors}")
    assert isinstance(fe.discretisation, Discretisation)  # others aren't of sectors
    mesh, x = fe.discretisation.mesh, fe.x
    n_cells = len(mesh.cells) // sectors
    points, corners = np.unique(mesh.cells[:n_cells], return_inverse=True)
    own = SolidMesh(mesh.points[points], corners.reshape(n_cells, -1), mesh.cell_type, {}, {})
    space = fe.discretisation
    sector = assemble(own, space.order, fe.material.of_elements(np.arange(n_cells)), space.formulation)
    tree = cKDTree(x)
    nearest = [tree.query(sector.x @ rotation_about_z(2 * np.pi * k / sectors).T) for k in range(sectors)]
    images = np.stack([image for _, image in nearest])
    distance = max(float(away.max()) for away, _ in nearest) / np.ptp(x, axis=0).max()
    place = np.full(len(x), -1)
    place[images[1]] = np.arange(len(sector.x))
    high = np.flatnonzero(place[images[0]] >= 0)
    whole = len(np.unique(images)) == len(x) == sectors * (len(sector.x) - len(high))
    if not (whole and distance < SAME_PLACE):
        raise AccuracyError(
            f"{sectors} turns of the mesh's first sector don't make the mesh: a node is {distance:.1e} of its size off "
            "its image"
        )
    return Sector(sector, images, place[images[0][high]], high)


def rotation_about_z(angle: float) -> Array:
    """Rotation matrix about z for an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class CyclicSolver(FreeBodySolver):
    """Solver for a cyclic body that factorises one sector only and finds free modes harmonic by harmonic.

    Each turn carries one of the sectors into the next; ``factorise`` makes a `Factor` of the sector's inside.
    """

    _part = SHIFT_OF_CYCLIC

    def __init__(self, fe: FEModel, sectors: int, factorise: Callable[[Any], Factor] = factorise) -> None:
        self._sector = cut_first_sector(fe, sectors)
        super().__init__(fe, factorise=factorise)

    def _shifted_factor(self) -> Factor:
        """Condense the sector to its cuts; they are fixed meanwhile, so ``K − σ M`` is stiff whatever σ."""
        self._harmonics = _CyclicInverse(self._sector, self.shift, self._factorise)
        return Factor(self._harmonics, self._harmonics.figures)

    def modes(self, count: int, constraints: Array | None = None, known: EigenPairs | None = None) -> EigenPairs:
        """Return the ``count`` lowest elastic modes as `FreeBodySolver.modes`; under constraints those of the whole."""
        n, n_sectors = self._sector.fe.K.shape[0], self._sector.count
        if constraints is not None or 4 * (count + 6) > n:
            return super().modes(count, constraints, known)
        modes: list[tuple[float, int, Array]] = []
        highest = np.inf  # below it, no harmonic has a mode that is missing
        for harmonic in range(n_sectors // 2 + 1):
            paired = self._sector.is_paired(harmonic)
            values, z = self._harmonics.modes(harmonic, (count + 6) // n_sectors + SPARE_MODES)
            highest = min(highest, float(values[-1]))
            for value, field in zip(values, z.T / np.sqrt(n_sectors / (1 + paired)), strict=True):
                modes += [(value, harmonic, field), (value, harmonic, -1j * field)][: 1 + paired]
        modes = sorted(modes, key=lambda mode: mode[0])[: count + 6]
        eigenvalues = np.array([value for value, _, _ in modes])
        if len(modes) < count + 6 or not eigenvalues[-1] <= highest:
            return super().modes(count, known=known)
        shapes = [self._sector.expand(z.reshape(-1, 3), harmonic).ravel() for _, harmonic, z in modes]
        return self._verified_pairs(eigenvalues, np.stack(shapes, axis=1), 6, self._inverse)


class _CyclicInverse:
    """Inverse of ``A = K − σ M`` for the whole body by static condensation of one sector to its cuts.

    The sector's inside is factorised once, with its cuts fixed; only the few unknowns of a cut differ by harmonic.
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
        self._following = self._inverse(self._from_inside.T.toarray())  # the inside follows the cuts by −Z
        S = A[cut][:, cut].toarray() - self._from_inside @ self._following
        self._cut_motions = [self._cut_motion(harmonic) for harmonic in range(sector.count // 2 + 1)]
        self._condensed = [cho_factor(T.conj().T @ S @ T) for T in self._cut_motions]

    def _cut_motion(self, harmonic: int) -> Array:
        """Motion of both cuts for unit motion of the lower one in a harmonic, shape (6 n_cut, 3 n_cut)."""
        n = len(self._sector.low)
        phase = self._sector.phases(harmonic)[1]
        return np.concatenate(
            [np.eye(3 * n), phase * np.kron(np.eye(n), rotation_about_z(2 * np.pi / self._sector.count))]
        )

    def solve_harmonic(self, harmonic: int, f: Array) -> Array:
        """Solve for sector loads f (3 n_nodes, k) of one harmonic, complex ones unless it is without pairs."""
        T, z = self._cut_motions[harmonic], np.empty_like(f)
        alone = _by_parts(self._inverse, f[self._inside])
        load = T.conj().T @ (f[self._cut] - _times(self._from_inside, alone))
        z[self._cut] = T @ cho_solve(self._condensed[harmonic], load)
        z[self._inside] = alone - _times(self._following, z[self._cut])
        return z

    def __call__(self, f: Array) -> Array:
        """Solve for loads f on the whole body, (3 n_all,) or (3 n_all, k)."""
        sector = self._sector
        loads = f.reshape(-1, 3, f[0].size)
        u = np.zeros(loads.shape)
        for harmonic in range(len(self._cut_motions)):
            part = sector.harmonic_part(loads, harmonic)
            z = self.solve_harmonic(harmonic, part.reshape(-1, f[0].size))
            u += (1 + sector.is_paired(harmonic)) * sector.expand(z.reshape(part.shape), harmonic)
        return u.reshape(f.shape)

    def modes(self, harmonic: int, count: int) -> tuple[Array, Array]:
        """Return the lowest eigenvalues of one harmonic, ascending [rad²/s²], and its fields Z (3 n_nodes, count).

        These are the sector's, with ``Zᴴ M Z = 1``.
        """
        return (self._paired_modes if self._sector.is_paired(harmonic) else self._real_modes)(harmonic, count)

    def _real_modes(self, harmonic: int, count: int) -> tuple[Array, Array]:
        """Eigenpairs of a harmonic whose fields are real."""
        n = self._K.shape[0]
        inverse = LinearOperator((n, n), lambda f: self.solve_harmonic(harmonic, f.reshape(n, 1)), dtype=float)
        values, Z = eigsh(
            self._K, count, self._M, self._shift, OPinv=inverse, v0=_start(n), ncv=_lanczos_vectors(count)
        )
        order = np.argsort(values)
        return values[order], Z[:, order]

    def _paired_modes(self, harmonic: int, count: int) -> tuple[Array, Array]:
        """Eigenpairs of a harmonic whose fields are complex."""
        n = self._K.shape[0]

        def operator(apply: Callable[[Array], Array]) -> LinearOperator:
            return LinearOperator((n, n), lambda u: apply(u.reshape(n, 1)), dtype=complex)

        K, M = (operator(lambda u, A=A: _times(A, u)) for A in (self._K, self._M))  # type: ignore[misc]
        inverse = operator(lambda f: self.solve_harmonic(harmonic, f))
        start = _start(n).astype(complex)
        values, Z = eigs(K, count, M, self._shift, OPinv=inverse, v0=start, ncv=_lanczos_vectors(count))
        order = np.argsort(values.real)
        Z = Z[:, order]
        # Orthonormal where eigenvalues are equal too, as those of rigid-body modes are.
        weights = np.linalg.cholesky(Z.conj().T @ _times(self._M, Z))
        return values.real[order], np.linalg.solve(weights, Z.conj().T).conj().T


def _start(n: int) -> Array:
    """Fixed start vector of a search, so that each run gives one result."""
    return np.random.default_rng(0).standard_normal(n)


def _lanczos_vectors(count: int) -> int:
    """Number of vectors in a search for ``count`` eigenpairs."""
    return max(2 * count + 1, 20)


def _by_parts(operation: Callable[[Array], Array], z: Array) -> Array:
    """Apply a real operation to columns (n, k), to real and imaginary parts side by side if they are complex."""
    if not np.iscomplexobj(z):
        return operation(z)
    both = operation(np.concatenate([z.real, z.imag], axis=1))
    return np.asarray(both[:, : z.shape[1]] + 1j * both[:, z.shape[1] :])


def _times(A: Any, z: Array) -> Array:
    """Product of a real matrix with columns (n, k), real or complex."""
    return _by_parts(lambda columns: A @ columns, z)

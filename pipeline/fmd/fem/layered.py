"""Laminates as materials of shells: ply by ply at a point, and summed over the thickness for energies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import DIRECTION_ALONG_NORMAL
from fmd.fem.material import PLANE, bond, plane_tensor

if TYPE_CHECKING:
    from fmd.fem.elements import ElementSpace
    from fmd.fem.laminate import Laminate


class DirectionError(ValueError):
    """The direction from which a laminate's angles count is the shell's normal somewhere."""


@dataclass(frozen=True)
class Layered:
    """A laminate as the material of a shell's elements."""

    laminate: Laminate
    # (n_elements, 3): of the body, vectors whose projections onto the shell are the laminate's direction
    directions: Array

    def over(self, elements: IntArray | slice) -> Iterator[tuple[Layered, IntArray | slice]]:
        """Yield the material with all of the elements."""
        yield self, slice(None)

    def repeats(self, times: int) -> bool:
        """Return false: shells aren't of sectors."""
        return False

    def of_elements(self, elements: IntArray) -> Layered:
        """Return the material of some elements."""
        return replace(self, directions=self.directions[elements])

    @property
    def summed(self) -> SummedLayers:
        """The laminate with its plies summed over the thickness, as energies take it."""
        return SummedLayers(self.laminate, self.directions)

    @property
    def isotropic(self) -> None:
        """Nothing: no modulus and no ratio are its own."""

    @property
    def rho(self) -> float:
        """Mean density [kg/m³]."""
        plies = self.laminate.plies
        return sum(ply.lamina.rho * ply.thickness for ply in plies) / self.laminate.thickness

    def density(self, X: Array) -> Array:
        """Return the density at quadrature points X (3, n_q), whose sums over the thickness are the plies', (n_q,)."""
        places, n = _through(X)
        moments = self.laminate.moments(places)
        return np.repeat(moments.density / moments.weights, n)

    def stress(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return the stress of strains at points X of elements, both of shape (n_elements, n_q, 6, n)."""
        N = bond(self.frames(space.jacobians(X, elements), elements))[..., PLANE, :]
        C = self.laminate.stiffnesses[self.laminate.ply_at(X[2])]
        return np.asarray((N.swapaxes(2, 3) @ C @ N) @ strain)

    def ply_stress(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return the stress of strains at points X in the axes of their plies, (n_elements, n_q, 5, n).

        Components are 11, 22, 23, 13, 12 [Pa].
        """
        frames, ply = self.frames(space.jacobians(X, elements), elements), self.laminate.ply_at(X[2])
        turn = np.array([each.turn for each in self.laminate.plies])[ply]
        C = np.array([each.lamina.stiffness for each in self.laminate.plies])[ply]
        return np.asarray((C @ bond(turn @ frames)[..., PLANE, :]) @ strain)

    def through_shell(
        self, A: Array, J: Array, zeta: Array | None, elements: IntArray, given_at: float | None = None
    ) -> Array:
        """Return strains (n_elements, n_q, 3, 3) of a shell's displacement with the plies' transverse shear.

        Parameters are those of `Material.through_shell`. Stretch through the thickness is left out: its stress is none.
        """
        R = self.frames(J, elements)
        local = R @ A @ R.swapaxes(2, 3)
        share = np.zeros((1, 2, 2)) if zeta is None else self.laminate.shear_strain(zeta)
        if given_at is not None:
            share = share @ np.linalg.inv(self.laminate.shear_strain(np.array([given_at])))
        across = (share @ local[..., :2, 2:])[..., 0]
        return np.asarray(R.swapaxes(2, 3) @ plane_tensor(local, across) @ R)

    def frames(self, J: Array, elements: IntArray) -> Array:
        """Return the laminate's axes at points with base vectors J, rows along, across and normal, (…, 3, 3).

        Raises
        ------
        DirectionError
            The direction is that of the shell's normal; the message counts the elements.
        """
        n = J[..., 2] / np.linalg.norm(J[..., 2], axis=-1, keepdims=True)
        d = np.broadcast_to(self.directions[elements][:, None], n.shape)
        along = d - (d * n).sum(axis=-1, keepdims=True) * n
        size, whole = np.linalg.norm(along, axis=-1, keepdims=True), np.linalg.norm(d, axis=-1, keepdims=True)
        if (bad := ~(size >= DIRECTION_ALONG_NORMAL * whole).all(axis=(1, 2))).any():
            raise DirectionError(f"is along the normal of {np.count_nonzero(bad)} elements; take another direction")
        along = along / size
        return np.stack([along, np.cross(n, along), n], axis=-2)


class SummedLayers(Layered):
    """A laminate at the quadrature points of a plain shell, with the moments of its plies' stiffness.

    Strains are those of the mean transverse shear. Between the places ζ_i of the points across the shell they are
    interpolated, so that

        ∫ ε·Q̄ ε dζ = Σ_ij ε_i·M_ij ε_j,  M_ij = ∫ ℓ_i ℓ_j Q̄ dζ

    with the polynomials ℓ_i, 1 at ζ_i and 0 at the other two. This is exact in elements whose directors are parallel,
    where strains are linear in ζ. Curved ones of thickness over radius 0.2 have energies to 1e-4 and masses to 3e-4
    of those by each ply, of 0.02 to 4e-7 and 3e-5.
    """

    @property
    def summed(self) -> SummedLayers:
        """The material itself."""
        return self

    def energy_root(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return R (n_elements, n_plane, 15, n) with ``|R|²`` twice the energy of strains (n_elements, 6, n_q, n).

        Of the weights of the quadrature points X (3, n_q) strains have the roots.
        """
        moments = self.laminate.moments(_through(X)[0])
        root = np.repeat(np.sqrt(moments.weights), len(PLANE))
        R = np.linalg.cholesky(moments.energy.reshape(len(root), -1) / np.outer(root, root)).T
        N = bond(self.frames(space.jacobians(X, elements), elements))[..., PLANE, :]
        return np.asarray(R @ _by_columns(N @ strain.swapaxes(1, 2), X))

    def stress(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return stresses at the quadrature points X, (n_elements, n_q, 6, n), whose sums are those of all plies.

        Each is the mean of ``ℓ_i σ`` over that of ℓ_i.
        """
        moments = self.laminate.moments(_through(X)[0])
        N = bond(self.frames(space.jacobians(X, elements), elements))[..., PLANE, :]
        each = np.repeat(moments.weights, len(PLANE))
        local = (moments.stress.reshape(len(each), -1) / each[:, None]) @ _by_columns(N @ strain, X)
        n_elements, n_plane, _, n = local.shape
        local = local.reshape(n_elements, n_plane, -1, len(PLANE), n).swapaxes(1, 2)
        return np.asarray(N.swapaxes(2, 3) @ local.reshape(n_elements, -1, len(PLANE), n))

    def through_shell(
        self, A: Array, J: Array, zeta: Array | None, elements: IntArray, given_at: float | None = None
    ) -> Array:
        """Return strains A of a shell's displacement without stretch through it; without ``zeta`` no shear either."""
        n = (J[..., 2] / np.linalg.norm(J[..., 2], axis=-1, keepdims=True))[..., None]
        across = A @ n
        stretch = (n.swapaxes(2, 3) @ across) * (n @ n.swapaxes(2, 3))
        if zeta is not None:
            return np.asarray(A - stretch)
        turned = across @ n.swapaxes(2, 3)
        return np.asarray(A - turned - turned.swapaxes(2, 3) + stretch)


def _through(X: Array) -> tuple[Array, int]:
    """Return the places across a shell of quadrature points X (3, n_q), and how many in its plane are at each."""
    n = int(np.count_nonzero(X[2] == X[2, 0]))
    return X[2, ::n], n


def _by_columns(local: Array, X: Array) -> Array:
    """Return strains (n_elements, n_q, 5, n) of points one above the other together, (n_elements, n_plane, 15, n)."""
    n_plane, n = _through(X)[1], local.shape[3]
    return local.reshape(len(local), -1, n_plane, len(PLANE), n).swapaxes(1, 2).reshape(len(local), n_plane, -1, n)

"""Laminates of orthotropic plies: their stiffness by classical theory, transverse shear, and stress of each ply.

Strains of a shell are those of a plane that stays plane; each ply has the plane stress of its own axes, so bending and
stretch are coupled as by the matrices A, B and D (Jones, Mechanics of Composite Materials, 1999). Transverse shear
follows from equilibrium, and its stiffness from its energy (Rolfes & Rohwer, Int J Num Meth Eng 40, 1997): with the
strain of a moment m and no force, ``ε = (z − A⁻¹ B) (D − B A⁻¹ B)⁻¹ m``, and two bending modes that are cylindrical,

    τ(z) = T(z) Q,  T = −∫ [[H_11, H_32], [H_31, H_22]] dz,  H = Q̄ (z − A⁻¹ B) (D − B A⁻¹ B)⁻¹

from the lower face, and ``S = (∫ Tᵀ G⁻¹ T dz)⁻¹``; a single isotropic ply has Reissner's parabola and 5/6.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array, IntArray, read_only
from fmd.core.limits.mesh import DIRECTION_ALONG_NORMAL
from fmd.fem.material import PLANE, bond, plane_tensor

if TYPE_CHECKING:
    from fmd.fem.elements import ElementKind, ElementSpace


class DirectionError(ValueError):
    """The direction from which a laminate's angles count is the shell's normal somewhere."""


@dataclass(frozen=True, slots=True)
class Lamina:
    """Material of a ply in its own axes, 1 along its fibres and 2 across them.

    Parameters
    ----------
    E1, E2 : float
        Young's moduli [Pa].
    nu12 : float
        Contraction along 2 over stretch along 1.
    G12, G13, G23 : float
        Shear moduli [Pa].
    rho : float
        Density [kg/m³].
    """

    E1: float
    E2: float
    nu12: float
    G12: float
    G13: float
    G23: float
    rho: float

    def __post_init__(self) -> None:
        if not (min(self.E1, self.E2, self.G12, self.G13, self.G23, self.rho) > 0):
            raise ValueError("a ply has moduli and a density above 0")
        if not self.nu12**2 < self.E1 / self.E2:
            raise ValueError(f"nu12 = {self.nu12:g} isn't below (E1/E2)^½ = {(self.E1 / self.E2) ** 0.5:.3g}")

    @property
    def stiffness(self) -> Array:
        """Matrix from strains 11, 22, 2·23, 2·13, 2·12 to stresses in plane stress, shape (5, 5) [Pa]."""
        C = np.diag([self.E1, self.E2, self.G23, self.G13, self.G12])
        C[:2, :2] = np.linalg.inv([[1 / self.E1, -self.nu12 / self.E1], [-self.nu12 / self.E1, 1 / self.E2]])
        return C


@dataclass(frozen=True, slots=True)
class Ply:
    """A layer of a laminate.

    Parameters
    ----------
    thickness : float
        [m]
    angle : float
        From the laminate's direction to the fibres, about the normal [rad].
    name : str
        Of its material.
    """

    lamina: Lamina
    thickness: float
    angle: float
    name: str = ""

    @property
    def turn(self) -> Array:
        """Rotation (3, 3) to the ply's axes."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.array([(c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)])

    @property
    def stiffness(self) -> Array:
        """Matrix (5, 5) from strains xx, yy, 2yz, 2xz, 2xy along the laminate's direction to stresses [Pa]."""
        N = bond(self.turn)[np.ix_(PLANE, PLANE)]
        return np.asarray(N.T @ self.lamina.stiffness @ N)


@dataclass(frozen=True)
class Laminate:
    """Plies from a shell's lower face to the upper one."""

    plies: tuple[Ply, ...]

    def turned_over(self) -> Laminate:
        """Return the laminate as it is along the opposite normal."""
        return Laminate(tuple(Ply(p.lamina, p.thickness, -p.angle, p.name) for p in reversed(self.plies)))

    @property
    def thickness(self) -> float:
        """Thickness of all plies [m]."""
        return sum(ply.thickness for ply in self.plies)

    @cached_property
    def ends(self) -> Array:
        """Places of the plies' faces from 0, the lower face, to 1, shape (n_plies + 1,)."""
        ends = np.cumsum([0.0, *(ply.thickness for ply in self.plies)]) / self.thickness
        ends[-1] = 1.0
        return read_only(ends)

    def ply_at(self, zeta: Array) -> IntArray:
        """Return the number of the ply at places across the laminate, 0 … 1."""
        return np.asarray(np.clip(np.searchsorted(self.ends, zeta, side="right") - 1, 0, len(self.plies) - 1))

    @cached_property
    def stiffnesses(self) -> Array:
        """Stiffness (n_plies, 5, 5) of each ply along the laminate's direction [Pa]."""
        return read_only(np.array([ply.stiffness for ply in self.plies]))

    @cached_property
    def plane(self) -> tuple[Array, Array, Array]:
        """The matrices A [N/m], B [N] and D [N m] about the middle, xx, yy, 2xy, each (3, 3)."""
        Q = self.stiffnesses[:, _IN_PLANE[:, None], _IN_PLANE]
        z = self.thickness * (self.ends - 0.5)
        A, B, D = (np.einsum("k,kab->ab", np.diff(z**n) / n, Q) for n in (1, 2, 3))
        return A, B, D

    @cached_property
    def shear(self) -> Array:
        """Stiffness (2, 2) against mean transverse shear along and across the laminate's direction [N/m]."""
        x, w = np.polynomial.legendre.leggauss(3)  # exact: energies are of fourth degree in each ply
        zeta = (self.ends[:-1, None] + np.diff(self.ends)[:, None] * (0.5 + 0.5 * x)).ravel()
        weights = 0.5 * self.thickness * (np.diff(self.ends)[:, None] * w).ravel()
        T, G = self._shear_stress(zeta), self.stiffnesses[self.ply_at(zeta)][:, _ACROSS[:, None], _ACROSS]
        return np.asarray(np.linalg.inv(np.einsum("q,qba,qbc->ac", weights, T, np.linalg.solve(G, T))))

    def shear_strain(self, zeta: Array) -> Array:
        """Return transverse shear at places across the laminate over its mean, shape (n, 2, 2)."""
        G = self.stiffnesses[self.ply_at(zeta)][:, _ACROSS[:, None], _ACROSS]
        return np.asarray(np.linalg.solve(G, self._shear_stress(zeta)) @ self.shear)

    def _shear_stress(self, zeta: Array) -> Array:
        """Return the matrices T at places across the laminate, shape (n, 2, 2) [1/m]."""
        A, B, D = self.plane
        AB = np.linalg.solve(A, B)
        compliance = np.linalg.inv(D - B @ AB)
        z = self.thickness * (self.ends - 0.5)
        Q = self.stiffnesses[:, _IN_PLANE[:, None], _IN_PLANE]
        whole = Q * (np.diff(z**2) / 2)[:, None, None] - (Q * np.diff(z)[:, None, None]) @ AB
        below = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(whole, axis=0)])
        ply, at = self.ply_at(zeta), self.thickness * (zeta - 0.5)
        start = z[ply]
        own = Q[ply] * ((at**2 - start**2) / 2)[:, None, None] - (Q[ply] * (at - start)[:, None, None]) @ AB
        H = (below[ply] + own) @ compliance
        return -np.stack(
            [np.stack([H[:, 0, 0], H[:, 2, 1]], axis=1), np.stack([H[:, 2, 0], H[:, 1, 1]], axis=1)], axis=1
        )


_IN_PLANE = np.array([0, 1, 4])  # of xx, yy, 2yz, 2xz, 2xy
_ACROSS = np.array([3, 2])  # along the direction, xz, and across it, yz


@dataclass(frozen=True)
class Layered:
    """A laminate as the material of a shell's elements.

    Parameters
    ----------
    directions : ndarray, shape (n_elements, 3)
        Vector for each element of the body, whose projection onto the shell is the laminate's direction.
    """

    laminate: Laminate
    directions: Array

    def over(self, elements: IntArray | slice) -> Iterator[tuple[Layered, IntArray | slice]]:
        """Yield the material with all of the elements."""
        yield self, slice(None)

    def repeats(self, times: int) -> bool:
        """Return false: shells aren't of sectors."""
        return False

    def of_elements(self, elements: IntArray) -> Layered:
        """Return the material of some elements."""
        return Layered(self.laminate, self.directions[elements])

    @property
    def n_layers(self) -> int:
        """Number of plies."""
        return len(self.laminate.plies)

    @property
    def isotropic(self) -> None:
        """Nothing: no modulus and no ratio are its own."""

    @property
    def rho(self) -> float:
        """Mean density [kg/m³]."""
        plies = self.laminate.plies
        return sum(ply.lamina.rho * ply.thickness for ply in plies) / self.laminate.thickness

    def quadrature(self, kind: ElementKind, order: int) -> tuple[Array, Array]:
        """Return points (3, n_q) and weights (n_q,) in each ply, exact to a polynomial degree."""
        return kind.shape.quadrature(order, self.laminate.ends)  # type: ignore[call-arg]

    def density(self, X: Array) -> Array:
        """Return the density at reference points X (3, n_q), shape (n_q,) [kg/m³]."""
        return np.array([ply.lamina.rho for ply in self.laminate.plies])[self.laminate.ply_at(X[2])]

    def energy_root(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return R (n_elements, 5, n_q, n) with ``|R|²`` twice the energy of strains (n_elements, 6, n_q, n)."""
        root = np.linalg.cholesky(self.laminate.stiffnesses).swapaxes(1, 2)[self.laminate.ply_at(X[2])]
        local = root @ bond(self.frames(space.jacobians(X, elements), elements))[..., PLANE, :]
        return np.ascontiguousarray((local @ strain.swapaxes(1, 2)).swapaxes(1, 2))

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

"""Laminates of orthotropic plies: their stiffness by classical theory, transverse shear, and stress of each ply.

Strains of a shell are those of a plane that stays plane; each ply has the plane stress of its own axes, so bending and
stretch are coupled as by the matrices A, B and D (Jones, Mechanics of Composite Materials, 1999). Transverse shear
follows from equilibrium, and its stiffness from its energy (Rolfes & Rohwer, Int J Num Meth Eng 40, 1997): with the
strain of a moment m and no force, ``ε = (z − A⁻¹ B) (D − B A⁻¹ B)⁻¹ m``, and two bending modes that are cylindrical,

    τ(z) = T(z) Q,  T = −∫ [[H_11, H_32], [H_31, H_22]] dz,  H = Q̄ (z − A⁻¹ B) (D − B A⁻¹ B)⁻¹

from the lower face, and ``S = (∫ Tᵀ G⁻¹ T dz)⁻¹``; a single isotropic ply has Reissner's parabola and 5/6.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray, read_only
from fmd.core.data_classes import dataclass
from fmd.fem.material import PLANE, bond


@dataclass(frozen=True, slots=True)
class Lamina:
    """Material of a ply in its own axes, 1 along its fibres and 2 across them."""

    E1: float  # Young's moduli [Pa]
    E2: float  # Young's moduli [Pa]
    nu12: float  # contraction along 2 over stretch along 1
    G12: float  # shear moduli [Pa]
    G13: float  # shear moduli [Pa]
    G23: float  # shear moduli [Pa]
    rho: float  # density [kg/m³]

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
    """A layer of a laminate."""

    lamina: Lamina
    thickness: float  # [m]
    angle: float  # from the laminate's direction to the fibres, about the normal [rad]
    name: str = ""  # of its material

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


class Moments(NamedTuple):
    """Integrals over a laminate's thickness, 0 … 1, of polynomials ℓ_i that interpolate strains between n places.

    S takes mean transverse shear to that at ζ.
    """

    weights: Array  # (n,): ``∫ ℓ_i dζ``
    density: Array  # (n,): ``∫ ℓ_i ρ dζ`` [kg/m³]
    stress: Array  # (n, 5, n, 5): ``∫ ℓ_i ℓ_j Q̄ S dζ`` [Pa]
    energy: Array  # (n, 5, n, 5): ``∫ ℓ_i ℓ_j Sᵀ Q̄ S dζ`` [Pa]


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
        zeta, weights = self._points
        T, G = self._shear_stress(zeta), self.stiffnesses[self.ply_at(zeta)][:, _ACROSS[:, None], _ACROSS]
        compliance = np.einsum("q,qba,qbc->ac", self.thickness * weights, T, np.linalg.solve(G, T))
        return np.asarray(np.linalg.inv(compliance))

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        """Places 0 … 1 and weights of three points in each ply: exact, as energies are of fourth degree there."""
        x, w = np.polynomial.legendre.leggauss(3)
        size = np.diff(self.ends)[:, None]
        return (self.ends[:-1, None] + size * (0.5 + 0.5 * x)).ravel(), (0.5 * size * w).ravel()

    def moments(self, places: Array) -> Moments:
        """Return moments of the polynomials ℓ_i that are 1 at one of some places 0 … 1 and 0 at the others."""
        zeta, weights = self._points
        ply, S = self.ply_at(zeta), np.tile(np.eye(5), (len(zeta), 1, 1))
        S[:, _ACROSS[:, None], _ACROSS] = self.shear_strain(zeta)
        share = np.linalg.solve(np.vander(places).T, np.vander(zeta, len(places)).T)
        rho, stress = np.array([each.lamina.rho for each in self.plies])[ply], self.stiffnesses[ply] @ S
        of_stress, of_energy = (
            np.einsum("q,iq,jq,qab->iajb", weights, share, share, C, optimize=True)
            for C in (stress, S.swapaxes(1, 2) @ stress)
        )
        return Moments(share @ weights, share @ (weights * rho), of_stress, of_energy)

    def shear_strain(self, zeta: Array) -> Array:
        """Return transverse shear at places across the laminate over its mean, shape (n, 2, 2)."""
        G = self.stiffnesses[self.ply_at(zeta)][:, _ACROSS[:, None], _ACROSS]
        return np.asarray(np.linalg.solve(G, self._shear_stress(zeta)) @ self.shear)

    def warping_strain(self, zeta: Array) -> Array:
        """Return strains xx, yy, 2xy that keep no section plane, over slopes of mean transverse shear, (n, 3, 4) [m].

        Slopes are those of xz and yz along the laminate's direction, and of both across it. The points of a section
        move along it by the integral of shear over z; strain of plane sections is added so that forces and moments
        are none.
        """
        (A, B, D), (points, weights) = self.plane, self._points
        L, h = self._slopes_of_sections(points), self.thickness
        Q = (h * weights)[:, None, None] * self.stiffnesses[self.ply_at(points)][:, _IN_PLANE[:, None], _IN_PLANE]
        sums = np.concatenate([np.einsum("q,qab,qbs->as", (h * (points - 0.5)) ** k, Q, L) for k in (0, 1)])
        stretch, bend = np.split(np.linalg.solve(np.block([[A, B], [B, D]]), sums), 2)
        return np.asarray(self._slopes_of_sections(zeta) - stretch - (h * (zeta - 0.5))[:, None, None] * bend)

    def _slopes_of_sections(self, zeta: Array) -> Array:
        """Return strains xx, yy, 2xy over slopes of mean shear by the integral of shear from the lower face."""
        start, size = self.ends[:-1], np.diff(self.ends)
        below = np.concatenate([np.zeros((1, 2, 2)), np.cumsum(self._integrated_shear(start, size), axis=0)])
        ply = self.ply_at(zeta)
        W = below[ply] + self._integrated_shear(start[ply], zeta - start[ply])
        L = np.zeros((len(zeta), 3, 4))
        L[:, 0, :2] = L[:, 2, 2:] = W[:, 0]
        L[:, 1, 2:] = L[:, 2, :2] = W[:, 1]
        return L

    def _integrated_shear(self, start: Array, size: Array) -> Array:
        """Return the integral over z of transverse shear over its mean within single plies, (n, 2, 2) [m]."""
        two = (start + size * at for at in 0.5 + np.array([-0.5, 0.5]) / 3**0.5)  # exact for parabolas
        return np.asarray((self.thickness * size / 2)[:, None, None] * sum(self.shear_strain(at) for at in two))

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

"""Linear elastic materials, one for a body or one for each element."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass

if TYPE_CHECKING:
    from fmd.fem.elements import ElementSpace

PLANE = np.array([0, 1, 3, 4, 5])  # strains xx, yy, 2yz, 2xz, 2xy of six


def bond(R: Array) -> Array:
    """Return the matrices (…, 6, 6) that turn strains xx, yy, zz, 2yz, 2xz, 2xy as rotations R (…, 3, 3) do vectors."""
    a, b = [0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]
    one, other = R[..., a, :], R[..., b, :]
    direct = one * other
    mixed = one[..., [1, 0, 0]] * other[..., [2, 2, 1]] + one[..., [2, 2, 1]] * other[..., [1, 0, 0]]
    N = np.concatenate([direct, 0.5 * mixed], axis=-1)
    N[..., 3:, :] *= 2
    return np.asarray(N)


def plane_tensor(A: Array, across: Array) -> Array:
    """Return tensors (…, 3, 3) with the plane part of A and shears across it, (…, 2), and no stretch through it."""
    changed = np.zeros_like(A)
    changed[..., :2, :2] = A[..., :2, :2]
    changed[..., :2, 2] = changed[..., 2, :2] = across
    return changed


class AnyElastic(Protocol):
    """A material of elements, isotropic or in layers."""

    @property
    def rho(self) -> float:
        """Mean density [kg/m³]."""

    @property
    def isotropic(self) -> tuple[float, float] | None:
        """Young's modulus [Pa] and Poisson's ratio, if these are all that it has."""

    def over(self, elements: IntArray | slice) -> Iterator[tuple[AnyElastic, IntArray | slice]]:
        """Yield the material with all of the elements."""

    def repeats(self, times: int) -> bool:
        """Return true if it is the same in so many equal parts of the elements."""

    def of_elements(self, elements: IntArray) -> AnyElastic:
        """Return the material of some elements."""

    @property
    def summed(self) -> SummedElastic:
        """The material at quadrature points: with layers summed over the thickness."""

    def density(self, X: Array) -> Array:
        """Return the density at quadrature points X (3, n_q), shape (n_q,) [kg/m³]."""

    def stress(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return the stress of strains at points X of elements, both of shape (n_elements, n_q, 6, n)."""

    def through_shell(
        self, A: Array, J: Array, zeta: Array | None, elements: IntArray, given_at: float | None = None
    ) -> Array:
        """Return strains (n_elements, n_q, 3, 3) of a shell's displacement as its plane stress has them."""


class SummedElastic(AnyElastic, Protocol):
    """A material at quadrature points, of which energies are."""

    def energy_root(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return R with ``|R|²`` twice the energy of strains (n_elements, 6, n_q, n) at quadrature points X."""


@dataclass(frozen=True, slots=True)
class Material:
    """A homogeneous isotropic material."""

    E: float  # Young's modulus [Pa]
    nu: float  # Poisson's ratio, between -1 and 0.5
    rho: float  # density [kg/m³]

    def __post_init__(self) -> None:
        if not (self.E > 0 and self.rho > 0 and -1 < self.nu < 0.5):
            raise ValueError(f"not a material: E = {self.E} Pa, nu = {self.nu}, rho = {self.rho} kg/m³")

    def over(self, elements: IntArray | slice) -> Iterator[tuple[Material, IntArray | slice]]:
        """Yield the material with all of the elements."""
        yield self, slice(None)

    def repeats(self, times: int) -> bool:
        """Return true: it is the same in each of the elements' equal parts."""
        return True

    def of_elements(self, elements: IntArray) -> Material:
        """Return the material of some elements."""
        return self

    @property
    def summed(self) -> Material:
        """The material itself: it has no layers."""
        return self

    @property
    def isotropic(self) -> tuple[float, float] | None:
        """Young's modulus [Pa] and Poisson's ratio."""
        return self.E, self.nu

    def density(self, X: Array) -> Array:
        """Return the density at quadrature points X (3, n_q), shape (n_q,) [kg/m³]."""
        return np.full(X.shape[1], self.rho)

    def energy_root(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return R with ``|R|²`` twice the energy of strains (n_elements, 6, n_q, n) at points X, of a like shape."""
        root = np.linalg.cholesky(self.stiffness).T @ strain.reshape(len(strain), 6, -1)
        return np.asarray(root.reshape(strain.shape))

    def stress(self, space: ElementSpace, X: Array, elements: IntArray, strain: Array) -> Array:
        """Return the stress of strains at points X of elements, both of shape (n_elements, n_q, 6, n)."""
        return np.asarray(self.stiffness @ strain)

    def through_shell(
        self, A: Array, J: Array, zeta: Array | None, elements: IntArray, given_at: float | None = None
    ) -> Array:
        """Return strains (n_elements, n_q, 3, 3) of a shell's displacement as its plane stress has them.

        Stretch through the thickness follows from plane stress; transverse shear has Reissner's parabola over the place
        ``zeta`` (n_q,) across, 0 … 1, and is left out without it. A has that of the place ``given_at``, or the mean's.
        Of the base vectors J (n_elements, n_q, 3, 3), last axis reference, the third goes through the thickness.
        """
        normal = J[..., 2] / np.linalg.norm(J[..., 2], axis=-1, keepdims=True)
        share = np.float64(0.0) if zeta is None else (1.25 * (1 - (2 * zeta - 1) ** 2))[:, None, None]
        if given_at is not None:
            share = share / (1.25 * (1 - (2 * given_at - 1) ** 2))
        n = normal[..., None]
        across = A @ n
        stretch = n.swapaxes(2, 3) @ across
        transverse = (across - stretch * n) @ n.swapaxes(2, 3)
        plane = np.trace(A, axis1=2, axis2=3)[..., None, None] - stretch
        nu = self.nu / (1 - self.nu)
        changed = (share - 1) * (transverse + transverse.swapaxes(2, 3))
        return np.asarray(A + changed - (stretch + nu * plane) * (n @ n.swapaxes(2, 3)))

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé's parameters λ and μ [Pa]."""
        mu = self.E / (2 * (1 + self.nu))
        return 2 * mu * self.nu / (1 - 2 * self.nu), mu

    @property
    def stiffness(self) -> Array:
        """Matrix from strain (xx, yy, zz, 2yz, 2xz, 2xy) to stress (xx, yy, zz, yz, xz, xy), shape (6, 6) [Pa]."""
        lam, mu = self.lame
        C = np.diag([2 * mu] * 3 + [mu] * 3)
        C[:3, :3] += lam
        return C


@dataclass(frozen=True)
class MaterialOfElements:
    """Materials of a body's elements."""

    materials: tuple[AnyElastic, ...]
    numbers: IntArray  # (n_elements,): position in ``materials`` of each element's

    def over(self, elements: IntArray | slice) -> Iterator[tuple[AnyElastic, IntArray | slice]]:
        """Yield each material of the elements with the numbers of those made of it."""
        numbers = self.numbers[elements]
        for k in np.unique(numbers):
            yield self.materials[k], np.flatnonzero(numbers == k)

    def repeats(self, times: int) -> bool:
        """Return true if the materials of so many equal parts of the elements, one behind the other, are the same."""
        return bool((self.numbers.reshape(times, -1) == self.numbers[: len(self.numbers) // times]).all())

    def of_elements(self, elements: IntArray) -> MaterialOfElements:
        """Return the materials of some elements."""
        return MaterialOfElements(tuple(own.of_elements(elements) for own in self.materials), self.numbers[elements])


AnyMaterial = AnyElastic | MaterialOfElements


def batches(material: AnyMaterial, n_elements: int, size: int) -> Iterator[tuple[AnyElastic, IntArray]]:
    """Yield each material with some of its elements at a time."""
    everything = np.arange(n_elements)
    for own, mine in material.over(slice(None)):
        numbers = everything[mine]
        for start in range(0, len(numbers), size):
            yield own, numbers[start : start + size]

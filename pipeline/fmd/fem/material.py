"""Linear isotropic elastic materials, one for a body or one for each element."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fmd.core.arrays import Array, IntArray


@dataclass(frozen=True, slots=True)
class Material:
    """A homogeneous isotropic material.

    Parameters
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio, between -1 and 0.5.
    rho : float
        Density [kg/m³].
    """

    E: float
    nu: float
    rho: float

    def __post_init__(self) -> None:
        if not (self.E > 0 and self.rho > 0 and -1 < self.nu < 0.5):
            raise ValueError(f"not a material: E = {self.E} Pa, nu = {self.nu}, rho = {self.rho} kg/m³")

    def over(self, elements: IntArray | slice) -> Iterator[tuple[Material, IntArray | slice]]:
        """Yield the material with all of the elements."""
        yield self, slice(None)

    def repeats(self, times: int) -> bool:
        """Return true: it is the same in each of the elements' equal parts."""
        return True

    def first_part(self, n_elements: int) -> Material:
        """Return the material of the first elements."""
        return self

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
    """Materials of a body's elements, each homogeneous and isotropic.

    Parameters
    ----------
    numbers : ndarray, shape (n_elements,)
        Position in ``materials`` of each element's.
    """

    materials: tuple[Material, ...]
    numbers: IntArray

    def over(self, elements: IntArray | slice) -> Iterator[tuple[Material, IntArray | slice]]:
        """Yield each material of the elements with the numbers of those made of it."""
        numbers = self.numbers[elements]
        for k in np.unique(numbers):
            yield self.materials[k], np.flatnonzero(numbers == k)

    def repeats(self, times: int) -> bool:
        """Return true if the materials of so many equal parts of the elements, one behind the other, are the same."""
        return bool((self.numbers.reshape(times, -1) == self.numbers[: len(self.numbers) // times]).all())

    def first_part(self, n_elements: int) -> MaterialOfElements:
        """Return the materials of the first elements."""
        return MaterialOfElements(self.materials, self.numbers[:n_elements])


AnyMaterial = Material | MaterialOfElements

"""Matrices and modes of a flexible body, for work of one's own with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fmd.core.arrays import Array
from fmd.stages.part import FlexiblePart

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True)
class BodyMatrices:
    """Finite element matrices of a flexible body and its modes, each computed when it is first asked for."""

    part: FlexiblePart  # the body with all its stages: mesh, reduced body, stress

    @property
    def x(self) -> Array:
        """Node positions, shape (n_nodes, 3) [m]."""
        return self.part.fe.x

    @property
    def K(self) -> csr_array:
        """Stiffness matrix, shape (3 n_nodes, 3 n_nodes) [N/m]; unknown ``3 i + a`` is node i along axis a."""
        return self.part.fe.K

    @property
    def M(self) -> csr_array:
        """Consistent mass matrix, shape (3 n_nodes, 3 n_nodes) [kg]."""
        return self.part.fe.M

    @property
    def Phi(self) -> Array:
        """Mode shapes with unit modal mass, ``Φᵀ M Φ = 1``, shape (3 n_nodes, n_modes) [kg^-1/2]."""
        return self.part.modes.shapes.reshape(-1, len(self.part.modes.omega))

    @property
    def frequencies_hz(self) -> Array:
        """Natural frequencies of the modes [Hz], shape (n_modes,)."""
        return self.part.modes.frequencies_hz

"""The finite element model: nodes, stiffness and mass of one body."""

from dataclasses import field
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import Array, short_repr
from fmd.core.data_classes import dataclass
from fmd.core.limits.modes import ROUNDED_ENERGY
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms
from fmd.fem.joined import AnySpace
from fmd.fem.material import AnyMaterial
from fmd.fem.products import SparseProducts
from fmd.fem.space import Discretisation
from fmd.fem.strain import elastic_forces


@dataclass(frozen=True)
class FEModel:
    """Stiffness and mass matrices of a body on its discretisation."""

    discretisation: AnySpace
    material: AnyMaterial
    K: sp.csr_array  # (3 n_nodes, 3 n_nodes): stiffness [N/m]; unknown ``3 i + a`` is node i along axis a
    m: sp.csr_array  # (n_nodes, n_nodes): consistent scalar mass matrix [kg]; the full mass matrix is ``m ⊗ 1₃``
    # (3 n_nodes, n): How the nodes move by the independent unknowns, ``u = T y``; ``None`` if each node's displacements
    # are such. Solutions are those of ``Tᵀ K T`` and ``Tᵀ M T``, all else is of nodes.
    T: sp.csr_array | None = field(default=None, kw_only=True)
    # Number of independent unknowns that are displacements and rotations of links; they come last.
    link_unknowns: int = field(default=0, kw_only=True)
    arms: Arms | None = field(default=None, kw_only=True)  # nodes on rigid arms, which move in second order
    # Points of a shell on its nodes' directors, whose motion of second order is a part of its geometric stiffness.
    directors: Arms | None = field(default=None, kw_only=True)

    strained: ClassVar[bool] = True  # true if all of K is the strain of solid elements

    __repr__ = short_repr

    @property
    def x(self) -> Array:
        """Node positions, shape (n_nodes, 3) [m]."""
        return self.discretisation.x

    @property
    def point_map(self) -> sp.csr_array:
        """How all points move by the unknowns, shape (3 n_nodes, n_unknowns): T, or one."""
        return sp.csr_array(sp.eye_array(3 * len(self.x), format="csr")) if self.T is None else self.T

    @cached_property
    def M(self) -> sp.csr_array:
        """Consistent mass matrix of all unknowns, shape (3 n_nodes, 3 n_nodes) [kg]."""
        n = self.m.shape[0]
        each = self.m[np.repeat(np.arange(n), 3)]  # every row three times, once an axis
        axis = np.repeat(np.tile(np.arange(3, dtype=each.indices.dtype), n), np.diff(each.indptr))
        return sp.csr_array((each.data, 3 * each.indices + axis, each.indptr), shape=(3 * n, 3 * n))

    def forces(self, V: Array) -> Array:
        """Return ``K V`` of fields V (3 n_nodes, n), by strain where K's round-off counts and all of K is of strain."""
        found = self.products @ V
        if self.strained:
            rounded = np.finfo(float).eps * np.einsum("i,ij,ij->j", self.diagonal, V, V)
            lost = ~(rounded < ROUNDED_ENERGY * np.einsum("ij,ij->j", V, found))
            if lost.any():
                assert isinstance(self.discretisation, Discretisation)
                shapes = V[:, lost].reshape(len(self.x), 3, -1)
                found[:, lost] = elastic_forces(self.discretisation, self.material, shapes).reshape(len(V), -1)
        return found

    def stiffness_of(self, V: Array) -> Array:
        """Return ``Vᵀ K V`` of fields V (3 n_nodes, n), shape (n, n), by `forces`."""
        found = V.T @ self.forces(V)
        return np.asarray(0.5 * (found + found.T))

    @property
    def local_pairs(self) -> int:
        """Pairs of nodes of an element, for which a stress has entries before they are summed."""
        return max(int(own.space.element_nodes.shape[1]) ** 2 for own in self.discretisation.members)

    def name_point(self, k: int) -> str:
        """Return what a message calls point k: its place."""
        return f"({', '.join(f'{each:.4g}' for each in self.x[k])}) m"

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(self.m.sum())

    @cached_property
    def products(self) -> SparseProducts:
        """Products of K with many fields."""
        return SparseProducts(self.K)

    @cached_property
    def diagonal(self) -> Array:
        """Diagonal of K, shape (3 n_nodes,) [N/m]."""
        return np.asarray(self.K.diagonal())

    @cached_property
    def rigid_modes(self) -> Array:
        """Three translations and three linearised rotations about the origin, shape (3 n_nodes, 6)."""
        return rigid_motions(self.x).reshape(-1, 6)

"""The finite element space: nodes and connectivity of a displacement field on a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import meshio
import numpy as np
import skfem
from skfem.io.meshio import from_meshio

from fmd.core.arrays import Array, IntArray, read_only
from fmd.fem.elements import ElementKind, Formulation, jacobians, match_nodes, shape_functions
from fmd.fem.mesh import SolidMesh
from fmd.fem.sparsity import BlockStructure


@dataclass(frozen=True)
class Discretisation:
    """Nodes and connectivity of a displacement field on a mesh.

    Parameters
    ----------
    mesh : SolidMesh
        The body's geometry.
    order : int
        Order of the displacement, 1 or 2.
    formulation : str
        ``enhanced`` or ``plain`` strain of linear hexahedra; of no effect on other elements.
    """

    mesh: SolidMesh
    order: int
    formulation: Formulation = "enhanced"

    @cached_property
    def kind(self) -> ElementKind:
        """The element on the mesh's cells."""
        return self.mesh.cell.element(self.order)

    @property
    def is_enhanced(self) -> bool:
        """True if the elements add strains of their own to those of the nodes' displacements."""
        return self.formulation == "enhanced" and self.kind.can_be_enhanced

    @cached_property
    def skfem_mesh(self) -> Any:
        """scikit-fem's mesh of the cells with straight edges, which numbers their nodes."""
        return from_meshio(
            meshio.Mesh(self.mesh.points, [(self.mesh.cell_type, self.mesh.cells)]), ignore_orientation=True
        )

    @cached_property
    def _nodes_are_points(self) -> bool:
        """True if the mesh's points number the nodes: for curved cells and those that scikit-fem lacks."""
        return self.kind.curved or not isinstance(self.kind.element, skfem.Element)

    @cached_property
    def element_nodes(self) -> IntArray:
        """Node numbers of each element, shape (n_elements, n_local), in scikit-fem's local order."""
        if self._nodes_are_points:
            local = match_nodes(self.kind.element.doflocs, self.mesh.cell.nodes_of_order(self.order))
            return read_only(self.mesh.cells[:, local])
        corners = np.asarray(self.skfem_mesh.t.T, dtype=np.int64)
        if not self.kind.element.edge_dofs:
            return read_only(corners)
        # scikit-fem numbers edges by their lower, then by their higher end. Sorting one number for both ends is about
        # ten times faster than sorting pairs.
        ends = np.sort(corners[:, np.array(self.kind.element.refdom.edges)], axis=2)
        n_corners = len(self.skfem_mesh.p.T)
        _, edges = np.unique(ends[..., 0] * n_corners + ends[..., 1], return_inverse=True)
        return read_only(np.concatenate([corners, n_corners + edges.reshape(ends.shape[:2])], axis=1))

    @cached_property
    def geometry_nodes(self) -> IntArray:
        """Mesh points that define each element's geometry, shape (n_elements, n_geometry)."""
        return self.element_nodes if self._nodes_are_points else np.asarray(self.skfem_mesh.t.T, dtype=np.int64)

    @cached_property
    def corner_coordinates(self) -> Array:
        """Positions of each element's `geometry_nodes`, shape (n_elements, n_geometry, 3) [m]."""
        return np.asarray(self.mesh.points[self.geometry_nodes])

    @cached_property
    def boundary_facets(self) -> tuple[IntArray, IntArray]:
        """Element and local number of each facet on the boundary, shapes (n_facets,) and (n_facets,)."""
        facets = self.kind.facet_corners
        # Three corners identify a facet, one of four corners too, since the mesh conforms.
        keys = np.stack([np.sort(self.element_nodes[:, corners], axis=1)[:, :3] for corners in facets], axis=1)
        flat = keys.reshape(-1, 3)
        order = np.lexsort(flat.T)
        new = np.r_[True, (np.diff(flat[order], axis=0) != 0).any(axis=1), True]
        single = np.sort(order[new[:-1] & new[1:]])
        elements, local = np.divmod(single, len(facets))
        return elements, local

    @cached_property
    def x(self) -> Array:
        """Node positions, shape (n_nodes, 3) [m]."""
        N, _ = shape_functions(self.kind.geometry, self.kind.element.doflocs.T)
        x = np.empty((self.element_nodes.max() + 1, 3))
        x[self.element_nodes] = N.T @ self.corner_coordinates
        return read_only(x)

    @cached_property
    def volumes(self) -> Array:
        """Volume of each element, shape (n_elements,) [m³]."""
        X, w = self.kind.quadrature(self.kind.mass_order)
        return np.asarray(np.abs(np.linalg.det(self.jacobians(X)) @ w))

    @cached_property
    def structure(self) -> BlockStructure:
        """Sparsity pattern of every matrix on these nodes."""
        return BlockStructure(self.element_nodes, len(self.x))

    def jacobians(self, X: Array, elements: slice | IntArray = slice(None)) -> Array:
        """Return the elements' `elements.jacobians` at reference points X (3, n_q), shape (n_elements, n_q, 3, 3)."""
        return jacobians(self.kind.geometry, self.corner_coordinates[elements], X)

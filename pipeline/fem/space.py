"""The finite element space: nodes and connectivity of a displacement field on a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import meshio
import numpy as np
from skfem.io.meshio import from_meshio

from pipeline.core.arrays import Array, IntArray, read_only
from pipeline.fem.cells import STRAIGHT, vtk_nodes
from pipeline.fem.elements import ElementKind, element_kind, jacobians, places, shape_functions
from pipeline.fem.mesh import SolidMesh
from pipeline.fem.sparsity import BlockStructure


@dataclass(frozen=True)
class Discretisation:
    """Nodes and connectivity of a displacement field on a mesh; no matrices yet.

    Parameters
    ----------
    mesh : SolidMesh
        Its geometry.
    order : int
        Order of the displacement, 1 or 2.
    """

    mesh: SolidMesh
    order: int

    @cached_property
    def kind(self) -> ElementKind:
        """The element."""
        return element_kind(self.mesh.cell_type, self.order)

    @cached_property
    def skfem_mesh(self) -> Any:
        """scikit-fem's mesh of cells with straight edges, in whose node order everything below is for these."""
        return from_meshio(
            meshio.Mesh(self.mesh.points, [(self.mesh.cell_type, self.mesh.cells)]), ignore_orientation=True
        )

    @cached_property
    def _as_given(self) -> bool:
        """Whether the nodes are the mesh's own points: of curved cells and of wedges they are."""
        return self.kind.curved or STRAIGHT[self.mesh.cell_type] == "wedge"

    @cached_property
    def element_nodes(self) -> IntArray:
        """Node numbers of each element, shape (n_elements, n_local), numbered by scikit-fem or as the mesh's points."""
        if self._as_given:
            local = places(self.kind.element.doflocs, vtk_nodes(self.mesh.cell_type, self.order))
            return read_only(self.mesh.cells[:, local])
        corners = np.asarray(self.skfem_mesh.t.T, dtype=np.int64)
        if not self.kind.element.edge_dofs:
            return read_only(corners)
        # As scikit-fem numbers them, edges by the lower, then by the higher of their ends, which one number for
        # both tells some ten times faster than sorting pairs.
        ends = np.sort(corners[:, np.array(self.kind.element.refdom.edges)], axis=2)
        n_corners = len(self.skfem_mesh.p.T)
        _, edges = np.unique(ends[..., 0] * n_corners + ends[..., 1], return_inverse=True)
        return read_only(np.concatenate([corners, n_corners + edges.reshape(ends.shape[:2])], axis=1))

    @cached_property
    def geometry_nodes(self) -> IntArray:
        """Points that shape each element, shape (n_elements, n_geometry), in the order of ``kind.geometry``'s nodes."""
        return self.element_nodes if self._as_given else np.asarray(self.skfem_mesh.t.T, dtype=np.int64)

    @cached_property
    def corner_coordinates(self) -> Array:
        """Positions of the geometry's nodes of each element, shape (n_elements, n_geometry, 3) [m]."""
        return np.asarray(self.mesh.points[self.geometry_nodes])

    @cached_property
    def boundary_facets(self) -> tuple[IntArray, IntArray]:
        """Element, and number among its facets, of each facet that belongs to one element only, (n_facets,) each."""
        facets = [list(dict.fromkeys(facet)) for facet in self.kind.element.refdom.facets]
        # Three corners tell facets apart, of four too: the mesh conforms.
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
        """The pattern of every matrix on these nodes."""
        return BlockStructure(self.element_nodes, len(self.x))

    def jacobians(self, X: Array, elements: slice | IntArray = slice(None)) -> Array:
        """Derivatives of position by reference coordinates, shape (n_elements, n_q, 3, 3), last axis reference."""
        return jacobians(self.kind.geometry, self.corner_coordinates[elements], X)

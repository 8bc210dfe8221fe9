"""The finite element space: nodes and connectivity of a displacement field on a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import meshio
import numpy as np
import scipy.sparse as sp
import skfem
from skfem.io.meshio import from_meshio

from fmd.core.arrays import Array, IntArray, read_only
from fmd.core.data_classes import dataclass
from fmd.core.errors import InputError
from fmd.fem.elements import ElementKind, Formulation, inverse_and_determinant, jacobians, match_nodes, shape_functions
from fmd.fem.material import AnyMaterial
from fmd.fem.mesh import SolidMesh, three_corners
from fmd.fem.midsurface import Midsurface
from fmd.fem.sections import NUMBERS_ALONE


class BlockStructure:
    """Pairs of nodes that share an element: the pattern of stiffness, mass and geometric stiffness.

    Two counting sorts, SciPy's conversions between compressed rows and columns, order the entries of all elements, with
    nodes (n_elements, n_local), by the row's node and then by the column's. A sparse matrix of ones in that order, with
    a row for each pair, sums them.
    """

    def __init__(self, element_nodes: IntArray, n_nodes: int) -> None:
        n_elements, n_local = element_nodes.shape
        index = np.int32 if n_elements * n_local**2 < 2**31 else np.int64
        nodes, local = element_nodes.astype(index), np.arange(n_local, dtype=index)
        place = np.arange(n_elements * n_local, dtype=index)
        by_element = (place, nodes.ravel(), np.append(place[::n_local], index(place.size)))
        by_node = sp.csr_array(by_element, shape=(n_elements, n_nodes)).tocsc()
        element, own = np.divmod(by_node.data, index(n_local))
        entry = ((element * index(n_local))[:, None] + local) * index(n_local) + own[:, None]
        by_row = (entry.ravel(), nodes[element].ravel(), by_node.indptr * index(n_local))
        sorted_entries = sp.csr_array(by_row, shape=(n_nodes, n_nodes)).tocsc()
        row = np.repeat(np.arange(n_nodes, dtype=index), np.diff(sorted_entries.indptr))
        column = sorted_entries.indices
        first = np.append(True, (column[1:] != column[:-1]) | (row[1:] != row[:-1]))
        start = np.append(np.flatnonzero(first), first.size)
        self._sums = sp.csr_array((np.ones(first.size), sorted_entries.data, start), shape=(start.size - 1, first.size))
        self._column = column[first]
        self._pointer = np.searchsorted(start, sorted_entries.indptr)
        self._n = n_nodes

    def sums(self, entries: Array) -> Array:
        """Sum entries (n_elements, n_local, n_local, …) over the elements of each pair of nodes, shape (n_pairs, …)."""
        total = self._sums @ entries.reshape(self._sums.shape[1], -1)
        return np.asarray(total.reshape(-1, *entries.shape[3:]))

    def scalar_matrix(self, pairs: Array) -> sp.csr_array:
        """Return the matrix (n_nodes, n_nodes) with a number for each pair, shape (n_pairs,)."""
        return sp.csr_array((pairs, self._column, self._pointer), shape=(self._n, self._n))

    def block_matrix(self, pairs: Array) -> sp.csr_array:
        """Return the matrix (3 n_nodes, 3 n_nodes) with a block for each pair, shape (n_pairs, 3, 3)."""
        n = 3 * self._n
        return sp.csr_array(sp.bsr_array((pairs, self._column, self._pointer), shape=(n, n)).tocsr())


@dataclass(frozen=True)
class Member:
    """Elements of one kind of a body, and where their points, nodes and numbers are among those of all."""

    space: Discretisation
    first: int = 0  # row of its first point
    first_element: int = 0  # number of its first element
    first_facet: int = 0  # number of its first boundary facet
    is_whole: bool = True  # false if the body has others beside it

    def of_shapes(self, shapes: Array) -> Array:
        """Return the rows of its points in a field of all points of the body."""
        return shapes[self.first : self.first + len(self.space.x)]

    def own(self, numbers: IntArray) -> IntArray:
        """Return which of some elements are its own, by their places."""
        return np.flatnonzero(
            (numbers >= self.first_element) & (numbers < self.first_element + len(self.space.mesh.cells))
        )

    def own_points(self, face: IntArray) -> IntArray:
        """Return the points (k,), or corners of facets (k, n), of a face that are its own, by its own numbers."""
        inside = (face >= self.first) & (face < self.first + len(self.space.x))
        return np.asarray(face[inside if face.ndim == 1 else inside.all(axis=1)] - self.first)

    def material(self, whole: AnyMaterial) -> AnyMaterial:
        """Return the material of its elements, given that of the body's."""
        if self.is_whole:
            return whole
        return whole.of_elements(self.first_element + np.arange(len(self.space.mesh.cells)))


def member_of(members: Sequence[Member], row: int) -> Member:
    """Return the elements of one kind that a row of a body's points and nodes is of."""
    return next(own for own in reversed(members) if row >= own.first)


@dataclass(frozen=True)
class Discretisation:
    """Nodes and connectivity of a displacement field on a mesh."""

    mesh: SolidMesh
    order: int  # order of the displacement, 1 or 2
    # ``enhanced`` or ``plain`` strain of linear hexahedra; of no effect on other elements.
    formulation: Formulation = "enhanced"

    @property
    def members(self) -> tuple[Member, ...]:
        """Elements of a body by kind, here of one."""
        return (Member(self),)

    @cached_property
    def kind(self) -> ElementKind:
        """The element on the mesh's cells."""
        return self.mesh.cell.element(self.order)

    @cached_property
    def stressed(self) -> Discretisation:
        """Elements with the strains that give stress: those at a section's own points in place of its drawing's.

        Raises
        ------
        InputError
            A beam's section is known by its numbers alone.
        """
        if (line := self.mesh.midsurface) is None:
            return self
        if (found := line.stressed()) is None:
            raise InputError("mesh", "beam", None, NUMBERS_ALONE)
        return self.strained_by(found)

    def strained_by(self, line: Midsurface) -> Discretisation:
        """Return it with the strains of another midsurface, or itself if that is its own."""
        return self if line is self.mesh.midsurface else replace(self, mesh=replace(self.mesh, midsurface=line))

    @property
    def is_enhanced(self) -> bool:
        """True if the elements add strains of their own to those of the nodes' displacements, or replace them."""
        of_their_own = self.kind.strain_matrix is not None
        return of_their_own or (self.formulation == "enhanced" and self.kind.can_be_enhanced)

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
        keys = np.stack([three_corners(self.element_nodes[:, corners]) for corners in facets], axis=1)
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

    def gradients(self, X: Array, elements: slice | IntArray) -> tuple[Array, Array]:
        """Return gradients (n_elements, n_q, n_local, 3) [1/m] and Jacobian determinants (n_elements, n_q) [m³].

        They are those of the shape functions in space at reference points X (3, n_q).
        """
        _, dN = shape_functions(self.kind.element, X)
        inverse, det = inverse_and_determinant(self.jacobians(X[:, :1] if self.kind.is_affine else X, elements))
        n_elements, n_jacobians = det.shape
        g = dN.transpose(2, 0, 1).reshape(n_jacobians, -1, 3) @ inverse
        return g.reshape(n_elements, X.shape[1], len(dN), 3), np.broadcast_to(det, (n_elements, X.shape[1]))

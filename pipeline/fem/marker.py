"""Markers: a named face's mean displacement and mean rotation as weights on its nodes, or the face held rigid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from skfem import BilinearForm, FacetBasis

from pipeline.checks import Array, IntArray
from pipeline.fem.model import Discretisation
from pipeline.tensors import EPSILON

# Shape functions of nodes off the face are round-off on it.
_ON_FACE = 1e-12


@dataclass(frozen=True)
class Marker:
    """A point that follows a face in the mean (RBE3), or holds it rigid (RBE2).

    The weights come from integrals over the face, so a force at the marker acts as a uniform traction. On a rigid face
    its mean displacement and rotation are its displacement and rotation.

    Parameters
    ----------
    position : ndarray, shape (3,)
        The face's centroid [m].
    nodes : ndarray, shape (n,)
        The face's nodes.
    translation_weights : ndarray, shape (n,)
        Weights of the mean displacement; they sum to 1.
    rotation_weights : ndarray, shape (3, n, 3)
        Weights [1/m] of the mean rotation: ``ψ_a = Σ_ib rotation_weights[a, i, b] u_ib``.
    rigid : bool
        Whether the face's nodes move as one rigid piece.
    """

    position: Array
    nodes: IntArray
    translation_weights: Array
    rotation_weights: Array
    rigid: bool = False

    def translation(self, u: Array) -> Array:
        """Mean displacement (3, …) [m] of a nodal field u, shape (n_nodes, 3, …)."""
        return np.asarray(np.tensordot(self.translation_weights, u[self.nodes], axes=1))

    def rotation(self, u: Array) -> Array:
        """Mean rotation vector (3, …) [rad] of a nodal field u, shape (n_nodes, 3, …)."""
        return np.asarray(np.tensordot(self.rotation_weights, u[self.nodes], axes=2))

    def columns(self, n_nodes: int, rotations: Array) -> Array:
        """Nodal loads of unit forces along x, y, z and unit torques about directions (k, 3), shape (n_nodes, 3, 3 + k).

        They are also what holds the marker: ``Bᵀ u = 0`` is no mean displacement, and no mean rotation about those.
        """
        B = np.zeros((n_nodes, 3, 3 + len(rotations)))
        for a in range(3):
            B[self.nodes, a, a] = self.translation_weights
        B[self.nodes, :, 3:] = np.einsum("ka,aib->ibk", rotations, self.rotation_weights)
        return B


@BilinearForm
def _area(u, v, _):  # type: ignore[no-untyped-def]
    return u * v


def face_marker(space: Discretisation, face_points: IntArray, rigid: bool = False) -> Marker:
    """Attach a marker to the boundary facets whose corners are all among ``face_points`` (mesh points).

    Raises
    ------
    ValueError
        No boundary facet has all of its corners among the points.
    """
    mesh = space.skfem_mesh
    chosen = np.zeros(mesh.nvertices, dtype=bool)
    chosen[face_points] = True
    facets = mesh.boundary_facets()
    facets = facets[chosen[mesh.facets[:, facets]].all(axis=0)]
    if facets.size == 0:
        raise ValueError("no boundary facet of the mesh lies on the face")
    A = _area.assemble(FacetBasis(mesh, space.kind.element, facets=facets)).tocsr()
    share = A.diagonal()
    nodes = np.flatnonzero(share > _ON_FACE * share.max())
    A = A[nodes][:, nodes]
    x = space.x[nodes]
    w = A @ np.ones(len(nodes))
    area = w.sum()
    centre = w @ x / area
    r = x - centre
    Ar = A @ r
    second = r.T @ Ar
    inertia = np.trace(second) * np.eye(3) - second
    moment = np.einsum("acb,ic->aib", EPSILON, Ar)
    return Marker(centre, nodes, w / area, np.einsum("ad,dib->aib", np.linalg.inv(inertia), moment), rigid)

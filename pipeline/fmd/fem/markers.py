"""Markers: mean displacement and rotation of a face as weights on its nodes, or a rigid face."""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import ON_A_LINE
from fmd.core.limits.rank import WORST_RESULTANTS
from fmd.core.limits.round_off import SUMMED
from fmd.fem.cells.shape import skfem_quadrature
from fmd.fem.elements import shape_functions
from fmd.fem.joined import AnySpace
from fmd.fem.mesh import rows_among, three_corners
from fmd.fem.space import Discretisation

_FACET_ORDER = {False: 2, True: 3}  # degree of N_i N_j over the displacement's; one more for a curved facet's area


@dataclass(frozen=True)
class Marker:
    """A point that follows a face in the mean (RBE3) or makes it rigid (RBE2).

    The weights come from integrals over the face, so a force at the marker acts as a uniform traction. On a rigid face
    its mean displacement and rotation are its displacement and rotation.
    """

    position: Array  # (3,): the face's centroid [m]
    nodes: IntArray  # (n,): the face's nodes
    # (n,) or (3, n, 3): Weights of the mean displacement, one for each node; they sum to 1. Of a section that tractions
    # weight (`traction_marker`) one for each direction of each node: ``d_a = Σ_ib translation_weights[a, i, b] u_ib``.
    translation_weights: Array
    # (3, n, 3): weights [1/m] of the mean rotation: ``ψ_a = Σ_ib rotation_weights[a, i, b] u_ib``
    rotation_weights: Array
    rigid: bool = False  # true if the face's nodes move as a rigid body
    areas: Array | None = None  # (n,): nodal forces by a unit pressure on the face [m²]; ``None`` of what is no face

    def translation(self, u: Array) -> Array:
        """Return the mean displacement (3, …) [m] of a nodal field u, shape (n_nodes, 3, …)."""
        w = self.translation_weights
        return np.asarray(np.tensordot(w, u[self.nodes], axes=1 if w.ndim == 1 else 2))

    def rotation(self, u: Array) -> Array:
        """Return the mean rotation vector (3, …) [rad] of a nodal field u, shape (n_nodes, 3, …)."""
        return np.asarray(np.tensordot(self.rotation_weights, u[self.nodes], axes=2))

    def columns(self, n_nodes: int, rotations: Array) -> Array:
        """Return nodal loads of unit forces and torques at the marker, shape (n_nodes, 3, 3 + k).

        The forces act along x, y, z, the torques about the directions ``rotations`` (k, 3). The columns are constraints
        too: ``Bᵀ u = 0`` allows no mean displacement, and no mean rotation about these directions.
        """
        B = np.zeros((n_nodes, 3, 3 + len(rotations)))
        if self.translation_weights.ndim == 3:
            B[self.nodes, :, :3] = self.translation_weights.transpose(1, 2, 0)
        else:
            for a in range(3):
                B[self.nodes, a, a] = self.translation_weights
        B[self.nodes, :, 3:] = np.einsum("ka,aib->ibk", rotations, self.rotation_weights)
        return B


def face_marker(
    space: AnySpace, face: IntArray | Sequence[IntArray], rigid: bool = False, centre: Array | None = None
) -> Marker:
    """Attach a marker to a face of the body, or to several together.

    A face is of mesh points (n,), and consists of the boundary facets with all corners among them, or of the corners
    (n_facets, 3 or 4) of its facets. ``centre`` (3,) is the marker's place by the face's geometry [m], which follows
    the face's mean displacement and rotation; by default the centroid of the mesh's facets.

    Raises
    ------
    ValueError
        No boundary facet lies on the face.
    """
    faces = [face] if isinstance(face, np.ndarray) else face
    on_facets, sections = list[tuple[IntArray, sp.csr_array]](), list[IntArray]()
    for own in space.members:
        mine = [own.own_points(one) for one in faces]
        chosen = np.unique(np.concatenate([facets_on_face(own.space, one) for one in mine]))
        elements, local = (numbers[chosen] for numbers in own.space.boundary_facets)
        if elements.size:
            nodes, A = _integrate_products(own.space, elements, local)
            on_facets.append((own.first + nodes, A))
        elif own.space.mesh.midsurface is not None and own.space.mesh.midsurface.has_sections:
            held = [own.first + np.unique(one) for one in mine if one.size]  # a section between the ends
            sections += held
    if sections and not on_facets:
        own_points = np.unique(np.concatenate(sections))
        return weighted_marker(own_points, space.x[own_points], np.ones(len(own_points)), rigid)
    if not on_facets:
        raise ValueError("no boundary facet of the mesh lies on the face")
    if sections:
        raise ValueError("it has sections of beams beside facets of other elements; name a set of each")
    nodes = np.concatenate([nodes for nodes, _ in on_facets])
    A = sp.csr_array(sp.block_diag([A for _, A in on_facets], format="csr"))
    x = space.x[nodes]
    w = A @ np.ones(len(nodes))
    area = w.sum()
    centroid = w @ x / area
    r = x - centroid
    Ar = A @ r
    second = r.T @ Ar
    inertia = np.trace(second) * np.eye(3) - second
    moment = np.einsum("acb,ic->aib", EPSILON, Ar)
    weights = np.einsum("ad,dib->aib", np.linalg.inv(inertia), moment)
    if centre is None:
        return Marker(centroid, nodes, w / area, weights, rigid, w)
    turned = np.einsum("acd,cib,d->aib", EPSILON, weights, centre - centroid)  # ψ × (centre − centroid)
    translation = np.eye(3)[:, None] * (w / area)[:, None] + turned
    return Marker(centre, nodes, translation, weights, rigid, w)


def weighted_marker(points: IntArray, x: Array, weights: Array, rigid: bool = False) -> Marker:
    """Return the marker of the weighted mean motion of points at x (n, 3), least squares of what is left of each.

    About an axis that all points lie on they have no mean rotation, and neither has the marker.
    """
    if not len(points):
        return Marker(np.zeros(3), points, weights, np.zeros((3, 0, 3)), rigid)
    share = weights / weights.sum()
    centre = share @ x
    r = x - centre
    second = np.einsum("i,ia,ib->ab", share, r, r)
    inertia = np.trace(second) * np.eye(3) - second
    turn = np.einsum("ad,i,dcb,ic->aib", np.linalg.pinv(inertia, rcond=ON_A_LINE), share, EPSILON, r)
    return Marker(centre, points, share, turn, rigid)


def traction_marker(position: Array, nodes: IntArray, x: Array, forces: Array) -> Marker:
    """Attach a marker at a position (3,) [m] to a section of a body by the nodal forces that the section transmits.

    The section's nodes (n,) at x (n, 3) [m] have forces (6, n, 3) of six independent loads. A load at the marker acts
    with these forces, and so its motion is the one on which they do the load's work. Unlike a uniform traction, the
    tractions of the body's own static deflections take the section's warping in torsion and in shear into account.

    Raises
    ------
    ValueError
        The resultants of the forces depend on one another.
    """
    r = x - position
    moments = np.cross(r, forces)
    resultants = np.concatenate([forces.sum(axis=1), moments.sum(axis=1)], axis=1)
    extent = np.linalg.norm(r, axis=1).max()
    scaled = resultants / np.repeat([1.0, extent], 3)
    scaled = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    if not np.linalg.cond(scaled) < WORST_RESULTANTS:
        raise ValueError("the resultants of the section's forces depend on one another")
    unit = np.einsum("kl,lib->kib", np.linalg.inv(resultants), forces)
    return Marker(position, nodes, unit[:3], unit[3:])


def facets_on_face(space: Discretisation, face: IntArray) -> IntArray:
    """Return the numbers of the boundary facets on a face, given as in `face_marker`."""
    elements, local = space.boundary_facets
    on_face = np.zeros(len(elements), dtype=bool)
    points = np.zeros(len(space.x), dtype=bool)
    points[face.ravel()] = True
    facets = three_corners(face) if face.ndim == 2 else None
    for k, facet in enumerate(space.kind.facet_corners):
        mine = local == k
        corners = space.element_nodes[elements[mine][:, None], facet]
        if facets is None:
            on_face[mine] = points[corners].all(axis=1)
        else:
            on_face[mine] = rows_among(three_corners(corners), facets)
    return np.flatnonzero(on_face)


def _integrate_products(space: Discretisation, elements: IntArray, local: IntArray) -> tuple[IntArray, sp.csr_array]:
    """Return the nodes of facets and ``∫ N_i N_j dA`` over them, shape (n_nodes, n_nodes) [m²]."""
    rows, values = [], []
    for k in np.unique(local):
        on = elements[local == k]
        X, w, tangents = _facet_quadrature(space, int(k))
        N, _ = shape_functions(space.kind.element, X)
        t = np.einsum("eqab,bc->eqac", space.jacobians(X, on), tangents)
        area = np.linalg.norm(np.cross(t[..., 0], t[..., 1]), axis=-1) * w
        values.append(np.einsum("eq,iq,jq->eij", area, N, N, optimize=True))
        rows.append(space.element_nodes[on])
    shared, entries = np.concatenate(rows), np.concatenate(values)
    n_local = shared.shape[1]
    nodes, place = np.unique(shared, return_inverse=True)
    place = place.reshape(shared.shape)
    pairs = np.repeat(place, n_local, axis=1).ravel(), np.tile(place, (1, n_local)).ravel()
    A = sp.csr_array(sp.coo_array((entries.ravel(), pairs), shape=(len(nodes), len(nodes))))
    share = A.diagonal()
    on_face = np.flatnonzero(share > SUMMED * share.max())
    return nodes[on_face], A[on_face][:, on_face]


def _facet_quadrature(space: Discretisation, facet: int) -> tuple[Array, Array, Array]:
    """Return points (3, n_q) and weights (n_q,) on a facet of the reference cell, and two of its sides (3, 2)."""
    corners = space.kind.facet_corners[facet]
    start, after, *_, before = space.kind.element.doflocs[corners]
    sides = np.stack([after - start, before - start], axis=1)
    X, w = skfem_quadrature("RefTri" if len(corners) == 3 else "RefQuad", _FACET_ORDER[space.kind.curved] * space.order)
    return start[:, None] + sides @ X, w, sides

"""Ties: faces of parts without common nodes, which stay together where they are near."""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import RIGID_RESIDUAL
from fmd.core.limits.round_off import SOLVED
from fmd.core.rotations import rigid_motions
from fmd.fem.connections import TiedFaces
from fmd.fem.constraints import rows_of
from fmd.fem.markers import facets_on_face, weighted_marker
from fmd.fem.model import FEModel
from fmd.fem.mortar import follow_face
from fmd.fem.sheet_ties import ShellNodes, far_apart, follow_edge, moved_already
from fmd.fem.space import Discretisation, Member


@dataclass(frozen=True)
class Tie:
    """Unknowns of a model that follow others."""

    label: str  # what messages call it
    unknowns: IntArray  # (n,)
    others: IntArray  # (m,)
    weights: sp.csr_array  # (n, m): rigid motions stay rigid
    share: float = 1.0  # share of an edge that lies on what it follows


def tie_faces(fe: FEModel, member: Member, given: TiedFaces) -> Tie:
    """Return how the first of two faces of a member follows the second, where both are near.

    Faces are of the points of solids, or of the nodes of shells, numbered from 0. Across a gap, as between polygons of
    two meshes of one bore, a node moves as on an arm that turns as the other face's nodes around it do in the mean.

    Raises
    ------
    ValueError
        The faces have no facets, share nodes, or are too far apart; the message says how far.
    """
    midsurface = member.space.mesh.midsurface
    if shared := len(np.intersect1d(given.face, given.onto)):
        raise ValueError(f"{given.label}: its faces share {shared} nodes, by which they are joined already")
    if midsurface is None:
        points, others, weights = _follow(member.space, given, given.face, given.onto)
        return Tie(given.label, rows_of(member.first + points), rows_of(member.first + others), weights)
    if midsurface.has_sections:
        raise ValueError(f"{given.label} joins beams, which links join")
    sheet = ShellNodes(fe, member)
    glued = sheet.whole(given.face)
    if given.face.ndim == 1 and not np.isin(given.face, sheet.cells[glued]).all():
        return Tie(given.label, *follow_edge(sheet, given))
    both = (
        np.flatnonzero(np.isin(midsurface.owner, sheet.cells[sheet.whole(each)])) for each in (given.face, given.onto)
    )
    points, others, weights = _follow(member.space, given, *both)
    kept = _facing(member.space.x, midsurface.owner, points, others, weights)
    points, weights = points[kept], weights[rows_of(kept)]
    owner = midsurface.owner[points]
    if len(np.unique(owner)) < len(owner):
        raise ValueError(f"{given.label}: both sides of its first face lie against the second; name a face for each")
    unknowns = fe.point_map[sheet.rows(owner)].indices
    if len(unknowns) > 3 * len(owner):
        raise ValueError(moved_already(given.label))
    moved = fe.point_map[rows_of(member.first + points)]
    own = sp.csr_array((np.ones(len(unknowns)), (np.arange(len(unknowns)), unknowns)), shape=moved.shape)
    follows = sp.csr_array(weights @ fe.point_map[rows_of(member.first + others)] - (moved - own))
    known = np.unique(follows.indices)
    return Tie(given.label, unknowns, known, sp.csr_array(follows[:, known]))


def _facing(x: Array, owner: IntArray, points: IntArray, others: IntArray, weights: sp.csr_array) -> IntArray:
    """Return the numbers of points but those at the backs of sheets, further away by all of their thickness."""
    away = np.linalg.norm((x[points].ravel() - weights @ x[others].ravel()).reshape(-1, 3), axis=1)
    order = np.lexsort((away, owner[points]))
    near, far = order[:-1], order[1:]
    both = owner[points[near]] == owner[points[far]]
    thickness = np.linalg.norm(x[points[far]] - x[points[near]], axis=1)
    back = both & (away[far] - away[near] > (1 - SOLVED) * thickness)
    return np.setdiff1d(np.arange(len(points)), far[back])


def _follow(
    space: Discretisation, given: TiedFaces, one: IntArray, other: IntArray
) -> tuple[IntArray, IntArray, sp.csr_array]:
    """Return the points (n,) of a face that follow those (m,) of another, and the weights (3 n, 3 m)."""
    face, onto = (facets_on_face(space, each) for each in (one, other))
    for name, facets in (("first", face), ("second", onto)):
        if not len(facets):
            raise ValueError(f"{given.label}: no facet of the mesh's boundary is on the {name} face")
    found = follow_face(space, face, onto, given.within)
    x = space.x
    if not len(found.nodes):
        nodes = (_nodes(space, each) for each in (onto, face))
        raise ValueError(far_apart(given.label, float(cKDTree(x[next(nodes)]).query(x[next(nodes)])[0].min())))
    weights = sp.csr_array(sp.kron(found.weights, sp.eye_array(3)))
    arms = x[found.nodes] - found.weights @ x[found.others]
    extent = float(np.ptp(x, axis=0).max())
    far = np.flatnonzero(np.linalg.norm(arms, axis=1) > SOLVED * extent)
    if len(far):
        weights = sp.csr_array(weights + _turned(found.weights, x[found.others], arms, far))
    left = weights @ rigid_motions(x[found.others]).reshape(-1, 6) - rigid_motions(x[found.nodes]).reshape(-1, 6)
    if np.abs(left).max() > RIGID_RESIDUAL * max(extent, 1.0):
        raise ValueError(f"{given.label}: its faces meet on a line, about which one would turn on the other")
    return found.nodes, found.others, weights


def _nodes(space: Discretisation, facets: IntArray) -> IntArray:
    """Return the corners of boundary facets."""
    elements, local = (each[facets] for each in space.boundary_facets)
    corners = [space.element_nodes[elements[local == k]][:, space.kind.facet_corners[k]].ravel() for k in set(local)]
    return np.unique(np.concatenate(corners))


def _turned(weights: sp.csr_array, x: Array, arms: Array, far: IntArray) -> sp.csr_array:
    """Return what the rotation of the nodes at x that each one follows adds to the weights, ``θ × arm``."""
    rows, columns, values = [], [], []
    for k in far:
        others = weights.indices[weights.indptr[k] : weights.indptr[k + 1]]
        turn = weighted_marker(others, x[others], np.ones(len(others))).rotation_weights
        moved = np.cross(turn, arms[k], axis=0).reshape(3, -1)
        values.append(moved.ravel())
        rows.append(np.repeat(3 * k + np.arange(3), moved.shape[1]))
        columns.append(np.tile((3 * others[:, None] + np.arange(3)).ravel(), 3))
    place = np.concatenate(rows), np.concatenate(columns)
    n, m = weights.shape
    return sp.csr_array((np.concatenate(values), place), shape=(3 * n, 3 * m))

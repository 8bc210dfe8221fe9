"""Markers at a point, at a node and on an edge: their motion is that of the displacement field there.

A face has a mean rotation by the displacements on it; a point has none, and a straight edge none about itself. There a
marker turns as the material does, by half the curl of the displacement, ``ψ = ½ ∇ × u``. A torque on it is the couple
of nodal forces with the same work.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.limits.mesh import OUTSIDE, SAME_PLACE, STRAIGHT_EDGE
from fmd.core.limits.round_off import SOLVED
from fmd.fem.elements import shape_functions
from fmd.fem.joined import AnySpace
from fmd.fem.markers import Marker, weighted_marker
from fmd.fem.selection import locate_points, points_of_nodes
from fmd.fem.space import Discretisation, Member

_POINTS = 4  # of Gauss's rule along an edge: exact for products of quadratic functions on a curved edge


class _Motion(NamedTuple):
    """Displacement and half its curl at points of elements, as weights of nodal displacements."""

    nodes: IntArray  # (n,)
    translation: Array  # (n,)
    rotation: Array  # (3, n, 3) [1/m]


def point_marker(space: AnySpace, point: Array) -> Marker:
    """Attach a marker to a point (3,) [m] in or on a body, by interpolation in the element that holds it.

    Raises
    ------
    ValueError
        The point lies outside the body; the message gives the nearest place.
    """
    extent, markers = float(np.ptp(space.x, axis=0).max()), [_nearest_marker(own, point) for own in space.members]
    near = SAME_PLACE * extent  # where two kinds of elements meet the first has it
    found = min(markers, key=lambda marker: float((np.linalg.norm(marker.position - point) / near).round()))
    if np.linalg.norm(found.position - point) > OUTSIDE * extent:
        place = ", ".join(f"{x:.6g} m" for x in space.x[np.linalg.norm(space.x - point, axis=1).argmin()])
        raise ValueError(f"lies outside the body; the node nearest to it is at [{place}]")
    return found


def _nearest_marker(member: Member, point: Array) -> Marker:
    """Return the marker in the elements of one kind that is nearest to a point (3,) [m]."""
    space = member.space
    elements, X = locate_points(space, point[None])
    N, _ = shape_functions(space.kind.geometry, X[0][:, None])
    found = N[:, 0] @ space.corner_coordinates[elements[0]]
    motion = _collect(space, elements, X[:, None], np.ones((1, 1)))
    return Marker(found, member.first + motion.nodes, motion.translation, motion.rotation)


def single_node_marker(space: AnySpace, node: int) -> Marker:
    """Attach a marker to a node; it turns as the elements around it do in the mean, by their volumes.

    A node of a shell's midsurface is between the points at both faces, and is numbered behind them.
    """
    points = points_of_nodes(space, np.array([node]))
    member = next(own for own in reversed(space.members) if node >= own.first)
    mine = member.space
    if mine.mesh.midsurface is not None and mine.mesh.midsurface.has_sections:
        return weighted_marker(points, space.x[points], np.ones(len(points)))
    own = points - member.first
    elements, local = np.nonzero(np.isin(mine.element_nodes, own))
    X = mine.kind.element.doflocs[local][:, None]
    if mine.mesh.midsurface is not None:
        X = np.concatenate([X[..., :2], np.full_like(X[..., 2:], 0.5)], axis=2)
    volumes = mine.volumes[elements]
    motion = _collect(mine, elements, X, (volumes / volumes.sum())[:, None])
    nodes = member.first + motion.nodes
    return Marker(mine.x[own].mean(axis=0), nodes, np.isin(motion.nodes, own) / len(own), motion.rotation)


def edge_marker(space: Discretisation, nodes: IntArray) -> Marker:
    """Attach a marker to the edges of elements between given nodes; it follows them in the mean along their length.

    Raises
    ------
    ValueError
        No edge of an element has all of its nodes among them.
    """
    elements, ends = _find_edges(space, nodes)
    if not len(elements):
        raise ValueError("no edge of an element lies there")
    s, weights = np.polynomial.legendre.leggauss(_POINTS)
    corners = space.kind.element.doflocs[ends]  # (n_edges, 2, 3)
    along = corners[:, 1] - corners[:, 0]
    X = corners[:, :1] + 0.5 * (1.0 + s)[:, None] * along[:, None]
    J = _jacobians(space, elements, X)
    lengths = 0.5 * weights * np.linalg.norm(np.einsum("eqab,eb->eqa", J, along), axis=2)
    keys = np.sort(space.element_nodes[elements[:, None], ends], axis=1)
    _, same, sharing = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    lengths /= sharing[same.ravel()][:, None]  # each element around an edge counts alike
    motion = _collect(space, elements, X, lengths / lengths.sum())
    on_edge = np.isin(motion.nodes, nodes)
    N = _shape_values(space, X)
    x = np.einsum("eqi,eia->eqa", N, space.x[space.element_nodes[elements]])
    share = lengths / lengths.sum()
    centre = np.einsum("eq,eqa->a", share, x)
    r = x - centre
    # Weights of ∫ r × u ds, node by node.
    place = np.searchsorted(motion.nodes, space.element_nodes[elements])
    moment = np.zeros((3, len(motion.nodes), 3))
    for a, b, c in zip(*np.nonzero(EPSILON), strict=True):
        np.add.at(moment[a, :, c], place, EPSILON[a, b, c] * np.einsum("eq,eq,eqi->ei", share, r[..., b], N))
    second = np.einsum("eq,eqa,eqb->ab", share, r, r)
    sizes, axes = np.linalg.eigh(np.trace(second) * np.eye(3) - second)
    rotation = np.zeros_like(moment)
    for size, axis in zip(sizes, axes.T, strict=True):
        own = motion.rotation if size <= STRAIGHT_EDGE * sizes[-1] else moment / size
        rotation += np.einsum("a,b,bic->aic", axis, axis, own)
    return Marker(centre, motion.nodes, np.where(on_edge, motion.translation, 0.0), rotation)


def _find_edges(space: Discretisation, nodes: IntArray) -> tuple[IntArray, IntArray]:
    """Return elements (n,) and local corners (n, 2) of the edges with all of their nodes among the given ones."""
    wanted = np.zeros(len(space.x), dtype=bool)
    wanted[nodes] = True
    pairs = {tuple(sorted(ends)) for facet in space.kind.facet_corners for ends in pairwise([*facet, facet[0]])}
    elements, found = [], []
    for ends in sorted(pairs):
        start, end = space.kind.element.doflocs[list(ends)]
        N, _ = shape_functions(space.kind.element, np.stack([start + 0.3 * (end - start)], axis=1))
        local = np.flatnonzero(np.abs(N[:, 0]) > SOLVED)
        mine = np.flatnonzero(wanted[space.element_nodes[:, local]].all(axis=1))
        elements.append(mine)
        found.append(np.tile(ends, (len(mine), 1)))
    return np.concatenate(elements), np.concatenate(found)


def _collect(space: Discretisation, elements: IntArray, X: Array, weights: Array) -> _Motion:
    """Sum displacement and half its curl over points X (n, n_q, 3) of elements (n,) with weights (n, n_q)."""
    shared = space.element_nodes[elements]
    nodes, place = np.unique(shared, return_inverse=True)
    place = place.reshape(shared.shape)
    gradients = np.stack([shape_functions(space.kind.element, x.T)[1] for x in X])  # (n, n_local, 3, n_q)
    inverse = np.linalg.inv(_jacobians(space, elements, X))
    G = np.einsum("eq,eibq,eqba->eia", weights, gradients, inverse)
    translation, slope = np.zeros(len(nodes)), np.zeros((len(nodes), 3))
    np.add.at(translation, place, np.einsum("eq,eqi->ei", weights, _shape_values(space, X)))
    np.add.at(slope, place, G)
    return _Motion(nodes, translation, 0.5 * np.einsum("acb,ic->aib", EPSILON, slope))


def _jacobians(space: Discretisation, elements: IntArray, X: Array) -> Array:
    """Derivatives of position at points X (n, n_q, 3) of elements (n,), shape (n, n_q, 3, 3)."""
    each = [space.jacobians(x.T, np.array([element]))[0] for element, x in zip(elements, X, strict=True)]
    return np.stack(each)


def _shape_values(space: Discretisation, X: Array) -> Array:
    """Shape functions of the displacement at points X (n, n_q, 3), shape (n, n_q, n_local)."""
    return np.stack([shape_functions(space.kind.element, x.T)[0].T for x in X])

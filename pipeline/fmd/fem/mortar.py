"""Faces of two meshes that don't match, joined by the mortar method with dual functions, over what polygons share.

One face follows the other: ``∫ ψ_j (u − u_other) dA = 0`` for functions ψ_j of its own nodes that are biorthogonal to
its shape functions, so that each node's displacement is given by few of the other face's. The integrals are over what
the facets of both have in common, and so constant stress passes from one mesh to the other exactly. Corners of
quadratic facets have no positive integral of their own, and are given three eighths of the functions beside them.

References
----------
Wohlmuth, A mortar finite element method using dual spaces for the Lagrange multiplier, SIAM Journal on Numerical
Analysis 38, 2000. Popp, Wohlmuth, Gee & Wall, Dual quadratic mortar finite element methods for 3D finite deformation
contact, SIAM Journal on Scientific Computing 34, 2012.
"""

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import TIE_COVERED, TIE_FACING, TIE_PAIRS_AT_ONCE, TIE_SHARE, TIE_WITHIN
from fmd.core.limits.newton import LOCATING_CORRECTIONS
from fmd.fem.cells.shape import skfem_quadrature
from fmd.fem.elements import shape_functions
from fmd.fem.space import Discretisation


def common_triangles(one: Array, other: Array) -> tuple[Array, IntArray]:
    """Return triangles (n, 3, 2) that cover what convex polygons have in common, and the number of each one's pair.

    Sutherland and Hodgman's algorithm: the first polygon is cut along each side of the second. Corners, (n_pairs, 3 or
    4, 2), are counter-clockwise; one may be there twice.
    """
    polygon = one
    for a, b in zip(other.swapaxes(0, 1), np.roll(other, -1, axis=1).swapaxes(0, 1), strict=True):
        polygon = _cut(polygon, a, b - a)
    n_pairs, n_corners = polygon.shape[:2]
    fan = np.array([(0, k, k + 1) for k in range(1, n_corners - 1)])
    triangles = polygon[:, fan].reshape(-1, 3, 2)
    sides = triangles[:, 1:] - triangles[:, :1]
    double = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    real = np.flatnonzero(double > 0.0)
    return triangles[real], np.repeat(np.arange(n_pairs), len(fan))[real]


def _cut(polygon: Array, start: Array, along: Array) -> Array:
    """Return what of polygons (n, k, 2) is to the left of a line each, with k + 1 corners, the last repeated."""
    off = polygon - start[:, None]
    left = along[:, None, 0] * off[..., 1] - along[:, None, 1] * off[..., 0]
    after, left_after = np.roll(polygon, -1, axis=1), np.roll(left, -1, axis=1)
    crosses = (left < 0.0) != (left_after < 0.0)
    share = np.where(crosses, left, 0.0) / np.where(crosses, left - left_after, 1.0)
    corners = np.stack([polygon, polygon + share[..., None] * (after - polygon)], axis=2)
    kept = np.stack([left >= 0.0, crosses], axis=2).reshape(len(polygon), -1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : polygon.shape[1] + 1]
    count = np.asarray(kept.sum(axis=1))
    last = np.maximum(count - 1, 0)[:, None]
    place = np.take_along_axis(order, np.minimum(np.arange(order.shape[1]), last), axis=1)
    found = np.take_along_axis(corners.reshape(len(polygon), -1, 2), place[..., None], axis=1)
    return np.asarray(np.where((count > 0)[:, None, None], found, start[:, None]))


def bilinear_places(corners: Array, points: Array) -> Array:
    """Return coordinates (n, 2), 0 to 1, of points (n, 2) in quadrilaterals (n, 4, 2); in triangles (n, 3, 2) too."""
    origin, a = corners[:, 0], corners[:, 1] - corners[:, 0]
    b = corners[:, -1] - origin
    twist = corners[:, 2] - corners[:, 1] - b if corners.shape[1] == 4 else np.zeros_like(a)
    place = np.full_like(points, 0.5)
    for _ in range(LOCATING_CORRECTIONS if corners.shape[1] == 4 else 1):
        s, t = place[:, :1], place[:, 1:]
        off = points - (origin + s * a + t * b + s * t * twist)
        by_s, by_t = a + t * twist, b + s * twist
        det = by_s[:, 0] * by_t[:, 1] - by_s[:, 1] * by_t[:, 0]
        step = [off[:, 0] * by_t[:, 1] - off[:, 1] * by_t[:, 0], by_s[:, 0] * off[:, 1] - by_s[:, 1] * off[:, 0]]
        place = place + np.stack(step, axis=1) / det[:, None]
    return place


@dataclass(frozen=True)
class _Facets:
    """Boundary facets with one number in their elements."""

    space: Discretisation
    local: IntArray  # their nodes in the element, corners around the facet first, shape (k,)
    origin: Array
    sides: Array
    """origin, sides: places of the facet in the reference cell by two coordinates, 0 to 1, shape (3,) and (3, 2)."""
    nodes: IntArray  # (n, k)
    x: Array  # corners, counter-clockwise from outside, shape (n, 3 or 4, 3) [m]
    frame: Array  # two directions in the plane of each facet, and its outer normal, shape (n, 3, 3)

    @property
    def centres(self) -> Array:
        """Middles of the facets, shape (n, 3) [m]."""
        return np.asarray(self.x.mean(axis=1))

    @property
    def reach(self) -> Array:
        """Distance of the farthest corner from the middle, shape (n,) [m]."""
        return np.asarray(np.linalg.norm(self.x - self.centres[:, None], axis=2).max(axis=1))

    @property
    def areas(self) -> Array:
        """Areas in each facet's plane, shape (n,) [m²]."""
        r = self.x - self.x[:, :1]
        across = sum(np.cross(r[:, k], r[:, k + 1]) for k in range(1, r.shape[1] - 1))
        return np.asarray(np.linalg.norm(across, axis=1) / 2)

    def values(self, places: Array) -> Array:
        """Return the nodes' shape functions at places (n, 2) on the facet, shape (n, k)."""
        X = self.origin[:, None] + self.sides @ places.T
        return np.asarray(shape_functions(self.space.kind.element, X)[0][self.local].T)

    def mixed(self) -> Array:
        """Return V (k, k): functions ``V N`` of the nodes whose integrals are above zero."""
        at = self.space.kind.element.doflocs[self.local]
        n = self.x.shape[1]
        V = np.eye(len(self.local))
        for a in range(n):
            middle = np.abs(at - (at[a] + at[(a + 1) % n]) / 2).max(axis=1) < 1e-9
            V[a, middle] = V[(a + 1) % n, middle] = TIE_SHARE
            V[middle, middle] = 1 - 2 * TIE_SHARE
        return V


def _group(space: Discretisation, chosen: IntArray) -> list[_Facets]:
    """Return boundary facets by their number in the element."""
    elements, numbers = (each[chosen] for each in space.boundary_facets)
    groups, places = [], space.kind.element.doflocs
    for k in np.unique(numbers):
        own, around = elements[numbers == k], np.array(space.kind.facet_corners[k])
        x = space.x[space.element_nodes[own[:, None], around]]
        normal = np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1])
        outward = x.mean(axis=1) - space.corner_coordinates[own].mean(axis=1)
        if np.median(np.einsum("ni,ni->n", normal, outward)) < 0:
            around, x, normal = around[::-1], x[:, ::-1], -normal
        start = places[around[0]]
        sides = np.stack([places[around[1]] - start, places[around[-1]] - start], axis=1)
        on = np.flatnonzero(np.abs((places - start) @ np.cross(*sides.T)) < 1e-9)
        local = np.concatenate([around, np.setdiff1d(on, around)])
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        first = x[:, 1] - x[:, 0]
        first = first - np.einsum("ni,ni->n", first, normal)[:, None] * normal
        first = first / np.linalg.norm(first, axis=1, keepdims=True)
        frame = np.stack([first, np.cross(normal, first), normal], axis=1)
        groups.append(_Facets(space, local, start, sides, space.element_nodes[own][:, local], x, frame))
    return groups


@dataclass(frozen=True)
class _Overlap:
    """Triangles that facets of one group have in common with those of another."""

    facet: IntArray
    other: IntArray
    """facet, other: numbers of the facets of each triangle, shape (n,)."""
    area: Array  # [m²], shape (n,)
    own: Array  # ``∫ Ñ Ñᵀ dA`` of the mixed functions of one's nodes, shape (n, k, k) [m²]
    both: Array  # ``∫ Ñ Nᵀ dA`` of these and the other's functions, shape (n, k, l) [m²]


def _near(one: _Facets, other: _Facets, within: Array) -> tuple[IntArray, IntArray]:
    """Return the pairs of facets that face each other and may be near enough, given how near for each of one's."""
    reach = one.reach + other.reach.max() + within
    found = cKDTree(other.centres).query_ball_point(one.centres, reach)
    i = np.repeat(np.arange(len(found)), [len(each) for each in found])
    j = np.concatenate([np.zeros(0, dtype=np.int64), *(np.array(each, dtype=np.int64) for each in found)])
    facing = np.einsum("ni,ni->n", one.frame[i, 2], other.frame[j, 2]) < -TIE_FACING
    return i[facing], j[facing]


def _overlap(one: _Facets, other: _Facets, i: IntArray, j: IntArray, within: Array) -> _Overlap:
    """Integrate over what pairs of facets have in common, no farther apart than ``within``, of each of one's."""
    flat, heights = np.split(one.frame[i] @ (one.x[i] - one.centres[i, None]).swapaxes(1, 2), [2], axis=1)
    shadow, above = np.split(one.frame[i] @ (other.x[j] - one.centres[i, None]).swapaxes(1, 2), [2], axis=1)
    flat, shadow = flat.swapaxes(1, 2), shadow.swapaxes(1, 2)
    triangles, pair = common_triangles(flat, shadow[:, ::-1])
    X, w = skfem_quadrature("RefTri", 4 * one.space.order)
    sides = triangles[:, 1:] - triangles[:, :1]
    points = triangles[:, :1] + np.einsum("cq,ncd->nqd", X, sides)
    det = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    at, n_q = np.repeat(pair, len(w)), len(w)
    place, other_place = (bilinear_places(each[at], points.reshape(-1, 2)) for each in (flat, shadow))
    height = (_height(above[at, 0], other_place) - _height(heights[at, 0], place)).reshape(-1, n_q) @ w / w.sum()
    near = np.abs(height) <= within[i[pair]]
    N, N_other = one.values(place) @ one.mixed().T, other.values(other_place)
    N, N_other = N.reshape(-1, n_q, N.shape[1])[near], N_other.reshape(-1, n_q, N_other.shape[1])[near]
    weighted = (det[near, None] * w)[..., None] * N
    turned = weighted.swapaxes(1, 2)
    return _Overlap(i[pair[near]], j[pair[near]], det[near] / 2, turned @ N, turned @ N_other)


def _height(corners: Array, places: Array) -> Array:
    """Return heights (n,) at places (n, 2) of facets whose corners (n, 3 or 4) are so high."""
    s, t = places.T
    rise = (corners[:, 1] - corners[:, 0]) * s + (corners[:, -1] - corners[:, 0]) * t + corners[:, 0]
    if corners.shape[1] == 3:
        return np.asarray(rise)
    return np.asarray(rise + (corners[:, 2] - corners[:, 1] - corners[:, 3] + corners[:, 0]) * s * t)


@dataclass(frozen=True)
class FollowingFace:
    """How the nodes of a face follow those of another."""

    nodes: IntArray  # (n,)
    others: IntArray  # (m,)
    weights: sp.csr_array  # (n, m): displacement of each node by those of the others; each row sums to 1
    area: float  # what the faces have in common [m²]


def follow_face(space: Discretisation, face: IntArray, onto: IntArray, within: float | None = None) -> FollowingFace:
    """Let the nodes of boundary facets (n,) follow those of others (m,), where both are near.

    That is within a distance [m], or a share of each facet's size by default.
    """
    others, n, area = _group(space, onto), len(space.x), 0.0
    rows, columns, values, mixed = [], [], [], [np.zeros((3, 0))]
    sums = np.zeros(n)
    for one in _group(space, face):
        near = TIE_WITHIN * np.sqrt(one.areas) if within is None else np.full(len(one.x), within)
        found = [(other, part) for other in others for part in _overlaps(one, other, near)]
        products, covered = np.zeros((len(one.x), *one.mixed().shape)), np.zeros(len(one.x))
        for _, part in found:
            np.add.at(products, part.facet, part.own)
            np.add.at(covered, part.facet, part.area)
        used = covered > TIE_COVERED * one.areas
        integrals, dual = products.sum(axis=2), np.zeros_like(products)
        dual[used] = integrals[used, :, None] * np.linalg.inv(products[used])
        area += float(covered[used].sum())
        np.add.at(sums, one.nodes[used], integrals[used])
        for other, part in found:
            kept = used[part.facet]
            each = dual[part.facet[kept]] @ part.both[kept]
            values.append(each.ravel())
            rows.append(np.broadcast_to(one.nodes[part.facet[kept]][:, :, None], each.shape).ravel())
            columns.append(np.broadcast_to(other.nodes[part.other[kept]][:, None, :], each.shape).ravel())
        a, b = np.nonzero(one.mixed())
        share = np.broadcast_to(one.mixed()[a, b], (int(used.sum()), len(a)))
        mixed.append(np.stack([one.nodes[used][:, b], one.nodes[used][:, a], share]).reshape(3, -1))
    nodes = np.flatnonzero(sums)
    if not len(nodes):
        return FollowingFace(nodes, nodes, sp.csr_array((0, 0)), 0.0)
    place = np.concatenate(rows), np.concatenate(columns)
    dual_weights = sp.csr_array((np.concatenate(values), place), shape=(n, n))[nodes] / sums[nodes, None]
    k, j, share = np.unique(np.concatenate(mixed, axis=1), axis=1)  # facets side by side have the same
    back = sp.csr_array((share, (k.astype(np.int64), j.astype(np.int64))), shape=(n, n))[nodes][:, nodes]
    weights = sp.csr_array(back @ dual_weights)
    used_others = np.unique(weights.indices)
    return FollowingFace(nodes, used_others, sp.csr_array(weights[:, used_others]), area)


def _overlaps(one: _Facets, other: _Facets, within: Array) -> Iterator[_Overlap]:
    """Yield what facets have in common, for so many pairs at once as memory bears."""
    i, j = _near(one, other, within)
    for start in range(0, len(i), TIE_PAIRS_AT_ONCE):
        part = slice(start, start + TIE_PAIRS_AT_ONCE)
        yield _overlap(one, other, i[part], j[part], within)

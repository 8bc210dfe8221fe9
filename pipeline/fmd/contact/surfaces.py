"""Surfaces of bodies that may touch: their points, and the triangles or planes before them."""

from collections.abc import Sequence

import numpy as np

from fmd.contact.primitives import Primitive
from fmd.contact.touching_body import ContactPair, ContactPlane, ContactPoints, TouchingBody
from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.contact import EDGE_SOFTNESS, SHARP_EDGE


@dataclass(frozen=True)
class ContactSurface:
    """Points of a body before a plane, or before triangles of another body."""

    slave: int  # number of the points' body
    master: int  # number of the triangles' body; -1 for a plane
    points: IntArray  # (n,): numbers in the points of the first body
    areas: Array  # (n,) [m²]
    outward: Array  # (n, 3): unit normals of the first body's face; 0 before a plane
    triangles: IntArray  # (n_triangles, 3): numbers in the points of the second body
    rim: IntArray  # (n_triangles, 6): 1 for each side and each corner on the rim of the face
    of: ContactPlane | ContactPair
    sign: int  # 1 if the contact's force is reported on the points' body, else -1
    softness: float  # more of the own flexibility of each point
    primitive: Primitive | None = None  # the second body's surface, if that is rigid
    edges: Primitive | None = None  # the first body's box, if its edges are meant


_NO_TRIANGLES = np.zeros((0, 3), dtype=np.int64), np.zeros((0, 6), dtype=np.int64)


def find_surfaces(bodies: Sequence[TouchingBody]) -> list[tuple[int, ContactSurface]]:
    """Return all surfaces with the number of each one's contact, in the order of the bodies' contacts.

    Of a pair there are two: points of the first face before triangles of the second, and, for edges and corners of the
    second may come between these points, its nodes on edges before triangles of the first.
    """
    found, number = list[tuple[int, ContactSurface]](), 0
    names = [body.body for body in bodies]
    for k, body in enumerate(bodies):
        own = body.points
        for plane in body.planes:
            points, areas = own.faces[plane.face], own.areas[plane.face]
            outward = np.zeros((len(points), 3))
            found.append((number, ContactSurface(k, -1, points, areas, outward, *_NO_TRIANGLES, plane, 1, 0.0)))
            number += 1
        for pair in body.pairs:
            other = names.index(pair.other)
            theirs, sign = bodies[other].points, -1 if pair.reported_on_other else 1
            if pair.other_face in theirs.primitives:
                for each in (pair, *pair.others):
                    ends, side = ((k, other), sign) if each.other == pair.other else ((other, k), -sign)
                    found.append((number, _before_primitive(bodies, *ends, each, side)))
                number += 1
                continue
            mine, beyond = own.surfaces[pair.face], theirs.surfaces[pair.other_face]
            points, areas = own.faces[pair.face], own.areas[pair.face]
            rim, normals = find_rim(beyond), node_normals(own, mine)[points]
            found.append((number, ContactSurface(k, other, points, areas, normals, beyond, rim, pair, sign, 0.0)))
            edge = edge_points(theirs.x, beyond)
            rim, normals = find_rim(mine), node_normals(theirs, beyond)[edge]
            nothing = np.zeros(len(edge))
            second = ContactSurface(other, k, edge, nothing, normals, mine, rim, pair, -sign, EDGE_SOFTNESS)
            found += [(number, second)] if len(edge) else []
            number += 1
    return found


def _before_primitive(
    bodies: Sequence[TouchingBody], slave: int, master: int, pair: ContactPair, sign: int
) -> ContactSurface:
    """Return points of a body before a surface of a rigid one."""
    own, primitive = bodies[slave].points, bodies[master].points.primitives[pair.other_face]
    points, areas, edges = own.faces[pair.face], own.areas[pair.face], own.primitives.get(pair.edges)
    outward = np.zeros((len(points), 3))
    return ContactSurface(slave, master, points, areas, outward, *_NO_TRIANGLES, pair, sign, 0.0, primitive, edges)


def triangle_normals(x: Array, triangles: IntArray) -> Array:
    """Return the normals of triangles (n, 3) with corners x, as long as twice their areas."""
    a, b, c = x[triangles].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def node_normals(points: ContactPoints, triangles: IntArray) -> Array:
    """Return unit normals at the corners of triangles, means of those around; 0 elsewhere, shape (n_points, 3)."""
    normals = np.zeros(points.x.shape)
    across = triangle_normals(points.x, triangles)
    for k in range(3):
        np.add.at(normals, triangles[:, k], across)
    sizes = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.where(sizes > 0.0, sizes, 1.0))


def _sides(triangles: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the sides (n, 2) of triangles, which one each of the 3 n sides is, and how many share it."""
    ends = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    sides, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return sides, number.ravel(), count


def find_rim(triangles: IntArray) -> IntArray:
    """Return 1 for each side and each corner of triangles (n, 3) that is on the rim of their face, shape (n, 6)."""
    sides, number, count = _sides(triangles)
    on_rim = np.isin(triangles, sides[count == 1])
    return np.concatenate([(count[number] == 1).reshape(-1, 3), on_rim], axis=1).astype(np.int64)


def edge_points(x: Array, triangles: IntArray) -> IntArray:
    """Return the corners of triangles (n, 3) that are on the rim of their face or on a sharp edge of it."""
    sides, number, count = _sides(triangles)
    normals = triangle_normals(x, triangles)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    triangle = np.repeat(np.arange(len(triangles)), 3)
    order = np.argsort(number, kind="stable")
    first = np.searchsorted(number[order], np.arange(len(sides)))
    second = first + np.minimum(count, 2) - 1
    cosine = np.einsum("na,na->n", *(normals[triangle[order[at]]] for at in (first, second)))
    sharp = (count == 1) | (cosine < np.cos(np.deg2rad(SHARP_EDGE)))
    return np.unique(sides[sharp])

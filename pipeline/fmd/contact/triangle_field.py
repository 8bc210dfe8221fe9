"""Flexibility of a rigid body's surface of triangles, as of an elastic half-space near each place."""

import numpy as np

from fmd.contact.half_space import shear_modulus
from fmd.contact.surfaces import triangle_normals
from fmd.contact.touching_body import ContactPoints
from fmd.core.arrays import Array, IntArray
from fmd.core.limits.contact import MOST_POINTS


def points_of_triangles(face: str, x: Array, triangles: IntArray, E: float, nu: float) -> ContactPoints:
    """Return the points of a surface of triangles (n, 3), which are their corners (n_points, 3) [m].

    Raises
    ------
    ValueError
        There are more points than forces are found on, or triangles don't turn around the outside.
    """
    if (n := len(x)) > MOST_POINTS:
        raise ValueError(
            f"has {n} corners of triangles, of which contacts take {MOST_POINTS}; a file of the part of "
            "the surface that touches, or of larger triangles, works"
        )
    _require_outside(x, triangles)
    across, normals = triangle_normals(x, triangles), np.zeros((n, 3))
    for k in range(3):
        np.add.at(normals, triangles[:, k], across)
    areas = _areas(n, triangles, across)
    if not (areas > 0.0).all():
        raise ValueError("has corners without a triangle, or triangles without an area")
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    G = surface_flexibility(x, areas, normals, E, nu)
    try:
        np.linalg.cholesky(G.reshape(3 * n, 3 * n))
    except np.linalg.LinAlgError:
        raise ValueError(
            "has corners far nearer to one another than its triangles are large; more even ones work"
        ) from None
    return ContactPoints(
        x=x,
        areas={face: areas},
        shapes=np.zeros((n, 3, 0)),
        G=G,
        faces={face: np.arange(n)},
        surfaces={face: triangles},
        elastic=(E, nu),
    )


def _require_outside(x: Array, triangles: IntArray) -> None:
    """Refuse neighbours that turn unlike ways, and a closed surface that is inside out: bodies would pass through."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ends, number = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    turns = np.bincount(number.ravel(), np.sign(edges[:, 1] - edges[:, 0]), len(ends))
    if (np.abs(turns) > 1.0).any():
        raise ValueError(
            "has neighbouring triangles that turn unlike ways; corners go counter-clockwise seen from outside"
        )
    volume = np.linalg.det(x[triangles] - x.mean(axis=0)).sum() / 6.0
    if not turns.any() and volume < 0.0:
        raise ValueError("is inside out; corners of triangles go counter-clockwise seen from outside")


def _areas(n: int, triangles: IntArray, across: Array) -> Array:
    """Return the areas around n points, a third of each triangle's; at an edge that of the side which has most.

    Triangles of other sides count by the cosine of the angle between both, so that a smooth place has all of it.
    """
    sizes = np.linalg.norm(across, axis=1)
    normals = across / np.maximum(sizes, np.finfo(float).tiny)[:, None]
    areas = np.zeros(n)
    order = np.argsort(triangles.ravel(), kind="stable")
    ends = np.searchsorted(triangles.ravel()[order], np.arange(n + 1))
    for i in range(n):
        around = order[ends[i] : ends[i + 1]] // 3
        seen = np.maximum(0.0, normals[around] @ normals[around].T) @ sizes[around]
        areas[i] = seen.max(initial=0.0) / 6.0
    return areas


def surface_flexibility(x: Array, areas: Array, normals: Array, E: float, nu: float) -> Array:
    """Return displacements of points of an elastic body's surface by unit forces that are spread around points.

    Places x (n, 3) [m] have areas (n,) [m²] and unit normals (n, 3) around them. Returned are displacements (n, 3, n,
    3) in the axes of the places [m/N], symmetric. Apart, ``((1 − ν) I + ν r rᵀ/r²)/(2 π G r)``: on a plane that is
    Boussinesq's displacement along the normal and Cerruti's along it, without what one draws along the other, and
    surfaces may be curved (Johnson, Contact Mechanics, 1985, sections 3.2 and 3.6). It is positive definite, as its
    transform over space, ``2 (I − 2 ν k kᵀ/k²)/(G k²)``, is. At its own point a force is spread over a disk of the
    point's area.
    """
    apart = x[:, None] - x[None]
    r = np.linalg.norm(apart, axis=2)
    own = np.arange(len(x))
    r[own, own] = 0.5 * np.sqrt(areas / np.pi)  # the middle of a disk of radius a moves by 2 F (1 − ν²)/(π E a)
    G = nu * np.einsum("ija,ijb->iajb", apart, apart / r[:, :, None] ** 3)
    aside = np.eye(3) - normals[:, :, None] * normals[:, None]
    G[own, :, own] += 0.5 * nu * aside / r[own, own, None, None]  # r rᵀ/r² is half of that in the middle of a disk
    G += np.einsum("ij,ab->iajb", (1.0 - nu) / r, np.eye(3))
    return np.asarray(G / (2.0 * np.pi * shear_modulus(E, nu)))

"""Simple solids as surfaces: boxes, cylinders, balls, plates and pyramids."""

from collections.abc import Sequence

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.render.surface import Surface

_AROUND = 40  # sides of a cylinder
_RINGS = 12  # of a ball, from pole to pole
_CUBE = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]], dtype=np.int64)


def make_box(size: Array, centre: Array, axes: Array | None = None) -> Surface:
    """Return a box of three edge lengths [m] around a centre (3,) [m]; columns of ``axes`` (3, 3) are its edges."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    turned = corners if axes is None else corners @ axes.T
    return _surface(turned + centre, _fans(_CUBE))


def make_cylinder(start: Array, end: Array, radius: float) -> Surface:
    """Return a cylinder between the middles of its ends, (3,) each [m], with a radius [m]."""
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) @ axes_along(end - start).T
    k, n = np.arange(_AROUND), (np.arange(_AROUND) + 1) % _AROUND
    sides = np.stack([k, n, n + _AROUND, k + _AROUND], axis=1)
    caps = [np.stack([0 * k + 2 * _AROUND, n, k], 1), np.stack([0 * k + 2 * _AROUND + 1, k + _AROUND, n + _AROUND], 1)]
    points = np.concatenate([start + ring, end + ring, start[None], end[None]])
    return _surface(points, np.concatenate([_fans(sides), *caps]))


def make_tube(start: Array, end: Array, inside: float, outside: float) -> Surface:
    """Return a tube between the middles of its ends, (3,) each [m], with two radii [m]."""
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) @ axes_along(end - start).T
    rings = [start + outside * ring, end + outside * ring, end + inside * ring, start + inside * ring]
    k, n = np.arange(_AROUND), (np.arange(_AROUND) + 1) % _AROUND
    around = [
        np.stack([k + a * _AROUND, n + a * _AROUND, n + b * _AROUND, k + b * _AROUND], axis=1)
        for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))
    ]
    return _surface(np.concatenate(rings), _fans(np.concatenate(around)))


def make_ball(centre: Array, radius: float) -> Surface:
    """Return a ball around a centre (3,) [m] with a radius [m]."""
    polar, around = np.linspace(0, np.pi, _RINGS + 1)[1:-1], 2 * np.pi * np.arange(_AROUND) / _AROUND
    p, a = np.meshgrid(polar, around, indexing="ij")
    ring = np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1).reshape(-1, 3)
    points = centre + radius * np.concatenate([ring, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    number = np.arange(len(ring)).reshape(len(polar), _AROUND)
    beside = np.roll(number, -1, axis=1)
    sides = np.stack([number[:-1], number[1:], beside[1:], beside[:-1]], axis=-1).reshape(-1, 4)
    north, south = len(ring), len(ring) + 1
    top = np.stack([np.full(_AROUND, north), number[0], beside[0]], axis=1)
    bottom = np.stack([np.full(_AROUND, south), beside[-1], number[-1]], axis=1)
    return _surface(points, np.concatenate([_fans(sides), top, bottom]))


def make_plate(corners: Array, thickness: float) -> Surface:
    """Return a plate between the convex corners (n, 3) [m] of its middle surface, in their order, and a thickness."""
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    lift = 0.5 * thickness * normal / np.linalg.norm(normal)
    n = len(corners)
    k, after = np.arange(n), (np.arange(n) + 1) % n
    fan = np.stack([0 * k[2:], k[1:-1], k[2:]], axis=1)
    sides = np.stack([k, after, after + n, k + n], axis=1)
    return _surface(
        np.concatenate([corners - lift, corners + lift]), np.concatenate([fan[:, ::-1], fan + n, _fans(sides)])
    )


def make_pyramid(apex: Array, along: Array, height: float, width: float) -> Surface:
    """Return a pyramid whose square base of a width [m] lies at a height [m] from its apex in a direction (3,)."""
    axes = axes_along(along)
    corners = 0.5 * width * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [0, 0, height]
    base = apex + corners @ axes.T
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 1, 0], [4, 2, 1], [4, 3, 2], [4, 0, 3]])
    return _surface(np.concatenate([base, apex[None]]), triangles)


def join_surfaces(surfaces: Sequence[Surface]) -> Surface:
    """Return several surfaces as one."""
    starts = np.cumsum([0, *(len(surface.points) for surface in surfaces)])
    pairs = list(zip(surfaces, starts[:-1].tolist(), strict=True))
    return Surface(
        np.concatenate([surface.points for surface in surfaces]),
        np.concatenate([surface.triangles + start for surface, start in pairs]),
        np.concatenate([surface.edges + start for surface, start in pairs]),
    )


def axes_along(direction: Array) -> Array:
    """Return a rotation (3, 3) whose last column is the unit vector of a direction (3,)."""
    along = direction / np.linalg.norm(direction)
    other = np.eye(3)[int(np.argmin(np.abs(along)))]
    across = np.cross(other, along)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(along, across), along], axis=1)


def _fans(quads: IntArray) -> IntArray:
    """Cut quadrilaterals (n, 4) into triangles (2 n, 3)."""
    return np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])


def _surface(points: Array, triangles: IntArray) -> Surface:
    """Return a surface without outlines of elements."""
    return Surface(np.asarray(points, dtype=np.float64), triangles, np.empty((0, 2), dtype=np.int64))

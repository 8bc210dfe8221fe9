"""Near field of a curved face on a fine grid: a half-space's flexibility there, and the mesh's farther away.

Where elements are larger than a contact, forces on their nodes can't tell its pressure. A grid of rectangles on the
face can: beside each other they move as those of a half-space do, and what remains of the mesh's flexibility G, once a
half-space's is taken off, varies little over a contact. It is known from pairs of nodes that aren't too near, and so

    G_grid = H + W (G − H) Wᵀ

with H by Boussinesq and Cerruti and rows W that interpolate from nodes to the grid's points.
"""

from dataclasses import replace

import numpy as np

from fmd.contact.curved_grid import CurvedGrid, GridFrame
from fmd.contact.surface_fit import Quadric, fit_quadric
from fmd.contact.touching_body import ContactPoints
from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits import contact as limits


@dataclass(frozen=True)
class CurvedPlace:
    """Where a curved face comes nearest to a plane, and how it is curved there."""

    surface: Quadric  # the face, in its body's frame
    place: Array  # (3,): its lowest place [m]
    axes: Array  # (3, 3): normal into the body and directions of the largest and the least curvature, a row each
    curvatures: tuple[float, float]  # along these [1/m]; the first is positive, and the second 0 on a cylinder
    beside: Array  # (2, 2): least and greatest place of the face along the two directions, from the lowest place [m]
    spacing: float  # distance of the mesh's points there [m]

    @property
    def is_line(self) -> bool:
        """True if the face touches a plane along a line."""
        return self.curvatures[1] < limits.LINE_CONTACT * self.curvatures[0]

    def half_width(self, E: float, nu: float, force: float, work: float) -> float:
        """Estimate half the width of the contact under a force at rest [N] or a shock of a work [J] (Hertz)."""
        stiff, (k1, k2) = E / (1.0 - nu**2), self.curvatures
        if self.is_line:  # of the whole length; a line's approach is about half of what it is loaded by over it
            length = float(np.ptp(self.beside[1]))
            force = max(force, np.sqrt(work * stiff * length))
            return float(np.sqrt(4.0 * force / (np.pi * length * stiff * k1)))
        radius = 1.0 / np.sqrt(k1 * k2)
        approach = (15.0 / 8.0 * work / (stiff * np.sqrt(radius))) ** 0.4
        approach = max(approach, (0.75 * force / (stiff * np.sqrt(radius))) ** (2.0 / 3.0))
        return float(np.sqrt(approach / k1))


def find_curved_place(points: ContactPoints, face: str, normal: Array) -> CurvedPlace | None:
    """Return where a face comes nearest to a plane with a normal in its body's frame; ``None`` if it isn't curved."""
    x = points.x[points.faces[face]]
    surface = fit_quadric(x)
    if surface is None:
        return None
    place = surface.lowest_place(x[(x @ normal).argmin()], normal)
    across = np.linalg.svd(normal[None])[2][1:]
    bends = -2.0 * across @ surface.A @ across.T / float(normal @ surface.gradients(place[None])[0])
    curvatures, turned = np.linalg.eigh(bends)
    tangents = turned.T[::-1] @ across
    tangents[1] *= np.sign(np.linalg.det(np.vstack([normal, tangents])))
    beside = (x - place) @ tangents.T
    ends = np.stack([beside.min(axis=0), beside.max(axis=0)], axis=1)
    if (
        not curvatures[1] * np.ptp(x, axis=0).max() > limits.LEAST_CURVED
        or curvatures[0] < -limits.LINE_CONTACT * curvatures[1]
    ):
        return None
    if (ends[:, 0] > 0.0).any() or (ends[:, 1] < 0.0).any():
        return None  # it touches with a border
    near = np.argsort(np.linalg.norm(x - place, axis=1))[:6]
    spacing = float(np.sqrt(points.areas[face][near].mean()))
    return CurvedPlace(
        surface,
        place,
        np.vstack([normal, tangents]),
        (float(curvatures[1]), max(0.0, float(curvatures[0]))),
        ends,
        spacing,
    )


def with_near_field(
    points: ContactPoints, face: str, at: CurvedPlace, half_width: float, count: int, travels: bool
) -> ContactPoints:
    """Return a body's points with a grid of about ``count`` points in place of a face's.

    Half of its width along the larger curvature is ``half_width`` [m]. One that ``travels`` follows a march's contact.

    Raises
    ------
    ValueError
        The mesh without a half-space is stiffer than a half-space is soft: its modes have the near field.
    """
    cells, cell, first, edge, free = _grid(at, half_width, count)
    others = _used_by_others(points, face)
    start, goes = GridFrame(at.place, at.axes), (travels and free[0], travels and free[1] and not at.is_line)
    nodes, size = points.faces[face], (at.curvatures, at.spacing)
    grid = CurvedGrid(points, nodes, at.surface, *size, start, cells, cell, first, edge, goes)
    x = grid.places(start, cells)
    weights, n, m = grid.weights(x), len(x), len(others)
    own = grid.flexibility(cells, weights, at.axes).transpose(0, 2, 1, 3)
    beside = np.einsum("ip,pajb->iajb", weights[:, nodes], points.G[nodes][:, :, others])
    try:
        np.linalg.cholesky(own.reshape(3 * n, 3 * n))
    except np.linalg.LinAlgError:
        raise ValueError(
            f"{face}: the modes have so much of the deflection near a contact that a half-space's can't be added; "
            "near_field = 'mesh' or fewer modes work"
        ) from None
    G = np.empty((m + n, 3, m + n, 3))
    G[:m, :, :m], G[m:, :, m:], G[m:, :, :m] = points.G[others][:, :, others], own, beside
    G[:m, :, m:] = beside.transpose(2, 3, 0, 1)
    moved = np.zeros((m + n, len(points.x)))  # how points move by those of the mesh
    moved[np.arange(m), others] = 1.0
    moved[m:] = weights
    areas = {name: own for name, own in points.areas.items() if name != face}
    faces = {name: np.searchsorted(others, points.faces[name]) for name in areas}
    return replace(
        points,
        x=np.concatenate([points.x[others], x]),
        areas=areas | {face: np.full(n, cell[0] * cell[1])},
        shapes=np.einsum("ip,pam->iam", moved, points.shapes),
        G=G,
        faces=faces | {face: np.arange(m, m + n)},
        surfaces={name: np.searchsorted(others, own) for name, own in points.surfaces.items()},
        border=np.concatenate([points.border[others], edge]),
        weights=moved if points.weights is None else moved @ points.weights,
        grids={**points.grids, face: grid},
        yields={name: np.einsum("ip,pak->iak", moved, own) for name, own in points.yields.items()},
        radii=np.zeros(m + n),
        shares=np.ones(m + n),
    )


def _used_by_others(points: ContactPoints, face: str) -> IntArray:
    """Return the points that other faces have, or triangles."""
    used = [own for name, own in points.faces.items() if name != face]
    used += [own.ravel() for own in points.surfaces.values()]
    return np.unique(np.concatenate([*used, np.zeros(0, dtype=np.int64)]))


def _grid(
    at: CurvedPlace, half_width: float, count: int
) -> tuple[IntArray, tuple[float, float], Array, BoolArray, tuple[bool, bool]]:
    """Return rectangles about the lowest place by their places in a lattice (n, 2), and where that stands.

    That are its sides and its first middle [m], which rectangles are at the grid's border, and along which directions
    the face goes on. The grid has the ellipse of Hertz's contact, whose axes are about as the curvatures to the power
    of -2/3, and ends where the face does.
    """
    ratio = np.inf if at.is_line else (at.curvatures[0] / at.curvatures[1]) ** (2.0 / 3.0)
    half = np.array([half_width, half_width * ratio])
    low, high = np.maximum(-half, at.beside[:, 0]), np.minimum(half, at.beside[:, 1])
    free = (low == -half) & (high == half)
    n = int(np.sqrt(count * (4.0 / np.pi if free.all() else 1.0)))
    side = (high - low) / n
    cells = np.stack(np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), axis=-1).reshape(-1, 2)
    places = low + (cells + 0.5) * side
    if free.all():
        inside = ((places / half) ** 2).sum(axis=1) <= 1.0
        cells, places = cells[inside], places[inside]
        outer = (((np.abs(places) + side) / half) ** 2).sum(axis=1) > 1.0
    else:
        below = (places < low + side) & (low == -half)
        outer = (below | ((places > high - side) & (high == half))).any(axis=1)
    first = low + 0.5 * side
    return cells, (float(side[0]), float(side[1])), first, np.asarray(outer), (bool(free[0]), bool(free[1]))

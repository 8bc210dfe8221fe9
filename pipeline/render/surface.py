"""The visible surface of a part, and what follows from its topology alone: where light and outlines break."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from pipeline.core.arrays import Array, IntArray, read_only, require_shape

CREASE = np.cos(np.radians(35.0))  # faces that meet at more than this angle keep a sharp edge


@dataclass(frozen=True, slots=True)
class Surface:
    """The visible surface of a part.

    Attributes
    ----------
    points : ndarray, shape (n_points, 3)
        Undeformed positions [m].
    triangles : ndarray, shape (n_triangles, 3)
        Positions in ``points``, counter-clockwise seen from outside.
    edges : ndarray, shape (n_edges, 2)
        Positions in ``points``: the sides of triangles that outline elements.
    """

    points: Array
    triangles: IntArray
    edges: IntArray

    def __post_init__(self) -> None:
        require_shape("points", self.points, (None, 3))
        require_shape("triangles", self.triangles, (None, 3))
        require_shape("edges", self.edges, (None, 2))
        for name, corners in (("triangles", self.triangles), ("edges", self.edges)):
            if corners.size and not 0 <= corners.min() <= corners.max() < len(self.points):
                raise ValueError(f"{name} name points beyond the {len(self.points)} that there are")
        for array in (self.points, self.triangles, self.edges):
            read_only(array)

    @property
    def cell(self) -> float:
        """How far element outlines are apart on average: the side of squares with as much outline per area [m]."""
        length = np.linalg.norm(self.points[self.edges[:, 1]] - self.points[self.edges[:, 0]], axis=1).sum()
        area = 0.5 * np.linalg.norm(doubled_areas(self.points, self.triangles), axis=1).sum()
        return float(2 * area / length) if length > 0 else 0.0


@dataclass(frozen=True, slots=True)
class Skin:
    """A surface's topology, made once and used for every position of its points.

    Attributes
    ----------
    source : ndarray, shape (n_drawn,)
        The surface's point that each drawn point lies at: one at a sharp edge is drawn once for each side of it.
    triangles : ndarray, shape (n_triangles, 3)
        Positions among the drawn points.
    share : sparse array, shape (n_drawn, n_triangles)
        One where a triangle takes part in a drawn point's normal.
    sides : ndarray, shape (n_sides, 2)
        The points of the surface that each side of a triangle joins, once each.
    between : ndarray, shape (n_sides, 2)
        The triangles that meet at each side, the same one twice at a border.
    is_sharp, is_outline : ndarray of bool, shape (n_sides,)
        Whether the surface has a crease or a border there; whether it is an outline of elements.
    """

    source: IntArray
    triangles: IntArray
    share: csr_array
    sides: IntArray
    between: IntArray
    is_sharp: NDArray[np.bool_]
    is_outline: NDArray[np.bool_]

    def normals(self, areas: Array) -> Array:
        """Return unit normals at the drawn points, shape (n_drawn, 3), from ``doubled_areas`` of the triangles."""
        sums = np.asarray(self.share @ areas)
        return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300))

    def element_lines(self, areas: Array, towards: Array) -> IntArray:
        """Return the outlines of elements, shape (any, 2), that do not look away from a viewer."""
        front = (areas @ towards > 0)[self.between]
        return np.asarray(self.sides[self.is_outline & front.any(axis=1)])

    def form_lines(self, areas: Array, towards: Array) -> IntArray:
        """Return the lines that show a form, shape (any, 2): creases, borders, and the rim that a viewer sees."""
        front = (areas @ towards > 0)[self.between]
        return np.asarray(self.sides[(self.is_sharp & front.any(axis=1)) | (front[:, 0] != front[:, 1])])


def doubled_areas(points: Array, triangles: IntArray) -> Array:
    """Return normals of the triangles, shape (n_triangles, 3), twice as long as the areas are large [m²]."""
    a, b, c = (np.take(points, corner, axis=0) for corner in triangles.T)
    return np.asarray(np.cross(b - a, c - a))


def skin_of(surface: Surface) -> Skin:
    """Find a surface's creases and the points that are drawn apart for them.

    Raises
    ------
    ValueError
        An edge is not a side of any triangle.
    """
    triangles, n_triangles = surface.triangles, len(surface.triangles)
    # Corner 3 t + k is the k-th of triangle t; half-side 3 t + k runs from it to the next corner.
    corners = triangles.ravel()
    following = np.roll(triangles, -1, axis=1).ravel()
    ends = np.sort(np.stack([corners, following], axis=1), axis=1)
    key = ends[:, 0] * len(surface.points) + ends[:, 1]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(np.append(starts, len(key)))
    one, other = order[starts], order[starts + (count > 1)]
    areas = doubled_areas(surface.points, triangles)
    unit = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    smooth = (count == 2) & (np.einsum("si,si->s", unit[one // 3], unit[other // 3]) > CREASE)
    # Two corners share a drawn point if smooth sides lead from the one's triangle to the other's around it. Neighbours
    # run along their common side in opposite ways.
    step_one, step_other = (3 * (half // 3) + (half + 1) % 3 for half in (one, other))
    joined = np.concatenate([np.stack([one, step_other]), np.stack([step_one, other])], axis=1)
    joined = joined[:, np.tile(smooth, 2) & (corners[joined[0]] == corners[joined[1]])]
    graph = coo_array((np.ones(joined.shape[1], dtype=np.int8), (joined[0], joined[1])), shape=(len(key),) * 2)
    n_drawn, drawn = connected_components(graph, directed=False)
    source = np.empty(n_drawn, dtype=np.int64)
    source[drawn] = corners
    share = csr_array((np.ones(len(key)), (drawn, np.arange(len(key)) // 3)), shape=(n_drawn, n_triangles))
    wanted = np.sort(surface.edges, axis=1) @ np.array([len(surface.points), 1])
    is_outline = np.isin(key[one], wanted)
    if np.count_nonzero(is_outline) != len(np.unique(wanted)):
        raise ValueError("edges must be sides of triangles, some are not")
    return Skin(
        source,
        drawn.reshape(-1, 3).astype(np.int64),
        share,
        ends[one],
        np.stack([one // 3, other // 3], axis=1),
        ~smooth,
        is_outline,
    )

"""The visible surface of a part, its creases and the lines that show its form."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from fmd.core.arrays import Array, IntArray, read_only, require_shape
from fmd.core.data_classes import dataclass

CREASE = np.cos(np.radians(35.0))  # faces that meet at more than this angle keep a sharp edge


@dataclass(frozen=True, slots=True)
class Surface:
    """The visible surface of a part as triangles with the outlines of its elements."""

    points: Array  # (n_points, 3): undeformed positions [m]
    triangles: IntArray  # (n_triangles, 3): positions in ``points``, counter-clockwise seen from outside
    edges: IntArray  # (n_edges, 2): positions in ``points``: the sides of triangles that outline elements

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
    def outline_spacing(self) -> float:
        """Average distance of element outlines: the side of squares with as much outline per area [m]."""
        length = np.linalg.norm(self.points[self.edges[:, 1]] - self.points[self.edges[:, 0]], axis=1).sum()
        area = 0.5 * np.linalg.norm(area_normals(self.points, self.triangles), axis=1).sum()
        return float(2 * area / length) if length > 0 else 0.0


@dataclass(frozen=True, slots=True)
class Skin:
    """Topology of a drawn surface, built once and used for every position of its points."""

    # (n_drawn,): the surface's point of each drawn point: a point on a sharp edge is drawn once for each side of it
    source: IntArray
    triangles: IntArray  # (n_triangles, 3): positions among the drawn points
    share: csr_array  # (n_drawn, n_triangles): 1 where a triangle takes part in a drawn point's normal
    sides: IntArray  # (n_sides, 2): ends of the triangles' sides, points of the surface; each side once
    between: IntArray  # (n_sides, 2): triangles that meet at each side; at a border one triangle twice
    is_sharp: NDArray[np.bool_]  # (n_sides,): true for sides at a crease or a border
    is_outline: NDArray[np.bool_]  # (n_sides,): true for sides that outline elements

    def normals(self, normals: Array) -> Array:
        """Return unit normals at the drawn points, shape (n_drawn, 3), from the triangles' `area_normals`."""
        sums = np.asarray(self.share @ normals)
        return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300))

    def element_lines(self, normals: Array, towards: Array) -> IntArray:
        """Return the outlines of elements, shape (any, 2), on the side of the viewer in direction ``towards``."""
        front = (normals @ towards > 0)[self.between]
        return np.asarray(self.sides[self.is_outline & front.any(axis=1)])

    def form_lines(self, normals: Array, towards: Array) -> IntArray:
        """Return the lines of the form, shape (any, 2): creases, borders, and the silhouette to a viewer."""
        front = (normals @ towards > 0)[self.between]
        return np.asarray(self.sides[(self.is_sharp & front.any(axis=1)) | (front[:, 0] != front[:, 1])])


def area_normals(points: Array, triangles: IntArray) -> Array:
    """Return the triangles' normals, shape (n_triangles, 3), each of twice the triangle's area [m²]."""
    a, b, c = (np.take(points, corner, axis=0) for corner in triangles.T)
    return np.asarray(np.cross(b - a, c - a))


def build_skin(surface: Surface) -> Skin:
    """Find a surface's creases and duplicate the points on them.

    Raises
    ------
    ValueError
        An edge is not a side of any triangle.
    """
    corners = surface.triangles.ravel()
    key, one, other, count = _pair_half_sides(surface)
    normals = area_normals(surface.points, surface.triangles)
    unit = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    smooth = (count == 2) & (np.einsum("si,si->s", unit[one // 3], unit[other // 3]) > CREASE)
    # Two corners share a drawn point if smooth sides lead from one triangle to the other around it. Neighbours run
    # along their common side in opposite directions.
    step_one, step_other = (3 * (half // 3) + (half + 1) % 3 for half in (one, other))
    joined = np.concatenate([np.stack([one, step_other]), np.stack([step_one, other])], axis=1)
    joined = joined[:, np.tile(smooth, 2) & (corners[joined[0]] == corners[joined[1]])]
    graph = coo_array((np.ones(joined.shape[1], dtype=np.int8), (joined[0], joined[1])), shape=(len(corners),) * 2)
    n_drawn, drawn = connected_components(graph, directed=False)
    source = np.empty(n_drawn, dtype=np.int64)
    source[drawn] = corners
    triangle = np.arange(len(corners)) // 3
    outlines = np.sort(surface.edges, axis=1) @ np.array([len(surface.points), 1])
    is_outline = np.isin(key[one], outlines)
    if np.count_nonzero(is_outline) != len(np.unique(outlines)):
        raise ValueError("edges must be sides of triangles, some are not")
    return Skin(
        source,
        drawn.reshape(-1, 3).astype(np.int64),
        csr_array((np.ones(len(corners)), (drawn, triangle)), shape=(n_drawn, len(surface.triangles))),
        np.stack(np.divmod(key[one], len(surface.points)), axis=1),
        np.stack([one // 3, other // 3], axis=1),
        ~smooth,
        is_outline,
    )


def _pair_half_sides(surface: Surface) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Pair the half-sides of neighbouring triangles; half-side 3 t + k starts at the k-th corner of triangle t.

    Returns the number of each half-side's pair of points, (3 n_triangles,), alike for both directions; both half-sides
    of each side, (n_sides,), at a border one twice; and how many triangles meet there.
    """
    ends = np.stack([surface.triangles.ravel(), np.roll(surface.triangles, -1, axis=1).ravel()], axis=1)
    ends.sort(axis=1)
    key = ends[:, 0] * len(surface.points) + ends[:, 1]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(np.append(starts, len(key)))
    return key, order[starts], order[starts + (count > 1)], count

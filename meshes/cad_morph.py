"""Nodes of a CAD part's mesh carried along as its dimensions change, so that its elements stay the same."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmd.meshes.cad_child import CadError

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

_LEAST_SHARE = 0.1  # of an element's volume at each of its nodes that a change may leave of it
# Ends of the edges that a tetrahedron's further nodes are in the middle of, in VTK's order.
_EDGES = np.array([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)])


class Topology:
    """Entities of Gmsh's current model and how they join, by which two models are alike."""

    def __init__(self, gmsh: Any) -> None:
        self.kinds = {entity: gmsh.model.getType(*entity) for entity in gmsh.model.getEntities()}
        self.joined = {entity: [list(x) for x in gmsh.model.getAdjacencies(*entity)] for entity in self.kinds}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Topology) and (self.kinds, self.joined) == (other.kinds, other.joined)

    __hash__ = None  # type: ignore[assignment]

    def __str__(self) -> str:
        counts = [sum(dimension == each for dimension, _ in self.kinds) for each in (3, 2, 1)]
        return "{} solids, {} surfaces and {} curves".format(*counts)


def carry_nodes(gmsh: Any, first: str, changed: str, points: Floats, cells: Numbers, place: Numbers) -> Floats:
    """Return where nodes of a part's mesh lie on the same part with other dimensions.

    Those on a curve keep their share of the way along it. Those of a surface move by what is harmonic between its
    curves, and then to the nearest point on it; those inside by what is harmonic between surfaces (Löhner & Yang,
    Communications in Numerical Methods in Engineering 12, 1996). A part that is stretched has a mesh that is stretched
    so, too. Nodes in the middle of an edge move by the mean of its ends first.

    Gmsh has both models, by their names, ``first`` that with the mesh: points (n_points, 3) and tetrahedra in VTK's
    order (n_cells, 4 or 10); ``place`` has the number of the point of each of Gmsh's nodes.

    Raises
    ------
    CadError
        The part has other faces or edges than at first, or elements would be turned or flattened.
    """
    topologies = []
    for name in (first, changed):
        gmsh.model.setCurrent(name)
        topologies.append(Topology(gmsh))
    before, after = topologies
    if before != after:
        raise CadError(
            f"nodes of the mesh made at first can't be carried to other dimensions: the part had {before}, and has "
            f"{after} or others"
        )
    move, known = np.zeros_like(points), np.zeros(len(points), dtype=bool)
    ends = np.full((len(points), 2), -1)
    if cells.shape[1] > 4:
        ends[cells[:, 4:]] = cells[:, _EDGES]
    for dimension, tag in before.kinds:
        gmsh.model.setCurrent(first)
        own = place[gmsh.model.mesh.getNodes(dimension, tag)[0]]
        if not len(own) or dimension == 3:
            continue
        if dimension == 2:
            types, _, nodes = gmsh.model.mesh.getElements(2, tag)
            triangles = place[nodes[0]].reshape(-1, {2: 3, 9: 6}[int(types[0])])[:, :3]
            _extend(points, triangles, move, known, ends, own)
            move[own] = _onto_surface(gmsh, (first, changed), tag, points[own], move[own])
        else:
            ways = _along_curve if dimension == 1 else _at_point
            old, new = ways(gmsh, (first, changed), tag, points[own])
            move[own] = new - old
        known[own] = True
    _extend(points, cells[:, :4], move, known, ends, np.arange(len(points)))
    moved = points + move
    _require_sound(points, moved, cells)
    return moved


def _at_point(gmsh: Any, models: Iterable[str], tag: int, _: Floats) -> list[Floats]:
    """Return the places of a point of the geometry in both models, shape (1, 3)."""
    found = []
    for name in models:
        gmsh.model.setCurrent(name)
        found.append(np.array(gmsh.model.getValue(0, tag, [])).reshape(1, 3))
    return found


def _along_curve(gmsh: Any, models: Iterable[str], tag: int, x: Floats) -> list[Floats]:
    """Return points of a curve in both models that have the same shares of its way as given ones in the first."""
    found: list[Floats] = []
    share = begin = None
    for name in models:
        gmsh.model.setCurrent(name)
        (low,), (high,) = gmsh.model.getParametrizationBounds(1, tag)
        at_low = np.array(gmsh.model.getValue(1, tag, [low]))
        rims = [gmsh.model.getValue(0, end, []) for end in sorted(gmsh.model.getAdjacencies(1, tag)[1])]
        nearest = int(np.argmin([np.linalg.norm(at_low - rim) for rim in rims])) if rims else 0
        if share is None:
            share, begin = (gmsh.model.getParametrization(1, tag, x.ravel()) - low) / (high - low), nearest
        own = share if nearest == begin else 1.0 - share
        found.append(np.array(gmsh.model.getValue(1, tag, low + own * (high - low))).reshape(-1, 3))
    return found


def _onto_surface(gmsh: Any, models: tuple[str, str], tag: int, x: Floats, move: Floats) -> Floats:
    """Return moves of points of a surface that end on it in the second model."""
    gmsh.model.setCurrent(models[0])
    old = np.array(gmsh.model.getClosestPoint(2, tag, x.ravel())[0]).reshape(-1, 3)
    gmsh.model.setCurrent(models[1])
    new = np.array(gmsh.model.getClosestPoint(2, tag, (old + move).ravel())[0]).reshape(-1, 3)
    return np.asarray(new - old)


def _extend(
    points: Floats, simplices: Numbers, move: Floats, known: NDArray[np.bool_], ends: Numbers, own: Numbers
) -> None:
    """Set the moves of those of some nodes that aren't known yet, harmonic between those that are."""
    nodes, number = np.unique(simplices, return_inverse=True)
    free = ~known[nodes]
    if free.any() and not free.all():
        from scipy.sparse.linalg import spsolve  # loaded where it is used: most children of Gmsh need none of SciPy

        K = _laplacian(points[nodes], number.reshape(simplices.shape))
        inner = K[free]
        inside = spsolve(inner[:, free].tocsc(), -inner[:, ~free] @ move[nodes[~free]])
        move[nodes[free]] = inside.reshape(-1, 3)
    middles = own[(ends[own, 0] >= 0) & ~known[own]]
    move[middles] = move[ends[middles]].mean(axis=1)


def _laplacian(x: Floats, simplices: Numbers) -> Any:
    """Return the conductivity of linear triangles or tetrahedra in space, times a constant."""
    from scipy.sparse import csr_array

    edges = x[simplices[:, 1:]] - x[simplices[:, :1]]
    metric = edges @ edges.transpose(0, 2, 1)
    reference = np.vstack([-np.ones(edges.shape[1]), np.eye(edges.shape[1])])
    K = reference @ np.linalg.solve(metric, np.broadcast_to(reference.T, (len(edges), *reference.T.shape)))
    K = np.sqrt(np.linalg.det(metric))[:, None, None] * K
    n = simplices.shape[1]
    rows, columns = np.repeat(simplices, n, axis=1).ravel(), np.tile(simplices, (1, n)).ravel()
    return csr_array((K.ravel(), (rows, columns)), shape=(len(x), len(x)))


def _require_sound(points: Floats, moved: Floats, cells: Numbers) -> None:
    """Raise ``CadError`` if an element's volume about one of its nodes is turned or nearly lost."""
    before, after = (_volumes(x, cells) for x in (points, moved))
    sound = before > 0.0
    share = (after[sound] / before[sound]).min(initial=np.inf)
    if not share >= _LEAST_SHARE:
        far = np.linalg.norm(moved - points, axis=1).max()
        raise CadError(
            f"nodes of the mesh made at first, carried by up to {far:.3g} of the file's unit, leave an element "
            f"{share:.2g} times its volume, where {_LEAST_SHARE:g} are the least: make the mesh at values between"
        )


def _volumes(x: Floats, cells: Numbers) -> Floats:
    """Return the determinants of the Jacobian at the nodes of tetrahedra, shape (n_cells, n_nodes)."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    at = corners if cells.shape[1] == 4 else np.vstack([corners, corners[_EDGES].mean(axis=1)])
    slope = np.vstack([-np.ones(3), np.eye(3)])  # of the barycentric coordinates, (4, 3)
    if cells.shape[1] == 4:
        slopes = np.broadcast_to(slope, (4, 4, 3))
    else:
        L = np.column_stack([1.0 - at.sum(axis=1), at])  # (10, 4)
        at_corners = (4.0 * L - 1.0)[:, :, None] * slope
        i, j = _EDGES.T
        at_edges = 4.0 * (L[:, i, None] * slope[j] + L[:, j, None] * slope[i])
        slopes = np.concatenate([at_corners, at_edges], axis=1)
    return np.asarray(np.linalg.det(np.einsum("pna,cnk->cpak", slopes, x[cells])))

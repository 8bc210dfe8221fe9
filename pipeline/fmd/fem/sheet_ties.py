"""Ties of shells without common nodes: an edge that moves and turns with a shell, and faces glued together.

An edge lies on the edge of another shell, on its face, or beside it. At each of its points the other moves by
``u = Σ N_J u_J + w n + θ × r`` with ``θ = Σ N_J θ_J``: r is the arm from its midsurface, n its normal, and w what the
rotations at the ends of its sides add to a deflection (linked interpolation), so that constant bending is exact. Edges
follow by ``∫ ψ (u − u_onto) ds = 0`` over what both have in common, with dual functions ψ, rotations alike: constant
forces and moments pass from one mesh to the other exactly.

Faces that lie against each other follow as those of solids do (`fem.mortar`), and turn freely.

References
----------
Zienkiewicz, Xu, Zeng, Samuelsson & Wiberg, Linked interpolation for Reissner–Mindlin plate elements, International
Journal for Numerical Methods in Engineering 36, 1993.
"""

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from fmd.core.arrays import EPSILON, Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import ON_A_LINE, TIE_COVERED, TIE_PLACES, TIE_WITHIN
from fmd.core.limits.round_off import SOLVED
from fmd.core.rotations import rigid_motions
from fmd.fem.arms import Arms
from fmd.fem.connections import TiedFaces
from fmd.fem.constraints import rows_of
from fmd.fem.mesh import rows_among, three_corners
from fmd.fem.model import FEModel
from fmd.fem.mortar import bilinear_places
from fmd.fem.node_turns import node_turns
from fmd.fem.space import Member


@dataclass(frozen=True)
class ShellNodes:
    """The shells of a model, by their nodes from 0."""

    fe: FEModel
    member: Member

    @cached_property
    def directors(self) -> Arms:
        """The points at both faces, which turn with the nodes."""
        assert self.fe.directors is not None
        return self.fe.directors

    @cached_property
    def cells(self) -> IntArray:
        """Nodes around each element, shape (n_cells, 3 or 4)."""
        mesh = self.member.space.mesh
        assert mesh.midsurface is not None
        return np.asarray(mesh.midsurface.owner[mesh.cells[:, : mesh.cells.shape[1] // 2]])

    @cached_property
    def x(self) -> Array:
        """Positions of the nodes, shape (n_nodes, 3) [m]."""
        assert self.member.space.mesh.midsurface is not None
        return self.member.space.mesh.midsurface.nodes

    @cached_property
    def normals(self) -> Array:
        """Unit normals of the elements, shape (n_cells, 3)."""
        corners = self.x[self.cells]
        found = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))

    @cached_property
    def thickness(self) -> Array:
        """Mean thickness of each element, shape (n_cells,) [m]."""
        lower, upper = np.split(self.member.space.mesh.points[self.member.space.mesh.cells], 2, axis=1)
        return np.asarray(np.linalg.norm(upper - lower, axis=2).mean(axis=1))

    def rows(self, nodes: IntArray) -> IntArray:
        """Return the rows of nodes' displacements in T, shape (3 n,)."""
        first = self.member.first + len(self.member.space.x)
        return rows_of(first + nodes)

    def whole(self, face: IntArray) -> IntArray:
        """Return the elements all of whose nodes are on a face, given by nodes (n,) or by corners of elements."""
        if face.ndim == 1:
            return np.flatnonzero(np.isin(self.cells, face).all(axis=1))
        return np.flatnonzero(rows_among(three_corners(self.cells), three_corners(face)))

    def sides(self, nodes: IntArray) -> tuple[IntArray, IntArray]:
        """Return the ends (n, 2) of sides of elements between some nodes, each once, and the element of each."""
        ends = np.stack([self.cells, np.roll(self.cells, -1, axis=1)], axis=2).reshape(-1, 2)
        own = np.flatnonzero(np.isin(ends, nodes).all(axis=1))
        found, first = np.unique(np.sort(ends[own], axis=1), axis=0, return_index=True)
        return found, own[first] // self.cells.shape[1]


def follow_edge(sheet: ShellNodes, given: TiedFaces) -> tuple[IntArray, IntArray, sp.csr_array, float]:
    """Let the edges between the nodes of a face follow the shells of another.

    Returns the unknowns (n,) that follow, those (m,) that they follow, the weights (n, m), and which share of the edges
    has others beside it.

    Raises
    ------
    ValueError
        No side of a shell is on a face, or they are too far apart; the message says how far.
    """
    sides, owner = sheet.sides(np.unique(given.face))
    carriers = sheet.whole(given.onto)
    if not np.isin(given.onto, sheet.cells[carriers]).all():  # an edge, of which a corner may be a whole triangle
        carriers = np.union1d(carriers, sheet.sides(np.unique(given.onto))[1])
    for name, found in (("first", sides), ("second", carriers)):
        if not len(found):
            raise ValueError(f"{given.label}: no side of a shell is on the {name} face")
    at = _common_points(sheet, sides, owner, carriers, given)
    nodes, dual = _dual_weights(at, sides, sheet.x)
    cells = sheet.cells[carriers]
    onto = np.unique(cells[at.carrier])
    N, rise = _carried(sheet, at, cells, carriers, onto)
    D = sp.csr_array(dual @ N)
    D3, dual3 = (sp.csr_array(sp.kron(each, sp.eye_array(3))) for each in (D, dual))
    own_rise = _own_rise(sheet, at, sides, owner, nodes)
    lifted = sp.csr_array(dual3 @ (rise - own_rise @ D3))
    U, turn = sheet.fe.point_map[sheet.rows(onto)], node_turns(sheet.fe.point_map, sheet.directors, sheet.member, onto)
    motions = sp.csr_array(sp.vstack([D3 @ U + lifted @ turn, D3 @ turn]))
    unknowns, by_motion = _unknowns_of(sheet, nodes, given.label)
    weights = sp.csr_array(by_motion @ motions)
    others = np.unique(weights.indices)
    ends = sheet.x[sides]
    share = float(at.weights.sum() / np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())
    return unknowns, others, sp.csr_array(weights[:, others]), share


@dataclass(frozen=True)
class _Points:
    """Points of integration along sides, and the places of carriers that they are nearest to."""

    side: IntArray  # (n,): numbers of the sides
    along: Array  # (n,): share of the side's length
    weights: Array  # (n,): length of each point [m]
    x: Array  # (n, 3): positions [m]
    carrier: IntArray  # (n,): numbers of the carriers
    places: Array  # (n, 2): coordinates in the carrier, 0 to 1


def _common_points(
    sheet: ShellNodes, sides: IntArray, owner: IntArray, carriers: IntArray, given: TiedFaces
) -> _Points:
    """Integrate along what sides have in common with carriers, between the borders of these."""
    corners = sheet.x[sheet.cells[carriers]]
    middles, ends = corners.mean(axis=1), sheet.x[sides]
    first = corners[:, 1] - corners[:, 0]
    first = first - np.einsum("ni,ni->n", first, sheet.normals[carriers])[:, None] * sheet.normals[carriers]
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    frames = np.stack([first, np.cross(sheet.normals[carriers], first)], axis=2)  # (n, 3, 2)
    reach = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    half = sheet.thickness[carriers] / 2
    near = np.maximum(TIE_WITHIN * reach, half) if given.within is None else half + given.within
    bridged = near.max() + sheet.thickness[owner].max() / 2
    candidates = cKDTree(middles).query_ball_point(ends.mean(axis=1), lengths / 2 + reach.max() + bridged)
    s, w = np.polynomial.legendre.leggauss(TIE_PLACES)
    found, away = list[tuple[Array, ...]](), np.inf
    for k, chosen in enumerate(map(np.array, candidates)):
        if not len(chosen):
            continue
        flat = np.einsum("nci,nij->ncj", corners[chosen] - middles[chosen, None], frames[chosen])
        breaks = _breaks(flat, np.einsum("nci,nij->ncj", ends[k] - middles[chosen, None], frames[chosen]))
        along = (breaks[:-1, None] + 0.5 * (1 + s) * np.diff(breaks)[:, None]).ravel()
        x = ends[k, 0] + along[:, None] * (ends[k, 1] - ends[k, 0])
        there = np.einsum("pni,nij->pnj", x[:, None] - middles[chosen], frames[chosen])
        places = _within(np.tile(flat, (len(x), 1, 1)), there.reshape(-1, 2)).reshape(len(x), len(chosen), 2)
        hit = np.einsum("pnc,nci->pni", _shape_values(places, flat.shape[1]), corners[chosen])
        gaps = np.linalg.norm(hit - x[:, None], axis=2)
        best = gaps.argmin(axis=1)
        rows = np.arange(len(x))
        limit = near[chosen[best]] + sheet.thickness[owner[k]] / 2
        kept = gaps[rows, best] <= limit * (1 + SOLVED)
        away = min(away, float(gaps.min()))
        size = (0.5 * w * np.diff(breaks)[:, None]).ravel() * lengths[k]
        found.append(
            (np.full(len(x), k)[kept], along[kept], size[kept], x[kept], chosen[best][kept], places[rows, best][kept])
        )
    if not sum(len(each[0]) for each in found):
        away = min(
            away, float(cKDTree(sheet.x[np.unique(sheet.cells[carriers])]).query(sheet.x[np.unique(sides)])[0].min())
        )
        raise ValueError(far_apart(given.label, away))
    return _Points(*(np.concatenate(each) for each in zip(*found, strict=True)))


def far_apart(label: str, away: float) -> str:
    """Return the message for faces that are too far apart [m] for a tie."""
    return (
        f"{label}: its faces don't lie against each other; they come as near as {away:.3g} m. "
        "Give the distance that it may bridge (mesh.tie.within, or POSITION TOLERANCE of the deck)"
    )


def moved_already(label: str) -> str:
    """Return the message for nodes that can't follow a tie, too."""
    return f"{label}: nodes of its first face are moved by other elements or ties already; swap its faces"


def _breaks(polygons: Array, ends: Array) -> Array:
    """Return where lines (n, 2, 2) cross the sides of polygons (n, k, 2), as shares of their length, with 0 and 1."""
    sides = np.roll(polygons, -1, axis=1) - polygons
    off = ends[:, :, None] - polygons[:, None]
    left = sides[:, None, :, 0] * off[..., 1] - sides[:, None, :, 1] * off[..., 0]  # (n, 2, k)
    size = np.abs(left).max()
    across = np.abs(left[:, 0] - left[:, 1]) > SOLVED * size
    share = np.where(across, left[:, 0] / np.where(across, left[:, 0] - left[:, 1], 1.0), -1.0)
    inside = left[:, 0, None] + share[..., None] * (left[:, 1] - left[:, 0])[:, None] >= -SOLVED * size
    found = share[inside.all(axis=2) & (share > SOLVED) & (share < 1 - SOLVED)]
    ordered = np.sort(np.concatenate([[0.0], found, [1.0]]))
    return np.asarray(ordered[np.append(True, np.diff(ordered) > SOLVED)])


def _within(polygons: Array, points: Array) -> Array:
    """Return coordinates (n, 2) of the places in triangles or quadrilaterals (n, k, 2) that are near to points."""
    size = np.ptp(polygons, axis=1)
    low, high = polygons.min(axis=1) - 0.5 * size, polygons.max(axis=1) + 0.5 * size
    places = np.clip(bilinear_places(polygons, np.clip(points, low, high)), 0.0, 1.0)
    if polygons.shape[1] == 3:
        places /= np.maximum(places.sum(axis=1, keepdims=True), 1.0)
    return np.asarray(places)


def _shape_values(places: Array, n_corners: int) -> Array:
    """Return the functions of the corners at places (…, 2), shape (…, 3 or 4)."""
    s, t = np.moveaxis(places, -1, 0)
    each = (1 - s - t, s, t) if n_corners == 3 else ((1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t)
    return np.stack(each, axis=-1)


def _dual_weights(at: _Points, sides: IntArray, x: Array) -> tuple[IntArray, sp.csr_array]:
    """Return the nodes that follow, and the weights (n_nodes, n_points) by which fields at the points are theirs."""
    n = len(sides)
    N = np.stack([1 - at.along, at.along], axis=1)
    products = np.zeros((n, 2, 2))
    np.add.at(products, at.side, at.weights[:, None, None] * N[:, :, None] * N[:, None])
    integrals = products.sum(axis=2)
    lengths = np.linalg.norm(x[sides[:, 1]] - x[sides[:, 0]], axis=1)
    used = np.linalg.det(products) > TIE_COVERED**4 / 12 * lengths**2  # of that share in one piece
    dual = np.zeros_like(products)
    dual[used] = integrals[used, :, None] * np.linalg.inv(products[used])
    values = np.einsum("qab,qb->qa", dual[at.side], N) * at.weights[:, None]
    kept = np.flatnonzero(used[at.side])
    place = sides[at.side[kept]].ravel(), np.repeat(kept, 2)
    n_nodes = int(sides.max()) + 1
    sums = np.zeros(n_nodes)
    np.add.at(sums, sides[used], integrals[used])
    nodes = np.flatnonzero(sums)
    psi = sp.csr_array((values[kept].ravel(), place), shape=(n_nodes, len(at.side)))[nodes]
    return nodes, sp.csr_array(sp.diags_array(1 / sums[nodes]) @ psi)


def _carried(
    sheet: ShellNodes, at: _Points, cells: IntArray, carriers: IntArray, onto: IntArray
) -> tuple[sp.csr_array, sp.csr_array]:
    """Return the carriers' functions at points (n_points, n_onto), and what rotations add (3 n_points, 3 n_onto)."""
    n, n_corners = len(at.side), cells.shape[1]
    mine = np.searchsorted(onto, cells[at.carrier])
    N, x, normal = _shape_values(at.places, n_corners), sheet.x[cells[at.carrier]], sheet.normals[carriers[at.carrier]]
    arms = at.x - np.einsum("pc,pci->pi", N, x)
    crossed = np.einsum("abc,pc->pab", EPSILON, arms)  # θ × r
    blocks = N[:, :, None, None] * crossed[:, None]
    s, t = at.places.T
    bubbles = (
        (N[:, 0] * N[:, 1], N[:, 1] * N[:, 2], N[:, 2] * N[:, 0])
        if n_corners == 3
        else (s * (1 - s) * (1 - t), t * (1 - t) * s, s * (1 - s) * t, t * (1 - t) * (1 - s))
    )
    for k, bubble in enumerate(bubbles):
        after = (k + 1) % n_corners
        rise = _rise(bubble, x[:, after] - x[:, k], normal)
        blocks[:, k] += rise
        blocks[:, after] -= rise
    functions = sp.csr_array((N.ravel(), (np.repeat(np.arange(n), n_corners), mine.ravel())), shape=(n, len(onto)))
    return functions, _sparse(blocks, np.arange(n), mine, (n, len(onto)))


def _rise(bubble: Array, side: Array, normal: Array) -> Array:
    """Return the deflection (n, 3, 3) by the rotation at the start of sides (n, 3), less that by the one at the end.

    A side whose slopes at its ends differ is bent: ``w = ½ l s (1 − s) (β₁ − β₂)``, β = θ · (e × n).
    """
    return np.asarray(0.5 * bubble[:, None, None] * normal[:, :, None] * np.cross(side, normal)[:, None])


def _own_rise(sheet: ShellNodes, at: _Points, sides: IntArray, owner: IntArray, nodes: IntArray) -> sp.csr_array:
    """Return what rotations of the edge's own nodes add to its deflection at points, shape (3 n_points, 3 n_nodes)."""
    ends = sides[at.side]
    rise = _rise(at.along * (1 - at.along), sheet.x[ends[:, 1]] - sheet.x[ends[:, 0]], sheet.normals[owner[at.side]])
    known = np.asarray(np.isin(ends, nodes).all(axis=1))
    mine = np.where(known[:, None], np.searchsorted(nodes, ends), 0)
    blocks = np.stack([rise, -rise], axis=1) * known[:, None, None, None]
    return _sparse(blocks, np.arange(len(ends)), mine, (len(ends), len(nodes)))


def _sparse(blocks: Array, rows: IntArray, columns: IntArray, shape: tuple[int, int]) -> sp.csr_array:
    """Return blocks (n, k, 3, 3) of rows (n,) and columns (n, k) as a matrix of three times the shape."""
    row = np.broadcast_to(3 * rows[:, None, None, None] + np.arange(3)[:, None], blocks.shape)
    column = np.broadcast_to(3 * columns[:, :, None, None] + np.arange(3), blocks.shape)
    return sp.csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=(3 * shape[0], 3 * shape[1]))


def _unknowns_of(sheet: ShellNodes, nodes: IntArray, label: str) -> tuple[IntArray, sp.csr_array]:
    """Return the unknowns of nodes, and how these are by displacements and then rotations of all, (n, 6 n_nodes)."""
    space, n = sheet.member.space, len(nodes)
    assert space.mesh.midsurface is not None
    unknowns, blocks, columns = [], [], []
    for k, node in enumerate(nodes):
        points = np.flatnonzero(space.mesh.midsurface.owner == node)
        both = np.append(3 * (sheet.member.first + points)[:, None] + np.arange(3), sheet.rows(nodes[k : k + 1]))
        moved = sheet.fe.point_map[both]
        own = np.unique(moved.indices)
        x = np.concatenate([space.x[points], sheet.x[[node]]]) - sheet.x[node]
        blocks.append(np.linalg.pinv(moved[:, own].toarray(), rcond=ON_A_LINE) @ rigid_motions(x).reshape(-1, 6))
        columns.append(np.concatenate([3 * k + np.arange(3), 3 * (n + k) + np.arange(3)]))
        unknowns.append(own)
    found = np.concatenate(unknowns)
    before = sp.csc_array(sheet.fe.point_map[: 3 * sheet.member.first])[:, found]  # solids, which lead shells
    if before.nnz or len(np.unique(found)) < len(found) or len(found) > 6 * n:
        raise ValueError(moved_already(label))
    order = np.concatenate(columns)
    stacked = sp.csr_array(sp.block_diag(blocks, format="csr"))
    place = sp.csr_array((np.ones(len(order)), (np.arange(len(order)), order)), shape=(len(order), 6 * n))
    return found, sp.csr_array(stacked @ place)

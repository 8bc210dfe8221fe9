"""Shells from midsurfaces: orientation, directors at the nodes, and the layer of solid cells between both faces."""

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, connected_components

from fmd.core.arrays import Array, BoolArray, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import SHELL_FOLD
from fmd.fem.mesh import SolidMesh, three_corners
from fmd.fem.midsurface import Layup, Midsurface

_LAYERS = {3: "wedge", 4: "hexahedron"}


@dataclass(frozen=True)
class Sheet:
    """Elements of a shell on their midsurface, as a file or a shape has them."""

    x: Array  # (n_nodes, 3): positions of the nodes [m]
    cells: IntArray  # (n_cells, 3 or 4): nodes around each element
    thickness: Array  # (n_cells,) or (n_cells, 3 or 4): of each element, or at its nodes [m]
    parts: Mapping[str, IntArray]  # elements of each part
    faces: Mapping[str, IntArray]  # nodes of each face, which is all of the shell's surface between them
    patches: Mapping[str, IntArray]  # elements of each face that consists of both sides of elements
    sides: tuple[str, str]  # names of the lower and of the upper face
    offset: Array | None = None  # (n_cells,): distance of the middle from the nodes along the normal [m]
    layup: Layup | None = None  # layers of its elements
    notes: tuple[str, ...] = ()
    shift: float = 0.0  # distance of the whole shell's middle besides, along the normals as they are after turning [m]


def thicken(sheet: Sheet) -> SolidMesh:
    """Return the layer of solid cells between both faces of a shell, with its midsurface.

    Raises
    ------
    AccuracyError
        A cell is inverted or flat; the message counts them.
    ValueError
        The shell has one side only, as a Möbius strip.
    """
    x = sheet.x
    cells, turned = _orient(sheet.cells)
    n_local = cells.shape[1]
    normals = corner_normals(x[cells])
    smooth = _smooth_corners(cells, normals)
    n_smooth = int(smooth.max()) + 1
    total = np.zeros((n_smooth, 3))
    np.add.at(total, smooth, normals.reshape(-1, 3))
    directors = total / np.linalg.norm(total, axis=1, keepdims=True)
    # Corners with a common director have points of their own where thickness or offset jumps.
    offset = np.zeros(len(cells)) if sheet.offset is None else np.where(turned, -sheet.offset, sheet.offset)
    offset = offset + sheet.shift
    t = np.array(np.broadcast_to(sheet.thickness.reshape(len(cells), -1), cells.shape))
    t[turned] = t[turned, ::-1]
    section = np.unique(np.stack([t.ravel(), np.repeat(offset, n_local)]), axis=1, return_inverse=True)[1].ravel()
    keys = smooth * (section.max() + 1) + section
    _, first, pair = np.unique(keys, return_index=True, return_inverse=True)
    pair, of_cell = pair.ravel(), first // n_local
    owner, d = cells.ravel()[first], directors[smooth[first]]
    middle, half = x[owner] + offset[of_cell, None] * d, t.ravel()[first, None] / 2 * d
    pairs = pair.reshape(cells.shape)
    n_pairs = len(first)
    points, layer = np.concatenate([middle - half, middle + half]), np.concatenate([pairs, pairs + n_pairs], axis=1)
    owners = np.tile(owner, 2)
    faces = {name: np.flatnonzero(np.isin(owners, nodes)) for name, nodes in sheet.faces.items()}
    faces |= {
        name: np.concatenate([three_corners(pairs[own]), three_corners(pairs[own] + n_pairs)])
        for name, own in sheet.patches.items()
    }
    faces |= {name: three_corners(pairs + k * n_pairs) for k, name in enumerate(sheet.sides) if name not in faces}
    note = f"{turned.sum()} shell elements have their normals to the other side and were turned"
    notes = sheet.notes + ((note,) if turned.any() else ())
    midsurface = Midsurface(x, owners, layup=sheet.layup and sheet.layup.turned_over(turned))
    return SolidMesh(points, layer, _LAYERS[n_local], sheet.parts, faces, notes=notes, midsurface=midsurface)


def _sides(cells: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the number of the edge, cell and local start of each cell's sides; directions make no difference."""
    ends = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    _, edge = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True)
    side = np.arange(len(ends))
    return edge.ravel(), side // cells.shape[1], side % cells.shape[1]


def _neighbours(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return pairs of sides that share an edge, both (n_pairs,): all pairs where more than two meet."""
    edge = _sides(cells)[0]
    order = np.argsort(edge, kind="stable")
    most = int(np.bincount(edge).max())
    one, other = [], []
    for step in range(1, most):
        same = edge[order[:-step]] == edge[order[step:]]
        one.append(order[:-step][same])
        other.append(order[step:][same])
    return np.concatenate([*one, np.zeros(0, int)]), np.concatenate([*other, np.zeros(0, int)])


def _orient(cells: IntArray) -> tuple[IntArray, BoolArray]:
    """Turn elements so that neighbours have their normals to one side; return them, and which were turned."""
    edge, cell, _ = _sides(cells)
    one, other = _neighbours(cells)
    two = np.bincount(edge)[edge[one]] == 2
    one, other = one[two], other[two]
    start = cells.ravel()
    opposed = start[one] == start[other]  # they run along their edge in one direction
    if not opposed.any():
        return cells, np.zeros(len(cells), dtype=bool)
    pairs = np.concatenate([cell[one], cell[other]]), np.concatenate([cell[other], cell[one]])
    graph = sp.csr_array((np.tile(np.where(opposed, 2, 1), 2), pairs), shape=2 * [len(cells)])
    n_pieces, piece = connected_components(graph, directed=False)
    flip = np.zeros(len(cells), dtype=bool)
    for k in range(n_pieces):
        order, before = breadth_first_order(graph, int(np.argmax(piece == k)), directed=False)
        for c in order[1:]:
            flip[c] = flip[before[c]] ^ (graph[before[c], c] == 2)
        own = piece == k
        if 2 * np.count_nonzero(flip & own) > np.count_nonzero(own):
            flip[own] = ~flip[own]
    if (flip[cell[one]] ^ flip[cell[other]] ^ opposed).any():
        raise ValueError("the shell has one side only, as a Möbius strip has; cut it into two parts")
    turned = cells.copy()
    turned[flip] = turned[flip, ::-1]
    return turned, flip


def corner_normals(x: Array) -> Array:
    """Return normals at the corners of elements x (n_cells, n_local, 3), as long as their angles there."""
    after, before = np.roll(x, -1, axis=1) - x, np.roll(x, 1, axis=1) - x
    normal = np.cross(after, before)
    size = np.linalg.norm(normal, axis=2)
    angle = np.arctan2(size, np.einsum("eic,eic->ei", after, before))
    size = np.where(size > 0, size, 1.0)
    return np.asarray(normal * (angle / size)[..., None])


def _smooth_corners(cells: IntArray, normals: Array) -> IntArray:
    """Return for each corner of an element the number of the smooth piece of surface at its node, flat."""
    one, other = _neighbours(cells)
    unit = normals / np.linalg.norm(normals, axis=2, keepdims=True).clip(min=np.finfo(float).tiny)
    flat, start = unit.reshape(-1, 3), cells.ravel()
    end = np.roll(np.arange(cells.size).reshape(cells.shape), -1, axis=1).ravel()
    reverse = start[one] != start[other]
    one, other = one[reverse], other[reverse]
    rows, columns = [], []
    for a, b in ((one, end[other]), (end[one], other)):  # corners at one node, on both sides of the edge
        near = np.einsum("ic,ic->i", flat[a], flat[b]) > np.cos(np.radians(SHELL_FOLD))
        rows.append(a[near])
        columns.append(b[near])
    pairs = np.concatenate(rows), np.concatenate(columns)
    graph = sp.coo_array((np.ones(len(pairs[0])), pairs), shape=2 * [cells.size])
    return np.asarray(connected_components(graph, directed=False)[1])

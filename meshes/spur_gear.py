"""Spur gears about the z axis: hexahedra of second order whose nodes lie on the involutes and their fillets.

A meshed tooth is one block of rows from its base, which is between the middles of both fillets, to its tip; below it
and beside it are rows from there to the bore. Sectors without a tooth of their own end at the root circle. All is
found on a grid of twice the elements' fineness, of which elements take every second point and the middles of sides.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from fmd.meshes.gmsh_session import MeshArrays

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_BASE_DIP = 0.25  # of the tooth's base below its ends, over half its width: opens the corners of elements there
_GROWTH = 1.7  # of elements from the fillets towards the bore, and towards the middle of a tooth
_PLAIN = 2  # elements around of a sector without a tooth
_DENSE = 2000  # points of a curve that is divided by its length
_NEAR = 1e-7  # of the module: points that are one

# Places of the nodes of an element on the fine grid, in meshio's order.
_CORNERS = np.array([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)])
_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
_NODES = np.concatenate([_CORNERS, [(_CORNERS[a] + _CORNERS[b]) // 2 for a, b in _EDGES]])


def mesh(gear: Any) -> MeshArrays:
    """Mesh the gear of a scene's table ``SpurGear``."""
    count, sector = gear.meshed_teeth, 2 * np.pi / gear.teeth
    block, outer = tooth_block(gear), _outer_edge(gear)
    plain = gear.tooth.root_radius * _direction(np.linspace(-0.5, 0.5, 2 * _PLAIN + 1) * sector)
    turns = [_turn((k - count // 2) * sector) for k in range(gear.teeth)]
    rims = [_rim(gear, outer if k < count else plain) @ turn.T for k, turn in enumerate(turns)]
    grids = [*rims, *(block @ turn.T for turn in turns[:count])]
    flat = np.concatenate([grid.reshape(-1, 2) for grid in grids])
    near = cKDTree(flat).query_ball_point(flat, _NEAR * gear.module)
    first, number = np.unique([min(each) for each in near], return_inverse=True)
    starts = np.cumsum([0, *(grid.shape[0] * grid.shape[1] for grid in grids)])
    numbers = [number[a:b].reshape(grid.shape[:2]) for a, b, grid in zip(starts, starts[1:], grids, strict=False)]
    return _extrude(gear, flat[first], numbers[: gear.teeth], numbers[gear.teeth :])


def tooth_block(gear: Any) -> Floats:
    """Return the fine grid of a tooth on the x axis, shape (2 rows + 1, 2 across + 1, 2) [m].

    Rows begin at the tooth's base; ``2 fillet`` of them are on the fillet, the rest at equal roll angles.
    """
    tooth, counts = gear.tooth, gear.mesh
    beta = np.linspace(_middle(tooth), tooth.alpha, 2 * counts.fillet + 1)
    roll = np.linspace(tooth.form_roll, tooth.tip_roll, 2 * counts.flank + 1)
    profile = np.concatenate([tooth.fillet(beta), tooth.flank(roll)[1:]])
    up = np.linspace(0.0, 1.0, len(profile))
    bulge = (tooth.tip_radius - profile[-1, 0]) * up**2 - _BASE_DIP * profile[0, 1] * (1.0 - up) ** 2
    half = 1.0 - _graded(counts.across // 2)[::-1]
    across = np.concatenate([-half[:0:-1], half])
    x = profile[:, :1] + bulge[:, None] * (1.0 - across**2)
    block = np.stack([x, profile[:, 1:] * across], axis=-1)
    block[-1] = tooth.tip_radius * _direction(across * np.arctan2(profile[-1, 1], profile[-1, 0]))
    return block


def _middle(tooth: Any) -> float:
    """Return the angle β of the fillet's point at which a tooth's block begins."""
    return float(0.5 * (tooth.alpha + 0.5 * np.pi))


def _outer_edge(gear: Any) -> Floats:
    """Return the fine points of the edge of a sector below its tooth, from gap to gap, shape (n, 2)."""
    tooth = gear.tooth
    dense = tooth.fillet(np.linspace(_middle(tooth), 0.5 * np.pi, _DENSE))
    end = np.arctan2(dense[-1, 1], dense[-1, 0])
    land = tooth.root_radius * _direction(np.linspace(end, np.pi / tooth.teeth, _DENSE)[1:])
    dense = np.concatenate([dense, land])
    length = np.cumsum([0.0, *np.linalg.norm(np.diff(dense, axis=0), axis=1)])
    at = np.linspace(0.0, length[-1], 2 * (gear.mesh.fillet + 1) + 1)
    upper = np.stack([np.interp(at, length, dense[:, a]) for a in range(2)], axis=1)
    lower = (upper * (1.0, -1.0))[::-1]
    return np.concatenate([lower, tooth_block(gear)[0, 1:-1], upper])


def _rim(gear: Any, outer: Floats) -> Floats:
    """Return the fine grid between the bore and an outer edge (n, 2), shape (2 rim + 1, n, 2)."""
    up = 1.0 - _graded(gear.mesh.rim)[::-1]
    inner: Floats = 0.5 * gear.bore * outer / np.linalg.norm(outer, axis=1, keepdims=True)
    return inner + up[:, None, None] * (outer - inner)


def _graded(count: int) -> Floats:
    """Return fine points from 0 to 1 of elements that grow, shape (2 count + 1,)."""
    ends = np.concatenate([[0.0], np.cumsum(_GROWTH ** np.arange(count))])
    return np.asarray(np.interp(np.arange(2 * count + 1) / 2, np.arange(count + 1), ends / ends[-1]))


def _extrude(gear: Any, flat: Floats, rims: list[Ints], teeth: list[Ints]) -> MeshArrays:
    """Extrude fine grids of numbers of points (n, 2) along z, and name the faces."""
    levels = 2 * gear.mesh.along + 1
    z = np.linspace(-0.5, 0.5, levels) * gear.width
    cells = []
    for grid in (*rims, *teeth):
        i, j, k = (
            each.ravel()
            for each in np.meshgrid(*(np.arange(0, n - 2, 2) for n in (*grid.shape, levels)), indexing="ij")
        )
        a, b, c = (start[:, None] + _NODES[:, axis] for axis, start in enumerate((i, j, k)))
        cells.append(grid[a, b] * levels + c)
    used, number = np.unique(np.concatenate(cells), return_inverse=True)
    points = np.column_stack([flat[used // levels], z[used % levels]])
    form, base = 2 * gear.mesh.fillet, 2 * (gear.mesh.fillet + 1)
    sides = [each[:, [0, -1]] for each in teeth]
    outer = [each[-1] for each in rims]
    roots = [edge[: base + 1] for edge in outer] + [edge[-base - 1 :] for edge in outer]
    lines = {
        "bore": [each[0] for each in rims],
        "flanks": [each[form:] for each in sides],
        "roots": [*roots, *(each[: form + 1] for each in sides)],
        "tips": [each[-1] for each in teeth],
    }
    faces = {
        name: np.flatnonzero(np.isin(used // levels, np.concatenate([each.ravel() for each in own])))
        for name, own in lines.items()
    }
    faces |= {"back": np.flatnonzero(used % levels == 0), "front": np.flatnonzero(used % levels == levels - 1)}
    blocks = number.reshape(-1, len(_NODES))
    parts = {"gear": np.arange(len(blocks))}
    return MeshArrays(points, blocks, "hexahedron20", parts, faces)


def _direction(angle: Floats) -> Floats:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _turn(angle: float) -> Floats:
    """Return the matrix (2, 2) of a rotation."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])

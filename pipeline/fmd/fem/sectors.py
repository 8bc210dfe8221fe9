"""A whole cyclic body from the mesh of one of its sectors, which two cuts bound."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import SAME_CUT
from fmd.core.rotations import rotation_matrix
from fmd.fem.mesh import SolidMesh

_ON_AXIS = "nodes lie on the axis, so all sectors are solved together"
_ONE_MESH = "both cuts need one mesh, as periodic ones have"


def repeat_sector(mesh: SolidMesh, count: int, cuts: tuple[str, str]) -> SolidMesh:
    """Turn a sector about the z axis as often as it takes to make the whole body, and join the sectors at their cuts.

    A turn by 2π over the count of sectors carries its two faces ``cuts`` into each other. There are 3 sectors at least:
    of two, each cut is turned onto the other by either turn. Cells and nodes come sector by sector, the first as it is;
    where one cut is turned onto the other, the first one's nodes stay. Parts and faces keep their names for all
    sectors, with ``-k`` behind it for those of the k-th, of which all cells are the part ``sector-k``.

    Raises
    ------
    ValueError
        The turn carries nodes of one cut to where the other one has none, either way, or the file has links.
    """
    if mesh.connections is not None:
        raise ValueError("links and masses of a deck can't be repeated; leave cyclic out, or them")
    x, angle = mesh.points, 2 * np.pi / count
    low, high = _match_cuts(mesh, angle, cuts)
    on_axis = np.intersect1d(low[low == high], low)
    low, high = low[low != high], high[low != high]
    own = np.setdiff1d(np.arange(len(x)), np.concatenate([high, on_axis]))
    number = np.empty((count, len(x)), dtype=np.int64)
    number[:, own] = np.arange(count * len(own)).reshape(count, -1)
    number[:, on_axis] = count * len(own) + np.arange(len(on_axis))
    number[:, high] = np.roll(number, -1, axis=0)[:, low]
    turns = rotation_matrix(np.outer(np.arange(count), [0.0, 0.0, angle]))
    points = np.concatenate([*(x[own] @ turn.T for turn in turns), x[on_axis]])
    inside = {name: rows for name, rows in mesh.faces.items() if not np.isin(rows, [*low, *high, *on_axis]).all()}
    n_cells = len(mesh.cells)
    return replace(
        mesh,
        points=points,
        cells=number[:, mesh.cells].reshape(-1, mesh.cells.shape[1]),
        parts={
            **_repeated({name: np.arange(count)[:, None] * n_cells + cells for name, cells in mesh.parts.items()}),
            **{f"sector-{k + 1}": k * n_cells + np.arange(n_cells) for k in range(count)},
        },
        faces=_repeated({name: number[:, rows] for name, rows in inside.items()}),
        centres=_turned_centres({name: mesh.centres[name] for name in inside if name in mesh.centres}, turns),
        sectors=1 if len(on_axis) else count,
        notes=(*mesh.notes, *([f"{len(on_axis)} {_ON_AXIS}"] if len(on_axis) else [])),
    )


def _match_cuts(mesh: SolidMesh, angle: float, cuts: tuple[str, str]) -> tuple[IntArray, IntArray]:
    """Return the nodes that a turn by the angle carries onto others, and these."""
    from scipy.spatial import cKDTree

    x = mesh.points
    first, second = (np.unique(mesh.faces[name]) for name in cuts)
    allowed = SAME_CUT * np.ptp(x, axis=0).max()
    apart = {}
    for turn in (angle, -angle):
        away, image = cKDTree(x).query(x @ rotation_matrix(np.array([[0.0, 0.0, turn]]))[0].T)
        missed = max(float(away[first].max()), allowed * (not np.isin(image[first], second).all()))
        if missed < allowed:
            low = np.flatnonzero(away < allowed)
            if loose := int(np.count_nonzero(~np.isin(second, image[low]))):
                raise ValueError(f"{loose} nodes of {cuts[1]} have none of {cuts[0]} turned onto them: {_ONE_MESH}")
            return (low, image[low]) if turn > 0.0 else (image[low], low)
        apart[missed] = int(np.count_nonzero(away[first] >= allowed))
    missed = min(apart)
    raise ValueError(
        f"{apart[missed]} of the {len(first)} nodes of {cuts[0]}, turned by {np.degrees(angle):.6g}° about z, lie on "
        f"none of {cuts[1]}, up to {missed:.3g} m off: {_ONE_MESH}, and z as axis"
    )


def _repeated(rows: Mapping[str, IntArray]) -> dict[str, IntArray]:
    """Return what each name has in all sectors, and what it has in each one, from arrays (count, …)."""
    whole = {name: np.concatenate([*own]) for name, own in rows.items()}
    return whole | {f"{name}-{k + 1}": one for name, own in rows.items() for k, one in enumerate(own)}


def _turned_centres(centres: Mapping[str, Array], turns: Array) -> dict[str, Array]:
    """Return area and centre of faces in all sectors, and in each one."""
    each = {name: np.stack([np.array([own[0], *(turn @ own[1:])]) for turn in turns]) for name, own in centres.items()}
    whole = {name: np.array([rows[:, 0].sum(), *rows[:, 1:].mean(axis=0)]) for name, rows in each.items()}
    return whole | {f"{name}-{k + 1}": row for name, rows in each.items() for k, row in enumerate(rows)}

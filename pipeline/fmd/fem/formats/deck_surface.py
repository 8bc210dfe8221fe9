"""Outer surface of the solid elements of a deck, as it is drawn; their nodes are those of the deck."""

from collections.abc import Sequence

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.fem.cells.table import CELLS
from fmd.fem.elements import match_nodes
from fmd.fem.mesh import three_corners
from fmd.fem.surface import SurfaceTopology, polygon_surface, turn_outwards


def deck_surface(x: Array, blocks: Sequence[tuple[str, IntArray]]) -> SurfaceTopology | None:
    """Return the facets that belong to one element alone, of elements of any kinds; ``None`` without solids.

    Each block has a type by meshio's name, and the elements' nodes in meshio's order; x (n_nodes, 3) is of all nodes.
    """
    polygons: list[IntArray] = []
    keys: list[IntArray] = []
    for name, cells in blocks:
        if name not in CELLS:
            continue
        cell = CELLS[name]
        kind = cell.element(cell.order)
        local = cells[:, match_nodes(kind.element.doflocs, cell.nodes)]
        inside = x[local[:, : cell.n_corners]].mean(axis=1)
        for around, corners in zip(kind.facet_polygons, kind.facet_corners, strict=True):
            polygons.append(turn_outwards(x, local[:, around], inside))
            keys.append(three_corners(local[:, corners]))
    if not polygons:
        return None
    _, number, count = np.unique(np.concatenate(keys), axis=0, return_inverse=True, return_counts=True)
    single = np.split(count[number.ravel()] == 1, np.cumsum([len(key) for key in keys])[:-1])
    outer = [around[own] for around, own in zip(polygons, single, strict=True)]
    sizes = sorted({around.shape[1] for around in outer})
    return polygon_surface(x, [np.concatenate([a for a in outer if a.shape[1] == size]) for size in sizes])

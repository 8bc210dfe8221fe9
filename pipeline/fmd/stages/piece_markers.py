"""Markers of pieces taken over from the whole part: sections weighted by tractions, points, nodes and edges."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from fmd.core.arrays import Array, IntArray
from fmd.fem.markers import Marker
from fmd.fem.space import Discretisation
from fmd.scene.bodies import Solid
from fmd.stages.cut_sections import weigh_cuts
from fmd.stages.piece_mesh import CutPart, round_to_grid

if TYPE_CHECKING:
    from fmd.stages.part import FlexiblePart


def mark_pieces(part: FlexiblePart, cut: CutPart, loaded: Collection[str]) -> CutPart:
    """Give pieces those markers that their own meshes don't define.

    Parameters
    ----------
    part : FlexiblePart
        The part in one piece.
    cut : CutPart
        The part's pieces.
    loaded : collection of str
        Names of the markers at which joints and loads act.
    """
    shape, wanted = part.shape, list[dict[str, Marker]]({} for _ in cut.pieces)
    assert isinstance(shape, Solid)
    for k, piece in enumerate(cut.pieces):
        wanted[k] |= {name: part.markers[name] for name in piece.own_markers if not shape.marker[name].is_face}
    if shape.sections == "tractions":
        for each, marker in zip(cut.cuts, weigh_cuts(part, cut, loaded), strict=True):
            if marker is not None:
                wanted[each.first][each.of_first] = wanted[each.second][each.of_second] = marker
    tree, extent = cKDTree(part.space.x), float(np.ptp(part.mesh.points, axis=0).max())
    pieces = []
    for piece, markers in zip(cut.pieces, wanted, strict=True):
        if not markers:
            pieces.append(piece)
            continue
        x = Discretisation(piece.mesh, part.order, part.formulation).x
        whole = np.asarray(tree.query(x + piece.offset)[1])
        given = {name: _moved(marker, whole, piece.offset, extent) for name, marker in markers.items()}
        pieces.append(replace(piece, given=given))
    return replace(cut, pieces=tuple(pieces))


def _moved(marker: Marker, whole: IntArray, offset: Array, extent: float) -> Marker:
    """Return a marker by the numbers of a piece's nodes, of which ``whole`` (n_nodes,) are those in the whole."""
    nodes = np.flatnonzero(np.isin(whole, marker.nodes))
    order = np.argsort(marker.nodes)
    place = order[np.searchsorted(marker.nodes[order], whole[nodes])]
    translation = marker.translation_weights
    return Marker(
        round_to_grid(marker.position - offset, extent),
        nodes,
        translation[place] if translation.ndim == 1 else translation[:, place],
        marker.rotation_weights[:, place],
    )

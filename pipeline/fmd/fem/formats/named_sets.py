"""Named sets of a mesh file: parts, faces, and ties between faces by their names."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fmd.core.arrays import BoolArray, IntArray
from fmd.fem.cells.table import CELLS, is_solid
from fmd.fem.connections import TiedFaces
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.mesh import rows_among, three_corners

PLANE = ("triangle", "quad", "polygon")
_NONE = np.empty(0, dtype=np.int64)


def tie_by_names(raw: RawMesh, scale: float, ties: Sequence[tuple[str, str, float | None]]) -> RawMesh:
    """Add ties between faces of a mesh by their names, in any case.

    Raises
    ------
    MeshFileError
        There is no such face.
    """
    faces = find_faces(raw, np.arange(len(raw.points)))
    known = {name.casefold(): face for name, face in faces.items()}
    added = []
    for number, (*names, within) in enumerate(ties):
        for name in names:
            if name.casefold() not in known:
                raise MeshFileError(f"mesh.tie.{number}: no face {name}; the faces: {', '.join(faces) or 'none'}")
        one, other = (known[name.casefold()] for name in names)
        points = np.unique(np.concatenate([one.ravel(), other.ravel()]))
        bridged = None if within is None else within / scale
        added.append(TiedFaces(f"tie of {names[0]} to {names[1]}", points, one, other, bridged))
    return replace(raw, connections=replace(raw.connections, ties=(*raw.connections.ties, *added)))


def with_curves(raw: RawMesh, path: Path) -> RawMesh:
    """Return a mesh of Gmsh with its named curves as node sets in place of lines; itself if some lines have no name.

    Lines of other files, the decks, are beams.
    """
    curves = {b: cells for b, (kind, cells) in enumerate(raw.blocks) if kind.startswith("line") and len(cells)}
    named = [(name, b, own[b]) for name, own in raw.cell_sets.items() for b in curves if len(own[b])]
    nameless = [
        np.setdiff1d(np.arange(len(cells)), np.concatenate([_NONE, *(k for _, at, k in named if at == b)]))
        for b, cells in curves.items()
    ]
    if path.suffix.lower() != ".msh" or any(map(len, nameless)):
        return raw
    sets: dict[str, IntArray] = {}
    for name, b, own in named:
        sets[name] = np.union1d(sets.get(name, _NONE), curves[b][own])
    blocks = [(kind, cells[:0] if b in curves else cells) for b, (kind, cells) in enumerate(raw.blocks)]
    cell_sets = {name: [_NONE if b in curves else k for b, k in enumerate(own)] for name, own in raw.cell_sets.items()}
    return replace(raw, blocks=blocks, cell_sets=cell_sets, point_sets=sets | raw.point_sets)


def find_parts(raw: RawMesh, kept: IntArray) -> dict[str, IntArray]:
    """Return the cells of each element set of solids; those of no set are the part ``rest``."""
    solid = [is_solid(kind) for kind, _ in raw.blocks]
    offsets = np.cumsum([0, *(len(cells) if s else 0 for s, (_, cells) in zip(solid, raw.blocks, strict=True))])
    place = np.full(offsets[-1], -1)
    place[kept] = np.arange(len(kept))
    parts = {}
    for name, sets in raw.cell_sets.items():
        chosen = [offsets[b] + cells for b, cells in enumerate(sets) if solid[b]]
        numbers = place[np.concatenate([_NONE, *chosen])]
        if (numbers >= 0).any():
            parts[name] = np.unique(numbers[numbers >= 0])
    rest = np.setdiff1d(np.arange(len(kept)), np.concatenate([_NONE, *parts.values()]))
    return parts | ({"rest" if parts else "all": rest} if len(rest) else {})


def find_faces(raw: RawMesh, place: IntArray) -> dict[str, IntArray]:
    """Return node sets as points, and sets of surface elements and surfaces as corners of facets."""
    faces = {name: np.unique(place[points][place[points] >= 0]) for name, points in raw.point_sets.items()}
    facets: dict[str, list[IntArray]] = {name: list(corners) for name, corners in raw.facet_sets.items()}
    for name, sets in raw.cell_sets.items():
        for (kind, block), chosen in zip(raw.blocks, sets, strict=True):
            if kind.startswith(PLANE) and len(chosen):
                facets.setdefault(name, []).append(block[chosen][:, : corners_of(kind)])
    for name, corners in facets.items():
        rows = [three_corners(place[block]) for block in corners]
        joined = np.concatenate(rows) if rows else np.empty((0, 3), dtype=np.int64)
        faces[name] = joined[(joined >= 0).all(axis=1)]
    return {name: face for name, face in faces.items() if face.size}


def facets_of_solids(raw: RawMesh) -> IntArray:
    """Return three corners of each facet of the solids, shape (n, 3)."""
    facets = [
        three_corners(cells[:, list(face)])
        for kind, cells in raw.blocks
        if kind in CELLS
        for face in CELLS[kind].shape.faces
    ]
    return np.concatenate([_NONE.reshape(0, 3), *facets])


def are_shells(raw: RawMesh, b: int, on_solids: IntArray, by_deck: bool) -> BoolArray:
    """Return which surface elements of a block are shells, (n_cells,): not those on `facets_of_solids`.

    Sections of the deck, if these are asked for, make shells of them too.
    """
    kind, cells = raw.blocks[b]
    own = ~rows_among(three_corners(cells[:, : corners_of(kind)]), on_solids)
    return own | np.isfinite(raw.shells[b].thickness).all(axis=1) if by_deck and raw.shells else own


def corners_of(kind: str) -> int:
    """Return the number of corners of a surface element of meshio's name."""
    return 3 if kind.startswith("triangle") else 4


def faces_of_points(raw: RawMesh, place: IntArray) -> dict[str, IntArray]:
    """Return the nodes of each point set that has some among a mesh's."""
    faces = {name: place[nodes][place[nodes] >= 0] for name, nodes in raw.point_sets.items()}
    return {name: nodes for name, nodes in faces.items() if len(nodes)}


def nodes_of_facets(raw: RawMesh, facets: list[IntArray]) -> IntArray:
    """Return the nodes of facets that are given by their corners, those between the corners too."""
    wanted = np.concatenate([three_corners(corners) for corners in facets])
    found = [np.concatenate([corners.ravel() for corners in facets])]
    for kind, block in raw.blocks:
        if kind.startswith(PLANE) and block.shape[1] > corners_of(kind):
            found.append(block[rows_among(three_corners(block[:, : corners_of(kind)]), wanted)].ravel())
        if kind not in CELLS:
            continue
        x = CELLS[kind].nodes
        for corners in map(list, CELLS[kind].shape.faces):
            mine = rows_among(three_corners(block[:, corners]), wanted)
            a, b = x[corners[1]] - x[corners[0]], x[corners[2]] - x[corners[0]]
            on = np.abs((x - x[corners[0]]) @ np.cross(a, b)) < 1e-9
            found.append(block[mine][:, on].ravel())
    return np.unique(np.concatenate(found))


def cells_by_block(places: list[tuple[int, int]], n_blocks: int) -> list[IntArray]:
    """Return the cells of each block from pairs of block and cell."""
    sets: list[list[int]] = [[] for _ in range(n_blocks)]
    for block, cell in places:
        sets[block].append(cell)
    return [np.unique(np.array(cells, dtype=np.int64)) for cells in sets]

"""Import of solids beside shells and beams, as one body, from a mesh file."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fmd.core.arrays import BoolArray, IntArray
from fmd.core.errors import as_input_error
from fmd.fem.beams import extrude
from fmd.fem.cells.table import is_solid
from fmd.fem.connections import Connections, TiedFaces
from fmd.fem.formats import repair as repairs
from fmd.fem.formats.divided_shells import divide_shells_with_middles, halve_shells
from fmd.fem.formats.import_beam import mesh_beams, take_beams
from fmd.fem.formats.import_mesh import UNUSABLE, connection_notes, connections_in_si, place_solids, read_sound
from fmd.fem.formats.import_shell import SHELLS, GivenSections, mesh_shells, take_shells
from fmd.fem.formats.mixed import split_mixed
from fmd.fem.formats.named_sets import PLANE, are_shells, corners_of, facets_of_solids, tie_by_names, with_curves
from fmd.fem.formats.raw_mesh import BlockShells, MeshFileError, RawMesh
from fmd.fem.joined import HINGE_MEND, STRUT_MEND, AnyMesh, JoinedMesh, Seam, count_nodes
from fmd.fem.mesh import SolidMesh, rows_among, three_corners
from fmd.fem.thicken import thicken

_LINES = "line"


def read_structure(
    path: Path,
    scale: float,
    shell: GivenSections | None,
    beams: bool = False,
    repair: bool = False,
    units: tuple[float | None, float | None] = (None, None),
    ties: Sequence[tuple[str, str, float | None]] = (),
) -> AnyMesh:
    """Read shells and beams of a file, beside its solids if it has some, as `read_mesh` does.

    Without sections nothing is a shell. Units are of mass [kg] and force [N].

    Raises
    ------
    InputError
        The file can't be read, or its elements can't be used; the message says what is wrong.
    """
    with as_input_error(str(path), of=UNUSABLE):
        raw = read_sound(path)
        if shell is not None:
            raw = divide_shells_with_middles(with_curves(raw, path), shell.thickness is None)
            for _ in range(shell.halvings):
                raw = halve_shells(raw)
        kinds = _kinds(raw, shell, beams)
        if sum(any(own.any() for own in each) for each in kinds) > 1:
            return _Joining(raw, scale, kinds, repair, units).joined(shell, ties)
        if ties:
            raw = tie_by_names(raw, scale, ties)
        return mesh_beams(raw, scale, units) if shell is None else mesh_shells(raw, scale, shell, units)


def _kinds(raw: RawMesh, shell: GivenSections | None, beams: bool) -> tuple[list[BoolArray], ...]:
    """Return which cells of each block are solids, shells and beams.

    Triangles and quadrilaterals on facets of solids are shells if the deck has a section for them, and faces if not.
    """
    solids = [np.full(len(cells), is_solid(kind)) for kind, cells in raw.blocks]
    shells, on_solids = [], facets_of_solids(raw)
    for b, (kind, cells) in enumerate(raw.blocks):
        if shell is None or kind not in SHELLS:
            shells.append(np.zeros(len(cells), dtype=bool))
        else:
            shells.append(are_shells(raw, b, on_solids, shell.thickness is None))
    lines = [np.full(len(cells), beams and kind == _LINES) for kind, cells in raw.blocks]
    return solids, shells, lines


class _Joining:
    """A file's solids, shells and beams, and the numbers of its points among each."""

    def __init__(
        self,
        raw: RawMesh,
        scale: float,
        kinds: tuple[list[BoolArray], ...],
        repair: bool,
        units: tuple[float | None, float | None],
    ) -> None:
        self._raw, self._scale, self._kinds, self._repair, self._units = raw, scale, kinds, repair, units
        self._meshes: list[SolidMesh] = []
        self._places: list[IntArray] = []  # of each mesh, (n_points,): node of each point of the file, -1 of none
        self._notes: list[str] = []

    def joined(self, shell: GivenSections | None, ties: Sequence[tuple[str, str, float | None]]) -> JoinedMesh:
        """Return the meshes with all that joins them."""
        raw = self._raw
        solids, shells, lines = self._kinds
        if ties:
            self._raw = raw = tie_by_names(raw, self._scale, ties)
        self._require_all()
        if any(own.any() for own in solids):
            faces = [own | kind.startswith(PLANE) for (kind, _), own in zip(raw.blocks, solids, strict=True)]
            sub = split_mixed(_only(raw, [own & ~other for own, other in zip(faces, shells, strict=True)]))
            self._add(*place_solids(sub, self._scale, self._repair, self._pieces(shells, lines)))
        if any(own.any() for own in shells):
            assert shell is not None
            sheet, place = take_shells(_only(raw, shells), self._scale, shell)
            self._add(thicken(sheet), place)
        if any(own.any() for own in lines):
            whole, place = take_beams(_only(raw, lines), self._scale, self._units[0])
            self._add(extrude(whole), place)
        firsts = np.cumsum([0, *(len(own.points) + count_nodes(own) for own in self._meshes)])
        rows = [self._rows(k, firsts) for k in range(len(self._meshes))]
        tied, seams = self._seams(rows)
        shared = self._shared(rows, seams)
        self._warn_of_hinges(rows, seams)
        self._warn_of_struts(rows, seams)
        connections = self._connections(rows, tied)
        notes = tuple(dict.fromkeys([*(note for own in self._meshes for note in own.notes), *self._notes]))
        return JoinedMesh(tuple(self._meshes), shared, seams, notes + connection_notes(connections), connections)

    def _add(self, mesh: SolidMesh, place: IntArray) -> None:
        self._meshes.append(mesh)
        whole = np.full(len(self._raw.points), -1)
        n = min(len(place), len(whole))  # splitting adds points behind the file's
        whole[:n] = place[:n]
        self._places.append(whole)

    def _require_all(self) -> None:
        """Raise ``MeshFileError`` for elements that none of the kinds takes, and for a body in pieces."""
        raw, lost = self._raw, dict(self._raw.others)
        for (kind, cells), *own in zip(raw.blocks, *self._kinds, strict=True):
            left = cells[~(own[0] | own[1] | own[2])]
            count = 0 if kind == "vertex" else self._off_solids(kind, left) if kind.startswith(PLANE) else len(left)
            if count:
                lost[kind] = lost.get(kind, 0) + count
        if lost and not self._repair:
            listed = ", ".join(f"{n} {kind}" for kind, n in lost.items())
            mend = "; mesh.beam = 'deck' takes lines as beams" if _LINES in lost else ""
            mend += "; mesh.shell takes triangles and quadrilaterals" if lost.keys() & SHELLS.keys() else ""
            raise MeshFileError(f"elements that aren't read beside its solids, shells and beams: {listed}{mend}")
        if lost:
            listed = ", ".join(f"{n} {kind}" for kind, n in lost.items())
            self._notes.append(f"mended: elements that aren't solid ({listed}): left out")
        groups = [*self._pieces(*self._kinds), *raw.connections.point_groups]
        used = np.unique(np.concatenate(groups))[:, None]
        if (n_pieces := len(repairs.size_pieces(used, len(raw.points), groups))) > 1:
            raise MeshFileError(
                f"its elements are in {n_pieces} unconnected pieces; join them at common nodes, by mesh.tie or by links"
            )

    def _off_solids(self, kind: str, cells: IntArray) -> int:
        """Count the surface elements that are on no facet of a solid."""
        on = rows_among(three_corners(cells[:, : corners_of(kind)]), facets_of_solids(self._raw))
        return len(cells) - int(on.sum())

    def _pieces(self, *kinds: list[BoolArray]) -> list[IntArray]:
        """Return the points of each cell of some kinds."""
        return [
            row for each in kinds for (_, cells), own in zip(self._raw.blocks, each, strict=True) for row in cells[own]
        ]

    def _rows(self, k: int, firsts: IntArray) -> IntArray:
        """Return the row of each point of the file as a node of a mesh, -1 of none."""
        mesh, place = self._meshes[k], self._places[k]
        first = firsts[k] + (0 if mesh.midsurface is None else len(mesh.points))
        return np.where(place >= 0, first + place, -1)

    def _seams(self, rows: list[IntArray]) -> tuple[tuple[TiedFaces, ...], tuple[Seam, ...]]:
        """Divide ties into those of elements of one kind, by rows, and those of nodes with rotations to solids."""
        tied, seams = [], []
        solids = rows[0] if self._meshes[0].midsurface is None else None
        for each in self._raw.connections.ties:
            turning = [own[np.unique(each.face)] for own in rows if own is not solids]
            nodes = np.unique(np.concatenate([*turning, np.zeros(0, dtype=np.int64)]))
            onto = None if solids is None else _on(solids, each.onto)
            if onto is not None and onto.size and nodes.max(initial=-1) >= 0:
                within = None if each.within is None else each.within * self._scale
                seams.append(Seam(each.label, nodes[nodes >= 0], onto, within))
                continue
            both = [(_on(own, each.face), _on(own, each.onto)) for own in rows]
            both = [pair for pair in both if len(pair[0]) == len(each.face) and pair[1].size]
            if not both:
                raise MeshFileError(
                    f"{each.label}: no elements of one kind have its first face and the second; shells follow solids "
                    "and shells, beams follow solids, and link joins others"
                )
            one, other = both[0]
            tied.append(replace(each, points=np.union1d(one, other), face=one, onto=other))
        return tuple(tied), tuple(seams)

    def _shared(self, rows: list[IntArray], seams: Sequence[Seam]) -> IntArray:
        """Return pairs of rows that are one node, but of those that a seam moves."""
        pairs = [np.zeros((0, 2), dtype=np.int64)]
        for k in range(len(rows) - 1, 0, -1):
            for other in range(k - 1, -1, -1):
                both = np.flatnonzero((rows[k] >= 0) & (rows[other] >= 0))
                pairs.append(np.column_stack([rows[other][both], rows[k][both]]))
        found = np.concatenate(pairs)
        return np.asarray(found[~np.isin(found[:, 1], _sewn(seams))])

    def _warn_of_hinges(self, rows: list[IntArray], seams: Sequence[Seam]) -> None:
        """Note nodes of shells and beams that share a solid's without one of their elements lying on it."""
        if self._meshes[0].midsurface is not None:
            return
        on_solid = rows[0] >= 0
        linked = np.zeros(len(on_solid), dtype=bool)
        for each in self._raw.connections.rigid:
            linked[each.points] = each.turning
        for average in self._raw.connections.mean:
            linked[average.points[0]] = average.turning
        for what, kinds, own in zip(("shells", "beams"), self._kinds[1:], _by_kind(self._meshes, rows), strict=True):
            if own is None:
                continue
            held = linked.copy()
            for (_, cells), chosen in zip(self._raw.blocks, kinds, strict=True):
                held[cells[chosen][on_solid[cells[chosen]].all(axis=1)]] = True
            free = np.flatnonzero(on_solid & (own >= 0) & ~held & ~np.isin(own, _sewn(seams)))
            if len(free):
                self._notes.append(
                    f"{len(free)} nodes of {what} are solids' too, which have no rotations, so they turn freely there, "
                    f"as on hinges; {HINGE_MEND}"
                )

    def _warn_of_struts(self, rows: list[IntArray], seams: Sequence[Seam]) -> None:
        """Note nodes of shells that bear the moment of a beam alone, without a beam along the shell or a link."""
        shells, beams = _by_kind(self._meshes, rows)
        if shells is None or beams is None:
            return
        both = (shells >= 0) & (beams >= 0)
        alone = both & ~np.isin(shells, _sewn(seams))
        for (_, cells), chosen in zip(self._raw.blocks, self._kinds[2], strict=True):
            alone[cells[chosen][both[cells[chosen]].all(axis=1)]] = False
        for link in (*self._raw.connections.rigid, *self._raw.connections.mean):
            alone[link.points] = False
        if count := int(np.count_nonzero(alone)):
            self._notes.append(
                f"{count} nodes of shells each bear the end of a beam alone: under a moment on one point a plate turns "
                f"without limit, the more the finer its mesh is; {STRUT_MEND}"
            )

    def _connections(self, rows: list[IntArray], ties: tuple[TiedFaces, ...]) -> Connections | None:
        """Return links, masses and springs by rows of nodes; one with rotations goes before a solid's."""
        raw = self._raw
        row = np.full(len(raw.points), -1)
        solids = rows[0] if self._meshes[0].midsurface is None else None
        for own in (solids, *reversed(_by_kind(self._meshes, rows))):  # a shell's node leads a beam's
            row = row if own is None else np.where(own >= 0, own, row)
        loose = replace(raw.connections, ties=())
        n = int(sum(len(own.points) + count_nodes(own) for own in self._meshes))
        found = connections_in_si(loose, raw.points * self._scale, row, self._scale, *self._units, n)
        if not ties:
            return found
        si = Connections(ties=ties).in_si(self._scale, 1.0, 1.0).ties
        return Connections(ties=si) if found is None else replace(found, ties=si)


def _on(rows: IntArray, face: IntArray) -> IntArray:
    """Return what of a face, of points or of corners of facets, is a mesh's, by its rows."""
    own = rows[face]
    return np.asarray(own[own >= 0] if own.ndim == 1 else own[(own >= 0).all(axis=1)])


def _sewn(seams: Sequence[Seam]) -> IntArray:
    return np.concatenate([np.zeros(0, dtype=np.int64), *(each.nodes for each in seams)])


def _by_kind(meshes: Sequence[SolidMesh], rows: Sequence[IntArray]) -> tuple[IntArray | None, IntArray | None]:
    shells = beams = None
    for mesh, own in zip(meshes, rows, strict=True):
        if mesh.midsurface is not None and mesh.midsurface.has_sections:
            beams = own
        elif mesh.midsurface is not None:
            shells = own
    return shells, beams


def _chosen(block: BlockShells, own: BoolArray) -> BlockShells:
    """Return the sections of some of a block's shells."""
    return BlockShells(block.thickness[own], block.offset[own], block.stack[own], block.direction[own])


def _only(raw: RawMesh, kept: Sequence[BoolArray]) -> RawMesh:
    """Return a mesh with some cells of each block, without connections."""
    number = [np.cumsum(own) - 1 for own in kept]
    keep = [b for b, own in enumerate(kept) if own.any()]
    lines = [own for (kind, _), own in zip(raw.blocks, kept, strict=True) if kind == _LINES]
    beams = raw.beams if any(own.any() for own in lines) else replace(raw.beams, elements=[], faults=[])
    return replace(
        raw,
        blocks=[(raw.blocks[b][0], raw.blocks[b][1][kept[b]]) for b in keep],
        cell_sets={name: [number[b][sets[b]][kept[b][sets[b]]] for b in keep] for name, sets in raw.cell_sets.items()},
        shells=[_chosen(raw.shells[b], kept[b]) for b in keep] if raw.shells else [],
        others={},
        connections=Connections(),
        beams=beams,
        notes=[],
        point_sets=dict(raw.point_sets),
    )

"""Import of a solid mesh from a file of another program: reading, checks and mends."""

from collections.abc import Callable, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.errors import AccuracyError, as_input_error
from fmd.core.limits.files import LARGEST_COORDINATE, MOST_MESH_BYTES
from fmd.fem.cells.table import CELLS, is_solid, solid_cell
from fmd.fem.connections import Connections
from fmd.fem.formats import abaqus, ansys, nastran
from fmd.fem.formats import repair as repairs
from fmd.fem.formats.meshio_reader import read_by_meshio
from fmd.fem.formats.mixed import split_mixed
from fmd.fem.formats.named_sets import PLANE, corners_of, find_faces, find_parts, tie_by_names
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.mesh import SolidMesh, rows_among, three_corners

_TEXT_READERS = {
    **dict.fromkeys(abaqus.SUFFIXES, abaqus.read_abaqus),
    **dict.fromkeys(ansys.SUFFIXES, ansys.read_ansys),
    **dict.fromkeys(nastran.SUFFIXES, nastran.read_nastran),
}
_DECK = "give the deck (.inp, .bdf, .cdb)"
_NO_MESH = {
    **dict.fromkeys(
        (".step", ".stp", ".iges", ".igs", ".brep"), "is CAD, no mesh; give it as mesh = { cad = …, size = … }"
    ),
    **dict.fromkeys((".rst", ".op2", ".f06", ".odb", ".frd", ".db"), f"is of results, no mesh; {_DECK}"),
    **dict.fromkeys(
        (".full", ".op4", ".pch", ".mtx", ".sti", ".mas"), f"is of matrices, no mesh; {_DECK} or `matrices`"
    ),
    ".sub": f"is a superelement of Ansys, which isn't read; {_DECK}",
    ".mail": "is a mesh of Code_Aster as text; write it as .med",
}
T = TypeVar("T")


@dataclass
class _Findings:
    """Faults of a mesh: those corrected without asking, those that repair mends, and those beyond mending."""

    notes: list[str] = field(default_factory=list)
    mendable: list[str] = field(default_factory=list)
    fatal: list[str] = field(default_factory=list)


UNUSABLE = MeshFileError, ValueError, AccuracyError
"""What readers of shells and beams raise for files that can't be used."""


def read_mesh(
    path: Path,
    scale: float,
    repair: bool = False,
    mass_unit: float | None = None,
    force_unit: float | None = None,
    ties: Sequence[tuple[str, str, float | None]] = (),
) -> SolidMesh:
    """Read a solid mesh from a file, check it, and repair it if that is allowed.

    The suffix gives the format, and ``scale`` is the file's unit of length [m]. Element sets become parts; surfaces,
    sets of surface elements and node sets become faces. Repair merges coincident nodes, turns inverted elements,
    straightens edges that turn an element inside out, and leaves out elements that aren't solid; the mesh's notes list
    the mends. Without the file's units of mass [kg] and force [N] lumped masses and springs are refused, but for a file
    in metres. Ties are faces that follow others, by both names and how far apart they may be [m], beside those of the
    file.

    Raises
    ------
    InputError
        The file can't be read, or its mesh can't be used; the message counts what is wrong.
    """
    with as_input_error(str(path), of=MeshFileError):
        raw = split_mixed(read_sound(path))
        return solid_mesh(tie_by_names(raw, scale, ties) if ties else raw, scale, repair, mass_unit, force_unit)


def read_raw(path: Path) -> RawMesh:
    """Read a file by the reader of its suffix."""
    reader = _TEXT_READERS.get(path.suffix.lower())
    try:
        if not path.is_file():
            raise MeshFileError("is a folder; give the mesh file in it" if path.is_dir() else "no such file")
        if path.stat().st_size > MOST_MESH_BYTES:
            raise MeshFileError(f"is over {MOST_MESH_BYTES / 1e9:g} GB")
        if path.suffix.lower() in _NO_MESH:
            raise MeshFileError(_NO_MESH[path.suffix.lower()])
        if reader is None:
            return read_by_meshio(path)
        return reader(path.read_text(encoding="utf-8", errors="replace"))
    except OSError as error:
        raise MeshFileError(f"can't be read: {error.strerror or error}") from error


def read_sound(path: Path) -> RawMesh:
    """Read a file by the reader of its suffix; refuses nodes that aren't there or aren't numbers."""
    raw = read_raw(path)
    require_sound(raw)
    return raw


def link_taken(
    raw: RawMesh,
    taken: tuple[T, IntArray],
    finish: Callable[[T], SolidMesh],
    scale: float,
    units: tuple[float | None, float | None],
) -> SolidMesh:
    """Return the mesh of what was taken of a file, with the file's links between its nodes.

    What was taken isn't solid, and comes with the number that each of the file's points has in it, -1 of no element;
    ``finish`` makes the mesh of it. The file's units are of length [m], mass [kg] and force [N].
    """
    own, place = taken
    links = connections_in_si(raw.connections, raw.points * scale, place, scale, *units)
    mesh = finish(own)
    return replace(mesh, connections=links, notes=mesh.notes + connection_notes(links))


def number_used(cells: IntArray, n_points: int) -> tuple[IntArray, IntArray]:
    """Return the points of cells, and the number of each point among these, shape (n_points,), -1 of no cell."""
    used = np.unique(cells)
    place = np.full(n_points, -1)
    place[used] = np.arange(len(used))
    return used, place


def require_one_piece(raw: RawMesh, cells: IntArray, what: str) -> None:
    """Raise ``MeshFileError`` for cells, such as ``shells``, that neither nodes nor links join."""
    n_pieces = len(repairs.size_pieces(cells, len(raw.points), raw.connections.point_groups))
    if n_pieces > 1:
        raise MeshFileError(f"its {what} are in {n_pieces} unconnected pieces; join them at common nodes, or by links")


def solid_mesh(
    raw: RawMesh, scale: float, repair: bool = False, mass_unit: float | None = None, force_unit: float | None = None
) -> SolidMesh:
    """Check and convert a raw mesh to a solid one, with the arguments of `read_mesh`.

    Raises
    ------
    MeshFileError
        The mesh can't be used; the message counts its faults.
    """
    mesh, place = place_solids(raw, scale, repair, raw.connections.point_groups)
    connections = connections_in_si(raw.connections, raw.points * scale, place, scale, mass_unit, force_unit)
    notes = list(mesh.notes)
    lone = len(raw.points) - len(
        np.unique(np.concatenate([raw.connections.points, *(b.ravel() for _, b in raw.blocks)]))
    )
    if lone:
        notes.append(f"{lone} nodes that belong to no element are left out")
    return replace(mesh, notes=(*notes, *connection_notes(connections)), connections=connections)


def place_solids(raw: RawMesh, scale: float, repair: bool, joined: Sequence[IntArray]) -> tuple[SolidMesh, IntArray]:
    """Return the mesh of the solids, and the number of each point of the file in it, -1 of none.

    Each array of ``joined`` has the points of something that joins pieces of the mesh.

    Raises
    ------
    MeshFileError
        The mesh can't be used; the message counts its faults.
    """
    require_sound(raw)
    findings = _Findings(list(raw.notes))
    cell_type, cells = _solid_cells(raw)
    points = raw.points * scale
    cells, first = _merge_coincident(points, cells, cell_type, joined, findings)
    kept = _find_sound_cells(cells, findings)
    cells = cells[kept]
    if not findings.fatal:
        points, cells = _turn_right_side_out(points, cells, cell_type, findings)
    _note_loose_elements(raw, cells, cell_type, first, findings)
    if findings.fatal or (findings.mendable and not repair):
        raise MeshFileError(_complaint(findings))
    used, place = number_used(cells, len(points))
    mesh = SolidMesh(
        points[used],
        place[cells],
        cell_type,
        find_parts(raw, kept),
        find_faces(raw, place[first]),
        notes=(*findings.notes, *(f"mended: {what}" for what in findings.mendable)),
    )
    return mesh, place[first]


def connection_notes(found: Connections | None) -> tuple[str, ...]:
    """Return the note of a file's connections, if it has some."""
    if found is None:
        return ()
    listed = ", ".join(f"{n} {kind}" for kind, n in found.count().items())
    return (f"links and masses of the file belong to the body: {listed}",)


def connections_in_si(
    found: Connections,
    points: Array,
    place: IntArray,
    scale: float,
    mass_unit: float | None,
    force_unit: float | None,
    n_nodes: int | None = None,
) -> Connections | None:
    """Return a file's connections in SI units, between the mesh's nodes and further points; ``None`` if it has none."""
    if not found.all:
        return None
    in_metres = scale == 1.0
    for some, unit, key, example in (
        (found.masses, mass_unit, "mass_unit", "'kg' or 't'"),
        (found.springs, force_unit, "force_unit", "'N'"),
    ):
        if some and unit is None and not in_metres:
            raise MeshFileError(f"has {some[0].label}; say the file's unit, mesh.{key} = {example}")
    free = found.points[place[found.points] < 0]
    n = int(place.max()) + 1 if n_nodes is None else n_nodes
    number = {int(point): int(place[point]) for point in found.points if place[point] >= 0}
    number |= {int(point): n + k for k, point in enumerate(free)}
    number |= {
        int(corner): int(place[corner]) for each in found.mean for facets in each.facets for corner in facets.flat
    }
    return found.numbered(number, points[free]).in_si(scale, mass_unit or 1.0, force_unit or 1.0)


def require_sound(raw: RawMesh) -> None:
    """Raise ``MeshFileError`` for coordinates, cells or sets that are no mesh at all."""
    bad = int(np.count_nonzero(~(np.abs(raw.points) < LARGEST_COORDINATE).all(axis=1)))
    if bad:
        raise MeshFileError(f"{bad} nodes have coordinates that aren't numbers below {LARGEST_COORDINATE:g}")
    for kind, cells in raw.blocks:
        if cells.size and (cells.min() < 0 or cells.max() >= len(raw.points)):
            raise MeshFileError(f"elements ({kind}) name nodes that aren't there")
    sets = [*raw.point_sets.values(), *(s for sets in raw.cell_sets.values() for s in sets)]
    if any(chosen.size and chosen.min() < 0 for chosen in sets):
        raise MeshFileError("a set names what isn't there")


def _solid_cells(raw: RawMesh) -> tuple[str, IntArray]:
    """Return the one type of solid cells in the file, and their points, block after block."""
    count, listed = replace(raw, others={}).count_elements(), raw.list_elements()
    solids = [kind for kind in count if is_solid(kind)]
    if not solids:
        plane = any(kind.startswith(PLANE) for kind in count)
        mend = "; mesh.shell = '2 mm' takes triangles and quadrilaterals as shells" if plane else ""
        mend += "; mesh.beam = 'deck' takes lines as beams" if "line" in count and not plane else ""
        raise MeshFileError(f"there are no solid elements; the elements: {listed}{mend}")
    for kind in solids:
        if kind not in CELLS:
            raise MeshFileError(f"solid elements of kind {kind} aren't read, {', '.join(CELLS)} are; it has {listed}")
    return solids[0], np.concatenate([cells for kind, cells in raw.blocks if kind == solids[0]])


def _merge_coincident(
    points: Array, cells: IntArray, cell_type: str, linked: Sequence[IntArray], findings: _Findings
) -> tuple[IntArray, IntArray]:
    """Merge nodes at one position; return the cells and for each node the one that replaces it.

    Pieces that links join are one, and stay apart where they touch.
    """
    apart = np.arange(len(points))
    if len(linked) and len(repairs.size_pieces(cells, len(points), linked)) == 1:
        return cells, apart
    first = repairs.find_coincident(points, cells, cell_type)
    n_merged = len(np.unique(cells)) - len(np.unique(first[cells]))
    n_pieces, sizes = len(repairs.size_pieces(cells, len(points))), repairs.size_pieces(first[cells], len(points))
    n_joined = len(sizes)
    if n_joined > 1:
        listed = ", ".join(str(size) for size in sizes[:5]) + (" …" if len(sizes) > 5 else "")
        findings.fatal.append(
            f"it is in {n_joined} unconnected pieces, of {listed} elements; join them, by mesh.tie where "
            "faces meet, or leave one"
        )
    if not n_merged:
        return cells, apart
    collapsed = (np.diff(np.sort(first[cells], axis=1), axis=1) == 0).any(axis=1)
    what = f"{n_merged} nodes lie on others, which leaves it in {n_pieces} pieces: merged"
    if n_pieces == n_joined or collapsed.any():
        findings.notes.append(f"{n_merged} nodes lie on others, as along a crack, and are left apart")
        return cells, apart
    findings.mendable.append(what)
    return first[cells], first


def _find_sound_cells(cells: IntArray, findings: _Findings) -> IntArray:
    """Return the numbers of the cells to keep, each once; cells with a node twice are beyond mending."""
    rows = np.sort(cells, axis=1)
    collapsed = int((np.diff(rows, axis=1) == 0).any(axis=1).sum())
    if collapsed:
        findings.fatal.append(f"{collapsed} elements have a node more than once, as collapsed ones do")
    _, kept = np.unique(rows, axis=0, return_index=True)
    again = len(cells) - len(kept)
    if again and not collapsed:
        findings.mendable.append(f"{again} elements lie on others with the same nodes: left out")
        return np.sort(kept)
    return np.arange(len(cells))


def _turn_right_side_out(points: Array, cells: IntArray, cell_type: str, findings: _Findings) -> tuple[Array, IntArray]:
    """Correct the order of nodes, and straighten the cells that are inside out even so."""
    hand = repairs.handedness(points, cells, cell_type)
    spoilt, turned = int((hand == 0).sum()), int((hand < 0).sum())
    if spoilt:
        worst = int(np.flatnonzero(hand == 0)[0])
        x = ", ".join(f"{value:.4g}" for value in points[cells[worst]].mean(axis=0))
        findings.fatal.append(f"{spoilt} of {len(cells)} elements are flat, twisted or concave, the first at ({x}) m")
        return points, cells
    if turned == len(cells):
        findings.notes.append(f"all {turned} elements have their nodes in left-handed order and were turned")
    elif turned:
        findings.mendable.append(f"{turned} of {len(cells)} elements are inverted: turned")
    cells = cells.copy()
    cells[hand < 0] = cells[hand < 0][:, solid_cell(cell_type).mirrored]
    if solid_cell(cell_type).order == 1:
        return points, cells
    order = repairs.find_node_order(points, cells, cell_type)
    if order is not None:
        findings.notes.append("the mid-edge nodes come in another order than the format's and were put into it")
        cells = cells[:, order]
    wrong = repairs.find_inside_out(points, cells, cell_type)
    if len(wrong):
        straight, n_cells, moved = repairs.straighten_cells(points, cells, cell_type, wrong)
        findings.mendable.append(
            f"{len(wrong)} elements are inside out by their curved edges: {n_cells} straightened by up to {moved:.3g} m"
        )
        if len(repairs.find_inside_out(straight, cells, cell_type)):
            findings.fatal.append("elements that are inside out by their curved edges stay so with straight ones")
        points = straight
    return points, cells


def _note_loose_elements(raw: RawMesh, cells: IntArray, cell_type: str, first: IntArray, findings: _Findings) -> None:
    """Note the elements that are neither solid nor on a solid's faces or edges: they would be lost."""
    facets = np.concatenate([three_corners(cells[:, list(face)]) for face in solid_cell(cell_type).shape.faces])
    sides = np.sort(repairs.edges(cells, cell_type).reshape(-1, 2), axis=1)
    loose: dict[str, int] = dict(raw.others)
    on_solid = 0
    for kind, block in raw.blocks:
        if kind.startswith(PLANE):
            on = int(rows_among(three_corners(first[block[:, : corners_of(kind)]]), facets).sum())
            on_solid += on
            lost = len(block) - on
        elif kind.startswith("line"):
            lost = len(block) - int(rows_among(np.sort(first[block[:, :2]], axis=1), sides).sum())
        else:
            continue
        if lost:
            loose[kind] = loose.get(kind, 0) + lost
    if on_solid:
        findings.notes.append(f"{on_solid} surface elements on the solid's facets count as its faces, not as shells")
    if loose:
        listed = ", ".join(f"{n} {kind}" for kind, n in loose.items())
        keys = [
            key for key, kinds in (("shell", PLANE), ("beam", ("line",))) if any(k.startswith(kinds) for k in loose)
        ]
        taken = "".join(f"; mesh.{key} takes them as {key}s" for key in keys)
        findings.mendable.append(f"elements that aren't solid ({listed}): left out{taken}")


def _complaint(findings: _Findings) -> str:
    """Return the error message for a mesh with faults."""
    wrong = "; ".join([*findings.fatal, *findings.mendable])
    if findings.fatal:
        return f"its mesh can't be used: {wrong}"
    return f"its mesh needs mending, which mesh.repair = true (or --repair) does: {wrong}"

"""Import of shells from the triangles and quadrilaterals of a mesh file."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.fem.cells.table import is_solid
from fmd.fem.formats.import_mesh import link_taken, number_used, require_one_piece
from fmd.fem.formats.named_sets import faces_of_points
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.mesh import SolidMesh
from fmd.fem.midsurface import Layup
from fmd.fem.thicken import Sheet, thicken

THICKNESS_ALONE = "mesh.shell's thickness is all that shells have in their place"
SHELLS = {"triangle": 3, "quad": 4}
_NONE = np.empty(0, dtype=np.int64)


class GivenSections(NamedTuple):
    """Sections that a scene gives to a file's shells: thickness and offset."""

    thickness: float | None = None  # of all [m]; ``None`` for that of the deck's sections
    offset: float = 0.0  # distance of the middle from the nodes along the normal, beside that of a deck [m]
    by_part: Mapping[str, float] = MappingProxyType({})  # thickness of single parts, where it differs [m]
    halvings: int = 0  # times that each shell is divided into four


def mesh_shells(
    raw: RawMesh, scale: float, given: GivenSections, units: tuple[float | None, float | None]
) -> SolidMesh:
    """Return the mesh of a file that holds shells alone, by its units of mass and of force."""
    found = take_shells(raw, scale, given)
    require_one_piece(
        raw, np.concatenate([cells[:, [0, 1, 2, -1]] for _, cells in raw.blocks if cells.shape[1] > 2]), "shells"
    )
    return link_taken(raw, found, thicken, scale, units)


def take_shells(raw: RawMesh, scale: float, sections: GivenSections) -> tuple[Sheet, IntArray]:
    """Take the shells of a raw mesh; return their sheet, and the number of each point of the file there, -1 of none."""
    count, listed = raw.count_elements(), raw.list_elements()
    if any(map(is_solid, count)):
        raise MeshFileError(f"mesh.shell is of shells alone, and the file has solid elements: {listed}")
    given = [(b, kind, cells) for b, (kind, cells) in enumerate(raw.blocks) if kind in SHELLS and len(cells)]
    if not given:
        raise MeshFileError(f"there are no shells of three or four nodes; the elements: {listed}")
    lost = {kind: n for kind, n in count.items() if kind not in (*SHELLS, "vertex")}
    if lost:
        names = ", ".join(f"{n} {kind}" for kind, n in lost.items())
        mend = (
            "; curves of Gmsh are faces by its .msh, lines with sections are beams by mesh.beam"
            if "line" in lost
            else ""
        )
        raise MeshFileError(f"elements beside shells of three or four nodes aren't read with mesh.shell: {names}{mend}")
    notes = list(raw.notes)
    split = len({kind for _, kind, _ in given}) > 1
    blocks, source = [], []  # of each element the block and its number there
    for b, kind, cells in given:
        number, own = np.arange(len(cells)), cells
        if split and kind == "quad":
            notes.append(f"{len(cells)} quadrilaterals beside triangles are split into two triangles each")
            own, number = _halved(cells, raw.points), np.repeat(number, 2)
        blocks.append(own)
        source.append(np.stack([np.full(len(number), b), number], axis=1))
    cells, of = np.concatenate(blocks), np.concatenate(source)
    refuse_collapsed(cells)
    used, place = number_used(cells, len(raw.points))
    t, offset, layup = _sections(raw, of, cells, scale, sections.thickness)
    if raw.shell_faults and sections.thickness is not None:
        notes.append(f"sections of shells that aren't read: {_listed(raw.shell_faults)}; {THICKNESS_ALONE}")
    sets = {name: _members(chosen, of) for name, chosen in raw.cell_sets.items()}
    sets = {name: own for name, own in sets.items() if len(own)}
    rest = np.setdiff1d(np.arange(len(cells)), np.concatenate([_NONE, *sets.values()]))
    parts = sets | ({"rest" if sets else "all": rest} if len(rest) else {})
    for name, thickness in _own_thickness(sections.by_part, parts).items():
        if layup is not None and (layup.numbers[parts[name]] >= 0).any():
            raise MeshFileError(f"mesh.thickness of {name}, whose shells have layers by the deck")
        t[parts[name]] = thickness
    if without := int(np.count_nonzero(~(t > 0).all(axis=1))):
        raise MeshFileError(f"{without} of its {len(t)} shells have no thickness above 0 by a section")
    faces = faces_of_points(raw, place)
    sheet = Sheet(
        raw.points[used] * scale,
        place[cells],
        t,
        parts,
        faces,
        {name: own for name, own in sets.items() if name not in raw.point_sets},
        ("bottom", "top"),
        offset,
        layup,
        notes=tuple(notes),
        shift=sections.offset,
    )
    return sheet, place


def _sections(
    raw: RawMesh, of: IntArray, cells: IntArray, scale: float, thickness: float | None
) -> tuple[Array, Array, Layup | None]:
    """Return thickness at the nodes and offset of each element [m], and layers, if there are any and none is given."""
    if not raw.shells and thickness is None:
        raise MeshFileError("says no thickness of its shells; give one, mesh.shell = '2 mm'")
    if raw.shell_faults and thickness is None:
        listed = _listed(raw.shell_faults)
        raise MeshFileError(f"sections of shells that aren't read: {listed}; give mesh.shell a thickness")
    t, offset = np.full(cells.shape, np.nan if thickness is None else thickness), np.zeros(len(of))
    stack, direction = np.full(len(of), -1), np.zeros((len(of), 3))
    for b, block in enumerate(raw.shells):
        own = np.flatnonzero(of[:, 0] == b)
        there = of[own, 1]
        offset[own] = scale * block.offset[there]
        if thickness is None:
            corner = (raw.blocks[b][1][there][:, None] == cells[own][:, :, None]).argmax(axis=2)
            t[own] = scale * np.take_along_axis(block.thickness[there], corner, axis=1)
            stack[own], direction[own] = block.stack[there], block.direction[there]
    if not (stack >= 0).any():
        return t, offset, None
    stacks = tuple(tuple((name, scale * each, angle) for name, each, angle in plies) for plies in raw.stacks)
    return t, offset, Layup(stacks, stack, direction)


def _own_thickness(given: Mapping[str, float], parts: Mapping[str, IntArray]) -> dict[str, float]:
    """Return thickness [m] by the mesh's names of parts, the largest first: of parts within parts the smallest counts.

    Upper and lower case may differ.
    """
    known = {name.casefold(): name for name in parts}
    if missing := [name for name in given if name.casefold() not in known]:
        raise MeshFileError(f"mesh.thickness of {missing[0]}, and the parts are {', '.join(parts)}")
    own = {known[name.casefold()]: thickness for name, thickness in given.items()}
    order = sorted(own, key=lambda name: -len(parts[name]))
    for k, name in enumerate(order):
        for other in order[:k]:
            common = len(np.intersect1d(parts[name], parts[other]))
            whole = len(parts[name]) if len(parts[name]) < len(parts[other]) else 0
            if common not in (0, whole) and own[name] != own[other]:
                raise MeshFileError(f"mesh.thickness of {other} and of {name}, which share {common} shells")
    return {name: own[name] for name in order}


def refuse_collapsed(cells: IntArray) -> None:
    """Raise ``MeshFileError`` if shells (n_cells, n_local) have a node more than once."""
    if repeated := int((np.diff(np.sort(cells, axis=1), axis=1) == 0).any(axis=1).sum()):
        raise MeshFileError(
            f"{repeated} shells have a node more than once, as collapsed ones do; write them as triangles"
        )


def _listed(faults: list[str]) -> str:
    """Return the first fault and how many more there are."""
    return faults[0] + ("" if len(faults) == 1 else f" and {len(faults) - 1} more")


def _members(chosen: list[IntArray], of: IntArray) -> IntArray:
    """Return the elements of a set that has its members by blocks."""
    own = [(of[:, 0] == b) & np.isin(of[:, 1], cells) for b, cells in enumerate(chosen) if len(cells)]
    return np.flatnonzero(np.any(own, axis=0)) if own else _NONE


def _halved(cells: IntArray, x: Array) -> IntArray:
    """Split quadrilaterals along their shorter diagonals, shape (2 n, 3)."""
    one, other = (np.linalg.norm(x[cells[:, k]] - x[cells[:, k + 2]], axis=1) for k in (0, 1))
    turned = np.where((other < one)[:, None], np.roll(cells, -1, axis=1), cells)
    return np.asarray(turned[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))

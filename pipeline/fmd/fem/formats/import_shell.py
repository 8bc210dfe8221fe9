"""Import of shells from the triangles and quadrilaterals of a mesh file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import AccuracyError, InputError
from fmd.fem.cells.table import is_solid
from fmd.fem.formats.import_mesh import connection_notes, connections_in_si, read_raw, require_sound
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.formats.repair import count_pieces
from fmd.fem.mesh import SolidMesh
from fmd.fem.thicken import Sheet, thicken

_SHELLS = {"triangle": 3, "quad": 4}
_NONE = np.empty(0, dtype=np.int64)


def read_shell(
    path: Path,
    scale: float,
    thickness: float | None,
    mass_unit: float | None = None,
    force_unit: float | None = None,
) -> SolidMesh:
    """Read the triangles and quadrilaterals of a file as shells.

    Parameters
    ----------
    path : Path
        The file, its format given by the suffix. Element sets become parts and, with both of their sides, faces; node
        sets become faces: all of the surface between their nodes.
    scale : float
        The file's unit of length [m].
    thickness : float, optional
        Of all shells [m]; by default that of the deck's sections.
    mass_unit, force_unit : float, optional
        The file's units [kg], [N]. Without, lumped masses and springs are refused, but for a file in metres.

    Raises
    ------
    InputError
        The file can't be read, or its mesh can't be used; the message counts what is wrong.
    """
    try:
        raw = read_raw(path)
        sheet, place = _sheet(raw, scale, thickness)
        links = connections_in_si(raw.connections, raw.points * scale, place, scale, mass_unit, force_unit)
        mesh = thicken(sheet)
        return replace(mesh, connections=links, notes=mesh.notes + connection_notes(links))
    except (MeshFileError, ValueError, AccuracyError) as error:
        raise InputError(str(path), "", None, str(error)) from error


def _sheet(raw: RawMesh, scale: float, thickness: float | None) -> tuple[Sheet, IntArray]:
    """Check a raw mesh and take its shells; return their sheet, and the number that each point of the file has there.

    Points of no shell have -1.
    """
    require_sound(raw)
    count: dict[str, int] = dict(raw.others)
    for kind, cells in raw.blocks:
        count[kind] = count.get(kind, 0) + len(cells)
    listed = ", ".join(f"{n} {kind}" for kind, n in count.items() if n) or "none"
    if any(is_solid(kind) and n for kind, n in count.items()):
        raise MeshFileError(f"mesh.shell is of shells alone, and the file has solid elements: {listed}")
    given = [(b, kind, cells) for b, (kind, cells) in enumerate(raw.blocks) if kind in _SHELLS and len(cells)]
    if not given:
        raise MeshFileError(f"there are no shells of three or four nodes; the elements: {listed}")
    lost = {kind: n for kind, n in count.items() if kind not in (*_SHELLS, "vertex") and n}
    if lost:
        names = ", ".join(f"{n} {kind}" for kind, n in lost.items())
        raise MeshFileError(f"elements beside shells of three or four nodes aren't read with mesh.shell: {names}")
    notes = []
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
    repeated = int((np.diff(np.sort(cells, axis=1), axis=1) == 0).any(axis=1).sum())
    if repeated:
        raise MeshFileError(
            f"{repeated} shells have a node more than once, as collapsed ones do; write them as triangles"
        )
    n_pieces = count_pieces(cells, len(raw.points), raw.connections.point_groups)
    if n_pieces > 1:
        raise MeshFileError(f"its shells are in {n_pieces} unconnected pieces; join them at common nodes, or by links")
    used = np.unique(cells)
    place = np.full(len(raw.points), -1)
    place[used] = np.arange(len(used))
    t, offset = _sections(raw, of, scale, thickness)
    sets = {name: _members(chosen, of) for name, chosen in raw.cell_sets.items()}
    sets = {name: own for name, own in sets.items() if len(own)}
    rest = np.setdiff1d(np.arange(len(cells)), np.concatenate([_NONE, *sets.values()]))
    parts = sets | ({"rest" if sets else "all": rest} if len(rest) else {})
    faces = {name: place[nodes][place[nodes] >= 0] for name, nodes in raw.point_sets.items()}
    sheet = Sheet(
        raw.points[used] * scale,
        place[cells],
        t,
        parts,
        {name: nodes for name, nodes in faces.items() if len(nodes)},
        {name: own for name, own in sets.items() if name not in faces},
        ("bottom", "top"),
        offset,
        notes=tuple(notes),
    )
    return sheet, place


def _sections(raw: RawMesh, of: IntArray, scale: float, thickness: float | None) -> tuple[Array, Array]:
    """Return thickness and offset of each element [m]."""
    if not raw.shells and thickness is None:
        raise MeshFileError("says no thickness of its shells; give one, mesh.shell = '2 mm'")
    if raw.shell_faults and thickness is None:
        more = "" if len(raw.shell_faults) == 1 else f" and {len(raw.shell_faults) - 1} more"
        raise MeshFileError(
            f"sections of shells that aren't read: {raw.shell_faults[0]}{more}; give mesh.shell a thickness"
        )
    t, offset = np.full(len(of), np.nan if thickness is None else thickness), np.zeros(len(of))
    for b, (thick, off) in enumerate(raw.shells):
        own = np.flatnonzero(of[:, 0] == b)
        offset[own] = scale * off[of[own, 1]]
        if thickness is None:
            t[own] = scale * thick[of[own, 1]]
    without = int(np.count_nonzero(~(t > 0)))
    if without:
        raise MeshFileError(f"{without} of its {len(t)} shells have no thickness above 0 by a section")
    return t, offset


def _members(chosen: list[IntArray], of: IntArray) -> IntArray:
    """Return the elements of a set that has its members by blocks."""
    own = [(of[:, 0] == b) & np.isin(of[:, 1], cells) for b, cells in enumerate(chosen) if len(cells)]
    return np.flatnonzero(np.any(own, axis=0)) if own else _NONE


def _halved(cells: IntArray, x: Array) -> IntArray:
    """Split quadrilaterals along their shorter diagonals, shape (2 n, 3)."""
    one, other = (np.linalg.norm(x[cells[:, k]] - x[cells[:, k + 2]], axis=1) for k in (0, 1))
    turned = np.where((other < one)[:, None], np.roll(cells, -1, axis=1), cells)
    return np.asarray(turned[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))

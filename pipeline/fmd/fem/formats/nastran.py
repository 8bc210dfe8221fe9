"""Reader of Nastran bulk data files: grid points and elements, with a set for each property.

meshio's own reader mistakes a grid point's coordinate system for a label and a cell with missing nodes for a shorter
one, and never returns from a file that is cut off.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.fortran import read_field
from fmd.fem.cells.table import CELLS
from fmd.fem.connections import Connections
from fmd.fem.formats.beam_sections import NastranBeams
from fmd.fem.formats.coordinate_systems import CoordinateSystems
from fmd.fem.formats.nastran_links import NastranLinks
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.formats.shell_sections import NastranShells

SUFFIXES = (".bdf", ".nas", ".fem")
_SOLIDS: dict[str, dict[int, str]] = {}
for _cell_type in CELLS.values():
    for _card in _cell_type.nastran:
        _SOLIDS.setdefault(_card, {})[len(_cell_type.nodes)] = _cell_type.name
_PLANES = {
    "CTRIA3": {3: "triangle"},
    "CTRIAR": {3: "triangle"},
    "CTRIA6": {3: "triangle", 6: "triangle6"},
    "CQUAD4": {4: "quad"},
    "CQUADR": {4: "quad"},
    "CQUAD8": {4: "quad", 8: "quad8"},
}
_LINES = ("CBAR", "CBEAM", "CROD", "CTUBE", "CBEND")
_OTHERS = (
    "CSHEAR",
    "CONM1",
    "CONROD",
    "CBUSH",
    "CBUSH1D",
    "CGAP",
    "RBE1",
    "RROD",
    "RTRPLT",
    "RSPLINE",
    "RSSCON",
    "MPCADD",
)
_OTHER = re.compile(r"CELAS\d|CDAMP\d|CMASS\d|CVISC|CWELD|CFAST")


def read_nastran(text: str) -> RawMesh:
    """Read the mesh in the text of a bulk data file, in small, large or free fields.

    Raises
    ------
    MeshFileError
        The text is damaged, or has a form that isn't read; the message gives the line.
    """
    points: dict[int, GridPoint] = {}
    systems: list[tuple[str, list[str]]] = []
    default, named = list[str](), list[int]()
    cells: dict[str, list[list[int]]] = defaultdict(list)
    properties: dict[str, list[str]] = defaultdict(list)
    others: dict[str, int] = defaultdict(int)
    seen: set[int] = set()
    links, shells, beams = NastranLinks(), NastranShells(), NastranBeams()
    for line, name, fields in read_cards(text):
        try:
            if name == "GRID":
                if _take_point(fields, points):
                    named.append(int(fields[0]))
            elif name == "GRDSET":
                default = default or fields
            elif name in _SOLIDS or name in _PLANES or name in _LINES:
                kind, nodes = _cell(name, fields)
                number = int(fields[0])
                if number in seen:
                    raise MeshFileError(f"element {number} is given twice")
                seen.add(number)
                cells[kind].append(nodes)
                properties[kind].append(fields[1])
                if name in _PLANES:
                    shells.add(kind, max(_PLANES[name]), fields)
                elif kind == "line":
                    beams.add(name, fields)
            elif shells.takes(name, fields) or beams.takes(name, fields) or links.takes(name, fields):
                pass
            elif name in _OTHERS or _OTHER.fullmatch(name):
                others[name] += 1
            elif name.startswith("CORD"):
                systems.append((name, fields))
            elif name == "INCLUDE":
                raise MeshFileError("INCLUDE isn't followed; put all into one file")
        except MeshFileError as error:
            raise MeshFileError(f"line {line}: {error}") from None
        except (ValueError, IndexError, OverflowError):
            raise MeshFileError(f"line {line}: {name} has fields that aren't the numbers they should be") from None
    if not points:
        raise MeshFileError("there are no grid points: no GRID lines")
    if named and "".join(default[1:2]) not in ("", "0"):
        raise MeshFileError(f"grid point {named[0]} is given twice, at two places")
    known = CoordinateSystems(systems)
    within = {number: grid_systems(point.systems, default) for number, point in points.items()}
    x = _basic_places(points, within, known)
    moves = {number: moving for number, (_, moving) in within.items() if moving not in ("", "0")}
    links.turned.update(moves)
    place = {number: k for k, number in enumerate(points)}
    begin = _begin_bulk(text)
    try:
        connections = links.connections(text[:begin], begin > 0, place)
    except ValueError as error:
        raise MeshFileError(str(error)) from None
    raw = RawMesh(np.array(list(x.values())), others=dict(others), connections=connections)
    raw.beams = beams.finished(x, moves, known.directions)
    raw.blocks = [(kind, _number_nodes(kind, rows, place)) for kind, rows in cells.items()]
    by_block = {kind: properties[kind] for kind in cells}
    raw.shells = shells.of_blocks(by_block, raw.blocks, raw.points, known.directions)
    raw.stacks, raw.shell_faults = shells.stacks, shells.faults
    raw.cell_sets |= _sets_by_property(by_block)
    return raw


def _number_nodes(kind: str, rows: list[list[int]], place: Mapping[int, int]) -> IntArray:
    """Return the nodes of elements of a kind by their places, in the order of our cells."""
    try:
        numbers = np.array([[place[node] for node in row] for row in rows], dtype=np.int64)
    except KeyError as error:
        raise MeshFileError(f"an element names grid point {error}, which isn't there") from None
    order = CELLS[kind].nastran_order if kind in CELLS else ()
    return numbers[:, order] if order else numbers


def _sets_by_property(by_block: Mapping[str, list[str]]) -> dict[str, list[IntArray]]:
    """Return the elements of each block that have a property, by its name."""
    found = dict[str, list[IntArray]]()
    for b, labels in enumerate(map(np.array, by_block.values())):
        for label in np.unique(labels):
            sets = found.setdefault(f"property-{label or 'none'}", [np.empty(0, int) for _ in by_block])
            sets[b] = np.flatnonzero(labels == label)
    return found


def read_grid_points(text: str) -> tuple[IntArray, Array, Connections]:
    """Return numbers (n,) and positions (n, 3) of a deck's grid points, ascending as in matrices, and connections.

    Raises
    ------
    MeshFileError
        A grid point moves in a coordinate system of its own, or a link isn't one of those that are read.
    """
    numbers: dict[int, None] = {}
    lines: dict[str, tuple[int, str]] = {}  # of grid points that differ in CD: the first, its line
    default = list[str]()
    for line, name, fields in read_cards(text):
        if name == "GRID":
            lines.setdefault("".join(fields[5:6]), (line, fields[0]))
            numbers[int(fields[0]) if fields[0].isdigit() else 0] = None
        elif name == "GRDSET":
            default = default or fields
        elif name == "SPOINT":
            raise MeshFileError(f"line {line}: SPOINT {fields[0]} has rows without a grid point; leave it out")
        elif name in ("RBE1", "RROD", "RTRPLT", "RSPLINE", "RSSCON"):
            raise MeshFileError(f"line {line}: {name} isn't in KGG, which comes before it, and isn't read")
    for own, (line, number) in lines.items():
        if (moves := grid_systems(("", own), default)[1]) not in ("", "0"):
            raise MeshFileError(
                f"line {line}: grid point {number} moves in coordinate system {moves}, its CD, by which its "
                "rows are turned; write the deck with CD = 0"
            )
    raw = read_nastran(text)
    order = np.argsort(list(numbers))
    place = {int(old): new for new, old in enumerate(order)}
    return np.array(list(numbers), dtype=np.int64)[order], raw.points[order], raw.connections.numbered(place)


class GridPoint(NamedTuple):
    """A grid point by its card: its coordinates, and the systems that it lies in (CP) and moves in (CD)."""

    x: list[float]
    systems: tuple[str, str]


def _basic_places(
    points: Mapping[int, GridPoint], within: Mapping[int, tuple[str, str]], systems: CoordinateSystems
) -> dict[int, Array]:
    """Return the places of grid points in the basic system."""
    found = {}
    for number, point in points.items():
        try:
            found[number] = systems.find(within[number][0]).place(np.array(point.x))
        except MeshFileError as error:
            raise MeshFileError(f"grid point {number}: {error}") from None
    return found


def grid_systems(own: tuple[str, str], default: Sequence[str]) -> tuple[str, str]:
    """Return the systems that a grid point lies in (CP) and moves in (CD), of GRDSET where its own fields are blank."""
    return own[0] or "".join(default[1:2]), own[1] or "".join(default[5:6])


def _take_point(fields: list[str], points: dict[int, GridPoint]) -> bool:
    """Add a grid point; return True if it is given again, once with the basic system named and once with none."""
    number = int(fields[0])
    x = [read_field(field) for field in fields[2:5]]
    found = GridPoint(x + [0.0] * (3 - len(x)), (fields[1], "".join(fields[5:6])))
    before = points.setdefault(number, found)
    if before.x != found.x or (before.systems[0] or "0") != (found.systems[0] or "0"):
        raise MeshFileError(f"grid point {number} is given twice, at two places")
    return before.systems[0] != found.systems[0]


def _cell(name: str, fields: list[str]) -> tuple[str, list[int]]:
    if name in _LINES:
        return "line", [int(field) for field in fields[2:4]]
    kinds = _SOLIDS.get(name) or _PLANES[name]
    n_full = max(kinds)
    given = [*fields[2 : 2 + n_full], *[""] * n_full][:n_full]
    nodes = [int(field) if field else 0 for field in given]
    n_local = next(n for n in sorted(kinds) if not any(nodes[n:]))
    if not all(nodes[:n_local]):
        missing = sum(node == 0 for node in nodes[:n_local])
        raise MeshFileError(
            f"{name} {fields[0]} lacks {missing} of {n_local} nodes; give it all its mid-edge nodes or none"
        )
    return kinds[n_local], nodes[:n_local]


def read_cards(text: str) -> Iterator[tuple[int, str, list[str]]]:
    """Yield line number, name and fields, without the continuation marks, of each card of the bulk data."""
    lines = text.splitlines()
    begin = text[: _begin_bulk(text)].count("\n") + bool(_begin_bulk(text))
    start, name, fields = 0, "", list[str]()
    for number, raw in enumerate(lines[begin:], start=begin + 1):
        line = raw.partition("$")[0].rstrip().expandtabs(8)
        if not line:
            continue
        head, body = _fields(line)
        if head == "" or head[0] in "+*":
            fields += body
            continue
        if name:
            yield start, name, fields
        start, name, fields = number, head.rstrip("* "), body
        if name == "ENDDATA":
            return
    if name:
        yield start, name, fields


def _begin_bulk(text: str) -> int:
    """Return the place where the line that begins the bulk data starts; 0 if there is none."""
    return found.start() if (found := re.search(r"^\s*BEGIN(\s+|,)BULK", text, re.I | re.M)) else 0


def _fields(line: str) -> tuple[str, list[str]]:
    """Return the first field of a line, and its eight data fields, or four large ones."""
    if "," in line:
        head, *rest = (field.strip() for field in line.split(","))
        large = head.endswith("*")
    else:
        head, large = line[:8].strip(), line[:8].strip().endswith("*") or line.startswith("*")
        width = 16 if large else 8
        rest = [line[k : k + width].strip() for k in range(8, 72, width)]
    n = 4 if large else 8
    return head.upper(), [*rest, *[""] * n][:n]

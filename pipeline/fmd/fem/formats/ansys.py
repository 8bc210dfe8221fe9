"""Reader of Ansys' decks as CDWRITE writes them (``.cdb``): nodes, elements, sets, sections, links and masses."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import field

import numpy as np

from fmd.core.data_classes import dataclass
from fmd.core.fortran import read_field
from fmd.fem.formats.ansys_links import AnsysLinks, Element
from fmd.fem.formats.ansys_sections import AnsysSection, beam_element, beam_section, shell_section
from fmd.fem.formats.beam_sections import DeckBeams
from fmd.fem.formats.named_sets import PLANE, cells_by_block, corners_of
from fmd.fem.formats.raw_mesh import BlockShells, MeshFileError, RawMesh, at_all_nodes

SUFFIXES = (".cdb",)
_WRITE = "write the deck by CDWRITE,DB"
_BRICKS = (45, 185, 190, 95, 186)
_TETRAHEDRA = (72, 92, 187, 285)
_SHELLS = (63, 93, 154, 181, 281)
_BEAMS = (188,)
# Kinds of collapsed bricks: which of the eight corners are the same, and places of corners and then of middles.
_COLLAPSED: tuple[tuple[str, tuple[tuple[int, int], ...], tuple[int, ...], tuple[int, ...]], ...] = (
    ("tetra", ((2, 3), (4, 5), (4, 6), (4, 7)), (0, 1, 2, 4), (8, 9, 11, 16, 17, 18)),
    ("pyramid", ((4, 5), (4, 6), (4, 7)), (0, 1, 2, 3, 4), (8, 9, 10, 11, 16, 17, 18, 19)),
    ("wedge", ((2, 3), (6, 7)), (0, 1, 2, 4, 5, 6), (8, 9, 11, 12, 13, 15, 16, 17, 18)),
    ("hexahedron", (), tuple(range(8)), tuple(range(8, 20))),
)


@dataclass
class _Deck:
    """Nodes, elements, sets, sections and equations of an Ansys deck, by its numbers."""

    nodes: dict[int, tuple[float, ...]] = field(default_factory=dict)
    turned: set[int] = field(default_factory=set)  # nodes with coordinate systems of their own
    kinds: dict[int, int] = field(default_factory=dict)
    options: dict[int, dict[int, int]] = field(default_factory=lambda: defaultdict(dict))
    elements: dict[int, Element] = field(default_factory=dict)
    sets: dict[tuple[str, str], list[int]] = field(default_factory=dict)  # of NODE or ELEM, by name
    reals: dict[int, list[float]] = field(default_factory=dict)
    sections: dict[int, AnsysSection] = field(default_factory=dict)
    equations: dict[str, list[str]] = field(default_factory=dict)  # node, direction and coefficient of each term
    others: dict[str, int] = field(default_factory=lambda: defaultdict(int))


def read_ansys(text: str) -> RawMesh:
    """Read the mesh in the text of a deck.

    Raises
    ------
    MeshFileError
        The text is damaged, or has a form that isn't read; the message gives the line.
    """
    lines = enumerate(text.splitlines(), start=1)
    reader = _Reader(lines)
    for reader.line, raw in lines:
        line = raw.partition("!")[0].strip()
        fields = [item.strip() for item in line.split(",")]
        try:
            reader.take(fields)
        except MeshFileError as error:
            raise MeshFileError(f"line {reader.line}: {error}") from None
        except (ValueError, IndexError, StopIteration):
            raise MeshFileError(
                f"line {reader.line}: {fields[0]} is cut off or has fields that aren't numbers"
            ) from None
    return _mesh(reader.deck)


class _Reader:
    """Commands of a deck, each of which may take further lines."""

    def __init__(self, lines: Iterator[tuple[int, str]]) -> None:
        self.deck = _Deck()
        self.line, self._lines = 0, lines
        self._real, self._section = 0, 0
        self._take: dict[str, Callable[[list[str]], None]] = {
            "NBLOCK": self._nodes,
            "EBLOCK": self._elements,
            "CMBLOCK": self._set,
            "ET": self._kind,
            "KEYOPT": self._option,
            "KEYOP": self._option,
            "RLBLOCK": self._reals,
            "R": self._constants,
            "RMORE": self._constants,
            "SECTYPE": self._sectype,
            "SECBLOCK": self._secblock,
            "SECDATA": self._secdata,
            "SECOFFSET": self._secoffset,
            "CE": self._equation,
        }

    def take(self, fields: list[str]) -> None:
        """Take a command, with the lines that belong to it."""
        command = fields[0].upper()
        if command in self._take:
            self._take[command](fields)
        elif command in ("CP", "CERIG", "RBE3", "CEINTF", "CECYC"):
            self.deck.others[command] += 1
        elif command in ("N", "E", "EN") and not fields[1].startswith("R5"):
            raise MeshFileError(f"{command} isn't read; {_WRITE}, whose NBLOCK and EBLOCK are")

    def _next(self) -> str:
        self.line, text = next(self._lines)
        return text

    def _widths(self) -> list[int]:
        """Return the widths of a line's fields by the Fortran format in the next line, the whole numbers' negative."""
        found = re.findall(r"(\d*)([ieg])(\d+)", self._next().lower())
        if not found:
            raise MeshFileError("no format like (19i10) follows")
        return [
            -int(width) if kind == "i" else int(width) for count, kind, width in found for _ in range(int(count or 1))
        ]

    def _nodes(self, _: list[str]) -> None:
        widths = self._widths()
        n_whole, ends = sum(width < 0 for width in widths), np.cumsum(np.abs(widths)).tolist()
        while True:
            line = self._next().rstrip()
            if line[:2].upper() == "N," or line[: ends[0]].strip() in ("-1", ""):
                return
            number = int(line[: ends[0]])
            given = [line[a:b].strip() for a, b in zip(ends[n_whole - 1 : -1], ends[n_whole:], strict=True)]
            x = tuple(read_field(item) for item in given[:3])
            if self.deck.nodes.setdefault(number, x) != x:
                raise MeshFileError(f"node {number} is given twice, at two places")
            if any(read_field(item) for item in given[3:]):
                self.deck.turned.add(number)

    def _elements(self, fields: list[str]) -> None:
        if fields[2:3] != ["SOLID"]:
            raise MeshFileError(f"EBLOCK isn't in the form SOLID; {_WRITE}")
        width = -self._widths()[0]
        while True:
            row = _whole(self._next(), width)
            if row[0] == -1:
                return
            n, number = row[8], row[10]
            while len(row) < 11 + n:
                row += _whole(self._next(), width)
            if row[1] not in self.deck.kinds:
                raise MeshFileError(f"element {number} has type {row[1]}, which no ET gives")
            if number in self.deck.elements:
                raise MeshFileError(f"element {number} is given twice")
            options = self.deck.options[row[1]]
            self.deck.elements[number] = Element(
                number, self.deck.kinds[row[1]], options, row[0], row[2], row[3], row[11 : 11 + n]
            )

    def _set(self, fields: list[str]) -> None:
        width, count, members = -self._widths()[0], int(fields[3].split("!")[0]), list[int]()
        while count > 0:
            row = _whole(self._next(), width)
            count -= max(len(row), 1)
            for item in row:
                members += [item] if item > 0 else range(members[-1] + 1, -item + 1)
        self.deck.sets[fields[2].upper(), fields[1]] = members

    def _kind(self, fields: list[str]) -> None:
        number = re.sub(r"^\D+", "", fields[2])
        self.deck.kinds[int(fields[1])] = int(number)

    def _option(self, fields: list[str]) -> None:
        self.deck.options[int(fields[1])][int(fields[2])] = int(fields[3])

    def _reals(self, fields: list[str]) -> None:
        first, more = self._widths(), self._widths()
        for _ in range(int(fields[1])):
            line = self._next()
            number, n = (int(line[a:b]) for a, b in ((0, -first[0]), (-first[0], -first[0] - first[1])))
            values = _reals(line[-first[0] - first[1] :], first[2])
            while len(values) < n:
                values += _reals(self._next(), more[0])
            self.deck.reals[number] = values[:n]

    def _constants(self, fields: list[str]) -> None:
        if fields[0].upper() == "R":
            self._real, values = int(fields[1]), fields[2:8]
            self.deck.reals[self._real] = []
        else:
            values = fields[1:7]
        self.deck.reals[self._real] += [read_field(item) for item in values]

    def _sectype(self, fields: list[str]) -> None:
        self._section = int(fields[1])
        self.deck.sections[self._section] = AnsysSection(
            f"section {fields[1]}", fields[2].upper(), "".join(fields[3:4])
        )

    def _secblock(self, fields: list[str]) -> None:
        for _ in range(int(fields[1])):
            self._secdata(["", *(item.strip() for item in self._next().split(","))])

    def _secdata(self, fields: list[str]) -> None:
        self.deck.sections[self._section].rows.append([read_field(item) for item in fields[1:]])

    def _secoffset(self, fields: list[str]) -> None:
        self.deck.sections[self._section].offset[:] = fields[1:]

    def _equation(self, fields: list[str]) -> None:
        if fields[1] != "R5.0":
            raise MeshFileError(f"CE as a command isn't read; {_WRITE}")
        if fields[2] == "DEFI":
            if read_field(fields[5]):
                raise MeshFileError(f"CE {fields[4]} has the constant {fields[5]}; sums that are 0 are read")
            self.deck.equations[fields[4]] = []
        else:
            self.deck.equations[[*self.deck.equations][-1]] += [item for item in fields[3:] if item]


def _whole(line: str, width: int) -> list[int]:
    line = line.rstrip()
    return [int(line[k : k + width]) for k in range(0, len(line), width)]


def _reals(line: str, width: int) -> list[float]:
    line = line.rstrip()
    return [read_field(line[k : k + width].strip()) for k in range(0, len(line), width)]


def _mesh(deck: _Deck) -> RawMesh:
    """Return the mesh of a deck, and what is connected to it."""
    if not deck.nodes:
        raise MeshFileError(f"there are no nodes: no NBLOCK; {_WRITE}")
    place = {number: k for k, number in enumerate(deck.nodes)}
    x = np.array(list(deck.nodes.values()))
    links = AnsysLinks(place, x, deck.turned)
    blocks: dict[str, list[tuple[Element, list[int]]]] = defaultdict(list)
    others = defaultdict(int, deck.others)
    for element in deck.elements.values():
        for node in element.nodes:
            if node and node not in place:
                raise MeshFileError(f"element {element.number} names node {node}, which isn't there")
        if links.takes(element, deck.reals.get(element.real, []), others):
            continue
        if found := _cell(element):
            blocks[found[0]].append((element, found[1]))
        else:
            others[element.name] += 1
    raw = RawMesh(x, others=dict(others), numbers=np.array(list(deck.nodes)))
    where, by_material = dict[int, tuple[int, int]](), dict[int, list[tuple[int, int]]]()
    for b, (kind, own) in enumerate(blocks.items()):
        raw.blocks.append((kind, np.array([[place[node] for node in nodes] for _, nodes in own], dtype=np.int64)))
        for k, (element, _) in enumerate(own):
            where[element.number] = b, k
            by_material.setdefault(element.material, []).append((b, k))
    n = len(raw.blocks)
    raw.cell_sets = {f"material-{number}": cells_by_block(own, n) for number, own in by_material.items()}
    for (of, name), members in deck.sets.items():
        if of == "NODE":
            raw.point_sets[name] = np.unique(np.array([place[m] for m in members if m in place], dtype=np.int64))
        else:
            raw.cell_sets[name] = cells_by_block([where[m] for m in members if m in where], n)
    _add_sections(raw, deck, list(blocks.values()))
    raw.connections = links.connections(deck.equations, raw)
    return raw


def _cell(element: Element) -> tuple[str, list[int]] | None:
    """Return an element's cell type by meshio's name, and its nodes in meshio's order; ``None`` if it is no cell."""
    nodes, kind = element.nodes, element.kind
    if kind in _BEAMS:
        return "line", nodes[:2]
    if kind in _SHELLS:
        corners, middles = nodes[:4], nodes[4:8] if kind in (93, 281) else []
        if corners[2] == corners[3]:
            corners, middles = corners[:3], [middles[k] for k in (0, 1, 3)] if middles else []
        name = "triangle" if len(corners) == 3 else "quad"
        return (f"{name}{len(corners) * 2}", corners + middles) if any(middles) else (name, corners)
    if kind in _TETRAHEDRA:
        # those of four and ten nodes may be written as bricks
        corners, middles = nodes[:4], nodes[4:10]
        if len(nodes) == 8 and len(set(nodes)) == 4:
            corners, middles = [nodes[0], nodes[1], nodes[2], nodes[4]], []
        name, count = "tetra", 6
    elif kind in _BRICKS:
        full = nodes + [0] * (20 - len(nodes))
        name, _, at, between = next(each for each in _COLLAPSED if all(full[a] == full[b] for a, b in each[1]))
        corners, middles = [full[k] for k in at], [full[k] for k in between]
        count = len(between)
    else:
        return None
    if not any(middles):
        return name, corners
    if not all(middles) or len(middles) < count:
        missing = count - sum(map(bool, middles))
        raise MeshFileError(
            f"element {element.number} lacks {missing} of its {count} nodes between corners; give it all or none"
        )
    return f"{name}{len(corners) + count}", corners + middles


def _add_sections(raw: RawMesh, deck: _Deck, blocks: Sequence[Sequence[tuple[Element, list[int]]]]) -> None:
    faults, beams = dict[str, None](), DeckBeams()
    for b, ((kind, cells), own) in enumerate(zip(raw.blocks, blocks, strict=True)):
        n, m = cells.shape
        t, offset = np.full((n, m), np.nan), np.zeros(n)
        for k, (element, _) in enumerate(own):
            section = deck.sections.get(element.section)
            if kind.startswith(PLANE) and element.kind != 154:
                real, n_corners = deck.reals.get(element.real, []), corners_of(kind)
                at_corners, offset[k], fault = shell_section(element, section, real, n_corners)
                t[k] = at_all_nodes(at_corners, m)
                faults |= {fault: None} if fault else {}
            elif kind == "line":
                found = beam_element(element, section, raw.points[raw.blocks[b][1][k]], deck.nodes)
                beams.elements.append(found)
                if section and found.section not in beams.sections:
                    beam_section(beams, section)
        raw.shells.append(BlockShells(t, offset, np.full(n, -1), np.tile([1.0, 0.0, 0.0], (n, 1))))
    raw.shell_faults, raw.beams = list(faults), beams

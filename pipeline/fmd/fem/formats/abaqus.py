"""Reader of Abaqus and CalculiX input files: nodes, elements, sets and surfaces.

meshio's own reader loses sets that are given in several pieces, knows few of the elements, follows includes, and
confuses the numbers of a second part with the first's.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fmd.core.arrays import IntArray
from fmd.core.fortran import read_real
from fmd.core.limits.files import DEEPEST_SETS
from fmd.fem.cells.table import CELLS
from fmd.fem.formats.abaqus_links import LINK_KEYWORDS, POINT_ELEMENTS, AbaqusLinks, DeckPoints
from fmd.fem.formats.beam_sections import BeamElement, DeckBeams, take_abaqus_section
from fmd.fem.formats.named_sets import cells_by_block, nodes_of_facets
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh, ShellSection
from fmd.fem.formats.shell_sections import abaqus_section, of_sets

SUFFIXES = (".inp",)
_SOLID = re.compile(r"(?:AC|DC|DCC|EC|Q|C)3D(\d+)")
_PLANE = re.compile(r"(?:S|STRI|DS|SFM3D|M3D|R3D|F3D|CPS|CPE|CPEG|CAX|SAX|CGAX)(\d+)")
_LINE = re.compile(r"B[23]\d|PIPE|T[23]D|R2D|RB[23]D")
_CELLS = {len(cell.nodes): cell for cell in CELLS.values()}
_PLANE_CELLS = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_LINKS = ("DISTRIBUTING COUPLING", "MPC", "PRE-TENSION SECTION", "SHELL TO SOLID COUPLING", "EMBEDDED ELEMENT")
_SECTIONS = ("SHELL SECTION", "BEAM SECTION", "BEAM GENERAL SECTION", "SHELL GENERAL SECTION")
_SPACED = {keyword.replace(" ", ""): keyword for keyword in (*_LINKS, *_SECTIONS, *LINK_KEYWORDS)}
_WRITE_FLAT = "write the mesh out flat, all nodes and elements in one file without parts and assemblies"


_Item = int | str | range  # of a set: a number, another set's name, a range


@dataclass
class _Block:
    """Elements of one section: their numbers, and the nodes of all one after the other."""

    kind: str
    numbers: list[int] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)


def read_abaqus(text: str) -> RawMesh:
    """Read the mesh in the text of an input file.

    Raises
    ------
    MeshFileError
        The text is damaged, or its mesh is in a form that isn't read; the message gives the line.
    """
    deck = _Deck()
    for line, keyword, options, data in deck_sections(text):
        try:
            deck.take(keyword, options, data)
        except MeshFileError as error:
            raise MeshFileError(f"line {line}: {error}") from None
        except (ValueError, OverflowError):
            raise MeshFileError(
                f"line {line}: the lines after *{keyword} aren't all numbers as they should be"
            ) from None
    try:
        return deck.mesh()
    except MeshFileError:
        raise
    except ValueError as error:
        raise MeshFileError(f"links, masses or sections aren't all numbers as they should be: {error}") from None


def deck_sections(text: str) -> Iterator[tuple[int, str, dict[str, str], list[list[str]]]]:
    """Yield line number, keyword, options and data of each section."""
    start, keyword, options, data = 0, "", dict[str, str](), list[list[str]]()
    header = ""
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        if line.startswith("*") or header:
            if not header and keyword:
                yield start, keyword, options, data
            if not header:
                start, data = number, []
            header += line
            if line.endswith(","):  # a keyword goes on in the next line
                keyword = ""
                continue
            keyword, options = _keyword(header)
            header = ""
        elif keyword:
            data.append([item.strip() for item in line.split(",")])
    if keyword:
        yield start, keyword, options, data


def _keyword(line: str) -> tuple[str, dict[str, str]]:
    """Split a keyword line into the keyword and its options, in capitals."""
    name, *options = line.split(",")
    pairs = (option.partition("=") for option in options)
    words = " ".join(name[1:].split()).upper()
    return _SPACED.get(words.replace(" ", ""), words), {
        key.strip().upper(): value.strip().strip('"') for key, _, value in pairs if key.strip()
    }


class _Deck:
    """Nodes, elements and sets by their numbers in the file, gathered section by section."""

    def __init__(self) -> None:
        self.nodes: dict[int, tuple[float, float, float]] = {}
        self.blocks: list[_Block] = []
        self.node_sets: dict[str, list[_Item]] = defaultdict(list)
        self.element_sets: dict[str, list[_Item]] = defaultdict(list)
        self.surfaces: dict[str, list[tuple[str, str]]] = defaultdict(list)
        self.others: dict[str, int] = defaultdict(int)
        self.links = AbaqusLinks()
        self.shells: dict[str, ShellSection] = {}
        self.beams = DeckBeams()
        self.beam_sections: dict[str, tuple[dict[str, str], list[list[str]]]] = {}
        self.names: dict[str, str] = {}
        self.parts = self.instances = 0

    def take(self, keyword: str, options: dict[str, str], data: list[list[str]]) -> None:
        """Add a section."""
        match keyword:
            case "NODE":
                self._take_nodes(options, data)
            case "ELEMENT":
                self._take_elements(options, data)
            case "NSET" | "ELSET":
                self._take_set(keyword, options, data)
            case "SURFACE" if options.get("TYPE", "ELEMENT").upper() == "ELEMENT":
                name = self._named(options.get("NAME", ""))
                self.surfaces[name] += [(row[0], row[1].upper()) for row in data if len(row) > 1]
            case "SURFACE" if options.get("TYPE", "").upper() == "NODE":
                if any(item for row in data for item in row[1:]):
                    raise MeshFileError("a surface of nodes with areas; leave these out")
                name = self._named(options.get("NAME", ""))  # may be that of a set, which is all of it then
                self.node_sets[name] += [
                    _number_or_name(row[0]) for row in data if row[0].casefold() != name.casefold()
                ]
            case "INSTANCE":
                self.instances += 1
                if any(read_real(item or "0") for row in data for item in row):
                    raise MeshFileError(f"an instance is moved; {_WRITE_FLAT}")
            case _ if keyword in ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "INCLUDE"):
                raise MeshFileError(f"*{keyword} isn't read; {_WRITE_FLAT}")
            case "PART":
                self.parts += 1
            case "SHELL SECTION":
                self.shells[self._named(options.get("ELSET", ""))] = abaqus_section(options, data)
            case "BEAM SECTION":
                self.beam_sections[self._named(options.get("ELSET", ""))] = options, data
            case "BEAM GENERAL SECTION":
                self.beams.faults.append(f"*{keyword}; *BEAM SECTION is read")
            case "SHELL GENERAL SECTION":
                self.shells[self._named(options.get("ELSET", ""))] = ShellSection(float("nan"), fault=f"*{keyword}")
            case _ if keyword in _LINKS:
                self.others[f"*{keyword}"] += 1
            case "TIE" if "CYCLIC SYMMETRY" in options:
                self.others["*TIE with CYCLIC SYMMETRY"] += 1
            case "EQUATION" if "REMOVE" in options:
                self.others["*EQUATION with REMOVE"] += 1
            case _:
                self.links.takes(keyword, options, data)
        if self.instances > 1:
            raise MeshFileError(f"there is more than one instance; {_WRITE_FLAT}")

    def _take_nodes(self, options: dict[str, str], data: list[list[str]]) -> None:
        """Add nodes and, if it is named, their set."""
        if self.parts > 1:
            raise MeshFileError(f"there is more than one part; {_WRITE_FLAT}")
        if options.get("SYSTEM", "R").upper() != "R":
            raise MeshFileError("the nodes are in cylindrical or spherical coordinates; Cartesian ones are read")
        for row in data:
            x = [read_real(item or "0") for item in row[1:4]]
            number = int(row[0])
            if number in self.nodes and self.nodes[number] != (*x, *[0.0] * (3 - len(x))):
                raise MeshFileError(f"node {number} is given twice, at two places")
            self.nodes[number] = (*x, *[0.0] * (3 - len(x)))  # type: ignore[assignment]
        if "NSET" in options:
            self.node_sets[self._named(options["NSET"])] += [int(row[0]) for row in data]

    def _take_elements(self, options: dict[str, str], data: list[list[str]]) -> None:
        """Add elements of one type and, if it is named, their set."""
        name = options.get("TYPE", "").upper()
        kind, n_local = _cell_kind(name)
        if name in POINT_ELEMENTS:
            for row in data:
                number, *nodes = (int(item) for item in row if item)
                self.links.elements[number] = name, nodes
                if "ELSET" in options:
                    self.element_sets[self._named(options["ELSET"])].append(number)
            return
        if not kind:
            self.others[name] += len(data)
            return
        block = _Block(kind)
        entries: list[int] = []
        for row in data:
            entries += [int(item) for item in row if item]
            if len(entries) > n_local:  # an element may take several lines
                if len(entries) > n_local + 1:
                    raise MeshFileError(f"element {entries[0]} has more than the {n_local} nodes of a {name}")
                block.numbers.append(entries[0])
                block.nodes += entries[1:]
                entries = []
        if entries:
            raise MeshFileError(f"element {entries[0]} has fewer than the {n_local} nodes of a {name}")
        self.blocks.append(block)
        if "ELSET" in options:
            self.element_sets[self._named(options["ELSET"])] += block.numbers

    def _take_set(self, keyword: str, options: dict[str, str], data: list[list[str]]) -> None:
        """Add members to a set of nodes or elements."""
        sets = self.node_sets if keyword == "NSET" else self.element_sets
        name = self._named(options.get(keyword, ""))
        if "GENERATE" in options:
            for row in data:
                first, last, step = (*map(int, row[:2]), int(row[2]) if len(row) > 2 and row[2] else 1)
                if step < 1:
                    raise MeshFileError(f"{keyword.lower()} {name}: {first} to {last} by {step} is no range")
                sets[name].append(range(first, last + 1, step))
            return
        if keyword == "NSET" and "ELSET" in options:
            sets[name].append("elset " + self._named(options["ELSET"]))
        sets[name] += [_number_or_name(item) for row in data for item in row if item]

    def _named(self, name: str) -> str:
        """Return a name in its first spelling; upper and lower case are equal."""
        if not name:
            raise MeshFileError("a set or surface without a name")
        return self.names.setdefault(name.casefold(), name)

    def mesh(self) -> RawMesh:
        """Return the mesh, numbered in the file's order in place of the file's numbers."""
        if not self.nodes:
            raise MeshFileError("there are no nodes: no *NODE section with lines of number, x, y, z")
        place = {number: k for k, number in enumerate(self.nodes)}
        linked = {name: list(items) for name, items in self.element_sets.items()}  # with elements of points
        blocks, where = [], dict[int, tuple[int, int]]()
        for b, block in enumerate(block for block in self.blocks if block.numbers):
            try:
                cells = np.array([place[node] for node in block.nodes], dtype=np.int64)
            except KeyError as error:
                raise MeshFileError(f"an element names node {error}, which isn't there") from None
            for k, number in enumerate(block.numbers):
                if number in where:
                    raise MeshFileError(f"element {number} is given twice")
                where[number] = b, k
            cells = cells.reshape(len(block.numbers), -1)
            order = CELLS[block.kind].abaqus_order if block.kind in CELLS else ()
            blocks.append((block.kind, cells[:, order] if order else cells))
        cell_sets = {
            name: cells_by_block([where[n] for n in self._members(name, self.element_sets, where)], len(blocks))
            for name in self.element_sets
        }
        point_sets = {
            name: np.array(sorted(place[n] for n in self._members(name, self.node_sets, place)), dtype=np.int64)
            for name in self.node_sets
        }
        for name, items in self.node_sets.items():
            for item in items:
                if isinstance(item, str) and item.startswith("elset "):
                    chosen = cell_sets.get(self.names.get(item[6:].casefold(), ""), [])
                    found = [blocks[b][1][cells].ravel() for b, cells in enumerate(chosen)]
                    point_sets[name] = np.unique(np.concatenate([point_sets[name], *found]))
        raw = RawMesh(np.array(list(self.nodes.values())), blocks, cell_sets, point_sets, {}, dict(self.others))
        raw.numbers = np.array(list(self.nodes))
        for name, rows in self.surfaces.items():
            raw.facet_sets[name] = self._facets(name, rows, raw, where)
        if self.shells:
            raw.shells = of_sets(self.shells, cell_sets, [len(cells) for _, cells in blocks])
            raw.shell_faults = [section.fault for section in self.shells.values() if section.fault]
        raw.beams = self._beams(raw)
        self._add_links(raw, place, linked)
        return raw

    def _beams(self, raw: RawMesh) -> DeckBeams:
        """Return the beams of the deck's lines, each with the section of a set that holds it."""
        lines = [b for b, (kind, cells) in enumerate(raw.blocks) if kind == "line" and len(cells)]
        numbers = [block.numbers for block in self.blocks if block.numbers]
        found = {
            (b, k): BeamElement(f"element {numbers[b][k]}", "", np.zeros(0), np.zeros((2, 3)))
            for b in lines
            for k in range(len(raw.blocks[b][1]))
        }
        for name, (options, data) in self.beam_sections.items():
            towards = take_abaqus_section(self.beams, name, options, data)
            for b in lines:
                for k in raw.cell_sets.get(name, [np.zeros(0, int)] * (b + 1))[b].tolist():
                    found[b, k] = found[b, k]._replace(section=name, towards=towards)
        self.beams.elements = list(found.values())
        return self.beams

    def _add_links(self, raw: RawMesh, place: dict[int, int], element_sets: dict[str, list[_Item]]) -> None:
        """Add the deck's connections, with names of their points."""

        def known(name: str, sets: Mapping[str, Any], what: str) -> str:
            found = self.names.get(name.rpartition(".")[2].casefold(), "")
            if found not in sets:
                raise MeshFileError(f"a link names the {what} {name}, which isn't there")
            return found

        def nodes(name: str) -> IntArray:
            if not name.isdigit():
                return raw.point_sets[known(name, raw.point_sets, "node set")]
            if int(name) not in place:
                raise MeshFileError(f"a link names node {name}, which isn't there")
            return np.array([place[int(name)]])

        def cell_nodes(name: str) -> IntArray:
            chosen = raw.cell_sets[known(name, raw.cell_sets, "element set")]
            return np.unique(
                np.concatenate([block[k].ravel() for (_, block), k in zip(raw.blocks, chosen, strict=True)])
            )

        def surface(name: str) -> tuple[list[IntArray], IntArray]:
            found = known(name, {**raw.facet_sets, **raw.point_sets}, "surface")
            facets = raw.facet_sets.get(found, [])
            if not facets and found not in raw.point_sets:
                raise MeshFileError(f"a link names the surface {name}, which has no facets of solids or shells")
            return facets, nodes_of_facets(raw, facets) if facets else raw.point_sets[found]

        def elements(name: str, numbers: Mapping[int, object]) -> list[int]:
            return sorted(self._members(known(name, element_sets, "element set"), element_sets, dict(numbers)))

        found = self.links.connections(DeckPoints(place, raw.points, nodes, cell_nodes, surface, elements))
        used = set(found.points.tolist())
        names = {str(number): point for number, point in place.items() if point in used}
        for name, points in raw.point_sets.items():
            if len(points) == 1 and int(points[0]) in used:
                names[name] = int(points[0])
        raw.connections = replace(found, names=names)

    def _members(
        self, name: str, sets: dict[str, list[_Item]], known: dict[int, Any], above: tuple[str, ...] = ()
    ) -> set[int]:
        """Return the known numbers in a set and in the sets that it names."""
        if name in above or len(above) > DEEPEST_SETS:
            raise MeshFileError(f"set {name} holds itself")
        numbers: set[int] = set()
        for item in sets[name]:
            if isinstance(item, range):
                few, many = (item, known) if len(item) < len(known) else (known, item)
                numbers.update(n for n in few if n in many)
            elif isinstance(item, int):
                numbers.update([item] if item in known else [])
            elif not item.startswith("elset "):
                inner = self.names.get(item.rpartition(".")[2].casefold(), "")
                if inner not in sets:
                    raise MeshFileError(f"set {name} names {item}, which isn't there")
                numbers |= self._members(inner, sets, known, (*above, name))
        sets[name] = [*numbers, *(item for item in sets[name] if isinstance(item, str) and item.startswith("elset "))]
        return numbers

    def _facets(
        self, name: str, rows: list[tuple[str, str]], raw: RawMesh, where: dict[int, tuple[int, int]]
    ) -> list[IntArray]:
        """Return the corners of a surface's facets, an array for each block and face."""
        cells_of: dict[tuple[int, int], list[int]] = defaultdict(list)
        for of, side in rows:
            if not re.fullmatch(r"S[1-6]|SPOS|SNEG|", side):
                continue  # edges of shells
            inner = self.names.get(of.rpartition(".")[2].casefold(), "")
            if of.isdigit():
                numbers = {int(of)} & where.keys()
            elif inner in self.element_sets:
                numbers = self._members(inner, self.element_sets, where)
            else:
                raise MeshFileError(f"surface {name} names the element set {of}, which isn't there")
            for number in sorted(numbers):
                b, k = where[number]
                cells_of[b, int(side[1]) - 1 if side[1:].isdigit() else -1].append(k)
        facets = []
        for (b, face), chosen in cells_of.items():
            kind, cells = raw.blocks[b]
            if face < 0:  # a side of shells
                if kind.startswith(("triangle", "quad")):
                    facets.append(cells[chosen][:, : 3 if kind.startswith("triangle") else 4])
                continue
            if kind not in CELLS:
                continue  # edges of plane elements
            corners = CELLS[kind].shape.abaqus_faces
            if face >= len(corners):
                raise MeshFileError(f"surface {name}: elements of {cells.shape[1]} nodes have no face S{face + 1}")
            facets.append(cells[chosen][:, list(corners[face])])
        return facets


def _cell_kind(name: str) -> tuple[str, int]:
    """Return the cell type and number of nodes of an element's name; empty if it is no cell."""
    if match := _SOLID.match(name):
        n_local = int(match[1])
        if n_local not in _CELLS:
            raise MeshFileError(f"elements {name} of {n_local} nodes aren't read")
        return _CELLS[n_local].name, n_local
    if match := _PLANE.match(name):
        n_local = int(match[1][0])  # STRI65 has 6, S4R5 4
        return (_PLANE_CELLS[n_local], n_local) if n_local in _PLANE_CELLS else ("", 0)
    if _LINE.match(name):
        n_local = 3 if re.match(r"B[23]2|PIPE[23]2|T[23]D3", name) else 2
        return ("line3", 3) if n_local == 3 else ("line", 2)
    return "", 0


def _number_or_name(item: str) -> int | str:
    return int(item) if item.lstrip("+-").isdigit() else item.strip('"')

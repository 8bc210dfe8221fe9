"""Contents of a deck of Abaqus or CalculiX by the numbers in the file, and their mesh."""

import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.limits.files import DEEPEST_SETS
from fmd.fem.cells.table import CELLS, is_solid
from fmd.fem.formats.abaqus_links import AbaqusLinks, DeckPoints
from fmd.fem.formats.beam_sections import BeamElement, DeckBeams, take_abaqus_section
from fmd.fem.formats.named_sets import PLANE, cells_by_block, nodes_of_facets
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh, ShellSection
from fmd.fem.formats.shell_sections import of_sets

Item = int | str | range  # of a set: a number, another set's name, a range


@dataclass
class Block:
    """Elements of one section: numbers, negative of a line's second half, and the nodes of all one after the other."""

    kind: str
    name: str  # in the deck
    numbers: list[int] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)


class Deck:
    """Nodes, elements and sets by their numbers in the file, gathered section by section."""

    def __init__(self) -> None:
        self.nodes: dict[int, tuple[float, float, float]] = {}
        self.blocks: list[Block] = []
        self.node_sets: dict[str, list[Item]] = defaultdict(list)
        self.element_sets: dict[str, list[Item]] = defaultdict(list)
        self.surfaces: dict[str, list[tuple[str, str]]] = defaultdict(list)
        self.mixed: set[str] = set()  # surfaces of faces and of edges of shells
        self.edges: dict[str, IntArray] = {}  # points of surfaces of edges, whose names node sets may have, too
        self.others: dict[str, int] = defaultdict(int)
        self.links = AbaqusLinks()
        self.shells: dict[str, ShellSection] = {}
        self.nodal_thickness: list[tuple[int | str, float]] = []  # by a node's number or a set
        self.thickness_faults: list[str] = []  # options of these sections that aren't read
        self.directions: dict[str, Array | str] = {}  # of orientations, or why one isn't read
        self.beams = DeckBeams()
        self.beam_sections: dict[str, tuple[dict[str, str], list[list[str]], list[float] | None]] = {}
        self.faults: list[str] = self.beams.faults  # of the last section, be it of shells or of beams
        self.points: list[float] = []  # of stress in the last section of beams
        self.names: dict[str, str] = {}
        self.parts = self.instances = 0

    def named(self, name: str) -> str:
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
        other = {b.name: 0 for b in self.blocks if b.kind.startswith(PLANE) and not re.match("D?S(?!FM)", b.name)}
        if other and not any(is_solid(kind) for kind, _ in blocks):
            raw.notes.append(f"{', '.join(other)} are taken as shells, which they aren't in Abaqus")
        for name, rows in self.surfaces.items():
            raw.facet_sets[name], edges = self._facets(name, rows, raw, where)
            if edges and raw.facet_sets[name]:
                self.mixed.add(name)
                raw.notes.append(f"surface {name} has faces and edges of shells: it is its faces")
            elif edges:
                self.edges[name] = np.unique(np.concatenate(edges))
                point_sets.setdefault(name, self.edges[name])
        if self.shells:
            nodal, faults = np.full(len(place), np.nan), list(self.thickness_faults)
            for of, thickness in self.nodal_thickness:
                at = place.get(of) if isinstance(of, int) else point_sets.get(self.named(of))
                if at is None:
                    faults.append(f"*NODAL THICKNESS of {of}, which is no node and no set of nodes")
                else:
                    nodal[at] = thickness
            raw.shells = of_sets(self.shells, cell_sets, blocks, nodal)
            raw.stacks = [section.plies for section in self.shells.values()]
            raw.shell_faults = faults + [section.fault for section in self.shells.values() if section.fault]
        raw.beams = self._beams(raw)
        self._add_links(raw, place, linked)
        return raw

    def _beams(self, raw: RawMesh) -> DeckBeams:
        """Return the beams of the deck's lines, each with the section of a set that holds it."""
        lines = [b for b, (kind, cells) in enumerate(raw.blocks) if kind == "line" and len(cells)]
        numbers = [block.numbers for block in self.blocks if block.numbers]
        found = {
            (b, k): BeamElement(f"element {abs(numbers[b][k])}", "", np.zeros(0), np.zeros((2, 3)))
            for b in lines
            for k in range(len(raw.blocks[b][1]))
        }
        for name, section in self.beam_sections.items():
            towards = take_abaqus_section(self.beams, name, *section)
            for b in lines:
                for k in raw.cell_sets.get(name, [np.zeros(0, int)] * (b + 1))[b].tolist():
                    found[b, k] = found[b, k]._replace(section=name, towards=towards)
        if n := sum(own < 0 for b in lines for own in numbers[b]):
            self.beams.notes.append(f"beams of three nodes, two of two nodes in place of each: {n}")
        self.beams.elements = list(found.values())
        return self.beams

    def _add_links(self, raw: RawMesh, place: dict[int, int], element_sets: dict[str, list[Item]]) -> None:
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
            if found in self.mixed:
                raise MeshFileError(f"a link names the surface {name}, which has faces and edges of shells; split it")
            if not facets and found not in raw.point_sets:
                raise MeshFileError(f"a link names the surface {name}, which has no facets of solids or shells")
            return facets, nodes_of_facets(raw, facets) if facets else self.edges.get(found, raw.point_sets[found])

        def elements(name: str, numbers: Mapping[int, object]) -> list[int]:
            return sorted(self._members(known(name, element_sets, "element set"), element_sets, dict(numbers)))

        none = np.zeros(0, dtype=np.int64)
        meshed = np.unique(np.concatenate([none, *(cells.ravel() for _, cells in raw.blocks)]))
        turning = np.concatenate([none, *(cells.ravel() for kind, cells in raw.blocks if not is_solid(kind))])
        points = DeckPoints(place, raw.points, meshed, turning, nodes, cell_nodes, surface, elements)
        names = {str(number): point for number, point in place.items()}
        names |= {name: int(own[0]) for name, own in raw.point_sets.items() if len(own) == 1}
        raw.connections = self.links.connections(points).named(names)

    def _members(
        self, name: str, sets: dict[str, list[Item]], known: dict[int, Any], above: tuple[str, ...] = ()
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
        numbers |= {-n for n in numbers if -n in known}
        sets[name] = [*numbers, *(item for item in sets[name] if isinstance(item, str) and item.startswith("elset "))]
        return numbers

    def _facets(
        self, name: str, rows: list[tuple[str, str]], raw: RawMesh, where: dict[int, tuple[int, int]]
    ) -> tuple[list[IntArray], list[IntArray]]:
        """Return the corners of a surface's facets, an array for each block and face, and nodes of shells' edges."""
        cells_of: dict[tuple[int, str], list[int]] = defaultdict(list)
        for of, side in rows:
            if not re.fullmatch(r"[SE][1-6]|SPOS|SNEG|", side):
                continue
            inner = self.names.get(of.rpartition(".")[2].casefold(), "")
            if of.isdigit():
                numbers = {int(of)} & where.keys()
            elif inner in self.element_sets:
                numbers = self._members(inner, self.element_sets, where)
            else:
                raise MeshFileError(f"surface {name} names the element set {of}, which isn't there")
            for number in sorted(numbers):
                b, k = where[number]
                cells_of[b, side].append(k)
        facets, edges = [], []
        for (b, side), chosen in cells_of.items():
            kind, cells = raw.blocks[b]
            element = [block.name for block in self.blocks if block.numbers][b]
            if side.startswith("S") and element.startswith("CPS"):
                raise MeshFileError(f"surface {name}: {side} of {element} is an edge there; name it by its nodes")
            face = int(side[1]) - 1 if side[1:].isdigit() else -1
            if kind.startswith(("triangle", "quad")):
                n = 3 if kind.startswith("triangle") else 4
                edge = face if side.startswith("E") else face - 2  # CalculiX's S1 and S2 are both sides
                if edge >= n:
                    raise MeshFileError(f"surface {name}: shells of {n} corners have no edge {side}")
                if edge < 0:
                    facets.append(cells[chosen][:, :n])
                else:
                    middle = [n + edge] if cells.shape[1] > n else []
                    edges.append(cells[chosen][:, [edge, (edge + 1) % n, *middle]].ravel())
                continue
            if face < 0 or side.startswith("E") or kind not in CELLS:
                continue
            corners = CELLS[kind].shape.abaqus_faces
            if face >= len(corners):
                raise MeshFileError(f"surface {name}: elements of {cells.shape[1]} nodes have no face S{face + 1}")
            facets.append(cells[chosen][:, list(corners[face])])
        return facets, edges

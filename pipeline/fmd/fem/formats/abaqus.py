"""Reader of Abaqus and CalculiX input files: nodes, elements, sets and surfaces.

meshio's own reader loses sets that are given in several pieces, knows few of the elements, follows includes, and
confuses the numbers of a second part with the first's.
"""

import re
from collections.abc import Iterator

from fmd.core.fortran import read_real
from fmd.fem.cells.table import CELLS
from fmd.fem.formats.abaqus_deck import Block, Deck
from fmd.fem.formats.abaqus_links import LINK_KEYWORDS, POINT_ELEMENTS
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh, ShellSection
from fmd.fem.formats.shell_sections import abaqus_section, orientation_direction

SUFFIXES = (".inp",)
# Letters behind the number of nodes are of integration, incompatible modes, hybrid forms and further unknowns.
_SOLID = re.compile(r"(?:AC|DC|DCC|EC|Q|C)3D(\d+)V?(?:M|I|RI?)?P?H?[SET]?D?")
# Gmsh writes CPS for surfaces in space.
_PLANE = re.compile(r"(?:S|STRI|DS|SFM3D|M3D|R3D|F3D(?=[34]$)|CPS)(\d+)(?:R5|RSW?|[MI]?R?P?H?[SET]?)")
_LINE = re.compile(r"B[23][123](?:R|OS)?H?|PIPE[23][12]H?|T[23]D[23][HTE]?|R2D2|RB[23]D2")
_CELLS = {len(cell.nodes): cell for cell in CELLS.values()}
_PLANE_CELLS = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_LINKS = ("DISTRIBUTING COUPLING", "MPC", "PRE-TENSION SECTION", "SHELL TO SOLID COUPLING", "EMBEDDED ELEMENT")
_SECTIONS = ("SHELL SECTION", "BEAM SECTION", "BEAM GENERAL SECTION", "SHELL GENERAL SECTION")
_PLACED_BY_THE_PROGRAM = (
    "NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "INCLUDE", "IMPERFECTION", "PARAMETER",
    "SYMMETRIC MODEL GENERATION",
)  # fmt: skip
_IN_FILES = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "NODAL THICKNESS", *LINK_KEYWORDS)
_SPACED = {keyword.replace(" ", ""): keyword for keyword in (*_LINKS, *_SECTIONS, *LINK_KEYWORDS)}
_WRITE_FLAT = "write the mesh out flat, all nodes and elements in one file without parts and assemblies"


def read_abaqus(text: str) -> RawMesh:
    """Read the mesh in the text of an input file.

    Raises
    ------
    MeshFileError
        The text is damaged, or its mesh is in a form that isn't read; the message gives the line.
    """
    deck = Deck()
    for line, keyword, options, data in deck_sections(text):
        try:
            _take(deck, keyword, options, data)
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


def _take(deck: Deck, keyword: str, options: dict[str, str], data: list[list[str]]) -> None:
    if "INPUT" in options and keyword in _IN_FILES:
        raise MeshFileError(f"*{keyword} with INPUT isn't followed; put the lines of {options['INPUT']} below it")
    match keyword:
        case "NODE":
            _take_nodes(deck, options, data)
        case "ELEMENT":
            _take_elements(deck, options, data)
        case "NSET" | "ELSET":
            _take_set(deck, keyword, options, data)
        case "SURFACE" if options.get("TYPE", "ELEMENT").upper() == "ELEMENT":
            name = deck.named(options.get("NAME", ""))
            deck.surfaces[name] += [(row[0], row[1].upper()) for row in data if len(row) > 1]
        case "SURFACE" if options.get("TYPE", "").upper() == "NODE":
            if any(item for row in data for item in row[1:]):
                raise MeshFileError("a surface of nodes with areas; leave these out")
            name = deck.named(options.get("NAME", ""))  # may be that of a set, which is all of it then
            deck.node_sets[name] += [_number_or_name(row[0]) for row in data if row[0].casefold() != name.casefold()]
        case "INSTANCE":
            deck.instances += 1
            if any(read_real(item or "0") for row in data for item in row):
                raise MeshFileError(f"an instance is moved; {_WRITE_FLAT}")
        case _ if keyword in _PLACED_BY_THE_PROGRAM:
            raise MeshFileError(f"*{keyword} isn't read; {_WRITE_FLAT}")
        case "PART":
            deck.parts += 1
        case "SHELL SECTION":
            deck.faults = deck.thickness_faults
            deck.shells[deck.named(options.get("ELSET", ""))] = abaqus_section(options, data, deck.directions)
        case "NODAL THICKNESS":
            deck.thickness_faults += [f"*NODAL THICKNESS with {option}" for option in options]
            deck.nodal_thickness += [(_number_or_name(row[0]), read_real(row[1])) for row in data if len(row) > 1]
        case "NORMAL":
            deck.thickness_faults.append("*NORMAL, their normals")
            deck.beams.faults.append("*NORMAL, their directions")
        case "ORIENTATION":
            deck.directions[options.get("NAME", "").casefold()] = orientation_direction(options, data)
        case "BEAM SECTION" | "BEAM GENERAL SECTION":
            deck.faults, deck.points = deck.beams.faults, []
            points = deck.points if "GENERAL" in keyword else None
            deck.beam_sections[deck.named(options.get("ELSET", ""))] = options, data, points
        case "SECTION POINTS":
            deck.points += [read_real(item) for row in data for item in row if item]
        case "CENTROID" | "SHEAR CENTER" | "TRANSVERSE SHEAR STIFFNESS":
            deck.faults.append(f"*{keyword} behind a section")
        case "SHELL GENERAL SECTION":
            deck.shells[deck.named(options.get("ELSET", ""))] = ShellSection(float("nan"), fault=f"*{keyword}")
        case _ if keyword in _LINKS:
            deck.others[f"*{keyword}"] += 1
        case "TIE" if "CYCLIC SYMMETRY" in options:
            deck.others["*TIE with CYCLIC SYMMETRY"] += 1
        case "EQUATION" if "REMOVE" in options:
            deck.others["*EQUATION with REMOVE"] += 1
        case _:
            deck.links.takes(keyword, options, data)
    if deck.instances > 1:
        raise MeshFileError(f"there is more than one instance; {_WRITE_FLAT}")


def _take_nodes(deck: Deck, options: dict[str, str], data: list[list[str]]) -> None:
    """Add nodes and, if it is named, their set."""
    if deck.parts > 1:
        raise MeshFileError(f"there is more than one part; {_WRITE_FLAT}")
    if options.get("SYSTEM", "R").upper() != "R":
        raise MeshFileError("the nodes are in cylindrical or spherical coordinates; Cartesian ones are read")
    for row in data:
        x = [read_real(item or "0") for item in row[1:4]]
        number = int(row[0])
        if number in deck.nodes and deck.nodes[number] != (*x, *[0.0] * (3 - len(x))):
            raise MeshFileError(f"node {number} is given twice, at two places")
        deck.nodes[number] = (*x, *[0.0] * (3 - len(x)))  # type: ignore[assignment]
    if "NSET" in options:
        deck.node_sets[deck.named(options["NSET"])] += [int(row[0]) for row in data]


def _take_elements(deck: Deck, options: dict[str, str], data: list[list[str]]) -> None:
    """Add elements of one type and, if it is named, their set."""
    name = options.get("TYPE", "").upper()
    kind, n_local = _cell_kind(name)
    if name in POINT_ELEMENTS:
        for row in data:
            number, *nodes = (int(item) for item in row if item)
            deck.links.elements[number] = name, nodes
            if "ELSET" in options:
                deck.element_sets[deck.named(options["ELSET"])].append(number)
        return
    if not kind:
        deck.others[name] += len(data)
        return
    block = Block(kind, name)
    entries: list[int] = []
    for row in data:
        entries += [int(item) for item in row if item]
        if len(entries) > n_local:  # an element may take several lines
            if len(entries) > n_local + 1:
                raise MeshFileError(f"element {entries[0]} has more than the {n_local} nodes of a {name}")
            number, *nodes = entries
            halves = n_local == 3 and kind == "line"  # nodes are an end, the middle, the other end
            block.numbers += [number, -number] if halves else [number]
            block.nodes += [*nodes[:2], *nodes[1:]] if halves else nodes
            entries = []
    if entries:
        raise MeshFileError(f"element {entries[0]} has fewer than the {n_local} nodes of a {name}")
    deck.blocks.append(block)
    if "ELSET" in options:
        deck.element_sets[deck.named(options["ELSET"])] += block.numbers


def _take_set(deck: Deck, keyword: str, options: dict[str, str], data: list[list[str]]) -> None:
    sets = deck.node_sets if keyword == "NSET" else deck.element_sets
    name = deck.named(options.get(keyword, ""))
    if "GENERATE" in options:
        for row in data:
            first, last, step = (*map(int, row[:2]), int(row[2]) if len(row) > 2 and row[2] else 1)
            if step < 1:
                raise MeshFileError(f"{keyword.lower()} {name}: {first} to {last} by {step} is no range")
            sets[name].append(range(first, last + 1, step))
        return
    if keyword == "NSET" and "ELSET" in options:
        sets[name].append("elset " + deck.named(options["ELSET"]))
    sets[name] += [_number_or_name(item) for row in data for item in row if item]


def _cell_kind(name: str) -> tuple[str, int]:
    """Return the cell type and number of nodes of an element's name; empty if it is no cell."""
    if begin := _SOLID.match(name):
        n_local = int(begin[1])
        if n_local not in _CELLS or begin.end() < len(name):
            raise MeshFileError(f"elements {name} of {n_local} nodes aren't read")
        return _CELLS[n_local].name, n_local
    if match := _PLANE.fullmatch(name):
        n_local = int(match[1][0])  # STRI65 has 6, S4R5 4
        return (_PLANE_CELLS[n_local], n_local) if n_local in _PLANE_CELLS else ("", 0)
    if _LINE.fullmatch(name):
        return "line", 3 if re.match(r"B[23]2|PIPE[23]2|T[23]D3", name) else 2
    return "", 0


def _number_or_name(item: str) -> int | str:
    return int(item) if item.lstrip("+-").isdigit() else item.strip('"')

"""Links, equations, springs and lumped masses in input files of Abaqus and CalculiX."""

from collections.abc import Callable, Mapping
from dataclasses import field

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.data_classes import dataclass
from fmd.core.fortran import read_real
from fmd.fem.connections import (
    Connections,
    Equation,
    MassOnPoint,
    MeanConnection,
    RigidConnection,
    SpringBetween,
    TiedFaces,
)
from fmd.fem.formats.raw_mesh import MeshFileError

POINT_ELEMENTS = ("MASS", "ROTARYI", "SPRING1", "SPRING2", "SPRINGA")
_PROPERTIES = ("MASS", "ROTARY INERTIA", "SPRING")
_JOINS = ("RIGID BODY", "COUPLING", "KINEMATIC COUPLING")
_KINDS = ("KINEMATIC", "DISTRIBUTING")
LINK_KEYWORDS = (*_JOINS, *_KINDS, *_PROPERTIES, "EQUATION", "TIE", "TRANSFORM")
_OWN_NODE = "write that node into the NSET, and one of no element at its place as REF NODE"
_ALL, _MOVES = {1, 2, 3, 4, 5, 6}, {1, 2, 3}

Data = list[list[str]]


@dataclass(frozen=True)
class DeckPoints:
    """Points of a deck as links name them."""

    place: Mapping[int, int]  # place of each node by its number
    x: Array  # (n, 3): positions
    meshed: IntArray  # those of elements of the mesh
    turning: IntArray  # those of shells and beams
    nodes: Callable[[str], IntArray]  # places of the nodes of a set of nodes, or of one node, by name or number
    cell_nodes: Callable[[str], IntArray]  # places of the nodes of a set of elements
    # Corners of a surface's facets and the places of its nodes; no facets if it is one of nodes.
    surface: Callable[[str], tuple[list[IntArray], IntArray]]
    # Numbers of the elements in a set, of those with the given numbers.
    elements: Callable[[str, Mapping[int, object]], list[int]]


@dataclass
class AbaqusLinks:
    """Sections of links and point elements, gathered until nodes and sets are known."""

    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    _joins: list[tuple[str, dict[str, str], Data]] = field(default_factory=list)
    _kinds: list[tuple[str, dict[str, str], Data]] = field(default_factory=list)
    _properties: list[tuple[str, dict[str, str], Data]] = field(default_factory=list)
    _equations: list[Data] = field(default_factory=list)
    _ties: list[tuple[str, dict[str, str], Data]] = field(default_factory=list)
    _turned: list[str] = field(default_factory=list)

    def takes(self, keyword: str, options: dict[str, str], data: Data) -> bool:
        """Add a section, and return whether it is one of those that are read."""
        if keyword in _JOINS:
            self._joins.append((keyword, options, data))
        elif keyword in _KINDS:
            if len(self._kinds) >= sum(joined == "COUPLING" for joined, *_ in self._joins):
                raise MeshFileError(f"*{keyword} stands behind no *COUPLING of its own")
            self._kinds.append((keyword, options, data))
        elif keyword in _PROPERTIES:
            self._properties.append((keyword, options, data))
        elif keyword == "EQUATION":
            self._equations.append(data)
        elif keyword == "TIE":
            self._ties.append((f"*TIE {options.get('NAME') or len(self._ties) + 1}", options, data))
        elif keyword == "TRANSFORM":
            self._turned.append(_option("*TRANSFORM", options, "NSET"))
        return keyword in LINK_KEYWORDS

    def connections(self, points: DeckPoints) -> Connections:
        """Return all connections of the deck."""
        rigid, mean = list[RigidConnection](), list[MeanConnection]()
        kinds = iter(self._kinds)
        for number, (keyword, options, data) in enumerate(self._joins, start=1):
            label = f"*{keyword} {options.get('CONSTRAINT NAME') or number}"
            reference = points.nodes(_option(label, options, "REF NODE"))
            if len(reference) != 1:
                raise MeshFileError(f"{label} has a reference of {len(reference)} nodes")
            if set(options) & {"ORIENTATION", "INFLUENCE RADIUS", "ANALYTICAL SURFACE"}:
                raise MeshFileError(f"{label} has an orientation, a radius or an analytical surface, which isn't read")
            if keyword == "COUPLING":
                of_kind = next(kinds, None)
                if of_kind is None:
                    raise MeshFileError(f"{label} has neither *KINEMATIC nor *DISTRIBUTING behind it")
                kind, own, rows = of_kind
                surface = points.surface(_option(label, options, "SURFACE"))
                if kind == "DISTRIBUTING":
                    mean.append(_mean(label, reference, surface, own, rows))
                else:
                    rigid.append(_rigid(label, reference, surface[1], _turns(label, rows)))
            elif keyword == "RIGID BODY":
                rigid += _rigid_body(label, reference, options, points)
            else:
                tied = [points.nodes(row[0]) for row in data]
                rigid.append(_rigid(label, reference, np.concatenate(tied), _turns(label, [row[1:] for row in data])))
        masses, springs = self._on_elements(points)
        equations = [each for data in self._equations for each in _equations(data, points)]
        turned = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *map(points.nodes, self._turned)]))
        for each in (*equations, *springs):
            if np.isin(each.points, turned).any():
                raise MeshFileError(f"{each.label} is in directions that *TRANSFORM turns, which isn't read")
        ties = [each for tie in self._ties for each in _tied(*tie, points)]
        return Connections(tuple(rigid), tuple(mean), tuple(equations), tuple(springs), tuple(masses), tuple(ties))

    def _on_elements(self, points: DeckPoints) -> tuple[list[MassOnPoint], list[SpringBetween]]:
        """Return masses and springs; each element has one section of properties."""
        masses, springs, left = list[MassOnPoint](), list[SpringBetween](), dict(self.elements)
        for keyword, options, data in self._properties:
            elset = _option(f"*{keyword}", options, "ELSET")
            if set(options) & {"ORIENTATION", "NONLINEAR", "COMPLEX STIFFNESS", "TYPE"}:
                raise MeshFileError(f"*{keyword} of {elset} has an orientation or is nonlinear, which isn't read")
            for number in points.elements(elset, self.elements):
                kind, nodes = self.elements[number]
                left.pop(number, None)
                at = np.array([_place(points, node, f"{kind} {number}") for node in nodes])
                if kind.startswith("SPRING"):
                    springs.append(_spring(f"{kind} {number}", at, data, points.x))
                else:
                    masses.append(_mass(f"{kind} {number}", at, data))
        if left:
            number, (kind, _) = next(iter(left.items()))
            raise MeshFileError(f"{kind} {number} has no mass or stiffness: no section names a set that holds it")
        return masses, springs


def _option(label: str, options: dict[str, str], key: str) -> str:
    given = options.get(key) or options.get(key.replace(" ", ""))  # CalculiX takes REFNODE, too
    if not given:
        raise MeshFileError(f"{label} has no {key}")
    return given


def _place(points: DeckPoints, node: int, label: str) -> int:
    if node not in points.place:
        raise MeshFileError(f"{label} names node {node}, which isn't there")
    return points.place[node]


def _rigid_body(label: str, reference: IntArray, options: dict[str, str], points: DeckPoints) -> list[RigidConnection]:
    """Return the connections of a rigid body: of the nodes that turn with it, and of those on pins.

    ``NSET`` is CalculiX's word, whose rigid bodies hold nodes of shells and beams on pins; Abaqus has the other ones.
    """
    turning = [points.nodes(options["TIE NSET"])] if "TIE NSET" in options else []
    pinned = [points.nodes(options["PIN NSET"])] if "PIN NSET" in options else []
    if "ELSET" in options:
        turning.append(points.cell_nodes(options["ELSET"]))
    if "NSET" in options:
        if np.isin(reference, points.turning).any():
            raise MeshFileError(
                f"{label} has a node of shells or beams as REF NODE, which CalculiX holds on a pin, too; {_OWN_NODE}"
            )
        own = points.nodes(options["NSET"])
        pinned.append(np.intersect1d(own, points.meshed))
        turning.append(np.setdiff1d(own, points.meshed))
    if not (turning or pinned):
        raise MeshFileError(f"{label} has no NSET or ELSET")
    both = ((np.unique(np.concatenate(each)), turns) for each, turns in ((turning, True), (pinned, False)) if each)
    return [_rigid(label, reference, nodes, turns) for nodes, turns in both if len(nodes)]


def _rigid(label: str, reference: IntArray, nodes: IntArray, turning: bool) -> RigidConnection:
    return RigidConnection(label, np.concatenate([reference, np.setdiff1d(nodes, reference)]), turning)


def _mean(
    label: str, reference: IntArray, surface: tuple[list[IntArray], IntArray], options: dict[str, str], data: Data
) -> MeanConnection:
    """Return a distributing coupling: by the areas of a surface of facets, alike for the nodes of one of nodes."""
    facets, nodes = surface
    if options.get("WEIGHTING METHOD", "UNIFORM").upper() != "UNIFORM":
        raise MeshFileError(f"{label} has weights by distance; WEIGHTING METHOD=UNIFORM is read")
    others = np.setdiff1d(nodes, reference)
    points = np.concatenate([reference, others])
    return MeanConnection(label, points, np.ones(len(others)), tuple(facets), _turns(label, data))


def _turns(label: str, rows: Data) -> bool:
    """Return whether ranges of directions tie rotations too; all three displacements must be among them."""
    tied = set[int]()
    for row in rows:
        ends = [int(item) for item in row if item]
        tied |= set(range(ends[0], ends[-1] + 1)) if ends else _ALL
    tied = tied or _ALL
    if tied not in (_ALL, _MOVES):
        raise MeshFileError(
            f"{label} ties the directions {', '.join(map(str, sorted(tied)))}; 1 to 3 and 1 to 6 are read"
        )
    return tied == _ALL


def _mass(label: str, at: IntArray, data: Data) -> MassOnPoint:
    """Return a lumped mass, or a rotary inertia, whose products are those of the tensor, −∫ xy dm."""
    given = [read_real(item) for row in data for item in row if item]
    if label.startswith("MASS"):
        if not given or given[0] < 0:
            raise MeshFileError(f"{label} has no mass, or one below 0")
        return MassOnPoint(label, at, given[0], np.zeros(3), np.zeros((3, 3)))
    xx, yy, zz, xy, xz, yz = [*given, *[0.0] * 6][:6]
    return MassOnPoint(label, at, 0.0, np.zeros(3), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def _spring(label: str, at: IntArray, data: Data, x: Array) -> SpringBetween:
    """Return a spring between directions of two points, or along the line between them."""
    if label.startswith("SPRING1"):
        raise MeshFileError(f"{label} has one end on the ground; give the body a support, or the scene a spring")
    rows = [[item for item in row if item] for row in data]
    stiffness = read_real(rows[-1][0])
    if stiffness < 0:
        raise MeshFileError(f"{label} has a stiffness below 0")
    if label.startswith("SPRINGA"):
        along = x[at[1]] - x[at[0]]
        if not (length := float(np.linalg.norm(along))):
            raise MeshFileError(f"{label} has both ends at one place, and so no direction")
        return SpringBetween(
            label, np.repeat(at, 3), np.tile(np.arange(3), 2), np.concatenate([-along, along]) / length, stiffness
        )
    directions = np.array([int(item) for item in rows[0]]) - 1
    if len(directions) != 2 or not ((directions >= 0) & (directions < 6)).all():
        raise MeshFileError(f"{label} needs two directions, 1 to 6")
    return SpringBetween(label, at, directions, np.array([1.0, -1.0]), stiffness)


def _equations(data: Data, points: DeckPoints) -> list[Equation]:
    """Return the equations of one section: each a number of terms, then node, direction and coefficient of each."""
    items = [item for row in data for item in row if item]
    equations = []
    while items:
        n_terms = int(items[0])
        terms = items[1 : 1 + 3 * n_terms]
        del items[: 1 + 3 * n_terms]
        label = f"*EQUATION of node {terms[0] if terms else '?'}"
        if not n_terms or len(terms) < 3 * n_terms:
            raise MeshFileError(f"{label} has fewer terms than it says")
        if not all(node.isdigit() for node in terms[::3]):
            raise MeshFileError(f"{label} names sets; nodes by their numbers are read")
        places = np.array([_place(points, int(node), label) for node in terms[::3]])
        directions = np.array([int(item) for item in terms[1::3]]) - 1
        if not ((directions >= 0) & (directions < 6)).all():
            raise MeshFileError(f"{label} has a direction that isn't 1 to 6")
        equations.append(Equation(label, places, directions, np.array([read_real(item) for item in terms[2::3]])))
    return equations


def _tied(label: str, options: dict[str, str], data: Data, points: DeckPoints) -> list[TiedFaces]:
    """Return the ties of one section: the first surface of each line follows the second."""
    within = read_real(options["POSITION TOLERANCE"]) if options.get("POSITION TOLERANCE") else None
    ties = []
    for row in data:
        if len(row) < 2:
            raise MeshFileError(f"{label} needs two surfaces")
        follows, onto = (points.surface(name)[1] for name in row[:2])
        ties.append(TiedFaces(label, np.unique(np.concatenate([follows, onto])), follows, onto, within))
    return ties

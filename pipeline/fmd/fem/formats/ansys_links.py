"""Links, equations, springs and lumped masses in Ansys' decks."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.fortran import read_field
from fmd.core.limits.files import ARM_BY_DIGITS, ISOTROPIC
from fmd.core.rotations import rigid_motions
from fmd.fem.connections import Connections, Equation, MassOnPoint, RigidConnection, SpringBetween
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh

_DIRECTIONS = {name: k for k, name in enumerate(("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ"))}
_Term = tuple[int, int, float]  # place of a node, direction, coefficient


_NAMES = {
    14: "COMBIN14", 21: "MASS21", 39: "COMBIN39", 40: "COMBIN40", 45: "SOLID45", 63: "SHELL63", 72: "SOLID72",
    92: "SOLID92", 93: "SHELL93", 95: "SOLID95", 154: "SURF154", 170: "TARGE170", 173: "CONTA173", 174: "CONTA174",
    175: "CONTA175", 177: "CONTA177", 179: "PRETS179", 180: "LINK180", 181: "SHELL181", 184: "MPC184", 185: "SOLID185",
    186: "SOLID186", 187: "SOLID187", 188: "BEAM188", 189: "BEAM189", 190: "SOLSH190", 214: "COMBI214", 281: "SHELL281",
    285: "SOLID285",
}  # fmt: skip


class Element(NamedTuple):
    """An element by its row in EBLOCK."""

    number: int
    kind: int  # of its element type, as 186
    options: dict[int, int]  # KEYOPT by number
    material: int
    real: int
    section: int
    nodes: list[int]

    @property
    def name(self) -> str:
        """Name of its element type."""
        return _NAMES.get(self.kind, f"element type {self.kind}")


class AnsysLinks:
    """Links gathered element by element, by places of nodes."""

    def __init__(self, place: Mapping[int, int], x: Array, turned: set[int]) -> None:
        self._place, self._x, self._turned = place, x, turned
        self._masses: list[MassOnPoint] = []
        self._springs: list[SpringBetween] = []
        self._bars: list[tuple[str, list[int]]] = []

    def takes(self, element: Element, real: list[float], others: dict[str, int]) -> bool:
        """Add an element, and return whether it is a mass, a spring or a rigid beam; count damping as not read.

        Raises
        ------
        MeshFileError
            It has options or nodes that aren't read.
        """
        label, option = f"{element.name} {element.number}", element.options.get
        if element.kind == 21:
            self._take_mass(label, self._points(label, element.nodes[:1]), real, option(3, 0), option(1, 0))
        elif element.kind == 14:
            self._take_spring(label, self._points(label, element.nodes[:2]), real, option(2, 0), option(3, 0))
            if any(real[1:3]):
                others["damping of COMBIN14"] = others.get("damping of COMBIN14", 0) + 1
        elif element.kind == 184 and option(1, 0) == 1:
            self._bars.append((label, self._points(label, element.nodes[:2])))
        else:
            return False
        return True

    def _points(self, label: str, nodes: Sequence[int]) -> list[int]:
        for node in nodes:
            if node in self._turned:
                raise MeshFileError(f"{label} is at node {node}, which is turned by NROTAT; write it along the axes")
        return [self._place[node] for node in nodes]

    def _take_mass(self, label: str, points: list[int], real: list[float], form: int, by_volume: int) -> None:
        if form not in (0, 2) or by_volume:
            raise MeshFileError(f"{label} has KEYOPT(1) = {by_volume}, KEYOPT(3) = {form}; masses in space are read")
        values = np.array((real + [0.0] * 6)[:6])
        masses = values[:1] if form == 2 else values[:3]
        if not real or np.ptp(masses) > ISOTROPIC * np.abs(masses).max() or values.min() < 0:
            raise MeshFileError(f"{label} has masses that aren't alike in x, y and z, or below 0: {masses.tolist()}")
        inertia = np.diag(values[3:] if form == 0 else np.zeros(3))
        self._masses.append(MassOnPoint(label, np.array(points), float(masses[0]), np.zeros(3), inertia))

    def _take_spring(self, label: str, points: list[int], real: list[float], along: int, form: int) -> None:
        k = real[0] if real else 0.0
        if k < 0 or not 0 <= along <= 6 or (along == 0 and form):
            raise MeshFileError(f"{label} turns, has KEYOPT(2) = {along}, or a stiffness below 0")
        if along:
            ends, directions, signs = np.array(points), np.full(2, along - 1), np.array([1.0, -1.0])
        else:
            span = self._x[points[1]] - self._x[points[0]]
            length = float(np.linalg.norm(span))
            if not length > 0:
                raise MeshFileError(f"{label} is between nodes at one place and has no direction; say KEYOPT(2)")
            ends, directions = np.repeat(points, 3), np.tile(np.arange(3), 2)
            signs = np.concatenate([span, -span]) / length
        if k:
            self._springs.append(SpringBetween(label, ends, directions, signs, k))

    def connections(self, given: Mapping[str, list[str]], raw: RawMesh) -> Connections:
        """Return all connections; equations that are those of rigid arms, as of CERIG, as rigid ones.

        Equations are given by node, direction and coefficient of each of their terms, by their numbers.
        """
        equations = {number: self._terms(f"CE {number}", items) for number, items in given.items()}
        rigid, kept = self._rigid(equations)
        of_cells = np.unique(np.concatenate([np.zeros(0, np.int64), *(cells.ravel() for _, cells in raw.blocks)]))
        for label, (a, b) in self._bars:
            pair = (b, a) if a in of_cells and b not in of_cells else (a, b)
            rigid.append(RigidConnection(label, np.array(pair)))
        names = {str(number): point for number, point in self._place.items()}
        names |= {name: int(own[0]) for name, own in raw.point_sets.items() if len(own) == 1}
        return Connections(tuple(rigid), (), tuple(kept), tuple(self._springs), tuple(self._masses)).named(names)

    def _terms(self, label: str, items: list[str]) -> list[_Term]:
        terms = []
        for node, name, coefficient in zip(items[::3], items[1::3], items[2::3], strict=True):
            if name not in _DIRECTIONS or int(node) not in self._place:
                raise MeshFileError(f"{label} names {name} of node {node}, which isn't there")
            (point,) = self._points(label, [int(node)])
            terms.append((point, _DIRECTIONS[name], read_field(coefficient)))
        if not terms or not terms[0][2]:
            raise MeshFileError(f"{label} has no terms, or a first coefficient of 0")
        return terms

    def _rigid(self, equations: Mapping[str, list[_Term]]) -> tuple[list[RigidConnection], list[Equation]]:
        """Split equations into those by which a node moves on an arm with another, and the rest."""
        arms: dict[frozenset[int], dict[int, tuple[str, int]]] = {}  # of two nodes, by direction: equation and master
        for number, terms in equations.items():
            if found := self._arm(terms):
                pair, direction, master = found
                arms.setdefault(pair, {})[direction] = number, master
        hung: dict[tuple[int, bool], list[int]] = {}
        taken = set[str]()
        for pair, own in arms.items():
            masters = {master for _, master in own.values() if master >= 0}
            if len(masters) > 1 or not {0, 1, 2} <= own.keys():
                continue
            first, second = sorted(pair)
            master = masters.pop() if masters else first
            hung.setdefault((master, {3, 4, 5} <= own.keys()), []).append(first if master == second else second)
            taken |= {number for number, _ in own.values()}
        labels = {point: number for number, point in self._place.items()}
        rigid = [
            RigidConnection(f"CERIG {labels[master]}", np.array([master, *points]), turning)
            for (master, turning), points in hung.items()
        ]
        return rigid, [_equation(number, terms) for number, terms in equations.items() if number not in taken]

    def _arm(self, terms: list[_Term]) -> tuple[frozenset[int], int, int] | None:
        """Return nodes, direction and master (-1 if it may be either) of an equation of an arm; else ``None``."""
        moves = [term for term in terms if term[1] < 3] or terms
        turns = [term for term in terms if term not in moves]
        if (
            len(moves) != 2
            or moves[0][1] != moves[1][1]
            or abs(moves[0][2] + moves[1][2]) > ARM_BY_DIGITS * abs(moves[0][2])
        ):
            return None
        (a, direction, unit), (b, _, _) = moves
        if a == b:
            return None
        if direction >= 3:
            return frozenset((a, b)), direction, -1
        for slave, master, sign in ((a, b, unit), (b, a, -unit)):
            r = self._x[slave] - self._x[master]
            wanted = -sign * rigid_motions(r[None])[0, direction, 3:]
            given = np.zeros(3)
            for point, turn, coefficient in turns:
                given[turn - 3] += coefficient if point == master else np.inf
            if np.abs(given - wanted).max() <= ARM_BY_DIGITS * abs(unit) * max(
                float(np.linalg.norm(r)), np.finfo(float).tiny
            ):
                return frozenset((a, b)), direction, master if turns else -1
        return None


def _equation(number: str, terms: list[_Term]) -> Equation:
    points, directions, coefficients = zip(*terms, strict=True)
    return Equation(f"CE {number}", _places(points), _places(directions), np.array(coefficients))


def _places(items: Sequence[int]) -> IntArray:
    return np.array(items, dtype=np.int64)

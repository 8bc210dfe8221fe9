"""Links, equations, springs and lumped masses in Nastran bulk data."""

import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fmd.core.fortran import read_field
from fmd.fem.connections import Connections, Equation, MassOnPoint, MeanConnection, RigidConnection, SpringBetween
from fmd.fem.formats.raw_mesh import MeshFileError

_ALL, _MOVES = frozenset("123456"), frozenset("123")


class NastranLinks:
    """Links gathered card by card, by the numbers of their grid points."""

    def __init__(self) -> None:
        self._rigid: list[RigidConnection] = []
        self._mean: list[MeanConnection] = []
        self._springs: list[tuple[str, list[int], list[int], float | str]] = []
        self._masses: list[MassOnPoint] = []
        self._equations: dict[str, list[Equation]] = defaultdict(list)
        self._stiffness: dict[str, float] = {}
        self.turned: set[int] = set()  # grid points with displacements in a coordinate system of their own
        self._take: dict[str, Callable[[list[str]], None]] = {
            "RBE2": self._take_rbe2,
            "RBE3": self._take_rbe3,
            "RBAR": self._take_rbar,
            "MPC": self._take_mpc,
            "CONM2": self._take_conm2,
            "CELAS1": self._take_celas,
            "CELAS2": self._take_celas,
            "PELAS": self._take_pelas,
        }

    def takes(self, name: str, fields: list[str]) -> bool:
        """Add a card, and return whether it is one of those that are read."""
        if name not in self._take:
            return False
        self._take[name]([name, *fields])
        return True

    def _take_rbe2(self, card: list[str]) -> None:
        label, first, tied = f"RBE2 {card[1]}", int(card[2]), card[3]
        others = [field for field in card[4:] if field]
        if others and "." in others[-1]:  # coefficient of thermal expansion
            others.pop()
        self._rigid.append(_rigid(label, first, _points(others), tied))

    def _take_rbar(self, card: list[str]) -> None:
        label, (a, b), free = f"RBAR {card[1]}", map(int, card[2:4]), [*card[4:8], *[""] * 4][:4]
        independent, tied = free[:2], free[2:]
        if set(independent[0]) == _ALL and not independent[1]:
            self._rigid.append(_rigid(label, a, [b], tied[1] or "123456"))
        elif set(independent[1]) == _ALL and not independent[0]:
            self._rigid.append(_rigid(label, b, [a], tied[0] or "123456"))
        else:
            raise MeshFileError(f"{label} has independent components at both ends; one end with 123456 is read")

    def _take_rbe3(self, card: list[str]) -> None:
        label, reference, moved = f"RBE3 {card[1]}", int(card[3]), card[4]
        if set(moved) not in (_ALL, _MOVES):
            raise MeshFileError(f"{label} moves its point in {moved}; 123456 and 123 are read")
        points, weights = list[int](), list[float]()
        rest = [field for field in card[5:] if field]
        if "UM" in rest:
            raise MeshFileError(f"{label} has UM, other dependent components, which aren't read")
        rest = rest[: rest.index("ALPHA")] if "ALPHA" in rest else rest
        starts = [k for k, field in enumerate(rest) if "." in field]  # a weight, then components, then points
        for start, end in pairwise([*starts, len(rest)]):
            weight, components = read_field(rest[start]), rest[start + 1]
            if set(components) != _MOVES:
                raise MeshFileError(f"{label} follows its points in {components}; 123, displacements, are read")
            points += _points(rest[start + 2 : end])
            weights += [weight] * (len(points) - len(weights))
        if not points or not min(weights) > 0:
            raise MeshFileError(f"{label} has no points, or weights that aren't above 0")
        self._mean.append(
            MeanConnection(label, np.array([reference, *points]), np.array(weights), turning=set(moved) == _ALL)
        )

    def _take_mpc(self, card: list[str]) -> None:
        label, rest = f"MPC {card[1]}", [*card[2:], *[""] * 8]
        starts = [k for line in range(0, len(rest) - 8, 8) for k in (line, line + 3) if rest[k]]
        points, components = ([int(rest[k + i]) for k in starts] for i in (0, 1))
        coefficients = [read_field(rest[k + 2]) for k in starts]
        if not set(components) <= set(range(1, 7)) or not coefficients[0]:
            raise MeshFileError(f"{label} has a component that isn't 1 to 6, or a first coefficient of 0")
        self._equations[card[1]].append(
            Equation(label, np.array(points), np.array(components) - 1, np.array(coefficients))
        )

    def _take_conm2(self, card: list[str]) -> None:
        label, card = f"CONM2 {card[1]}", [*card, *[""] * 16]
        if card[3] not in ("", "0"):
            raise MeshFileError(f"{label} is in coordinate system {card[3]}; write it in the basic one, 0")
        mass, *offset = (read_field(field) for field in card[4:8])
        xx, xy, yy, xz, yz, zz = (read_field(field) for field in card[9:15])
        inertia = np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])  # whose products are ∫ xy dm
        if mass < 0:
            raise MeshFileError(f"{label} has a mass below 0")
        self._masses.append(MassOnPoint(label, np.array([int(card[2])]), mass, np.array(offset), inertia))

    def _take_celas(self, card: list[str]) -> None:
        label, card = f"{card[0]} {card[1]}", [*card, *[""] * 4]
        ends = [(int(point), int(c or 0)) for point, c in (card[3:5], card[5:7]) if point not in ("", "0")]
        if len(ends) < 2:
            raise MeshFileError(f"{label} has one end on the ground; give the body a support, or the scene a spring")
        if not all(1 <= c <= 6 for _, c in ends):
            raise MeshFileError(f"{label} has a component that isn't 1 to 6")
        k = read_field(card[2]) if card[0] == "CELAS2" else card[2]
        self._springs.append((label, [point for point, _ in ends], [c - 1 for _, c in ends], k))

    def _take_pelas(self, card: list[str]) -> None:
        for own in (card[1:5], card[5:9]):  # two in a card
            if len(own) > 1 and own[0]:
                self._stiffness[own[0]] = read_field(own[1])

    def connections(self, case_control: str, has_bulk_line: bool, place: Mapping[int, int]) -> Connections:
        """Return all connections, of places of points where cards have numbers.

        The case control selects the equations; without a line that begins the bulk data a single set of them holds.
        """
        springs = []
        for label, points, directions, given in self._springs:
            if isinstance(given, str) and given not in self._stiffness:
                raise MeshFileError(f"{label} names PELAS {given}, which isn't there")
            k = self._stiffness[given] if isinstance(given, str) else given
            if k < 0:
                raise MeshFileError(f"{label} has a stiffness below 0")
            if k:
                signs = np.array([1.0, -1.0])
                springs.append(SpringBetween(label, np.array(points), np.array(directions), signs, k))
        equations = self._selected(case_control, has_bulk_line)
        for each in (*equations, *springs):
            if turned := self.turned & set(each.points.tolist()):
                system = f"the coordinate system of grid point {min(turned)}"
                raise MeshFileError(f"{each.label} is in {system}; write its CD as 0, the basic one")
        found = Connections(
            tuple(self._rigid), tuple(self._mean), tuple(equations), tuple(springs), tuple(self._masses)
        )
        return replace(found, names={str(point): point for point in found.points.tolist()}).numbered(place)

    def _selected(self, case_control: str, has_bulk_line: bool) -> list[Equation]:
        """Return the equations of the set that the case control selects."""
        chosen = re.findall(r"^\s*MPC\s*=\s*(\d+)", case_control, re.I | re.M)
        if len(set(chosen)) > 1:
            raise MeshFileError(f"subcases select several sets of MPC: {', '.join(sorted(set(chosen)))}; leave one")
        if chosen or has_bulk_line:
            return self._equations.get(chosen[0], []) if chosen else []
        if len(self._equations) > 1:
            raise MeshFileError(f"there are several sets of MPC: {', '.join(self._equations)}; leave one")
        return [each for own in self._equations.values() for each in own]


def _rigid(label: str, first: int, others: Sequence[int], tied: str) -> RigidConnection:
    """Return a rigid connection whose points are tied in components such as ``123456``."""
    if not _MOVES <= set(tied) <= _ALL or set(tied) not in (_ALL, _MOVES):
        raise MeshFileError(f"{label} ties its points in {tied or 'nothing'}; 123456 and 123 are read")
    return RigidConnection(label, np.array([first, *others]), set(tied) == _ALL)


def _points(fields: list[str]) -> list[int]:
    """Return points from fields that may hold ``a THRU b``."""
    points: list[int] = []
    rest = list(fields)
    while rest:
        if rest[0].upper() == "THRU":
            points += range(points[-1] + 1, int(rest[1]) + 1)
            del rest[:2]
        else:
            points.append(int(rest.pop(0)))
    return points

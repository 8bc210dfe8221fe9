"""Sections, orientation and offsets of the beams of a deck, and what of them isn't read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.fortran import read_field, read_real
from fmd.core.limits.files import ISOTROPIC
from fmd.fem.sections import Section, box_section, i_section, rectangular_section, round_section


class DrawnSection(NamedTuple):
    """A section with its measures in the file's unit."""

    make: Callable[..., Section]  # makes the section of its measures [m]
    measures: tuple[float, ...]
    turned: bool = False  # true if the section's z is along the beam's first axis, and not its y


class BeamElement(NamedTuple):
    """Section, orientation and offsets of a beam by its card."""

    label: str  # its name and number, for messages
    section: str  # name of its property or set
    towards: Array  # (3,) or (0,): vector in the plane of the beam's first axis; empty if there is none
    offsets: Array  # (2, 3): of both ends from their nodes, in the file's unit


@dataclass
class DeckBeams:
    """Beams of a deck."""

    sections: dict[str, DrawnSection] = field(default_factory=dict)  # by the name of their property or set
    elements: list[BeamElement] = field(default_factory=list)  # of the lines of two nodes, in the order of their blocks
    faults: list[str] = field(default_factory=list)  # what isn't read


class NastranBeams:
    """Beams of Nastran, card by card."""

    def __init__(self) -> None:
        self.deck = DeckBeams()
        self._ends: list[tuple[int, int]] = []
        self._towards_point: dict[int, tuple[int, int]] = {}  # of an element: the grid points of its vector

    def takes(self, name: str, fields: list[str]) -> bool:
        """Take the card of a beam's property; return False for another."""
        if name in ("PBARL", "PBEAML"):
            self._take_section(f"{name} {fields[0]}", fields)
        elif name in ("PBAR", "PBEAM", "PBCOMP", "PROD", "PTUBE"):
            self.deck.faults.append(f"{name} {fields[0]} has no drawing; PBARL and PBEAML are read")
        else:
            return False
        return True

    def _take_section(self, label: str, fields: list[str]) -> None:
        """Take a section by its measures, all of one size along the beam."""
        kind = fields[3].upper()
        if kind not in _NASTRAN:
            self.deck.faults.append(f"{label} of type {kind}; {', '.join(_NASTRAN)} are read")
            return
        n, read = _NASTRAN[kind]
        measures = [read_field(each) for each in fields[8 : 8 + n] if each]
        if len(measures) < n or any(each not in ("", "0", "0.", "0.0") for each in fields[8 + n :]):
            self.deck.faults.append(f"{label} has fewer measures than its type, a mass or stations of its own")
            return
        found = read(*measures)
        if found is None:
            self.deck.faults.append(f"{label} has walls that differ from side to side")
            return
        self.deck.sections[fields[0]] = found

    def add(self, name: str, fields: list[str]) -> None:
        """Take the orientation and the offsets of an element."""
        label = f"{name} {fields[0]}"
        given = [*fields, *[""] * 16]
        if name not in ("CBAR", "CBEAM"):
            self.deck.faults.append(f"{label}; CBAR and CBEAM are read")
        if given[7] not in ("", "GGG") or any(each not in ("", "0") for each in given[8:10]):
            self.deck.faults.append(f"{label} has OFFT other than GGG, BIT or pins")
        vector, offsets = given[4:7], [read_field(each) for each in given[10:16]]
        if vector[0] and not any(vector[1:]) and "." not in vector[0]:
            self._towards_point[len(self.deck.elements)] = int(fields[2]), int(vector[0])
            vector = ["", "", ""]
        towards = np.array([read_field(each) for each in vector]) if any(vector) else np.zeros(0)
        self.deck.elements.append(BeamElement(label, fields[1], towards, np.reshape(offsets, (2, 3))))
        self._ends.append((int(fields[2]), int(fields[3])))

    def finished(
        self, points: Mapping[int, Array], moves: Mapping[int, str], directions: Callable[[str], Array | None]
    ) -> DeckBeams:
        """Return the beams in the basic system, with vectors towards points, whose places are in that.

        Points move in systems (CD); a beam's vector is in that of its first end, an offset in that of its own.
        ``directions`` gives a system's axes, the columns; ``None`` if they differ from place to place.
        """
        for k, ends in enumerate(self._ends if moves else ()):
            label, _, towards, offsets = self.deck.elements[k]
            for number, end in enumerate(ends):
                of_first = towards if number == 0 else np.zeros(0)
                if end not in moves or not (offsets[number].any() or of_first.any()):
                    continue
                axes = directions(moves[end])
                if axes is None:
                    what = f"coordinate system {moves[end]} of grid point {end}, its CD; CORD2R is read"
                    self.deck.faults.append(f"{label} has a vector or an offset in the round {what}")
                    continue
                offsets[number] = axes @ offsets[number]
                if of_first.size:
                    towards = axes @ towards
            self.deck.elements[k] = self.deck.elements[k]._replace(towards=towards)
        for k, (end, point) in self._towards_point.items():
            if end in points and point in points:
                towards = np.subtract(points[point], points[end])
                self.deck.elements[k] = self.deck.elements[k]._replace(towards=towards)
        return self.deck


def are_alike(*walls: float) -> bool:
    """Return true for thicknesses that are equal but for how they are rounded."""
    return max(walls) - min(walls) <= ISOTROPIC * max(walls)


def _nastran_box(width: float, height: float, wall: float, side: float) -> DrawnSection | None:
    return DrawnSection(box_section, (height, width, wall)) if are_alike(wall, side) else None


def _nastran_i(h: float, below: float, above: float, web: float, low: float, high: float) -> DrawnSection | None:
    if not (are_alike(below, above) and are_alike(low, high)):
        return None
    return DrawnSection(i_section, (below, h, web, low), turned=True)


# Numbers of measures, and what they are; a beam's first axis is y, along which Nastran's heights are.
_NASTRAN: dict[str, tuple[int, Callable[..., DrawnSection | None]]] = {
    "ROD": (1, lambda radius: DrawnSection(round_section, (2 * radius,))),
    "TUBE": (2, lambda outer, inner: DrawnSection(round_section, (2 * outer, 2 * inner))),
    "TUBE2": (2, lambda outer, wall: DrawnSection(round_section, (2 * outer, 2 * (outer - wall)))),
    "BAR": (2, lambda width, height: DrawnSection(rectangular_section, (height, width))),
    "BOX": (4, _nastran_box),
    "I": (6, _nastran_i),
}


def _abaqus_box(a: float, b: float, *walls: float) -> DrawnSection | None:
    return DrawnSection(box_section, (a, b, walls[0])) if are_alike(*walls) else None


def _abaqus_i(
    low: float, h: float, below: float, above: float, thick: float, top: float, web: float
) -> DrawnSection | None:
    if not (are_alike(below, above) and are_alike(thick, top) and abs(2 * low - h) <= ISOTROPIC * h):
        return None
    return DrawnSection(i_section, (below, h, web, thick))


_ABAQUS: dict[str, tuple[int, Callable[..., DrawnSection | None]]] = {
    "CIRC": (1, lambda radius: DrawnSection(round_section, (2 * radius,))),
    "PIPE": (2, lambda radius, wall: DrawnSection(round_section, (2 * radius, 2 * (radius - wall)))),
    "RECT": (2, lambda a, b: DrawnSection(rectangular_section, (a, b))),
    "BOX": (6, _abaqus_box),
    "I": (7, _abaqus_i),
}


def take_abaqus_section(deck: DeckBeams, name: str, options: Mapping[str, str], data: list[list[str]]) -> Array:
    """Take Abaqus' ``*BEAM SECTION`` of an element set, and return its direction n₁."""
    kind, label = options.get("SECTION", "").upper(), f"*BEAM SECTION of {name}"
    rows = [[read_real(item) for item in row if item] for row in data]
    if kind not in _ABAQUS:
        deck.faults.append(f"{label} with SECTION = {kind or 'none'}; {', '.join(_ABAQUS)} are read")
    elif not rows or len(rows[0]) != _ABAQUS[kind][0]:
        deck.faults.append(f"{label} has not the {_ABAQUS[kind][0]} measures of its kind")
    elif (found := _ABAQUS[kind][1](*rows[0])) is None:
        deck.faults.append(f"{label} has walls that differ from side to side, or nodes off its middle")
    else:
        deck.sections[name] = found
    return np.array(rows[1]) if len(rows) > 1 and len(rows[1]) == 3 else np.array([0.0, 0.0, -1.0])

"""Sections, orientation and offsets of the beams of a deck, and what of them isn't read."""

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import NamedTuple

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.fortran import read_field, read_real
from fmd.core.limits.files import ISOTROPIC
from fmd.core.limits.mesh import FULLEST_TUBE, MOST_TUBES
from fmd.fem.sections import Section, box_section, i_section, numbered_section, rectangular_section, round_section

DIAMETER_MEND = "CalculiX takes it for the diameter, for which write the number twice"


class DrawnSection(NamedTuple):
    """A section with its measures in the file's unit."""

    make: Callable[..., Section]  # makes the section of its measures [m]
    measures: tuple[float, ...]
    angle: float = 0.0  # of the section's y from the beam's first axis, about the beam [rad]
    line_mass: float = 0.0  # mass beside the material's, in the file's units of mass and length


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
    notes: list[str] = field(default_factory=list)  # how something is read that other programs read otherwise

    def add_numbers(self, name: str, label: str, found: DrawnSection | str) -> None:
        """Add a section by its numbers, or what is wrong with it."""
        if isinstance(found, str):
            self.faults.append(f"{label} {found}")
        else:
            self.sections[name] = found


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
        elif name in ("PBAR", "PBEAM"):
            self._take_numbers(f"{name} {fields[0]}", name == "PBAR", [*fields, *[""] * 48])
        elif name in ("PBCOMP", "PROD", "PTUBE"):
            self.deck.faults.append(f"{name} {fields[0]}; PBAR, PBEAM, PBARL and PBEAML are read")
        else:
            return False
        return True

    def _take_numbers(self, label: str, is_bar: bool, fields: list[str]) -> None:
        """Take a section by its numbers, alike at both ends."""
        points, rest = fields[8:16], fields[16:]
        if is_bar:
            area, about_z, about_y, torsion, mass = map(read_field, fields[2:7])
            product, rest = read_field(rest[2]), [*rest[:2], fields[7], *rest[3:]]
        else:
            area, about_z, about_y, product, torsion, mass = map(read_field, fields[2:8])
            if (far := rest[0].upper()) in ("YES", "YESA", "NO"):  # a station, at the second end
                same = [*fields[2:8], *points][: 14 if far == "YES" else 6]
                again = rest[2 : 2 + len(same)]
                other = any(two and read_field(one) != read_field(two) for one, two in zip(same, again, strict=True))
                rest = ["other"] if other or read_field(rest[1]) != 1 else rest[16 if far == "YES" else 8 :]
        if any(each not in ("", "0", "0.", "0.0") for each in rest[2:] or rest):
            self.deck.faults.append(f"{label} has stations, shear relief, warping or inertia beside areas and moments")
            return
        shares = tuple(read_field(each) if each or is_bar else 1.0 for each in rest[:2])
        seen = np.reshape([read_field(each) for each in points], (4, 2)) if any(points) else None
        found = numbers(area, (about_y, about_z, product), torsion, shares, mass, seen)
        self.deck.add_numbers(fields[0], label, found)

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


def numbers(
    area: float,
    second: tuple[float, float, float],
    torsion: float,
    shares: tuple[float, ...],
    line_mass: float = 0.0,
    seen: Array | None = None,
) -> DrawnSection | str:
    """Return a section by area, ∫ z², ∫ y² and ∫ y z, J, shares of shear along y and z (0 without shear), and mass.

    All are in the file's units; y and z are the beam's first and second axis, in which the points (4, 2) of its stress
    are, too. Return what is wrong of one that isn't that of a beam.
    """
    about_y, about_z, product = second
    given = np.array([area, *second, torsion, line_mass, *shares, *(() if seen is None else seen.ravel())])
    if not np.isfinite(given).all() or min(line_mass, *shares) < 0:
        return "has a number that isn't finite, or a mass or a factor of shear below 0"
    moments, axes = np.linalg.eigh(np.array([[about_z, product], [product, about_y]]))
    if not (area > 0 and moments[0] > 0 and torsion > 0):
        return "has an area, a moment of inertia or a torsion constant J that isn't positive"
    if area**4 > 144 * (MOST_TUBES * FULLEST_TUBE) ** 2 * moments.prod():
        return "has moments of inertia as of a rod that hardly resists bending"
    if not product:
        moments, axes = np.array([about_z, about_y]), np.eye(2)
    elif shares[0] != shares[1]:
        return "has I12 and two factors of shear, K1 and K2"
    elif np.linalg.det(axes) < 0:
        axes[:, 1] *= -1

    def make(side: float, of_y: float, of_z: float, of_twist: float, *places: float, line_mass: float = 0.0) -> Section:
        points = np.reshape(places, (4, 2)) if places else None
        return numbered_section(side**2, (of_y**4, of_z**4), of_twist**4, (shares[0], shares[1]), line_mass, points)

    sizes = np.array([moments[1], moments[0], torsion]) ** 0.25
    places = [] if seen is None else (seen @ axes).ravel().tolist()
    angle = float(np.arctan2(axes[1, 0], axes[0, 0]))
    return DrawnSection(make, (area**0.5, *sizes.tolist(), *places), angle, line_mass)


def are_alike(*walls: float) -> bool:
    """Return true for thicknesses that are equal but for how they are rounded."""
    return max(walls) - min(walls) <= ISOTROPIC * max(walls)


def _nastran_box(width: float, height: float, wall: float, side: float) -> DrawnSection | None:
    return DrawnSection(box_section, (height, width, wall)) if are_alike(wall, side) else None


def _nastran_i(h: float, below: float, above: float, web: float, low: float, high: float) -> DrawnSection | None:
    if not (are_alike(below, above) and are_alike(low, high)):
        return None
    return DrawnSection(i_section, (below, h, web, low), angle=-np.pi / 2)


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


def take_abaqus_section(
    deck: DeckBeams, name: str, options: Mapping[str, str], data: list[list[str]], points: list[float] | None = None
) -> Array:
    """Take Abaqus' ``*BEAM SECTION`` of an element set, and return its direction n₁.

    With ``points``, coordinates one after the other, empty if there are none, it is ``*BEAM GENERAL SECTION``.
    """
    general = points is not None
    kind = options.get("SECTION", "GENERAL" if general else "").upper()
    label = f"*BEAM {'GENERAL ' * general}SECTION of {name}"
    rows = [[read_real(item) for item in row if item] for row in data]
    if general and kind == "GENERAL":
        if not rows or len(rows[0]) < 5 or any(rows[0][5:]) or len(points or ()) > 8:
            deck.faults.append(f"{label} has not A, I11, I12, I22 and J alone, or more than four *SECTION POINTS")
        else:
            area, about_y, product, about_z, torsion = rows[0][:5]
            seen = np.reshape([*points, *[0.0] * (8 - len(points))], (4, 2)) if points else None
            deck.add_numbers(name, label, numbers(area, (about_y, about_z, product), torsion, (1.0, 1.0), 0.0, seen))
    elif kind not in _ABAQUS:
        deck.faults.append(f"{label} with SECTION = {kind or 'none'}; {', '.join(_ABAQUS)} are read")
    elif kind == "CIRC" and rows and len(rows[0]) == 2:  # CalculiX's, the thickness along both axes
        if are_alike(*rows[0]):
            deck.sections[name] = DrawnSection(round_section, (rows[0][0],))
        else:
            deck.faults.append(f"{label} with SECTION = CIRC of two thicknesses is an ellipse; a circle is read")
    elif not rows or len(rows[0]) != _ABAQUS[kind][0]:
        deck.faults.append(f"{label} has not the {_ABAQUS[kind][0]} measures of its kind")
    elif (found := _ABAQUS[kind][1](*rows[0])) is None:
        deck.faults.append(f"{label} has walls that differ from side to side, or nodes off its middle")
    else:
        deck.sections[name] = found
        if kind == "CIRC" and not any(DIAMETER_MEND in note for note in deck.notes):
            deck.notes.append(
                f"{label}: CIRC {rows[0][0]:g} is a radius, as in Abaqus, here and elsewhere; {DIAMETER_MEND}"
            )
    return np.array(rows[1]) if len(rows) > 1 and len(rows[1]) == 3 else np.array([0.0, 0.0, -1.0])

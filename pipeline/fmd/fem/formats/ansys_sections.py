"""Sections of shells and beams in Ansys' decks."""

from collections.abc import Callable, Mapping
from dataclasses import field

import numpy as np

from fmd.core.arrays import Array
from fmd.core.data_classes import dataclass
from fmd.core.fortran import read_field
from fmd.core.limits.files import UPRIGHT_BEAM
from fmd.fem.formats.ansys_links import Element
from fmd.fem.formats.beam_sections import BeamElement, DeckBeams, DrawnSection, are_alike, numbers
from fmd.fem.sections import box_section, i_section, rectangular_section, round_section


@dataclass(frozen=True)
class AnsysSection:
    """A section by SECTYPE, SECDATA and SECOFFSET."""

    label: str
    of: str  # SHELL, BEAM …
    kind: str  # of a beam: RECT …
    rows: list[list[float]] = field(default_factory=list)  # numbers of each line
    offset: list[str] = field(default_factory=list)


def shell_section(
    element: Element, section: AnsysSection | None, real: list[float], m: int
) -> tuple[Array, float, str]:
    """Return thickness at the m corners of a shell, offset of its middle from them, and what of its section isn't read.

    SHELL63 and SHELL93 have real constants in place of a section.
    """
    part = element.options.get(1, 0) if element.kind != 93 else 0
    fault = f"{element.name} with KEYOPT(1) = {part}, a part of a shell's stiffness" if part else ""
    if element.kind in (63, 93):
        t = np.array([each or real[0] for each in (real[:4] + [0.0] * 4)[:m]]) if real else np.full(m, np.nan)
        return t, 0.0, fault
    if section is None or section.of != "SHELL" or not section.rows:
        return np.full(m, np.nan), 0.0, fault
    thickness = sum(row[0] for row in section.rows)
    where = (section.offset or ["MID"])[0].upper()
    shares = {"MID": 0.0, "TOP": -0.5, "BOT": 0.5}  # of nodes on the upper face the middle is below
    if len(section.rows) > 1:
        fault = f"{section.label} of {len(section.rows)} layers"
    elif where not in shares:
        fault = f"{section.label} with SECOFFSET,{where}"
    return np.full(m, thickness), shares.get(where, 0.0) * thickness, fault


def _hollow(across: float, along: float, *walls: float) -> DrawnSection | None:
    return DrawnSection(box_section, (along, across, walls[0])) if are_alike(*walls) else None


def _i(low: float, top: float, height: float, *walls: float) -> DrawnSection | None:
    if not (are_alike(low, top) and are_alike(*walls[:2])):
        return None
    return DrawnSection(i_section, (low, height, walls[2], walls[0]), angle=-np.pi / 2)


def _arbitrary(
    area: float, about_y: float, product: float, about_z: float, _warping: float, torsion: float, *more: float
) -> DrawnSection | str:
    """Return a section by its numbers, ASEC; y here is Ansys' z, and z its y backwards."""
    *centres, along_z, along_y, share_z, share_y = more
    if any(centres) or not (share_z > 0 and share_y > 0):
        return "of type ASEC has its centroid or its shear centre off the node, or no TSxz and TSxy"
    seen = 0.5 * np.array([(a * along_z, b * along_y) for a in (1, -1) for b in (1, -1)])
    has_points = along_z > 0 and along_y > 0
    second = (about_z, about_y, -product)
    return numbers(area, second, torsion, (share_z, share_y), seen=seen if has_points else None)


# Numbers of measures, and what they are; a beam's first axis here is Ansys' z, along which its heights are.
_DRAWN: dict[str, tuple[int, Callable[..., DrawnSection | str | None]]] = {
    "RECT": (2, lambda across, along: DrawnSection(rectangular_section, (along, across))),
    "CSOLID": (1, lambda radius: DrawnSection(round_section, (2 * radius,))),
    "CTUBE": (2, lambda inner, outer: DrawnSection(round_section, (2 * outer, 2 * inner))),
    "HREC": (6, _hollow),
    "I": (6, _i),
    "ASEC": (14, _arbitrary),
}


def beam_section(deck: DeckBeams, section: AnsysSection) -> None:
    """Add the drawing of a beam's section, or what of it isn't read."""
    n, draw = _DRAWN.get(section.kind.upper(), (0, None))
    values = [value for row in section.rows for value in row]
    if section.of != "BEAM" or draw is None:
        deck.faults.append(f"{section.label} of type {section.kind or section.of}; {', '.join(_DRAWN)} are read")
    elif len(values) < n:
        deck.faults.append(f"{section.label} has not the {n} measures of its type")
    elif (section.offset or ["CENT"])[0].upper() != "CENT" or any(read_field(each) for each in section.offset[1:]):
        deck.faults.append(f"{section.label} with SECOFFSET other than CENT")
    elif (found := draw(*values[:n])) is None:
        deck.faults.append(f"{section.label} has walls that differ from side to side")
    elif isinstance(found, str):
        deck.faults.append(f"{section.label} {found}")
    else:
        deck.sections[section.label] = found


def beam_element(
    element: Element, section: AnsysSection | None, ends: Array, nodes: Mapping[int, tuple[float, ...]]
) -> BeamElement:
    """Return a beam with its z axis, towards its third node or, without, across a y axis that is level."""
    label = f"{element.name} {element.number}"
    if len(element.nodes) > 2 and element.nodes[2]:
        towards = np.array(nodes[element.nodes[2]]) - ends[0]
    else:
        x = ends[1] - ends[0]
        level = np.hypot(x[0], x[1]) > UPRIGHT_BEAM * abs(x[2])
        towards = np.cross(x, np.array([-x[1], x[0], 0.0]) if level else np.array([0.0, 1.0, 0.0]))
    return BeamElement(label, section.label if section else "", towards, np.zeros((2, 3)))

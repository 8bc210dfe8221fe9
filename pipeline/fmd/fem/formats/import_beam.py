"""Import of beams from the lines of a deck of Nastran, Abaqus or Ansys."""

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.limits.mesh import ON_A_LINE
from fmd.fem.beams import Beams, extrude
from fmd.fem.formats.beam_sections import BeamElement, DrawnSection
from fmd.fem.formats.import_mesh import link_taken, number_used, require_one_piece
from fmd.fem.formats.named_sets import faces_of_points
from fmd.fem.formats.raw_mesh import MeshFileError, RawMesh
from fmd.fem.mesh import SolidMesh
from fmd.fem.sections import RoundSection, Section


def mesh_beams(raw: RawMesh, scale: float, units: tuple[float | None, float | None]) -> SolidMesh:
    """Return the mesh of a deck that holds beams alone, its units of length, mass and force given."""
    found = take_beams(raw, scale, units[0])
    require_one_piece(raw, np.concatenate([cells for kind, cells in raw.blocks if kind == "line"]), "beams")
    return link_taken(raw, found, extrude, scale, units)


def take_beams(raw: RawMesh, scale: float, mass_unit: float | None) -> tuple[Beams, IntArray]:
    """Take the beams of a raw mesh; return the number that each point of the file has, too, -1 of no beam."""
    if not raw.beams.elements or not raw.count_elements().keys() <= {"line", "vertex"}:
        raise MeshFileError(f"mesh.beam is of beams of two nodes alone; the elements: {raw.list_elements()}")
    if raw.beams.faults:
        more = "" if len(raw.beams.faults) == 1 else f", and {len(raw.beams.faults) - 1} more"
        raise MeshFileError(f"beams that aren't read: {raw.beams.faults[0]}{more}")
    blocks = [(b, cells) for b, (kind, cells) in enumerate(raw.blocks) if kind == "line" and len(cells)]
    cells = np.concatenate([cells for _, cells in blocks])
    used, place = number_used(cells, len(raw.points))
    names = list(dict.fromkeys(element.section for element in raw.beams.elements))
    missing = next((element for element in raw.beams.elements if element.section not in raw.beams.sections), None)
    if missing is not None:
        raise MeshFileError(f"{missing.label} has no section")
    drawn = [raw.beams.sections[name] for name in names]
    if mass_unit is None and scale != 1.0 and any(each.line_mass for each in drawn):  # kg in a file in metres
        raise MeshFileError("has beams with mass of their own, NSM, whose unit is wanted: mesh.mass_unit")
    sections = tuple(_section(each, scale, mass_unit) for each in drawn)
    of = np.array([names.index(element.section) for element in raw.beams.elements])
    offsets = scale * np.array([element.offsets for element in raw.beams.elements])
    x = raw.points * scale
    along = x[cells] + offsets
    axes = np.stack(
        [
            _axes(element, ends[1] - ends[0], drawn[k], sections[k])
            for element, ends, k in zip(raw.beams.elements, along, of, strict=True)
        ]
    )
    starts = np.cumsum([0, *(len(own) for _, own in blocks)])
    parts = {
        name: np.concatenate([starts[k] + chosen[b] for k, (b, _) in enumerate(blocks)])
        for name, chosen in raw.cell_sets.items()
    }
    parts = {name: own for name, own in parts.items() if len(own)} or {"all": np.arange(len(cells))}
    rest = np.setdiff1d(np.arange(len(cells)), np.concatenate(list(parts.values())))
    whole = Beams(
        x[used],
        place[cells],
        axes,
        sections,
        of,
        parts | ({"rest": rest} if len(rest) else {}),
        faces_of_points(raw, place),
        offsets,
        tuple(raw.beams.notes),
    )
    return whole, place


def _section(drawn: DrawnSection, scale: float, mass_unit: float | None) -> Section:
    """Return the section of its measures, given the file's units of length [m] and mass [kg]."""
    mass = {"line_mass": drawn.line_mass * (mass_unit or 1.0) / scale} if drawn.line_mass else {}
    return drawn.make(*(scale * one for one in drawn.measures), **mass)


def _axes(element: BeamElement, along: Array, drawn: DrawnSection, section: Section) -> Array:
    """Return unit vectors along a beam, and along y and z of its section as it is drawn, as rows (3, 3)."""
    length = float(np.linalg.norm(along))
    if not length > 0:
        raise MeshFileError(f"{element.label} has no length")
    x, towards = along / length, element.towards
    if not towards.size and isinstance(section, RoundSection):
        towards = np.eye(3)[np.abs(x).argmin()]
    if not towards.size:
        raise MeshFileError(f"{element.label} has no orientation vector")
    y = towards - (towards @ x) * x
    if np.linalg.norm(y) ** 2 <= ON_A_LINE * (towards @ towards):
        if not isinstance(section, RoundSection):
            raise MeshFileError(f"{element.label} has an orientation vector along itself")
        y = np.cross(x, np.eye(3)[np.abs(x).argmin()])
    y /= np.linalg.norm(y)
    z = np.cross(x, y)
    c, s = np.cos(drawn.angle), np.sin(drawn.angle)
    return np.stack([x, c * y + s * z, c * z - s * y])

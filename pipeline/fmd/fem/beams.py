"""Beams as layers of solid cells between drawn sections, which hang on the nodes of a line as rigid pieces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fmd.core.arrays import Array, IntArray, read_only
from fmd.core.data_classes import dataclass
from fmd.core.limits.mesh import FACE_IN_PLANE, ON_A_LINE
from fmd.fem.cells.beam import BEAM
from fmd.fem.cells.cell import SolidCell
from fmd.fem.mesh import SolidMesh
from fmd.fem.midsurface import Midsurface
from fmd.fem.sections import Changed, EvenSection, Section


@dataclass(frozen=True)
class Beams:
    """Beams between nodes."""

    x: Array  # (n_nodes, 3): positions of the nodes [m]
    ends: IntArray  # (n_beams, 2): nodes at the ends of each
    axes: Array  # (n_beams, 3, 3): unit vectors along each beam and along y and z of its section, as rows
    sections: tuple[Section, ...]
    of: IntArray  # (n_beams,): number of each beam's section
    parts: Mapping[str, IntArray]
    faces: Mapping[str, IntArray]  # nodes of each face, which is all of the sections there
    offsets: Array | None = None  # (n_beams, 2, 3): of the centroids at both ends from their nodes [m]
    notes: tuple[str, ...] = ()  # how something of their file is read


@dataclass(frozen=True)
class BeamLine(Midsurface):
    """Nodes of beams, each with the points of the sections that turn with it."""

    axes: Array  # (n_cells, 3, 3): unit vectors along each cell's beam and along y and z of its section, as rows
    start: Array  # (n_cells, 3): centroid of the section at which each begins [m]
    length: Array  # (n_cells,) [m]
    sections: tuple[Section | Changed, ...]
    of: IntArray  # (n_cells,): number of each cell's section
    beam: IntArray  # (n_cells,): number of each cell's beam
    ends: IntArray  # (n_beams, 2): nodes at the ends of each beam

    alike = ON_A_LINE
    has_sections = True

    def __post_init__(self) -> None:
        super().__post_init__()
        for each in (self.axes, self.start, self.length, self.of, self.beam, self.ends):
            read_only(each)

    def forced(self) -> BeamLine:
        """Return the line with sections whose strain gives their force."""
        found = tuple(own.forced() for own in self.sections)
        return self if all(a is b for a, b in zip(found, self.sections, strict=True)) else replace(self, sections=found)

    def stressed(self) -> BeamLine | None:
        """Return the line with sections whose strain gives their stress; ``None`` if one has none."""
        found = [own.stressed() for own in self.sections]
        known = tuple(own for own in found if own is not None)
        if all(a is b for a, b in zip(found, self.sections, strict=True)):
            return self
        return replace(self, sections=known) if len(known) == len(found) else None

    def evenly_strained(self) -> BeamLine:
        """Return the line with sections over which strains of shear and twist are even."""
        return replace(self, sections=tuple(EvenSection(own) for own in self.sections))

    def cell(self, name: str) -> SolidCell:
        """Return the layer between two sections."""
        return BEAM


def extrude(beams: Beams) -> SolidMesh:
    """Return the mesh of solid cells between the sections of beams, with the line that they hang on."""
    middles = beams.x[beams.ends] + (0.0 if beams.offsets is None else beams.offsets)
    points, owners, cells, beam, count = [], [], [], [], 0
    for k, (ends, axes) in enumerate(zip(beams.ends, beams.axes, strict=True)):
        section = beams.sections[beams.of[k]]
        n, drawn = len(section.points), section.points @ axes[1:]
        points += [middle + drawn for middle in middles[k]]
        owners += [np.full(n, end) for end in ends]
        cells.append(np.concatenate([section.quads, section.quads + n], axis=1) + count)
        beam.append(np.full(len(section.quads), k))
        count += 2 * n
    x, owner, of_beam = np.concatenate(points), np.concatenate(owners), np.concatenate(beam)
    # Beams in line have their points in common, but a section's own stay apart.
    size = min(FACE_IN_PLANE * float(np.ptp(x, axis=0).max()), *(0.5 * each.closest() for each in beams.sections))
    keys = np.column_stack([owner, np.round(x / size)])
    _, first, same = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    line = BeamLine(
        beams.x,
        owner[first],
        beams.axes[of_beam],
        middles[of_beam, 0],
        np.linalg.norm(middles[:, 1] - middles[:, 0], axis=1)[of_beam],
        beams.sections,
        beams.of[of_beam],
        of_beam,
        beams.ends,
    )
    return SolidMesh(
        x[first],
        same.ravel()[np.concatenate(cells)],
        "hexahedron",
        {name: np.flatnonzero(np.isin(of_beam, own)) for name, own in beams.parts.items()},
        {name: np.flatnonzero(np.isin(owner[first], nodes)) for name, nodes in beams.faces.items()},
        notes=beams.notes,
        midsurface=line,
    )

"""The layer of a beam between two sections, one cell for each quadrilateral of the section."""

from __future__ import annotations

from functools import partial

from fmd.fem.beam_strain import beam_strain, uniaxial_stress
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.shell import QuadrilateralElement, ShellQuadrilateral
from fmd.fem.elements import ElementKind

_QUAD = partial(QuadrilateralElement, 1)
_KIND = ElementKind(
    "beam", 12, ShellQuadrilateral, 1, _QUAD, _QUAD, 4, 3, 3, strain_matrix=beam_strain, stressed=uniaxial_stress
)
BEAM = SolidCell("hexahedron", ShellQuadrilateral, 1, (_KIND,))

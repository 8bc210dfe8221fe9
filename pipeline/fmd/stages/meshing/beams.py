"""Meshes of shafts and profiles from their tables in the scene."""

from functools import singledispatch

import numpy as np

from fmd.fem.beams import Beams, extrude
from fmd.fem.mesh import SolidMesh
from fmd.fem.sections import Section, box_section, i_section, rectangular_section, round_section
from fmd.scene.beams import Box, ISection, MeshedBeam, Rectangle, ShaftSegment


def mesh_beams(shape: MeshedBeam) -> SolidMesh:
    """Divide a body of beams in a line along x."""
    steps, fixed = np.cumsum([0.0, *shape.lengths]), shape.fixed_sections
    spans = zip(fixed[:-1], fixed[1:], shape.divisions, strict=True)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in spans]
    place = np.concatenate([*pieces, fixed[-1:]])
    n = len(place) - 1
    of = np.searchsorted(steps, 0.5 * (place[:-1] + place[1:])) - 1
    x = np.zeros((n + 1, 3))
    x[:, 0] = place
    at = {"x-": 0.0, "x+": float(steps[-1])} | shape.station
    return extrude(
        Beams(
            x,
            np.stack([np.arange(n), np.arange(1, n + 1)], axis=1),
            np.tile(np.eye(3), (n, 1, 1)),
            tuple(_section(table) for table in shape.section_tables),
            of,
            {name: np.flatnonzero(of == k) for k, name in enumerate(shape.parts or ())},
            {name: np.array([np.abs(place - distance).argmin()]) for name, distance in at.items()},
        )
    )


@singledispatch
def _section(table: object) -> Section:
    """Return the section of a scene's table."""
    raise TypeError(f"{type(table).__name__} is no section")


@_section.register
def _(table: ShaftSegment) -> Section:
    return round_section(table.diameter, table.bore or 0.0)


@_section.register
def _(table: Rectangle) -> Section:
    return rectangular_section(table.width, table.height)


@_section.register
def _(table: Box) -> Section:
    return box_section(table.width, table.height, table.wall)


@_section.register
def _(table: ISection) -> Section:
    return i_section(table.width, table.height, table.web, table.flange)

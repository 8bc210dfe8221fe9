"""Meshes of shafts and profiles from their tables in the scene."""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from fmd.core.limits.mesh import FACE_IN_PLANE
from fmd.fem.beams import Beams, extrude
from fmd.fem.mesh import SolidMesh
from fmd.fem.sections import Section, box_section, i_section, rectangular_section, round_section
from fmd.scene.beams import Box, ISection, MeshedBeam, Profile, Rectangle, Shaft, ShaftSegment


def mesh_beams(shape: MeshedBeam) -> SolidMesh:
    """Divide a body of beams in a line along x."""
    lengths, sections = _spans(shape)
    steps = np.cumsum([0.0, *lengths])
    near = FACE_IN_PLANE * steps[-1]
    fixed = np.sort(np.concatenate([steps, list(shape.station.values())]))
    fixed = fixed[np.append(True, np.diff(fixed) > near)]
    counts = np.ceil(np.diff(fixed) / shape.mesh.size - 1e-9).astype(int)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(fixed[:-1], fixed[1:], counts, strict=True)]
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
            sections,
            of,
            {name: np.flatnonzero(of == k) for k, name in enumerate(shape.parts or ())},
            {name: np.array([np.abs(place - distance).argmin()]) for name, distance in at.items()},
        )
    )


@singledispatch
def _spans(shape: object) -> tuple[tuple[float, ...], tuple[Section, ...]]:
    """Return the lengths [m] and sections of a body's spans."""
    raise TypeError(f"{type(shape).__name__} is no body of beams")


@_spans.register
def _(shape: Shaft) -> tuple[tuple[float, ...], tuple[Section, ...]]:
    return tuple(each.length for each in shape.segment), tuple(_section(each) for each in shape.segment)


@_spans.register
def _(shape: Profile) -> tuple[tuple[float, ...], tuple[Section, ...]]:
    return (shape.length,), (_section(shape.section),)


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

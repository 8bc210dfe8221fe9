"""Where a flexible body is held, jointed and loaded: its scene's markers and supports on its mesh or nodes."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from pipeline.core.arrays import IntArray
from pipeline.core.errors import InputError
from pipeline.scene.reading import suggest_name

if TYPE_CHECKING:
    from pipeline.fem.markers import Marker
    from pipeline.scene.places import MarkerPlace
    from pipeline.stages.part import FlexiblePart


def markers_of(part: FlexiblePart) -> dict[str, Marker]:
    """A body's markers on its finite element model.

    Raises
    ------
    InputError
        A face isn't there, or no part of the surface is.
    """
    found = {}
    for name, marker in part.shape.marker.items():
        try:
            found[name] = _marker(part, name, marker)
        except ValueError as error:
            key = f"body.{part.name}.marker.{name}"
            raise InputError(part.file, key, next(iter(marker.where.values())), str(error)) from error
    return found


def _marker(part: FlexiblePart, name: str, marker: MarkerPlace) -> Marker:
    from pipeline.fem.formats.matrices import MatrixModel, node_marker, nodes_in_plane
    from pipeline.fem.markers import face_marker
    from pipeline.fem.selection import facets_in_plane, facets_near

    rigid = marker.attachment == "rigid"
    if not part.has_mesh:
        assert isinstance(part.fe, MatrixModel)
        nodes = nodes_in_plane(part.fe, *marker.plane) if marker.plane else np.array(marker.nodes)
        return node_marker(part.fe, nodes, rigid)
    if marker.plane is not None:
        return face_marker(part.space, facets_in_plane(part.space, *marker.plane), rigid)
    if marker.near is not None:
        return face_marker(part.space, facets_near(part.space, np.array(marker.near), _cad_faces(part)), rigid)
    faces = [part.mesh.faces[known_name(part, "marker", name, face)] for face in marker.faces]
    return face_marker(part.space, faces, rigid)


def _cad_faces(part: FlexiblePart) -> list[IntArray]:
    """The faces that CAD itself tells apart; fillets, which have no sharp edges, are such."""
    if part.shape.shape != "cad":
        return []
    return [face for name, face in part.mesh.faces.items() if re.fullmatch(r"face-\d+", name)]


def known_name(part: FlexiblePart, kind: str, name: str | int, given: str) -> str:
    """A face's or a part's name as the mesh has it; upper and lower case may differ.

    Raises
    ------
    InputError
        There is none of that name.
    """
    what, names = ("part", part.mesh.parts) if kind in ("element", "material") else ("face", part.mesh.faces)
    alike = [known for known in names if known.casefold() == given.casefold()]
    if given not in names and len(alike) != 1:
        mend = f"no such {what}; {suggest_name(given, names, f'the {what}s')}"
        raise InputError(part.file, f"body.{part.name}.{kind}.{name}.{what}", given, mend)
    return given if given in names else alike[0]


def fixed_unknowns(part: FlexiblePart) -> IntArray:
    """Unknowns that a body's supports hold."""
    from pipeline.fem.supports import node_at, nodes_on_edge, nodes_on_faces

    fixed = []
    for number, support in enumerate(part.shape.support):
        try:
            if support.edge is not None:
                nodes = nodes_on_edge(part.space, np.array(support.edge))
            elif support.point is not None:
                nodes = node_at(part.space, np.array(support.point))
            else:
                nodes = nodes_on_faces(
                    part.space, [part.mesh.faces[known_name(part, "support", number, face)] for face in support.faces]
                )
        except ValueError as error:
            key = f"body.{part.name}.support.{number}"
            raise InputError(part.file, key, support.edge or support.faces, str(error)) from error
        fixed += [3 * nodes + "xyz".index(axis) for axis in support.fixed]
    return np.unique(np.concatenate(fixed))

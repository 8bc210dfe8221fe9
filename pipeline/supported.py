"""From a scene's supports to the unknowns of a body's finite element model that they hold."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from pipeline.checks import InputError, IntArray

if TYPE_CHECKING:
    from pipeline.fem.model import Discretisation
    from pipeline.scene_shapes import Support


def fixed_unknowns(
    space: Discretisation, supports: tuple[Support, ...], known: Callable[[str, int, str], str], file: str, body: str
) -> IntArray | None:
    """Held unknowns, ascending; ``None`` if nothing is held.

    Parameters
    ----------
    known : callable
        Finds the mesh's name of a face: takes ``"support"``, the support's number and the name given.
    file, body : str
        The scene's file and the body, for messages.

    Raises
    ------
    InputError
        A support is where the mesh has no node.
    """
    if not supports:
        return None
    from pipeline.fem.place import node_at, nodes_on_edge, nodes_on_faces

    fixed = []
    for number, support in enumerate(supports):
        try:
            if support.edge is not None:
                nodes = nodes_on_edge(space, np.array(support.edge))
            elif support.point is not None:
                nodes = node_at(space, np.array(support.point))
            else:
                faces = [space.mesh.faces[known("support", number, face)] for face in support.faces]
                nodes = nodes_on_faces(space, faces)
        except ValueError as error:
            given = support.edge or support.faces
            raise InputError(file, f"body.{body}.support.{number}", given, str(error)) from error
        fixed += [3 * nodes + "xyz".index(axis) for axis in support.fixed]
    return np.unique(np.concatenate(fixed))

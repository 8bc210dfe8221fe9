"""The named elements of a flexible body: their numbers, and the places where their stress is taken."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fmd.fem.joined import AnyMesh
    from fmd.fem.mesh import SolidMesh
    from fmd.scene.places import NamedElement


def number_elements(named: Mapping[str, NamedElement], mesh: AnyMesh, file: str, body: str) -> dict[str, int]:
    """Return the number of each named element, the one whose middle is nearest to its point.

    Raises
    ------
    InputError
        The mesh has no part of a name that is given.
    """
    x = np.concatenate([own.points[own.cells].mean(axis=1) for own in mesh.members])
    numbers = {}
    for name, element in named.items():
        chosen = np.arange(len(x))
        if element.part:
            from fmd.stages.meshing.bodies import find_name  # with all that makes meshes

            chosen = mesh.parts[find_name(mesh.parts, element.part, file, f"body.{body}.element.{name}.part", "part")]
        numbers[name] = int(chosen[np.linalg.norm(x[chosen] - element.at, axis=1).argmin()])
    return numbers


def find_sides(named: Mapping[str, NamedElement], mesh: AnyMesh, numbers: Mapping[str, int]) -> tuple[bool, ...]:
    """Return True for each element of a shell whose point is nearer to its upper face; nothing for solids."""
    if all(own.midsurface is None for own in mesh.members):
        return ()
    sides = []
    for name, number in numbers.items():
        own, k = _mesh_of(mesh, number)
        lower, upper = own.points[own.cells[k]].reshape(2, -1, 3).mean(axis=1) if own.midsurface else np.zeros((2, 3))
        sides.append(bool((np.array(named[name].at) - (lower + upper) / 2) @ (upper - lower) >= 0.0))
    return tuple(sides)


def stress_places(mesh: AnyMesh, numbers: Mapping[str, int], sides: tuple[bool, ...]) -> Array:
    """Return the middles of elements, of shells on one face, shape (n_elements, 3) [m]."""
    places = []
    for i, number in enumerate(numbers.values()):
        own, k = _mesh_of(mesh, number)
        cell = own.cells[k]
        if own.midsurface is not None:
            cell = np.split(cell, 2)[int(sides[i])]
        places.append(own.points[cell].mean(axis=0))
    return np.asarray(places).reshape(-1, 3)


def _mesh_of(mesh: AnyMesh, number: int) -> tuple[SolidMesh, int]:
    """Return the mesh of an element's kind, and the element's number in it."""
    for own in mesh.members:
        if number < own.n_cells:
            return own, number
        number -= own.n_cells
    raise ValueError("no such element")

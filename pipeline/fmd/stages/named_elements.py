"""The named elements of a flexible body: their numbers, and the places where their stress is taken."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fmd.core.arrays import Array
from fmd.stages.meshing.bodies import find_name

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fmd.fem.mesh import SolidMesh
    from fmd.scene.places import NamedElement


def number_elements(named: Mapping[str, NamedElement], mesh: SolidMesh, file: str, body: str) -> dict[str, int]:
    """Return the number of each named element, the one whose middle is nearest to its point.

    Raises
    ------
    InputError
        The mesh has no part of a name that is given.
    """
    x = mesh.points[mesh.cells].mean(axis=1)
    numbers = {}
    for name, element in named.items():
        chosen = np.arange(len(x))
        if element.part:
            chosen = mesh.parts[find_name(mesh.parts, element.part, file, f"body.{body}.element.{name}.part")]
        numbers[name] = int(chosen[np.linalg.norm(x[chosen] - element.at, axis=1).argmin()])
    return numbers


def find_sides(named: Mapping[str, NamedElement], mesh: SolidMesh, numbers: Mapping[str, int]) -> tuple[bool, ...]:
    """Return True for each element of a shell whose point is nearer to its upper face; nothing for solids."""
    if mesh.midsurface is None:
        return ()
    sides = []
    for name, number in numbers.items():
        lower, upper = mesh.points[mesh.cells[number]].reshape(2, -1, 3).mean(axis=1)
        sides.append(bool((np.array(named[name].at) - (lower + upper) / 2) @ (upper - lower) >= 0.0))
    return tuple(sides)


def stress_places(mesh: SolidMesh, numbers: Mapping[str, int], sides: tuple[bool, ...]) -> Array:
    """Return the middles of elements, of shells on one face, shape (n_elements, 3) [m]."""
    cells = mesh.cells[list(numbers.values())]
    if sides:
        lower, upper = np.split(cells, 2, axis=1)
        cells = np.where(np.array(sides)[:, None], upper, lower)
    return np.asarray(mesh.points[cells].mean(axis=1)).reshape(-1, 3)

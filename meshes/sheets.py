"""Midsurfaces of shells as plain arrays, without Gmsh."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class SheetArrays(NamedTuple):
    """Midsurface of a shell."""

    points: NDArray[np.float64]  # (n_points, 3): positions [m]
    # (n_cells, 3 or 4): point numbers around each element, counter-clockwise seen from the upper side
    cells: NDArray[np.int64]
    edges: dict[str, NDArray[np.int64]]  # point numbers on each named edge
    sides: tuple[str, str]  # names of the lower and of the upper side


def grid_cells(n_rows: int, n_points: int, n_columns: int, element: str) -> NDArray[np.int64]:
    """Return the cells between rows of points, quadrilaterals or two triangles each; a row may close in itself.

    A row has as many points as columns if it is closed, else one more; an element is ``quadrilateral`` or ``triangle``.
    """
    row, column = (each.ravel() for each in np.indices((n_rows, n_columns)))
    after = (column + 1) % n_points
    a, b = row * n_points + column, row * n_points + after
    quadrilaterals = np.stack([a, a + n_points, b + n_points, b], axis=1)
    if element == "quadrilateral":
        return quadrilaterals
    odd = (row + column) % 2 == 1  # diagonals of both directions
    quadrilaterals[odd] = np.roll(quadrilaterals[odd], 1, axis=1)
    return quadrilaterals[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)

"""Midsurfaces of flat rectangular plates along x from 0, centred on y = 0."""

from typing import Any

import numpy as np

from fmd.meshes.sheets import SheetArrays, grid_cells


def sheet(plate: Any) -> SheetArrays:
    """Divide the midsurface of a scene's table ``Plate``."""
    n_x, n_y = plate.mesh.divisions
    x, y = np.linspace(0, plate.length, n_x + 1), np.linspace(-plate.width / 2, plate.width / 2, n_y + 1)
    X, Y = (grid.ravel() for grid in np.meshgrid(x, y, indexing="ij"))
    edges = {"x-": x[0] == X, "x+": x[-1] == X, "y-": y[0] == Y, "y+": y[-1] == Y}
    return SheetArrays(
        np.column_stack([X, Y, np.zeros_like(X)]),
        grid_cells(n_x, n_y + 1, n_y, plate.mesh.element),
        {name: np.flatnonzero(on) for name, on in edges.items()},
        ("z-", "z+"),
    )

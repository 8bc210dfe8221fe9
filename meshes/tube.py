"""Midsurfaces of round tubes around x, from 0."""

from typing import Any

import numpy as np

from fmd.meshes.sheets import SheetArrays, grid_cells


def sheet(tube: Any) -> SheetArrays:
    """Divide the midsurface of a scene's table ``Tube``."""
    n_x, n_around = tube.mesh.divisions
    x, angle = np.linspace(0, tube.length, n_x + 1), 2 * np.pi * np.arange(n_around) / n_around
    X, A = (grid.ravel() for grid in np.meshgrid(x, angle, indexing="ij"))
    ends = {"x-": np.flatnonzero(x[0] == X), "x+": np.flatnonzero(x[-1] == X)}
    # Around from z to y, so that with x the normal points outwards.
    points = np.column_stack([X, -tube.radius * np.sin(A), tube.radius * np.cos(A)])
    return SheetArrays(points, grid_cells(n_x, n_around, n_around, tube.mesh.element), ends, ("inside", "outside"))

"""Where in which element a point of the body is."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pipeline.core.arrays import Array, IntArray
from pipeline.fem.elements import shape_functions
from pipeline.fem.mesh import STRAIGHT
from pipeline.fem.model import Discretisation

_NEAREST = 24  # elements to look through
_STEPS = 20


def locate(space: Discretisation, points: Array) -> tuple[IntArray, Array]:
    """Find the element that holds each point, or comes nearest to it, by Newton's method in those around.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        [m].

    Returns
    -------
    elements : ndarray, shape (n,)
    X : ndarray, shape (n, 3)
        Reference coordinates in them; inside the reference cell.
    """
    corners, geometry = space.corner_coordinates, space.kind.geometry
    straight = STRAIGHT[space.mesh.cell_type]
    count = min(_NEAREST, len(corners))
    near = np.asarray(cKDTree(corners.mean(axis=1)).query(points, k=count)[1]).reshape(len(points), count)
    middle = space.kind.element.refdom.init_refdom()[0].mean(axis=1)
    elements, X = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 3))
    for k, (point, candidates) in enumerate(zip(points, near, strict=True)):
        best = np.inf
        for element in candidates:
            x = middle
            for _ in range(_STEPS):
                N, dN = shape_functions(geometry, x[:, None])
                step = np.linalg.solve(corners[element].T @ dN[:, :, 0], point - N[:, 0] @ corners[element])
                x = np.clip(x + step, -1.0, 2.0)
                if np.abs(step).max() < 1e-12:
                    break
            outside = max(-x.min(), _reach(straight, x) - 1.0)
            if outside < best:
                best, elements[k], X[k] = outside, element, np.clip(x, 0.0, 1.0)
            if best <= 1e-9:
                break
    return elements, X


def _reach(cell_type: str, x: Array) -> float:
    """What is 1 at most inside of the reference cell."""
    match cell_type:
        case "tetra":
            return float(x.sum())
        case "wedge":
            return float(max(x[0] + x[1], x[2]))
    return float(x.max())

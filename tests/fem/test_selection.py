"""Where a point is in a mesh: reference coordinates carry back to the point."""

import numpy as np

from pipeline.fem.elements import shape_functions
from pipeline.fem.model import FEModel
from pipeline.fem.selection import locate


def test_a_point_inside_is_found_where_it_is(distorted: FEModel) -> None:
    space = distorted.discretisation
    points = np.random.default_rng(3).uniform([0.05, 0.05, 0.05], [1.15, 0.95, 0.75], (20, 3))
    elements, X = locate(space, points)
    for point, element, x in zip(points, elements, X, strict=True):
        N, _ = shape_functions(space.kind.geometry, x[:, None])
        assert np.abs(N[:, 0] @ space.corner_coordinates[element] - point).max() < 1e-9


def test_a_point_outside_is_put_on_the_nearest_side(distorted: FEModel) -> None:
    space = distorted.discretisation
    elements, X = locate(space, np.array([[-0.01, 0.5, 0.4]]))
    N, _ = shape_functions(space.kind.geometry, X[0][:, None])
    assert abs((N[:, 0] @ space.corner_coordinates[elements[0]])[0]) < 1e-9

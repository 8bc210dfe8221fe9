"""The outer surface: closed, turned outwards, and of the right size."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.space import Discretisation
from fmd.fem.surface import boundary_polygons, surface_topology

SIZES = np.array([1.2, 1.0, 0.8])
AREA = 2 * (1.2 * 1.0 + 1.0 * 0.8 + 0.8 * 1.2)
VOLUME = 1.2 * 1.0 * 0.8


def triangle_corners(space: Discretisation) -> Array:
    surface = surface_topology(space)
    return space.x[surface.nodes][surface.triangles]


def test_the_triangles_have_the_area_of_the_box(distorted: FEModel) -> None:
    a, b, c = np.moveaxis(triangle_corners(distorted.discretisation), 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    assert area.min() > 0
    assert area.sum() == pytest.approx(AREA, rel=1e-13)


def test_the_triangles_enclose_the_volume_of_the_box(distorted: FEModel) -> None:
    # Gauss: the volume is ∮ x·n dA / 3; positive only if every normal points outwards
    a, b, c = np.moveaxis(triangle_corners(distorted.discretisation) - SIZES / 2, 1, 0)
    parts = np.einsum("ti,ti->t", a, np.cross(b, c)) / 6
    assert parts.min() > 0
    assert parts.sum() == pytest.approx(VOLUME, rel=1e-13)


def test_the_surface_is_closed_and_turned_one_way(distorted: FEModel) -> None:
    triangles = surface_topology(distorted.discretisation).triangles
    ways = Counter(zip(triangles.ravel().tolist(), np.roll(triangles, -1, axis=1).ravel().tolist(), strict=True))
    assert set(ways.values()) == {1}
    assert all((end, start) in ways for start, end in ways)


def test_the_nodes_are_those_on_the_faces_of_the_box(distorted: FEModel) -> None:
    x = distorted.x
    on_a_face = ((np.abs(x) < 1e-12) | (np.abs(x - SIZES) < 1e-12)).any(axis=1)
    assert surface_topology(distorted.discretisation).nodes.tolist() == np.flatnonzero(on_a_face).tolist()


def test_the_outlines_are_the_edges_of_the_element_faces(element: Any, box_mesh: Callable[..., SolidMesh]) -> None:
    # A box of n³ cells has 6 n² squares, each with four sides shared by two: 12 n² edges; cutting every square into
    # two triangles adds one diagonal each. Order 2 halves every edge.
    n = 3
    edges = 12 * n**2 + (6 * n**2 if element.cell_type == "tetra" else 0)
    space = Discretisation(box_mesh(element.cell_type, (n, n, n)), element.order)
    surface = surface_topology(space)
    assert surface.edges.shape == (edges * element.order, 2)
    # sphere-like (Euler): V − E + F = 2 for the triangles, whose closed surface has 3/2 F edges
    assert len(surface.nodes) - len(surface.triangles) // 2 == 2
    ends = space.x[surface.nodes][surface.edges]
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() <= np.sqrt(2) / n / element.order + 1e-12


def test_quadratic_faces_are_joined_the_long_way(box_mesh: Callable[..., SolidMesh]) -> None:
    """Of the middles of a face's sides, those further apart: elements are drawn out along what changes least."""
    space = Discretisation(box_mesh("hexahedron", (2, 7, 3)), 2)
    surface = surface_topology(space)
    joined = {
        frozenset(pair)
        for t in surface.nodes[surface.triangles].tolist()
        for pair in zip(t, np.roll(t, 1).tolist(), strict=True)
    }
    ((_, polygons),) = boundary_polygons(space)
    for around in polygons:
        ways = [(around[k], around[k + 4]) for k in (1, 3)]
        short, long = sorted(ways, key=lambda way: np.linalg.norm(space.x[way[0]] - space.x[way[1]]))
        assert (frozenset(short) in joined, frozenset(long) in joined) == (False, True)


def test_polygons_start_at_a_corner_and_turn_outwards(distorted: FEModel) -> None:
    space = distorted.discretisation
    ((_, polygons),) = boundary_polygons(space)
    around = space.x[polygons]
    corners = around[:, :: space.order]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
    outward = corners.mean(axis=1) - SIZES / 2
    assert (np.einsum("fi,fi->f", normal, outward) > 0).all()
    if space.order == 2:
        middle = (corners + np.roll(corners, -1, axis=1)) / 2
        assert np.abs(around[:, 1::2] - middle).max() < 1e-15

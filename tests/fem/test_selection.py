"""Selection by position: facets in a plane and up to sharp edges, nodes of supports, elements at points."""

from collections.abc import Callable

import numpy as np
import pytest

from fmd.fem.elements import shape_functions
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.selection import (
    facets_in_plane,
    facets_near,
    locate_points,
    node_at,
    nodes_on_edge,
    nodes_on_faces,
)
from fmd.fem.space import Discretisation


def test_a_point_inside_is_found_where_it_is(distorted: FEModel) -> None:
    space = distorted.discretisation
    points = np.random.default_rng(3).uniform([0.05, 0.05, 0.05], [1.15, 0.95, 0.75], (20, 3))
    elements, X = locate_points(space, points)
    for point, element, x in zip(points, elements, X, strict=True):
        N, _ = shape_functions(space.kind.geometry, x[:, None])
        assert np.abs(N[:, 0] @ space.corner_coordinates[element] - point).max() < 1e-9


def test_a_point_outside_is_put_on_the_nearest_side(distorted: FEModel) -> None:
    space = distorted.discretisation
    elements, X = locate_points(space, np.array([[-0.01, 0.5, 0.4]]))
    N, _ = shape_functions(space.kind.geometry, X[0][:, None])
    assert abs((N[:, 0] @ space.corner_coordinates[elements[0]])[0]) < 1e-9


def test_facets_in_a_plane_are_those_of_the_face_there(distorted: FEModel) -> None:
    space = distorted.discretisation
    facets = facets_in_plane(space, 0, 1.2)
    assert np.abs(space.x[facets][..., 0] - 1.2).max() < 1e-12
    assert set(np.unique(facets)) <= set(space.mesh.faces["x+"]) | set(np.flatnonzero(space.x[:, 0] > 1.2 - 1e-12))
    assert len(facets_in_plane(space, 0, 0.6)) == 0  # a plane inside of the body


@pytest.mark.parametrize("axis", range(3))
def test_the_face_near_a_point_ends_at_sharp_edges(distorted: FEModel, axis: int) -> None:
    space = distorted.discretisation
    point = np.array([0.55, 0.45, 0.35])
    point[axis] = -0.1
    facets = facets_near(space, point)
    assert np.array_equal(np.unique(facets, axis=0), np.unique(facets_in_plane(space, axis, 0.0), axis=0))


def test_a_known_face_is_taken_whole(distorted: FEModel) -> None:
    space = distorted.discretisation
    half = facets_in_plane(space, 2, 0.0)[:2]
    point = space.x[half[0]].mean(axis=0)
    assert facets_near(space, point, [half]) is half


def test_supports_hold_the_nodes_of_a_face_an_edge_and_a_corner(box_mesh: Callable[..., SolidMesh]) -> None:
    space = Discretisation(box_mesh("hexahedron", (3, 2, 2)), 1)
    faces = space.mesh.faces
    assert len(nodes_on_faces(space, [faces["x-"]])) == 9
    edge = nodes_on_faces(space, [faces["x-"], faces["y-"]])
    assert edge.tolist() == nodes_on_edge(space, np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)])).tolist()
    corner = nodes_on_faces(space, [faces["x-"], faces["y-"], faces["z-"]])
    assert corner.tolist() == node_at(space, np.array([0.1, -0.1, 0.0])).tolist()


def test_supports_without_nodes_are_refused(box_mesh: Callable[..., SolidMesh]) -> None:
    space = Discretisation(box_mesh("hexahedron", (3, 2, 2)), 1)
    with pytest.raises(ValueError, match="the faces have no node in common"):
        nodes_on_faces(space, [space.mesh.faces["x-"], space.mesh.faces["x+"]])
    with pytest.raises(ValueError, match=r"no node of the mesh lies there; the nearest is 0\.5 m away"):
        nodes_on_edge(space, np.array([(0.0, 0.0, 1.5), (1.0, 0.0, 1.5)]))

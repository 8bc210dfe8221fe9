"""Markers at points, at nodes and on edges, against fields whose motion there is known."""

from collections.abc import Callable

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.fem.local_markers import edge_marker, point_marker, single_node_marker
from fmd.fem.markers import Marker
from fmd.fem.mesh import SolidMesh
from fmd.fem.model import FEModel
from fmd.fem.selection import node_at, nodes_on_edge, nodes_on_faces
from fmd.fem.space import Discretisation
from fmd.meshes.gmsh_session import MeshArrays
from fmd.meshes.ring import add_mid_edge_nodes

SIZES = np.array([1.2, 1.0, 0.8])
SLOPE = np.random.default_rng(3).normal(size=(3, 3))
SHIFT = np.array([0.3, -0.2, 0.7])
HALF_CURL = 0.5 * np.array([SLOPE[2, 1] - SLOPE[1, 2], SLOPE[0, 2] - SLOPE[2, 0], SLOPE[1, 0] - SLOPE[0, 1]])
TURN = np.array([0.2, -0.5, 0.9])


def assert_moves(marker: Marker, x: Array, position: Array) -> None:
    """It moves and turns with any affine field as the material does, and resists no translation."""
    assert marker.position == pytest.approx(position, abs=1e-12)
    assert marker.translation(SHIFT + x @ SLOPE.T) == pytest.approx(SHIFT + SLOPE @ position, abs=1e-12)
    assert marker.rotation(np.cross(TURN, x) + SHIFT) == pytest.approx(TURN, abs=1e-9)


def assert_loads_in_balance(marker: Marker, x: Array) -> None:
    """Unit forces and torques act as such on the body as a whole."""
    B = marker.columns(len(x), np.eye(3))
    forces, moments = B.sum(axis=0), np.cross(x[:, :, None], B, axis=1).sum(axis=0)
    np.testing.assert_allclose(forces, np.eye(3, 6), atol=1e-9)
    of_forces = np.cross(marker.position, np.eye(3)).T
    np.testing.assert_allclose(moments, np.hstack([of_forces, np.eye(3)]), atol=1e-9)


@pytest.mark.parametrize("point", [[0.31, 0.47, 0.11], [1.2, 0.123, 0.8], [0.0, 0.0, 0.0], [0.6, 0.5, 0.4]])
def test_a_point_moves_and_turns_as_the_material_there(distorted: FEModel, point: list[float]):
    space, at = distorted.discretisation, np.array(point)
    marker = point_marker(space, at)
    assert_moves(marker, space.x, at)
    assert marker.rotation(space.x @ SLOPE.T) == pytest.approx(HALF_CURL, abs=1e-9)
    assert_loads_in_balance(marker, space.x)


def test_a_point_outside_the_body_is_refused_with_the_nearest_node(distorted: FEModel):
    with pytest.raises(ValueError, match=r"lies outside the body; the node nearest to it is at \[1.2 m, 1 m, 0.8 m\]"):
        point_marker(distorted.discretisation, np.array([1.3, 1.1, 0.9]))


def test_a_node_has_its_own_displacement_and_the_rotation_around_it(distorted: FEModel):
    space = distorted.discretisation
    node = int(node_at(space, np.array([0.45, 0.6, 0.3]))[0])
    marker = single_node_marker(space, node)
    assert_moves(marker, space.x, space.x[node])
    field = np.random.default_rng(1).normal(size=(len(space.x), 3))
    assert marker.translation(field) == pytest.approx(field[node], abs=1e-15)
    assert marker.rotation(space.x @ SLOPE.T) == pytest.approx(HALF_CURL, abs=1e-9)
    assert_loads_in_balance(marker, space.x)


def test_a_straight_edge_follows_its_mean_and_turns_about_itself_as_the_material(distorted: FEModel):
    space = distorted.discretisation
    ends = np.array([[0, 0, 0.8], [1.2, 0, 0.8]])
    marker = edge_marker(space, nodes_on_edge(space, ends))
    assert_moves(marker, space.x, np.array([0.6, 0, 0.8]))
    # By the displacement along x the edge turns about y and z, by half the curl about itself.
    turned = marker.rotation(space.x @ SLOPE.T)
    assert turned == pytest.approx([HALF_CURL[0], -SLOPE[2, 0], SLOPE[1, 0]], abs=1e-9)
    assert_loads_in_balance(marker, space.x)
    s = space.x[:, 0] / 1.2
    square = np.outer(s**2, SHIFT)  # its mean is a third where elements are quadratic, else by trapezia
    trapezia = 1 / 3 if space.order == 2 else 1 / 3 + 1 / (6 * 3**2)
    assert marker.translation(square) == pytest.approx(trapezia * SHIFT, rel=1e-9)


def test_two_faces_meet_in_the_same_edge(distorted: FEModel):
    space = distorted.discretisation
    faces = [space.mesh.faces[name] for name in ("y-", "z+")]
    by_faces = edge_marker(space, nodes_on_faces(space, faces))
    by_ends = edge_marker(space, nodes_on_edge(space, np.array([[0, 0, 0.8], [1.2, 0, 0.8]])))
    np.testing.assert_allclose(by_faces.translation_weights, by_ends.translation_weights)
    np.testing.assert_allclose(by_faces.rotation_weights, by_ends.rotation_weights)


def test_nodes_without_an_edge_between_them_are_refused(distorted: FEModel):
    with pytest.raises(ValueError, match="no edge of an element lies there"):
        edge_marker(distorted.discretisation, np.array([0]))


def test_a_curved_edge_follows_its_mean_displacement(box_mesh: Callable[..., SolidMesh]):
    """A quarter of a ring: r from 1 to 2; the arc at r = 1, z = 0 against integrals over the angle."""
    box = box_mesh("hexahedron", (2, 12, 2), (1.0, np.pi / 2, 0.5))
    r, angle, z = 1 + box.points[:, 0], box.points[:, 1], box.points[:, 2]
    points = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    curved = add_mid_edge_nodes(MeshArrays(points, box.cells, "hexahedron", {}, {}))
    space = Discretisation(SolidMesh(curved.points, curved.cells, curved.cell_type, {}, {}), 2)
    x = space.x
    arc = np.flatnonzero((np.abs(np.hypot(x[:, 0], x[:, 1]) - 1) < 1e-9) & (np.abs(x[:, 2]) < 1e-9))
    assert len(arc) == 25
    marker = edge_marker(space, arc)
    assert marker.position == pytest.approx([2 / np.pi, 2 / np.pi, 0.0], abs=1e-5)
    assert marker.translation(x**2) == pytest.approx([0.5, 0.5, 0.0], abs=1e-4)
    assert marker.rotation(np.cross(TURN, x)) == pytest.approx(TURN, abs=1e-9)
    assert_loads_in_balance(marker, x)

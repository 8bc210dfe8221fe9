"""The surface of a deck's solids is that of the same mesh."""

from collections.abc import Callable

import numpy as np
import pytest

from fmd.core.arrays import Array, IntArray
from fmd.fem.cells.table import CELLS
from fmd.fem.elements import match_nodes, shape_functions
from fmd.fem.formats.deck_surface import deck_surface
from fmd.fem.mesh import SolidMesh
from fmd.fem.space import Discretisation
from fmd.fem.surface import surface_topology

SIZES = (1.2, 1.0, 0.8)
SIDES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))


def box_of(name: str, box_mesh: Callable[..., SolidMesh]) -> tuple[Array, IntArray]:
    """Points and cells of a box whose 2 × 2 × 2 hexahedra are cut into cells of a type, straight ones."""
    cell = CELLS[name]
    mesh = box_mesh("tetra" if cell.shape.name == "tetra" else "hexahedron", (2, 2, 2), SIZES, 0.2)
    corners = mesh.points[mesh.cells]
    if cell.shape.name == "wedge":
        corners = np.concatenate([corners[:, [0, 1, 2, 4, 5, 6]], corners[:, [0, 2, 3, 4, 6, 7]]])
    if cell.shape.name == "pyramid":
        corners = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1)
        corners = np.concatenate([corners[:, [*side, 8]] for side in SIDES])
    linear = CELLS[cell.shape.name]
    element = linear.element(1).element
    N, _ = shape_functions(element, cell.nodes.T)
    x = np.einsum("nk,enj->ekj", N, corners[:, match_nodes(element.doflocs, linear.nodes)])
    _, first, cells = np.unique(x.reshape(-1, 3).round(9), axis=0, return_index=True, return_inverse=True)
    return x.reshape(-1, 3)[first], cells.reshape(x.shape[:2])


@pytest.mark.parametrize("name", CELLS)
def test_the_surface_of_a_deck_is_that_of_the_mesh_and_turned_outwards(
    name: str, box_mesh: Callable[..., SolidMesh]
) -> None:
    x, cells = box_of(name, box_mesh)
    found = deck_surface(x, [(name, cells[::2]), ("line", cells[:1, :2]), (name, cells[1::2])])
    wanted = surface_topology(Discretisation(SolidMesh(x, cells, name, {}, {}), CELLS[name].order))
    assert found is not None
    assert np.array_equal(found.nodes, wanted.nodes)
    assert np.array_equal(found.edges, wanted.edges)
    assert len(found.triangles) == len(wanted.triangles)
    parts = np.linalg.det((x - np.divide(SIZES, 2))[found.nodes][found.triangles]) / 6  # of the volume, by Gauss
    assert parts.min() > 0.0
    assert parts.sum() == pytest.approx(np.prod(SIZES), rel=1e-12)


def test_facets_between_elements_of_two_kinds_are_inside(box_mesh: Callable[..., SolidMesh]) -> None:
    mesh = box_mesh("hexahedron", (2, 1, 1), SIZES)
    wedges = np.concatenate([mesh.cells[1:][:, [0, 1, 2, 4, 5, 6]], mesh.cells[1:][:, [0, 2, 3, 4, 6, 7]]])
    found = deck_surface(mesh.points, [("hexahedron", mesh.cells[:1]), ("wedge", wedges)])
    assert found is not None
    volume = np.linalg.det(mesh.points[found.nodes][found.triangles]).sum() / 6
    assert volume == pytest.approx(np.prod(SIZES), rel=1e-12)
    assert len(found.triangles) == 20


def test_a_deck_without_solids_has_no_surface() -> None:
    assert deck_surface(np.eye(3), [("triangle", np.array([[0, 1, 2]]))]) is None

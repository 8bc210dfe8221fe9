"""Discretisations: numbering, geometry and boundary, against scikit-fem and counting."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import skfem

from fmd.fem.elements import shape_functions
from fmd.fem.mesh import SolidMesh
from fmd.fem.space import Discretisation

Make = Callable[..., SolidMesh]


@pytest.fixture
def space(element: Any, box_mesh: Make) -> Discretisation:
    return Discretisation(box_mesh(element.cell_type, (3, 2, 2), (1.2, 1.0, 0.8), 0.2), element.order)


def test_nodes_are_numbered_as_scikit_fem_does(space: Discretisation) -> None:
    basis = skfem.Basis(space.skfem_mesh, space.kind.element)
    assert np.array_equal(space.element_nodes, basis.element_dofs.T)
    assert np.abs(space.x - basis.doflocs.T).max() < 1e-15


def test_volumes_sum_to_that_of_the_box_and_of_the_mesh(space: Discretisation) -> None:
    assert space.volumes.sum() == pytest.approx(0.96, rel=1e-13)
    assert space.volumes.sum() == pytest.approx(space.mesh.volume, rel=1e-13)
    assert (space.volumes > 0).all()


def test_the_boundary_has_the_facets_of_the_box_and_all_nodes_on_it_only(space: Discretisation) -> None:
    elements, local = space.boundary_facets
    squares = 2 * (3 * 2 + 3 * 2 + 2 * 2)
    assert len(elements) == len(local) == (squares if space.mesh.cell_type == "hexahedron" else 2 * squares)
    nodes = space.element_nodes[elements[:, None], np.stack([space.kind.facet_polygons[k] for k in local])]
    on_side = (np.abs(space.x[nodes]) < 1e-12) | (np.abs(space.x[nodes] - (1.2, 1.0, 0.8)) < 1e-12)
    assert on_side.all(axis=1).any(axis=1).all()


def test_derivatives_of_position_are_differences_of_positions(space: Discretisation) -> None:
    X, step = np.full((3, 1), 0.2), 1e-6

    def position(X: np.ndarray) -> np.ndarray:
        N, _ = shape_functions(space.kind.geometry, X)
        return np.asarray(np.einsum("n,enb->eb", N[:, 0], space.corner_coordinates))

    for a in range(3):
        move = step * np.eye(3)[a][:, None]
        slope = (position(X + move) - position(X - move)) / (2 * step)
        assert np.abs(space.jacobians(X)[:, 0, :, a] - slope).max() < 1e-9

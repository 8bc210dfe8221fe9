"""The elements' names, their nodes and the quadrature they ask for."""

import numpy as np
import pytest

from fmd.fem.cells.table import CELLS
from fmd.fem.elements import jacobians, match_nodes, shape_functions

# Nodes of each element: corners, and mid-edges for order 2.
NODES = {"hex8": 8, "hex20": 8 + 12, "tet4": 4, "tet10": 4 + 6}


@pytest.mark.parametrize(("cell_type", "order"), [("tetra", 3), ("hexahedron", 0), ("wedge", 2)])
def test_an_element_that_does_not_exist_is_refused(cell_type: str, order: int) -> None:
    with pytest.raises(ValueError, match=f"no element of order {order} on {cell_type} cells"):
        CELLS[cell_type].element(order)


def test_each_element_has_its_name_and_its_nodes(element) -> None:
    kind = CELLS[element.cell_type].element(element.order)
    assert kind.name == element.name
    assert len(kind.element.doflocs) == NODES[element.name]


def test_shape_functions_are_one_at_their_own_node_and_zero_at_the_others(element) -> None:
    kind = CELLS[element.cell_type].element(element.order)
    N, _ = shape_functions(kind.element, kind.element.doflocs.T)
    assert np.abs(N - np.eye(len(N))).max() < 1e-14


def test_shape_functions_sum_to_one_and_their_gradients_to_zero(element) -> None:
    kind = CELLS[element.cell_type].element(element.order)
    N, dN = shape_functions(kind.element, np.random.default_rng(0).uniform(0, 0.3, (3, 7)))
    assert np.abs(N.sum(axis=0) - 1).max() < 1e-14
    assert np.abs(dN.sum(axis=0)).max() < 1e-13


def test_gradients_are_the_slopes_of_the_values(element) -> None:
    kind = CELLS[element.cell_type].element(element.order)
    X, step = np.random.default_rng(1).uniform(0, 0.3, (3, 5)), 1e-5
    _, dN = shape_functions(kind.element, X)
    for a in range(3):
        move = step * np.eye(3)[a][:, None]
        # central difference of a polynomial of degree ≤ 4: error below step² · 4 · 3 · 2
        slope = (shape_functions(kind.element, X + move)[0] - shape_functions(kind.element, X - move)[0]) / (2 * step)
        assert np.abs(slope - dN[:, a]).max() < 1e-8


def test_weights_sum_to_the_volume_of_the_reference_cell(element) -> None:
    kind = CELLS[element.cell_type].element(element.order)
    volume = 1 / 6 if element.cell_type == "tetra" else 1.0
    for order in (kind.stiffness_order, kind.mass_order, kind.stress_order):
        assert kind.quadrature(order)[1].sum() == pytest.approx(volume, rel=1e-14)


def test_facets_are_walked_around_corner_by_corner(element) -> None:
    kind = CELLS[element.cell_type].element(element.order)
    corners = 3 if element.cell_type == "tetra" else 4
    assert [len(polygon) for polygon in kind.facet_polygons] == [corners * element.order] * (corners * 2 - 2)
    for polygon in (kind.element.doflocs[polygon] for polygon in kind.facet_polygons):
        around = polygon[:: element.order]
        sides = np.roll(around, -1, axis=0) - around
        # the sides of a square or a triangle, not its diagonals: consecutive ones make no angle above 90° + 45°
        assert np.linalg.norm(sides, axis=1).max() <= (np.sqrt(2) if corners == 3 else 1) + 1e-12
        if element.order == 2:
            assert np.abs(polygon[1::2] - (around + np.roll(around, -1, axis=0)) / 2).max() < 1e-15


# Elements whose cells come from files: their nodes are the file's.
IMPORTED = [(cell.name, cell.order) for cell in CELLS.values() if cell.order == 2 or len(cell.elements) == 1]


@pytest.mark.parametrize(("cell_type", "order"), IMPORTED)
def test_shape_functions_of_imported_cells_are_right(cell_type: str, order: int) -> None:
    kind = CELLS[cell_type].element(order)
    N, _ = shape_functions(kind.element, kind.element.doflocs.T)
    assert np.abs(N - np.eye(len(N))).max() < 1e-14
    X, step = np.random.default_rng(1).uniform(0.1, 0.3, (3, 5)), 1e-5
    N, dN = shape_functions(kind.element, X)
    assert np.abs(N.sum(axis=0) - 1).max() < 1e-14
    for a in range(3):
        move = step * np.eye(3)[a][:, None]
        slope = (shape_functions(kind.element, X + move)[0] - shape_functions(kind.element, X - move)[0]) / (2 * step)
        assert np.abs(slope - dN[:, a]).max() < 1e-8
    # the cell's own nodes span every product of r, s, t that its polynomials have: here, all of second degree
    monomials = np.array([X[0] * X[1], X[1] * X[2], X[2] ** 2, X[0] ** 2])
    at_nodes = kind.element.doflocs.T
    nodal = np.array([at_nodes[0] * at_nodes[1], at_nodes[1] * at_nodes[2], at_nodes[2] ** 2, at_nodes[0] ** 2])
    if order == 2:
        assert np.abs(nodal @ N - monomials).max() < 1e-14


def test_jacobians_are_those_of_an_affine_map() -> None:
    kind = CELLS["tetra10"].element(2)
    A = np.random.default_rng(2).standard_normal((3, 3))
    x = kind.element.doflocs @ A.T + 5.0
    X = np.random.default_rng(3).uniform(0, 0.3, (3, 4))
    assert np.abs(jacobians(kind.geometry, x[None], X) - A).max() < 1e-13


def test_nodes_are_matched_by_place_and_others_are_refused() -> None:
    nodes = np.random.default_rng(4).uniform(size=(6, 3))
    order = np.array([3, 0, 5, 1, 2, 4])
    assert match_nodes(nodes[order], nodes).tolist() == order.tolist()
    with pytest.raises(ValueError, match="aren't of the same element"):
        match_nodes(nodes + 0.1, nodes)

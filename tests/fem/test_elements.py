"""The elements of all cells: their names, nodes, shape functions and the quadrature they ask for."""

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.fem.cells.cell import SolidCell
from fmd.fem.cells.table import CELLS
from fmd.fem.elements import ElementKind, jacobians, match_nodes, shape_functions

EVERY = [(cell, kind) for cell in CELLS.values() for kind in cell.elements]
every = pytest.mark.parametrize(("cell", "kind"), EVERY, ids=[f"{kind.name}-on-{cell.name}" for cell, kind in EVERY])
VOLUMES = {"tetra": 1 / 6, "hexahedron": 1.0, "wedge": 1 / 2, "pyramid": 1 / 3}


def inner_points(count: int) -> Array:
    """Points inside every reference cell, shape (3, count)."""
    return np.random.default_rng(1).uniform(0.05, 0.3, (3, count))


@pytest.mark.parametrize(("cell_type", "order"), [("tetra", 3), ("hexahedron", 0), ("wedge", 2)])
def test_an_element_that_does_not_exist_is_refused(cell_type: str, order: int) -> None:
    with pytest.raises(ValueError, match=f"no element of order {order} on {cell_type} cells"):
        CELLS[cell_type].element(order)


@every
def test_each_element_has_the_nodes_that_its_name_says(cell: SolidCell, kind: ElementKind) -> None:
    assert len(kind.element.doflocs) == int(kind.name.lstrip("abcdefghijklmnopqrstuvwxyz"))
    assert cell.element(kind.order) is kind


@every
def test_shape_functions_are_one_at_their_own_node_and_zero_at_the_others(cell: SolidCell, kind: ElementKind) -> None:
    N, _ = shape_functions(kind.element, kind.element.doflocs.T)
    assert np.abs(N - np.eye(len(N))).max() < 1e-14


@every
def test_shape_functions_sum_to_one_and_their_gradients_to_zero(cell: SolidCell, kind: ElementKind) -> None:
    N, dN = shape_functions(kind.element, inner_points(7))
    assert np.abs(N.sum(axis=0) - 1).max() < 1e-14
    assert np.abs(dN.sum(axis=0)).max() < 1e-13


@every
def test_gradients_are_the_slopes_of_the_values(cell: SolidCell, kind: ElementKind) -> None:
    X, step = inner_points(5), 1e-5
    _, dN = shape_functions(kind.element, X)
    for a in range(3):
        move = step * np.eye(3)[a][:, None]
        # central difference of a polynomial of degree ≤ 4, or of z² / (1 − z): error below step² · 4 · 3 · 2
        slope = (shape_functions(kind.element, X + move)[0] - shape_functions(kind.element, X - move)[0]) / (2 * step)
        assert np.abs(slope - dN[:, a]).max() < 1e-8


@every
def test_elements_of_second_order_have_all_quadratic_fields(cell: SolidCell, kind: ElementKind) -> None:
    def monomials(x: Array) -> Array:
        products = [x[a] * x[b] for a in range(3) for b in range(a, 3)]
        return np.array([*x, *(products if kind.order == 2 else [])])

    X = inner_points(5)
    N, _ = shape_functions(kind.element, X)
    assert np.abs(monomials(kind.element.doflocs.T) @ N - monomials(X)).max() < 1e-14


@every
def test_weights_sum_to_the_volume_of_the_reference_cell(cell: SolidCell, kind: ElementKind) -> None:
    for order in (kind.stiffness_order, kind.mass_order, kind.stress_order):
        assert kind.quadrature(order)[1].sum() == pytest.approx(VOLUMES[cell.shape.name], rel=1e-14)


@every
def test_stresses_that_are_linear_are_carried_from_their_points_to_the_nodes(
    cell: SolidCell, kind: ElementKind
) -> None:
    def linear(x: Array) -> Array:
        return 1 + np.array([2.0, -3.0, 0.5]) @ x if kind.stress_points.shape[1] > 1 else np.ones(x.shape[1])

    found = kind.stress_to_nodes @ linear(kind.stress_points)
    assert np.abs(found - linear(kind.element.doflocs.T)).max() < 1e-13


@every
def test_facets_are_walked_around_corner_by_corner(cell: SolidCell, kind: ElementKind) -> None:
    assert {frozenset(corners) for corners in kind.facet_corners} == {
        frozenset(match_nodes(np.array(cell.shape.corners, dtype=float)[list(face)], kind.corners))
        for face in cell.shape.faces
    }
    for polygon in (kind.element.doflocs[polygon] for polygon in kind.facet_polygons):
        around = polygon[:: kind.order]
        # once around the centre, always in one sense
        centre = around.mean(axis=0)
        turns = np.cross(around - centre, np.roll(around, -1, axis=0) - centre)
        assert (turns @ turns[0] > 0).all()
        if kind.order == 2:
            assert np.abs(polygon[1::2] - (around + np.roll(around, -1, axis=0)) / 2).max() < 1e-15


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

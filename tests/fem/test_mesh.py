"""The mesh's own checks, its quality and its volume."""

from collections.abc import Callable

import numpy as np
import pytest

from fmd.core.errors import AccuracyError
from fmd.fem.cells.table import CELLS
from fmd.fem.mesh import SolidMesh, rows_among
from fmd.fem.model import FEModel

# One regular tetrahedron and one cube, corners in VTK's order.
TETRAHEDRON = np.array([(0, 0, 0), (1, 1, 0), (0, 1, 1), (1, 0, 1)], dtype=float)
CUBE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float)


def cell(points: np.ndarray, cells: list[list[int]] | None = None) -> SolidMesh:
    cell_type = {4: "tetra", 8: "hexahedron"}[len(points)]
    return SolidMesh(points.copy(), np.array(cells or [list(range(len(points)))]), cell_type, {}, {})


def regular_tetrahedron() -> np.ndarray:
    """Ordered so that the fourth corner is on the side from which the first three run counter-clockwise."""
    return TETRAHEDRON if np.linalg.det(TETRAHEDRON[1:] - TETRAHEDRON[0]) > 0 else TETRAHEDRON[[0, 2, 1, 3]]


def test_the_ideal_cells_have_quality_one() -> None:
    assert cell(CUBE).quality == pytest.approx([1.0], rel=1e-14)
    assert cell(regular_tetrahedron()).quality == pytest.approx([1.0], rel=1e-14)


@pytest.mark.parametrize("angle", [0.1, 0.7, 1.4])
def test_a_sheared_cube_has_the_sine_of_its_angle_as_quality(angle: float) -> None:
    # edges of unit length at the angle π/2 − shear: the triple product is cos(shear)
    sheared = CUBE.copy()
    sheared[:, 0] += np.sin(angle) * CUBE[:, 1]
    sheared[:, 1] *= np.cos(angle)
    assert cell(sheared).quality == pytest.approx([np.cos(angle)], rel=1e-12)


def test_quality_is_the_same_in_any_unit_and_place() -> None:
    rng = np.random.default_rng(0)
    crooked = CUBE + rng.uniform(-0.2, 0.2, CUBE.shape)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)  # a rotation: the mirror image would be inverted
    assert cell(1e-3 * crooked @ turn.T + 5.0).quality == pytest.approx(cell(crooked).quality, rel=1e-9)


def test_the_volume_of_a_box_is_kept_when_its_inner_points_move(distorted: FEModel) -> None:
    # 1.2 × 1 × 0.8 m; what one cell loses its neighbour gains
    assert distorted.discretisation.mesh.volume == pytest.approx(0.96, rel=1e-13)


@pytest.mark.parametrize("seed", range(3))
def test_the_volume_of_a_cell_with_crooked_faces_is_that_of_its_shape_functions(seed: int) -> None:
    # the eight-point Gauss rule integrates the Jacobian of a trilinear cell, quadratic along each axis, exactly
    crooked = CUBE + np.random.default_rng(seed).uniform(-0.2, 0.2, CUBE.shape)
    gauss = np.array([-1.0, 1.0]) / np.sqrt(3)
    signs, total = 2 * CUBE - 1, 0.0
    for xi in np.stack(np.meshgrid(gauss, gauss, gauss), axis=-1).reshape(-1, 3):
        factors = (1 + signs * xi) / 2
        gradient = np.stack([signs[:, a] / 2 * np.delete(factors, a, axis=1).prod(axis=1) for a in range(3)], axis=1)
        total += np.linalg.det(crooked.T @ gradient)
    assert cell(crooked).volume == pytest.approx(total, rel=1e-13)


@pytest.mark.parametrize("cell_type", ["tetra10", "hexahedron20", "hexahedron27", "wedge15", "pyramid13"])
def test_the_volume_of_a_curved_cell_is_that_of_its_map(cell_type: str) -> None:
    # x + (0.1 y², 0, 0) keeps volumes, and bends edges by polynomials of second degree
    nodes = CELLS[cell_type].nodes
    bent = nodes + 0.1 * nodes[:, 1:2] ** 2 * (1, 0, 0)
    mesh = SolidMesh(bent, np.arange(len(nodes))[None], cell_type, {}, {})
    assert mesh.volume == pytest.approx({"t": 1 / 6, "h": 1.0, "w": 0.5, "p": 1 / 3}[cell_type[0]], rel=1e-13)


def test_rows_are_looked_up_in_a_table() -> None:
    table = np.array([[0, 1], [2, 3]])
    assert rows_among(np.array([[2, 3], [1, 0], [0, 1]]), table).tolist() == [True, False, True]
    assert rows_among(np.empty((0, 2), dtype=int), table).tolist() == []


def test_an_unknown_kind_of_cell_is_refused() -> None:
    with pytest.raises(ValueError, match="cell_type is 'penta_prism', expected one of tetra, tetra10, hexahedron"):
        SolidMesh(CUBE.copy(), np.arange(6)[None], "penta_prism", {}, {})


def test_points_in_the_plane_are_refused() -> None:
    with pytest.raises(ValueError, match=r"points has shape \(8, 2\), expected \(any, 3\)"):
        SolidMesh(CUBE[:, :2].copy(), np.arange(8)[None], "hexahedron", {}, {})


def test_cells_with_too_few_corners_are_refused() -> None:
    with pytest.raises(ValueError, match=r"cells has shape \(1, 4\), expected \(any, 8\)"):
        SolidMesh(CUBE.copy(), np.arange(4)[None], "hexahedron", {}, {})


def test_points_that_are_not_finite_are_counted() -> None:
    points = CUBE.copy()
    points[0, 0], points[3, 2] = np.nan, np.inf
    with pytest.raises(AccuracyError, match="points holds 2 values that are not finite, of 24"):
        cell(points)


@pytest.mark.parametrize("wrong", [-1, 8])
def test_a_cell_that_names_no_point_is_refused(wrong: int) -> None:
    with pytest.raises(ValueError, match="cells name points outside 0…7"):
        cell(CUBE, [[0, 1, 2, 3, 4, 5, 6, wrong]])


@pytest.mark.parametrize("cell_type", ["hexahedron", "tetra"])
def test_inverted_cells_are_counted(cell_type: str, box_mesh: Callable[..., SolidMesh]) -> None:
    box = box_mesh(cell_type, (2, 2, 2))
    cells = box.cells.copy()
    mirrored = {"hexahedron": [4, 5, 6, 7, 0, 1, 2, 3], "tetra": [1, 0, 2, 3]}[cell_type]
    cells[:3] = cells[:3, mirrored]
    with pytest.raises(AccuracyError, match=rf"3 of {len(cells)} cells are inverted or flat \(scaled Jacobian ≤ 0\)"):
        SolidMesh(box.points.copy(), cells, cell_type, {}, {})


def test_a_flat_cell_is_refused() -> None:
    with pytest.raises(AccuracyError, match="1 of 1 cells are inverted or flat"):
        cell(regular_tetrahedron() * [1, 1, 0])


def test_a_cell_with_two_corners_in_one_place_is_refused() -> None:
    collapsed = CUBE.copy()
    collapsed[6] = collapsed[5]
    with pytest.raises(AccuracyError, match="1 of 1 cells are inverted or flat"):
        cell(collapsed)


def test_a_mesh_cannot_be_changed_after_its_check() -> None:
    mesh = cell(CUBE)
    with pytest.raises(ValueError, match="read-only"):
        mesh.points[0, 0] = 7.0
    with pytest.raises(ValueError, match="read-only"):
        mesh.cells[0, 0] = 1

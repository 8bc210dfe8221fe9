"""Tables of the cells, against VTK's and against each other."""

import numpy as np
import pytest
from vtkmodules import vtkCommonDataModel

from fmd.fem.cells.table import CELLS
from fmd.fem.cells.wedge import Wedge

VTK_CELLS = {
    "tetra": "Tetra",
    "tetra10": "QuadraticTetra",
    "hexahedron": "Hexahedron",
    "hexahedron20": "QuadraticHexahedron",
    "hexahedron27": "TriQuadraticHexahedron",
    "wedge": "Wedge",
    "wedge15": "QuadraticWedge",
    "pyramid": "Pyramid",
    "pyramid13": "QuadraticPyramid",
}
STRAIGHT = [name for name, cell in CELLS.items() if cell.order == 1]


@pytest.mark.parametrize("cell_type", CELLS)
def test_nodes_come_in_vtks_own_order(cell_type: str) -> None:
    cell = getattr(vtkCommonDataModel, f"vtk{VTK_CELLS[cell_type]}")()
    coordinates = cell.GetParametricCoords()
    vtk = np.array([[coordinates[3 * k + a] for a in range(3)] for k in range(cell.GetNumberOfPoints())])
    if cell_type.startswith("pyramid"):  # VTK's are those of a cube that collapses to the apex
        vtk[:, :2] *= 1 - vtk[:, 2:]
    assert np.array_equal(CELLS[cell_type].nodes, vtk)


@pytest.mark.parametrize("cell_type", STRAIGHT)
def test_faces_are_walked_around_counter_clockwise_seen_from_outside(cell_type: str) -> None:
    x = CELLS[cell_type].nodes
    volume = 0.0
    for face in CELLS[cell_type].shape.faces:
        around = x[list(face)]
        normal = np.cross(around[1] - around[0], around[2] - around[0])
        assert normal @ (around.mean(axis=0) - x.mean(axis=0)) > 0
        volume += np.cross(around, np.roll(around, -1, axis=0)).sum(axis=0) @ around.mean(axis=0) / 6
    assert volume == pytest.approx({"tetra": 1 / 6, "hexahedron": 1.0, "wedge": 0.5, "pyramid": 1 / 3}[cell_type])


@pytest.mark.parametrize("cell_type", STRAIGHT)
def test_edges_are_the_sides_of_the_faces(cell_type: str) -> None:
    sides = {
        frozenset(side)
        for face in CELLS[cell_type].shape.faces
        for side in zip(face, [*face[1:], face[0]], strict=True)
    }
    assert sides == {frozenset(ends) for ends in CELLS[cell_type].shape.edges}
    assert len(sides) == len(CELLS[cell_type].shape.edges)


@pytest.mark.parametrize("cell_type", CELLS)
def test_a_cell_has_as_many_nodes_as_its_name_says(cell_type: str) -> None:
    cell = CELLS[cell_type]
    assert len(cell.nodes) == int(cell_type.removeprefix(cell.shape.name) or cell.n_corners)


@pytest.mark.parametrize("cell_type", STRAIGHT)
def test_abaqus_faces_are_the_cells_faces(cell_type: str) -> None:
    shape = CELLS[cell_type].shape
    assert {frozenset(face) for face in shape.abaqus_faces} == {frozenset(face) for face in shape.faces}


def test_a_wedge_of_equal_edges_has_quality_one() -> None:
    triangle = np.array([(0, 0, 0), (1, 0, 0), (0.5, 0.75**0.5, 0)])
    wedge = np.concatenate([triangle, triangle + np.array([0, 0, 1])])
    assert Wedge.scaled_jacobian(wedge[None]) == pytest.approx([1.0], rel=1e-14)
    assert Wedge.scaled_jacobian(wedge[None, [1, 0, 2, 4, 3, 5]])[0] < 0  # mirrored

"""Tables of the cells, against VTK's and against each other."""

import numpy as np
import pytest
from vtkmodules import vtkCommonDataModel

from fmd.fem.cells import EDGES, FACES, N_CORNERS, N_NODES, scaled_jacobian, vtk_nodes

VTK_CELLS = {
    "tetra": "Tetra",
    "tetra10": "QuadraticTetra",
    "hexahedron": "Hexahedron",
    "hexahedron20": "QuadraticHexahedron",
    "hexahedron27": "TriQuadraticHexahedron",
    "wedge": "Wedge",
    "wedge15": "QuadraticWedge",
}


@pytest.mark.parametrize("cell_type", VTK_CELLS)
def test_nodes_come_in_vtks_own_order(cell_type: str) -> None:
    cell = getattr(vtkCommonDataModel, f"vtk{VTK_CELLS[cell_type]}")()
    coordinates = cell.GetParametricCoords()
    vtk = np.array([[coordinates[3 * k + a] for a in range(3)] for k in range(cell.GetNumberOfPoints())])
    assert np.array_equal(vtk_nodes(cell_type, 1 if cell_type in N_CORNERS else 2), vtk)


@pytest.mark.parametrize("cell_type", N_CORNERS)
def test_faces_are_walked_around_counter_clockwise_seen_from_outside(cell_type: str) -> None:
    x = vtk_nodes(cell_type, 1)
    volume = 0.0
    for face in FACES[cell_type]:
        around = x[list(face)]
        normal = np.cross(around[1] - around[0], around[2] - around[0])
        assert normal @ (around.mean(axis=0) - x.mean(axis=0)) > 0
        volume += np.cross(around, np.roll(around, -1, axis=0)).sum(axis=0) @ around.mean(axis=0) / 6
    assert volume == pytest.approx({"tetra": 1 / 6, "hexahedron": 1.0, "wedge": 0.5}[cell_type])


@pytest.mark.parametrize("cell_type", N_CORNERS)
def test_edges_are_the_sides_of_the_faces(cell_type: str) -> None:
    sides = {frozenset(side) for face in FACES[cell_type] for side in zip(face, [*face[1:], face[0]], strict=True)}
    assert sides == {frozenset(ends) for ends in EDGES[cell_type]}
    assert len(sides) == len(EDGES[cell_type])


@pytest.mark.parametrize("cell_type", [name for name in N_NODES if name not in N_CORNERS])
def test_cells_of_second_order_have_as_many_nodes_as_the_table_says(cell_type: str) -> None:
    assert vtk_nodes(cell_type, 2).shape == (N_NODES[cell_type], 3)


def test_a_wedge_of_equal_edges_has_quality_one() -> None:
    triangle = np.array([(0, 0, 0), (1, 0, 0), (0.5, 0.75**0.5, 0)])
    wedge = np.concatenate([triangle, triangle + np.array([0, 0, 1])])
    assert scaled_jacobian(wedge[None], "wedge") == pytest.approx([1.0], rel=1e-14)
    assert scaled_jacobian(wedge[None, [1, 0, 2, 4, 3, 5]], "wedge")[0] < 0  # mirrored

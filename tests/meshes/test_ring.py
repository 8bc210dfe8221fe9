"""The propeller in tetrahedra and with curved edges."""

from math import cos, pi, sin

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fmd.fem.mesh import SolidMesh
from fmd.fem.space import Discretisation
from fmd.meshes.propeller import mesh as mesh_propeller
from tests.meshes.test_propeller import COARSE, divided, turn

KINDS = [("hexahedron", 2, "hexahedron20"), ("tetrahedron", 1, "tetra"), ("tetrahedron", 2, "tetra10")]


@pytest.fixture(scope="module", params=KINDS, ids=lambda kind: kind[2])
def mesh(request: pytest.FixtureRequest) -> SolidMesh:
    element, order, cell_type = request.param
    found = SolidMesh(*mesh_propeller(divided(COARSE, element=element, order=order)))
    assert found.cell_type == cell_type
    return found


def test_a_turn_carries_points_and_cells_into_themselves(mesh: SolidMesh) -> None:
    turned = mesh.points @ turn(pi / 3).T
    distance, image = cKDTree(mesh.points).query(turned)
    assert distance.max() < 1e-15
    for numbers in mesh.parts.values():
        first, second, *_ = np.split(np.sort(mesh.cells[numbers], axis=1), mesh.sectors)
        assert {tuple(sorted(cell)) for cell in image[first].tolist()} == {tuple(cell) for cell in second.tolist()}


def test_cells_conform(mesh: SolidMesh) -> None:
    """All that is outside belongs to a named face, to the gaps between blades, or to a blade's or joint's edges."""
    elements, _ = Discretisation(mesh, mesh.order).boundary_facets
    straight = Discretisation(SolidMesh(*mesh_propeller(COARSE)), 1).boundary_facets[0]
    each = 2 if mesh.cell_type.startswith("tetra") else 1
    assert len(elements) == each * len(straight)
    assert len(np.unique(mesh.points.round(9), axis=0)) == len(mesh.points)
    assert np.array_equal(np.unique(mesh.cells), np.arange(len(mesh.points)))


def test_a_sleeve_of_curved_hexahedra_has_parabolas_around(mesh: SolidMesh) -> None:
    cells = mesh.cells[mesh.parts["sleeve"]]
    numbers, own = np.unique(cells, return_inverse=True)
    sleeve = SolidMesh(mesh.points[numbers], own.reshape(cells.shape), mesh.cell_type, {}, {})
    half = pi / COARSE.mesh.sleeve[0]
    polygon = COARSE.mesh.sleeve[0] * sin(half) * cos(half)
    segments = COARSE.mesh.sleeve[0] * 2 / 3 * 2 * sin(half) * (1 - cos(half))  # Archimedes' two thirds
    area = {"hexahedron20": polygon + segments, "tetra": polygon, "tetra10": pi}[mesh.cell_type]
    # tetrahedra's diagonals bend too: no polygon and no parabola, but near them
    near = 2e-2 if mesh.cell_type == "tetra" else 1e-4
    expected = pytest.approx(area * (0.075**2 - 0.04**2) * 0.11, rel=1e-9 if mesh.cell_type == "hexahedron20" else near)
    assert sleeve.volume == expected


def test_a_seat_of_its_own_makes_the_same_part_of_other_counts() -> None:
    """A blade of three cells across has the sections of one of five."""
    seat = 2 * pi * 3 / 30
    seated = COARSE.model_copy(update={"seat": seat})
    assert np.array_equal(mesh_propeller(seated).points, mesh_propeller(COARSE).points)
    finer = SolidMesh(*mesh_propeller(divided(seated, sleeve=(48, 4, 2), joint=(4, 5, 4), blade=(4, 5, 6), order=2)))
    same = SolidMesh(*mesh_propeller(divided(COARSE, order=2)))
    assert finer.volume == pytest.approx(same.volume, rel=1e-4)
    angle = np.arctan2(*finer.points[finer.faces["tip-1"]].T[1::-1])
    assert np.ptp(angle) == pytest.approx(np.ptp(np.arctan2(*same.points[same.faces["tip-1"]].T[1::-1])), rel=1e-9)

"""Bars meshed by Gmsh."""

from itertools import product

import gmsh
import numpy as np
import pytest

from fmd.fem.mesh import SolidMesh
from fmd.meshes.bar import hexahedral_bar, tetrahedral_bar
from fmd.meshes.gmsh_session import MeshArrays, gmsh_model

SIZES = (0.34, 0.025, 0.01)
CORNER = np.array([0.0, -0.0125, -0.005])
FACES = {"x-", "x+", "y-", "y+", "z-", "z+"}


@pytest.fixture(scope="module")
def hexahedra() -> MeshArrays:
    return hexahedral_bar(*SIZES, (12, 4, 2))


@pytest.fixture(scope="module")
def tetrahedra() -> MeshArrays:
    return tetrahedral_bar(*SIZES, 0.01)


@pytest.fixture(params=["hexahedra", "tetrahedra"])
def bar(request: pytest.FixtureRequest) -> MeshArrays:
    return request.getfixturevalue(request.param)


@pytest.mark.parametrize("divisions", [(1, 1, 1), (5, 3, 2), (2, 3, 7)])
def test_a_grid_has_the_cells_and_points_of_its_divisions(divisions: tuple[int, int, int]) -> None:
    mesh = hexahedral_bar(*SIZES, divisions)
    assert mesh.cell_type == "hexahedron"
    assert mesh.cells.shape == (np.prod(divisions), 8)
    assert mesh.points.shape == (np.prod(np.add(divisions, 1)), 3)
    assert {name: len(points) for name, points in mesh.faces.items()} == {
        "xyz"[a] + sign: np.prod(np.add(np.delete(divisions, a), 1)) for a in range(3) for sign in "-+"
    }


def test_a_grids_points_are_equally_spaced(hexahedra: MeshArrays) -> None:
    lines = [np.linspace(0, size, n + 1) + start for size, n, start in zip(SIZES, (12, 4, 2), CORNER, strict=True)]
    grid = np.array(list(product(*lines)))
    found = hexahedra.points[np.lexsort(np.round(hexahedra.points, 9).T[::-1])]
    assert np.abs(found - grid).max() < 1e-12


def test_a_regular_grid_is_of_quality_one(hexahedra: MeshArrays) -> None:
    assert SolidMesh(*hexahedra).quality == pytest.approx(np.ones(12 * 4 * 2), abs=1e-9)


def test_tetrahedra_are_well_shaped(tetrahedra: MeshArrays) -> None:
    # 1 is the regular tetrahedron, 0 a flat one
    assert tetrahedra.cell_type == "tetra"
    assert SolidMesh(*tetrahedra).quality.min() > 0.1


def test_tetrahedra_have_about_the_size_asked_for(tetrahedra: MeshArrays) -> None:
    corners = tetrahedra.points[tetrahedra.cells]
    edges = np.concatenate([corners[:, i] - corners[:, j] for i in range(4) for j in range(i)])
    assert np.linalg.norm(edges, axis=1).mean() == pytest.approx(0.01, rel=0.3)


def test_a_bar_fills_its_box(bar: MeshArrays) -> None:
    assert bar.points.min(axis=0) == pytest.approx(CORNER, abs=1e-12)
    assert bar.points.max(axis=0) == pytest.approx(CORNER + SIZES, abs=1e-12)
    assert SolidMesh(*bar).volume == pytest.approx(np.prod(SIZES), rel=1e-9)


def test_every_point_belongs_to_a_cell(bar: MeshArrays) -> None:
    assert np.array_equal(np.unique(bar.cells), np.arange(len(bar.points)))


def test_the_whole_bar_is_one_part(bar: MeshArrays) -> None:
    assert list(bar.parts) == ["bar"]
    assert np.array_equal(bar.parts["bar"], np.arange(len(bar.cells)))


def test_the_faces_are_named_after_their_outward_normals(bar: MeshArrays) -> None:
    assert set(bar.faces) == FACES
    for name, points in bar.faces.items():
        axis = "xyz".index(name[0])
        end = CORNER[axis] + (SIZES[axis] if name[1] == "+" else 0.0)
        assert np.array_equal(points, np.flatnonzero(np.abs(bar.points[:, axis] - end) < 1e-9))


def test_faces_keep_their_names_on_a_plate() -> None:
    # on a thin, short bar the middles of all side faces are near one another
    for mesh in (hexahedral_bar(0.01, 0.1, 0.002, (1, 4, 1)), tetrahedral_bar(0.01, 0.1, 0.002, 0.01)):
        for name, points in mesh.faces.items():
            assert np.ptp(mesh.points[points, "xyz".index(name[0])]) < 1e-9


def test_a_mesh_comes_out_the_same_each_time(tetrahedra: MeshArrays) -> None:
    again = tetrahedral_bar(*SIZES, 0.01)
    assert np.array_equal(again.points, tetrahedra.points)
    assert np.array_equal(again.cells, tetrahedra.cells)


def mesh_half_a_box(failure: type[BaseException]) -> None:
    with gmsh_model("half done") as model:
        model.model.occ.addBox(0, 0, 0, 1, 1, 1)
        raise failure


@pytest.mark.parametrize("failure", [KeyboardInterrupt, RuntimeError])
def test_gmsh_is_closed_after_an_error(failure: type[BaseException], hexahedra: MeshArrays) -> None:
    with pytest.raises(failure):
        mesh_half_a_box(failure)
    assert not gmsh.isInitialized()
    assert np.array_equal(hexahedral_bar(*SIZES, (12, 4, 2)).points, hexahedra.points)


def test_gmsh_is_closed_after_its_own_error() -> None:
    with pytest.raises(Exception, match="Degenerate box"):
        tetrahedral_bar(-1.0, 0.0, 0.0, 0.01)
    assert not gmsh.isInitialized()


def test_gmsh_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    tetrahedral_bar(*SIZES, 0.02)
    assert capfd.readouterr() == ("", "")

"""Meshes as files, read back by other programs' own readers."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter
from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

from fmd.core.errors import InputError
from fmd.fem.cells.table import CELLS
from fmd.fem.formats.export import part_numbers, write_mesh
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.mesh import SolidMesh

Make = Callable[..., SolidMesh]
NAMES = ("inner hub & co", "blade", "Flügel <2>")


def in_parts(box_mesh: Make) -> SolidMesh:
    """Hexahedra in three parts that alternate along the numbering and share points."""
    mesh = box_mesh("hexahedron", (5, 2, 2), (2.0, 1.0, 0.5), 0.1)
    numbers = np.arange(len(mesh.cells))
    return replace(mesh, parts={name: numbers[numbers % 3 == k] for k, name in enumerate(NAMES)})


@pytest.fixture(params=["three parts of hexahedra", "one part of tetrahedra"])
def mesh(request: pytest.FixtureRequest, box_mesh: Make) -> SolidMesh:
    return in_parts(box_mesh) if "three" in request.param else box_mesh("tetra", (2, 1, 1))


def gmsh_groups(path: Path) -> dict[str, np.ndarray]:
    """Node tags of each physical group's elements, (n, n_local), as Gmsh itself reads them."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        assert [line for line in gmsh.logger.get() if line.startswith(("Error", "Warning"))] == []
        groups = {}
        for dimension, group in gmsh.model.getPhysicalGroups():
            assert dimension == 3
            cells = []
            for volume in gmsh.model.getEntitiesForPhysicalGroup(dimension, group):
                (kind,), _, (nodes,) = gmsh.model.mesh.getElements(dimension, volume)
                cells.append(nodes.reshape(-1, gmsh.model.mesh.getElementProperties(kind)[3]))
            groups[gmsh.model.getPhysicalName(dimension, group)] = np.concatenate(cells)
            tags, _ = gmsh.model.mesh.getNodesForPhysicalGroup(dimension, group)
            assert np.array_equal(np.unique(tags), np.unique(cells))
        return groups
    finally:
        gmsh.finalize()


def gmsh_points(path: Path) -> np.ndarray:
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        return xyz.reshape(-1, 3)[np.argsort(tags)]
    finally:
        gmsh.finalize()


def test_gmsh_finds_the_parts_by_name_with_all_their_cells(mesh: SolidMesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.msh"
    write_mesh(mesh, path)
    groups = gmsh_groups(path)
    assert {name: len(cells) for name, cells in groups.items()} == {n: len(c) for n, c in mesh.parts.items()}
    for name, cells in mesh.parts.items():
        assert np.array_equal(groups[name] - 1, mesh.cells[cells])
    assert np.array_equal(gmsh_points(path), mesh.points)


def test_meshio_finds_the_parts_by_name_and_the_points_in_order(mesh: SolidMesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.msh"
    write_mesh(mesh, path)
    with path.open("rb") as file:
        assert file.read(17).startswith(b"$MeshFormat\n4.1 ")
    back = meshio.read(path)
    assert np.array_equal(back.points, mesh.points)
    assert {name: tuple(data) for name, data in back.field_data.items()} == {
        name: (k, 3) for k, name in enumerate(mesh.parts, start=1)
    }
    for k, (name, cells) in enumerate(mesh.parts.items()):
        assert np.array_equal(back.cells[k].data, mesh.cells[cells])
        assert (back.cell_data["gmsh:physical"][k] == k + 1).all()
        assert [len(chosen) for chosen in back.cell_sets[name]] == [
            len(c) if other == name else 0 for other, c in mesh.parts.items()
        ]


def test_meshio_reads_numbers_and_names_of_the_parts_from_vtu(mesh: SolidMesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.vtu"
    write_mesh(mesh, path)
    back = meshio.read(path)
    assert np.array_equal(back.points, mesh.points)
    assert np.array_equal(back.cells[0].data, mesh.cells)
    (numbers,) = back.cell_data["part"]
    assert np.issubdtype(numbers.dtype, np.integer)
    for name, cells in mesh.parts.items():
        assert np.array_equal(np.flatnonzero(numbers == back.field_data[name]), cells)


def test_vtk_reads_the_same_from_vtu(mesh: SolidMesh, tmp_path: Path) -> None:
    path = tmp_path / "mesh.vtu"
    write_mesh(mesh, path)
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    grid = reader.GetOutput()
    fields = grid.GetFieldData()
    names = [fields.GetArrayName(k) for k in range(fields.GetNumberOfArrays())]
    assert {name: fields.GetArray(name).GetTuple1(0) for name in names} == {
        name: k for k, name in enumerate(mesh.parts, start=1)
    }
    assert np.array_equal(vtk_to_numpy(grid.GetCellData().GetArray("part")), part_numbers(mesh))
    assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData()), mesh.points)


def test_cells_of_no_part_are_a_group_too(box_mesh: Make, tmp_path: Path) -> None:
    mesh = replace(box_mesh("hexahedron", (3, 1, 1)), parts={"end": np.array([2]), "empty": np.array([], dtype=int)})
    write_mesh(mesh, tmp_path / "mesh.msh")
    groups = gmsh_groups(tmp_path / "mesh.msh")
    assert {name: len(cells) for name, cells in groups.items()} == {"end": 1, "unnamed": 2}
    assert part_numbers(mesh).tolist() == [0, 0, 1]


def test_a_cell_in_two_parts_counts_to_the_smaller(box_mesh: Make) -> None:
    mesh = replace(box_mesh("hexahedron", (2, 1, 1)), parts={"end": np.array([1]), "all": np.array([0, 1])})
    assert part_numbers(mesh).tolist() == [2, 1]


@pytest.mark.parametrize("suffix", [".msh", ".vtu"])
def test_a_mesh_without_parts_has_points_and_cells(box_mesh: Make, tmp_path: Path, suffix: str) -> None:
    mesh = replace(box_mesh("tetra", (1, 1, 1)), parts={})
    write_mesh(mesh, tmp_path / f"mesh{suffix}")
    back = meshio.read(tmp_path / f"mesh{suffix}")
    assert np.array_equal(back.points, mesh.points)
    assert np.array_equal(back.cells[0].data, mesh.cells)


def test_other_formats_get_points_and_cells(mesh: SolidMesh, tmp_path: Path) -> None:
    path = tmp_path / "deeper" / "mesh.inp"
    write_mesh(mesh, path)
    back = meshio.read(path)
    assert back.points == pytest.approx(mesh.points, abs=1e-12)
    assert np.array_equal(back.cells[0].data, mesh.cells)
    assert [entry.name for entry in path.parent.iterdir()] == ["mesh.inp"]


def test_an_unknown_format_and_a_bad_place_are_the_users_errors(mesh: SolidMesh, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no known mesh format"):
        write_mesh(mesh, tmp_path / "mesh.unheard-of")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="can't be written"):
        write_mesh(mesh, tmp_path / "file" / "mesh.msh")


def gmsh_volume(path: Path) -> float:
    """Volume of the elements in a file as Gmsh integrates it."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        (kind,) = gmsh.model.mesh.getElementTypes(3)
        points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss6")
        determinants = gmsh.model.mesh.getJacobians(kind, points)[1].reshape(-1, len(weights))
        return float((determinants @ weights).sum())
    finally:
        gmsh.finalize()


def vtk_volume(path: Path) -> float:
    """Volume of the elements in a file as VTK measures it."""
    reader, sizes = vtkXMLUnstructuredGridReader(), vtkCellSizeFilter()
    reader.SetFileName(str(path))
    sizes.SetInputConnection(reader.GetOutputPort())
    sizes.Update()
    return float(vtk_to_numpy(sizes.GetOutput().GetCellData().GetArray("Volume")).sum())


@pytest.mark.parametrize("cell_type", CELLS)
def test_gmsh_and_vtk_read_a_cell_of_every_type_with_its_volume(cell_type: str, tmp_path: Path) -> None:
    nodes = CELLS[cell_type].nodes
    mesh = SolidMesh(
        nodes + 0.1 * nodes[:, [1, 2, 0]], np.arange(len(nodes))[None], cell_type, {"cell": np.arange(1)}, {}
    )
    for suffix, volume in ((".msh", gmsh_volume), (".vtu", vtk_volume)):
        path = tmp_path / f"cell{suffix}"
        write_mesh(mesh, path)
        # of wedges with six nodes VTK numbers the triangles the other way round
        assert abs(volume(path)) == pytest.approx(mesh.volume, rel=1e-12)
        again = read_mesh(path, 1.0)
        assert (again.cell_type, again.volume) == (cell_type, pytest.approx(mesh.volume, rel=1e-12))


@pytest.mark.parametrize("cell_type", [name for name, cell in CELLS.items() if cell.nastran])
def test_nastran_files_of_every_cell_are_read_back_in_nastrans_order(cell_type: str, tmp_path: Path) -> None:
    nodes = CELLS[cell_type].nodes
    mesh = SolidMesh(nodes.copy(), np.arange(len(nodes))[None], cell_type, {}, {})
    write_mesh(mesh, tmp_path / "cell.bdf")
    again = read_mesh(tmp_path / "cell.bdf", 1.0)
    assert not any("order" in note for note in again.notes)
    assert (again.cell_type, again.volume) == (cell_type, pytest.approx(mesh.volume, rel=1e-6))


def test_cells_that_a_format_lacks_are_named(tmp_path: Path) -> None:
    nodes = CELLS["hexahedron27"].nodes
    mesh = SolidMesh(nodes.copy(), np.arange(27)[None], "hexahedron27", {}, {})
    with pytest.raises(InputError, match="the format has no cells of type hexahedron27"):
        write_mesh(mesh, tmp_path / "cell.bdf")

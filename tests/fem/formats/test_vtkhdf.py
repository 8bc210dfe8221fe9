"""The series file, read back by VTK's own reader."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter
from vtkmodules.vtkIOHDF import vtkHDFReader

from fmd.core.arrays import Array
from fmd.fem.formats.export import part_numbers
from fmd.fem.formats.vtkhdf import vtk_cells, write_series
from fmd.fem.mesh import SolidMesh
from fmd.fem.space import Discretisation

Make = Callable[..., SolidMesh]
TIMES = np.array([0.0, 0.1, 0.35, 2.0])
SIZES = (1.2, 1.0, 0.8)
NAMES = ("xx", "yy", "zz", "yz", "xz", "xy")  # ours


def space_of(element: Any, box_mesh: Make) -> Discretisation:
    """A box of inner points moved at random, in two parts."""
    mesh = box_mesh(element.cell_type, (3, 2, 2), SIZES, 0.2)
    half = len(mesh.cells) // 2
    parts = {"left": np.arange(half, len(mesh.cells)), "right": np.arange(half)}
    return Discretisation(replace(mesh, parts=parts), element.order)


def fields_of(space: Discretisation) -> Iterator[dict[str, Array]]:
    rng = np.random.default_rng(0)
    n = len(space.x)
    for _ in TIMES:
        yield {
            "displacement": rng.normal(size=(n, 3)),
            "stress": rng.normal(size=(n, 6)),
            "von_mises": rng.uniform(size=n),
        }


@pytest.fixture
def space(element: Any, box_mesh: Make) -> Discretisation:
    return space_of(element, box_mesh)


@pytest.fixture
def path(space: Discretisation, tmp_path: Path) -> Path:
    write_series(space, TIMES, fields_of(space), tmp_path / "motion.vtkhdf", {"von_mises": 2e6})
    return tmp_path / "motion.vtkhdf"


@pytest.fixture
def reader(path: Path) -> Any:
    reader = vtkHDFReader()
    assert reader.CanReadFile(str(path))
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    return reader


def test_a_field_has_its_error_as_an_attribute(path: Path) -> None:
    import h5py

    with h5py.File(path) as file:
        assert file["VTKHDF/PointData/von_mises"].attrs["error"] == 2e6


def at(reader: Any, step: int) -> Any:
    reader.SetStep(step)
    reader.Update()
    return reader.GetOutputDataObject(0)


def cells_of(grid: Any) -> Array:
    return vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(grid.GetNumberOfCells(), -1)


def test_vtk_finds_the_times(reader: Any) -> None:
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert reader.GetHasTemporalData()
    assert reader.GetNumberOfSteps() == len(TIMES)
    assert times == tuple(TIMES)


def test_vtk_reads_each_instants_fields_on_the_same_mesh(reader: Any, space: Discretisation) -> None:
    for step, want in enumerate(fields_of(space)):
        grid = at(reader, step)
        data = grid.GetPointData()
        assert np.array_equal(vtk_to_numpy(grid.GetPoints().GetData()), space.x)
        assert np.array_equal(np.sort(cells_of(grid)), np.sort(space.element_nodes))
        assert np.array_equal(vtk_to_numpy(grid.GetCellData().GetArray("part")), part_numbers(space.mesh))
        got = {name: vtk_to_numpy(data.GetArray(name)) for name in want}
        assert all(values.dtype == np.float32 for values in got.values())
        assert np.array_equal(got["displacement"], want["displacement"].astype("f4"))
        assert np.array_equal(got["von_mises"], want["von_mises"].astype("f4"))
        for place, name in enumerate(("xx", "yy", "zz", "xy", "yz", "xz")):  # vtkDataArray's symmetric tensors
            assert np.array_equal(got["stress"][:, place], want["stress"][:, NAMES.index(name)].astype("f4"))


def test_vtk_can_ask_by_time(reader: Any, space: Discretisation) -> None:
    reader.UpdateTimeStep(TIMES[2])
    got = vtk_to_numpy(reader.GetOutputDataObject(0).GetPointData().GetArray("von_mises"))
    assert np.array_equal(got, list(fields_of(space))[2]["von_mises"].astype("f4"))


def test_the_mesh_is_in_the_file_once(path: Path, space: Discretisation) -> None:
    import h5py

    with h5py.File(path) as file:
        root = file["VTKHDF"]
        assert len(root["Points"]) == len(space.x)
        assert len(root["Connectivity"]) == space.element_nodes.size
        assert len(root["CellData/part"]) == len(space.element_nodes)
        assert root["CellData/part"].attrs["names"].tolist() == list(space.mesh.parts)


def test_the_volume_of_every_cell_is_positive_and_their_sum_the_boxes(reader: Any) -> None:
    sizes = vtkCellSizeFilter()
    sizes.SetInputDataObject(at(reader, 0))
    sizes.Update()
    volumes = vtk_to_numpy(sizes.GetOutputDataObject(0).GetCellData().GetArray("Volume"))
    assert (volumes > 0).all()
    assert volumes.sum() == pytest.approx(np.prod(SIZES), rel=1e-9)


def test_vtk_takes_the_cells_for_what_they_are(reader: Any, element: Any) -> None:
    names = {
        "hex8": "vtkHexahedron",
        "hex20": "vtkQuadraticHexahedron",
        "tet4": "vtkTetra",
        "tet10": "vtkQuadraticTetra",
    }
    grid = at(reader, 0)
    assert {grid.GetCell(k).GetClassName() for k in range(grid.GetNumberOfCells())} == {names[element.name]}


def test_the_jacobian_of_vtks_own_shape_functions_is_positive_everywhere(reader: Any) -> None:
    # ∂x/∂r by central differences of vtkCell's map, at a point inside and at one near a corner
    grid = at(reader, 0)
    for k in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(k)
        weights = [0.0] * cell.GetNumberOfPoints()

        def place(r: Array, cell: Any = cell, weights: list[float] = weights) -> Array:
            x = [0.0] * 3
            cell.EvaluateLocation(reference(0), r, x, weights)
            return np.array(x)

        for centre in (np.full(3, 0.25), np.full(3, 0.05)):
            J = [(place(centre + 1e-3 * e) - place(centre - 1e-3 * e)) / 2e-3 for e in np.eye(3)]
            assert np.linalg.det(J) > 1e-4


@pytest.mark.parametrize("element", [("hex20", "hexahedron", 2), ("tet10", "tetra", 2)], indirect=True, ids=str)
def test_a_mid_edge_node_lies_between_the_corners_of_vtks_edge(reader: Any) -> None:
    grid = at(reader, 0)
    for k in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(k)
        for number in range(cell.GetNumberOfEdges()):  # VTK's own edges: two corners, then the node between them
            a, b, middle = vtk_to_numpy(cell.GetEdge(number).GetPoints().GetData())
            assert middle == pytest.approx((a + b) / 2, abs=1e-12)


def test_both_ways_round_are_tested(element: Any, space: Discretisation) -> None:
    # scikit-fem maps hexahedra in this numbering from a left-handed cell, tetrahedra from a right-handed one
    J = np.linalg.det(space.jacobians(np.full((3, 1), 0.25)))
    assert (J < 0).all() if element.cell_type == "hexahedron" else (J > 0).all()
    assert np.array_equal(np.sort(vtk_cells(space)), np.sort(space.element_nodes))


# What is refused, with no file left ------------------------------------------------------------------------------

ONE = pytest.mark.parametrize("element", [("hex8", "hexahedron", 1)], indirect=True, ids=str)


def spoilt(space: Discretisation, spoil: Callable[[list[dict[str, Array]]], Any]) -> list[dict[str, Array]]:
    fields = list(fields_of(space))
    spoil(fields)
    return fields


@ONE
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda fields: fields.pop(), "fields for 3 of 4 times"),
        (lambda fields: fields.append(fields[0]), "more fields than the 4 times"),
        (lambda fields: fields.clear(), "fields for 0 of 4 times"),
        (lambda fields: fields[2].pop("stress"), "fields at time 2 are displacement, von_mises"),
        (lambda fields: fields[1].update(heat=np.zeros(3)), "fields at time 1"),
        (lambda fields: fields[3].update(stress=np.zeros((5, 6))), "stress has shape"),
        (lambda fields: fields[3].update(von_mises=fields[0]["stress"]), "von_mises has shape"),
    ],
)
def test_fields_that_change_or_do_not_match_the_times_are_refused(
    space: Discretisation, tmp_path: Path, spoil: Callable[[list[dict[str, Array]]], Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        write_series(space, TIMES, spoilt(space, spoil), tmp_path / "motion.vtkhdf")
    assert list(tmp_path.iterdir()) == []


@ONE
@pytest.mark.parametrize("times", [[], [0.0, 1.0, 1.0, 2.0], [1.0, 0.5, 2.0, 3.0], [0.0, np.nan, 1.0, 2.0]])
def test_times_that_do_not_ascend_are_refused(space: Discretisation, tmp_path: Path, times: list[float]) -> None:
    with pytest.raises(ValueError, match="ascend"):
        write_series(space, np.array(times), fields_of(space), tmp_path / "motion.vtkhdf")


@ONE
def test_a_file_that_was_there_stays_if_the_fields_fail(space: Discretisation, path: Path) -> None:
    before = path.read_bytes()

    def failing() -> Iterator[dict[str, Array]]:
        yield next(fields_of(space))
        raise RuntimeError("no more")

    with pytest.raises(RuntimeError, match="no more"):
        write_series(space, TIMES, failing(), path)
    assert path.read_bytes() == before
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]
    with pytest.raises(OSError, match=path.name):  # a file is no folder
        write_series(space, TIMES, fields_of(space), path / "motion.vtkhdf")


@ONE
def test_one_instant_is_in_memory_at_a_time(space: Discretisation, tmp_path: Path) -> None:
    import tracemalloc

    n = 200
    size = 8 * 6 * len(space.x)
    tracemalloc.start()
    try:
        fields = ({"stress": np.full((len(space.x), 6), float(k))} for k in range(n))
        write_series(space, np.arange(float(n)), fields, tmp_path / "motion.vtkhdf")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.2 * n * size + 2e6

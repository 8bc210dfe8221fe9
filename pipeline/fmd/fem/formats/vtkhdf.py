"""Writer of fields over time on a body's mesh as one VTKHDF file, which ParaView plays.

The format is VTK's, version 2.0 (https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format). VTK's own
``vtkHDFWriter`` rounds times to single precision, repeats cell data at every instant and needs a source in VTK's
pipeline, which is no shorter than the functions below.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fmd.core.arrays import Array, IntArray, require_shape
from fmd.core.files import whole_file
from fmd.fem.elements import match_nodes
from fmd.fem.formats.export import part_numbers
from fmd.fem.joined import AnySpace
from fmd.fem.space import Discretisation

_TENSOR = [0, 1, 2, 5, 3, 4]  # from xx, yy, zz, yz, xz, xy to VTK's order, which ends xy, yz, xz


def write_series(
    space: AnySpace,
    times: Array,
    fields: Iterable[Mapping[str, NDArray[Any]]],
    path: Path,
    errors: Mapping[str, float | str] | None = None,
) -> None:
    """Write fields at a body's nodes over ascending times (n_times,) [s]; the file appears whole or not at all.

    Fields (n_nodes,) or (n_nodes, k) at each of the times are computed one after the other and stored in single
    precision; all have the names and shapes of the first. Six components are a symmetric tensor, xx, yy, zz, yz, xz,
    xy. The cell data ``part`` is the number of each element's part, from 1. The attribute ``error`` of a field is the
    largest of any node and time in its unit, or why none is stated.

    Raises
    ------
    ValueError
        The times don't ascend, fields and times differ in number, or a field changes its name or shape.
    OSError
        The place can't be written.
    """
    import h5py  # type: ignore[import-untyped]

    require_shape("times", times, (None,))
    if not len(times) or not (np.diff(times) > 0).all():
        raise ValueError("times have to ascend, and to be one at least")
    with whole_file(path) as part, h5py.File(part, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = (2, 0)
        root.attrs["Type"] = np.bytes_("UnstructuredGrid")
        _write_mesh(root, space)
        _write_fields(root, len(space.x), len(times), fields)
        for name, error in (errors or {}).items():
            root[f"PointData/{name}"].attrs["error"] = error
        _write_steps(root, times, len(space.x))


def vtk_cells(space: Discretisation) -> IntArray:
    """Return the nodes of each element in VTK's order, shape (n_elements, n_local), with positive volumes."""
    order = np.array([_local_order(space, mirrored) for mirrored in (False, True)])
    centre = space.kind.geometry.doflocs.mean(axis=0)[:, None]
    mirrored = np.linalg.det(space.jacobians(centre)[:, 0]) < 0
    return np.take_along_axis(space.element_nodes, order[mirrored.astype(np.int64)], axis=1)


def _local_order(space: Discretisation, mirrored: bool) -> IntArray:
    """Return the local nodes of an element in the order of VTK's on the reference cell, shape (n_local,).

    An element with a negative Jacobian is right-handed if x and y of the reference cell change places.
    """
    nodes = space.mesh.cell.nodes_of_order(space.order)
    if mirrored:
        nodes = nodes[:, [1, 0, 2]]
    return match_nodes(nodes, space.kind.element.doflocs)


def _write_mesh(root: Any, space: AnySpace) -> None:
    """Write points, cells and parts, which don't change over time."""
    cells = [own.first + vtk_cells(own.space) for own in space.members]
    sizes = np.repeat([own.shape[1] for own in cells], [len(own) for own in cells])
    for name, number in (("Points", len(space.x)), ("Cells", len(sizes)), ("ConnectivityIds", sizes.sum())):
        root[f"NumberOf{name}"] = np.array([number])
    root["Points"] = space.x
    root["Connectivity"] = np.concatenate([own.ravel() for own in cells])
    root["Offsets"] = np.cumsum([0, *sizes])
    types = [own.space.kind.vtk_type for own in space.members]
    root["Types"] = np.repeat(types, [len(own) for own in cells]).astype(np.uint8)
    root["CellData/part"] = part_numbers(space.mesh)
    root["CellData/part"].attrs["names"] = list(space.mesh.parts)


def _write_fields(root: Any, n_nodes: int, n_times: int, fields: Iterable[Mapping[str, NDArray[Any]]]) -> None:
    """Write the fields of one instant after the other, so that memory holds those of one."""
    group = root.create_group("PointData")
    step = -1
    for step, now in enumerate(fields):
        if step == n_times:
            raise ValueError(f"there are more fields than the {n_times} times")
        if step == 0:
            for name, values in now.items():
                group.create_dataset(name, (n_times * n_nodes, *values.shape[1:]), "f4", fill_time="never")
        if set(now) != set(group):
            raise ValueError(f"fields at time {step} are {', '.join(now)}; at first they were {', '.join(group)}")
        for name, values in now.items():
            require_shape(name, values, (n_nodes, *group[name].shape[1:]))
            group[name][step * n_nodes : (step + 1) * n_nodes] = _to_vtk_order(values)
    if step + 1 < n_times:
        raise ValueError(f"there are fields for {step + 1} of {n_times} times")


def _to_vtk_order(values: NDArray[Any]) -> NDArray[Any]:
    """Return a field with the components of a tensor in VTK's order."""
    return values[:, _TENSOR] if values.shape[1:] == (6,) else values


def _write_steps(root: Any, times: Array, n_nodes: int) -> None:
    """Write the offsets of each instant's data: the mesh's are 0, a field's follow one another."""
    steps = root.create_group("Steps")
    n_times = len(times)
    steps.attrs["NSteps"] = n_times
    steps["Values"] = times
    zeros = np.zeros(n_times, dtype=np.int64)
    steps["NumberOfParts"] = zeros + 1
    for name in ("PartOffsets", "PointOffsets", "CellDataOffsets/part"):
        steps[name] = zeros
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        steps[name] = zeros[:, None]
    for name in root["PointData"]:
        steps[f"PointDataOffsets/{name}"] = n_nodes * np.arange(n_times)

"""Writer of meshes in the formats of other programs, with the names of parts if the format allows."""

import re
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np
from meshio import _mesh

from fmd.core.arrays import Array, IntArray
from fmd.core.errors import InputError
from fmd.core.files import refusing, whole_file
from fmd.fem.cells.table import complete_dimensions
from fmd.fem.joined import AnyMesh
from fmd.fem.mesh import SolidMesh

complete_dimensions(_mesh.topological_dimension)


def write_mesh(mesh: AnyMesh, path: Path) -> None:
    """Write a mesh in the format of the file's suffix; points keep their order, cells theirs within a part.

    In ``.msh`` (Gmsh 4.1) each part is a physical group, in ``.vtu`` its number is the cell data ``part`` and its name
    a field datum with that number; other formats get points and cells alone.

    Raises
    ------
    InputError
        meshio doesn't write that format, or not these cells in it, or the place can't be written.
    """
    if path.suffix not in meshio.extension_to_filetypes:
        known = " ".join(sorted(meshio.extension_to_filetypes))
        raise InputError("--out", "", str(path), f"no known mesh format; these are: {known}")
    try:
        with refusing("--out", path), whole_file(path) as part:
            match path.suffix:
                case ".msh" if mesh.parts and isinstance(mesh, SolidMesh):
                    _to_gmsh(mesh).write(part, file_format="gmsh")
                case ".vtu" if mesh.parts:
                    _to_meshio(mesh, part_numbers(mesh)).write(part)
                    _add_part_names(mesh, part)
                case ".bdf" | ".fem" | ".nas":  # meshio's fields have no room for more digits, and it writes CHEXA_
                    found = _to_meshio(mesh)
                    found.points = np.vectorize(lambda x: float(f"{x:.9e}"))(found.points)
                    found.write(part)
                    part.write_text(re.sub(r"^(C[A-Z]+)_", r"\1 ", part.read_text(), flags=re.MULTILINE))
                case _:
                    _to_meshio(mesh).write(part)
    except KeyError as error:
        raise InputError("--out", "", str(path), f"the format has no cells of type {mesh.cell_type}") from error


def write_surface(points: Array, triangles: IntArray, fields: Mapping[str, Array], path: Path) -> None:
    """Write points (n, 3) [m], triangles (m, 3) and fields at the points (n, …) by their names as ``.vtu``."""
    with whole_file(path) as part:
        meshio.Mesh(points, [("triangle", triangles)], point_data=dict(fields)).write(part)


def part_numbers(mesh: AnyMesh) -> IntArray:
    """Return the number of each cell's part in ``mesh.parts``, from 1, shape (n_cells,); 0 without a part.

    A cell of several parts, which sets in files may overlap to, belongs to the smallest.
    """
    numbers = np.zeros(mesh.n_cells, dtype=np.int64)
    for number, cells in sorted(enumerate(mesh.parts.values(), start=1), key=lambda part: -len(part[1])):
        numbers[cells] = number
    return numbers


def _to_meshio(mesh: AnyMesh, numbers: IntArray | None = None) -> meshio.Mesh:
    """Convert a mesh, with numbers of its cells' parts as their data if they are given."""
    firsts = np.cumsum([0, *(len(own.points) for own in mesh.members)])
    kinds = [own.cell_type for own in mesh.members]
    cells = [first + own.cells for first, own in zip(firsts, mesh.members, strict=False)]
    alike = {kind: [k for k, other in enumerate(kinds) if other == kind] for kind in kinds}  # one block of each type
    blocks = [(kind, np.concatenate([cells[k] for k in chosen])) for kind, chosen in alike.items()]
    data = {}
    if numbers is not None:
        each = np.split(numbers, np.cumsum([len(own) for own in cells])[:-1])
        data = {"part": [np.concatenate([each[k] for k in chosen]) for chosen in alike.values()]}
    return meshio.Mesh(np.concatenate([own.points for own in mesh.members]), blocks, cell_data=data)


def _to_gmsh(mesh: SolidMesh) -> meshio.Mesh:
    """Convert a mesh with a volume and a physical group for each part; cells of no part form the last one."""
    numbers = part_numbers(mesh)
    names = dict(enumerate(mesh.parts, start=1))
    if not numbers.all():
        names[len(names) + 1] = "unnamed"
        numbers[numbers == 0] = len(names)
    used = np.unique(numbers)
    tags = [numbers[numbers == number] for number in used]
    # meshio writes the points volume by volume and reads them in the file's order, so the volumes of consecutive points
    # must ascend. Gmsh gets a group's points from its cells: a volume needs no more than one point.
    volume = used[np.minimum(np.arange(len(mesh.points)), len(used) - 1)]
    return meshio.Mesh(
        mesh.points,
        [(mesh.cell_type, mesh.cells[numbers == number]) for number in used],
        point_data={"gmsh:dim_tags": np.column_stack([np.full_like(volume, 3), volume])},
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={names[number]: np.array([number, 3]) for number in used.tolist()},
    )


def _add_part_names(mesh: AnyMesh, path: Path) -> None:
    """Insert the parts' numbers by name into a ``.vtu`` file as field data, which meshio reads but doesn't write."""
    arrays = "".join(
        f'<DataArray type="Int64" Name={quoteattr(name)} NumberOfTuples="1" format="ascii">{number}</DataArray>'
        for number, name in enumerate(mesh.parts, start=1)
    )
    grid = b"<UnstructuredGrid>"
    path.write_bytes(path.read_bytes().replace(grid, grid + f"<FieldData>{arrays}</FieldData>".encode(), 1))

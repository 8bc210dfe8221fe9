"""Meshes as files for other tools."""

from __future__ import annotations

from pathlib import Path

import meshio

from pipeline.checks import InputError
from pipeline.fem.mesh import SolidMesh
from pipeline.files import whole_file


def write_mesh(mesh: SolidMesh, path: Path) -> None:
    """Write a mesh in the format of the file's suffix.

    Raises
    ------
    InputError
        meshio doesn't write that format, or the place can't be written.
    """
    if path.suffix not in meshio.extension_to_filetypes:
        known = " ".join(sorted(meshio.extension_to_filetypes))
        raise InputError("--out", "", str(path), f"no known mesh format; these are: {known}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as part:
            meshio.Mesh(mesh.points, [(mesh.cell_type, mesh.cells)]).write(part)
    except OSError as error:
        raise InputError("--out", "", str(path), f"can't be written: {error.strerror or error}") from error

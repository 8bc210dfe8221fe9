"""Triangles on the faces of a CAD file; its `main` is run in a process of its own."""

import contextlib
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fmd.meshes.gmsh_session import gmsh_model, import_cad

_COARSE = 0.1  # longest side over the diagonal of what is in the file


def triangulate_cad(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points (n, 3) [m] and triangles (m, 3) on all faces in a STEP, IGES or BREP file.

    Raises
    ------
    ValueError
        The file has no face.
    """
    with gmsh_model("faces") as gmsh:
        import_cad(gmsh, path)
        if not gmsh.model.getEntities(2):
            raise ValueError("there is no face in it; export the part as a solid or as surfaces")
        box = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
        for option, value in {
            "MeshSizeMax": _COARSE * float(np.linalg.norm(box[1] - box[0])),
            "MeshSizeFromCurvature": 24,  # triangles around a full circle
        }.items():
            gmsh.option.setNumber(f"Mesh.{option}", value)
        gmsh.model.mesh.generate(2)
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        place = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
        place[tags] = np.arange(tags.size)
        corners = gmsh.model.mesh.getElementsByType(2)[1]
        return xyz.reshape(-1, 3), place[corners].reshape(-1, 3)


def main(arguments: list[str]) -> str | None:
    """Write the triangles of the first argument's file into the second, and return an error message or ``None``."""
    source, target = arguments
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            points, triangles = triangulate_cad(Path(source))
    except ValueError as error:
        return str(error)
    except Exception as error:  # Gmsh's own
        return " ".join(f"Gmsh can't read it: {error}".split())[:200]
    np.savez(target, points=points, triangles=triangles)
    return None

"""Mesh of a CAD part as plain arrays, and its file, which needs no Gmsh to be read."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class CadMesh(NamedTuple):
    """A meshed CAD part as plain arrays with named solids and faces."""

    points: NDArray[np.float64]  # (n_points, 3) [m]
    cells: NDArray[np.int64]  # (n_cells, 4 or 10): points of each tetrahedron in VTK's order
    parts: Mapping[str, NDArray[np.int64]]  # cells of each solid, by its name in the file or ``solid-1`` …
    # (n_facets, 3): corners of each face's facets, by its number ``face-1`` …, its name in the file, its colour
    # ``#ff0000``, and the name by its place, ``xmin`` or ``hole-1``
    faces: Mapping[str, NDArray[np.int64]]
    # (4,): area [m²] and centre [m] of each face by its geometry, of a whole cylinder the middle of its axis
    centres: Mapping[str, NDArray[np.float64]]
    volume: float  # of the solids by their geometry [m³]


def save(mesh: CadMesh, path: Path) -> None:
    """Save a mesh as plain arrays and names in an ``.npz`` file."""
    arrays: dict[str, Any] = {"points": mesh.points, "cells": mesh.cells}
    arrays |= {f"part {k}": cells for k, cells in enumerate(mesh.parts.values())}
    arrays |= {f"face {k}": corners for k, corners in enumerate(mesh.faces.values())}
    arrays |= {"centres": np.array(list(mesh.centres.values())), "volume": np.float64(mesh.volume)}
    names = json.dumps({"parts": list(mesh.parts), "faces": list(mesh.faces)})
    np.savez(path, **arrays, names=np.frombuffer(names.encode(), dtype=np.uint8))


def load(path: Path) -> CadMesh:
    """Load a mesh that `save` has written."""
    with np.load(path, allow_pickle=False) as file:
        names = json.loads(bytes(file["names"]))
        return CadMesh(
            file["points"],
            file["cells"],
            {name: file[f"part {k}"] for k, name in enumerate(names["parts"])},
            {name: file[f"face {k}"] for k, name in enumerate(names["faces"])},
            dict(zip(names["faces"], file["centres"], strict=True)),
            float(file["volume"]),
        )

"""Shapes of rigid bodies that come from STL, OBJ and CAD files, as triangles."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from fmd.core.arrays import Array, IntArray
from fmd.core.cache import Cache, stage_key
from fmd.core.errors import as_input_error
from fmd.core.files import digest_file
from fmd.core.limits.patience import VISUAL_SECONDS
from fmd.core.processes import ChildError, run_child
from fmd.core.rotations import rotation_by
from fmd.core.units import unit_ratio
from fmd.fem.formats.obj import read_obj
from fmd.fem.formats.stl import read_stl
from fmd.scene.scene import Scene

_READERS = {".stl": read_stl, ".obj": read_obj}  # of triangles, by suffix


def find_visual_files(scene: Scene) -> dict[str, str]:
    """Return the digests of the files that rigid bodies are shown or touched by, under their keys in the scene.

    Raises
    ------
    InputError
        A file can't be read.
    """
    digests = {}
    for body, table in scene.body.items():
        shapes = {f"visual.{number}": own for number, own in enumerate(getattr(table, "visual", ()))}
        shapes |= {f"surface.{name}": own for name, own in getattr(table, "surface", {}).items()}
        for place, own in shapes.items():
            if own.type == "file":
                key = f"body.{body}.{place}.file"
                with as_input_error(scene.file, key, own.file):
                    digests[key] = digest_file(Path(scene.file).parent / own.file)
    return digests


def read_shape(scene: Scene, body: str, place: str, cache: Cache) -> tuple[Array, IntArray]:
    """Read points (n, 3) in the body's frame [m] and triangles (m, 3) of a body's shape from its file.

    The file's table is ``visual.NUMBER`` or ``surface.NAME`` of the body.

    Raises
    ------
    InputError
        The file can't be read, or holds no shape; the message says why.
    """
    table: Any = scene.body[body]
    kind, _, name = place.partition(".")
    visual = table.visual[int(name)] if kind == "visual" else table.surface[name]
    key = f"body.{body}.{place}.file"
    digest = find_visual_files(scene)[key]
    path = Path(scene.file).parent / visual.file
    if (read := _READERS.get(path.suffix.lower())) is not None:
        with as_input_error(scene.file, key, visual.file):
            points, triangles = read(path)
        return _place(visual, points * unit_ratio(visual.unit, "m")), triangles
    sources = ("fmd/meshes", "fmd/stages/visual_files.py")
    kept = stage_key("visual", {"content": digest, "kind": path.suffix.lower()}, sources, ("gmsh",))
    found = cache.load(kept, "tuple[Array, ...]")
    if found is None:
        with as_input_error(scene.file, key, visual.file):
            found = _triangulate(path)
        cache.save(kept, found)
    points, triangles = found
    return _place(visual, points), triangles


def _place(table: Any, points: Array) -> Array:
    """Return points of a file in the body's frame."""
    return np.asarray(points @ rotation_by(table.rotation).T + np.array(table.at))


def _triangulate(path: Path) -> tuple[Array, IntArray]:
    """Cut the faces of a CAD file into triangles, by Gmsh in a process of its own; raises ``ValueError``."""
    with tempfile.TemporaryDirectory(prefix="fmd-") as folder:
        arrays = Path(folder) / "arrays.npz"
        try:
            run_child("fmd.meshes.cad_faces:main", str(path.resolve()), str(arrays), seconds=VISUAL_SECONDS)
        except ChildError as error:
            late = f"wasn't cut into triangles in {VISUAL_SECONDS} s; take an STL file"
            raise ValueError(late if error.late else f"{error}; is it damaged?") from None
        with np.load(arrays, allow_pickle=False) as file:
            return np.array(file["points"]), np.array(file["triangles"])

"""OBJ files of Wavefront as triangles: their vertices and faces, without normals, textures and materials."""

from itertools import pairwise
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array, IntArray


def read_obj(path: Path) -> tuple[Array, IntArray]:
    """Read points (n, 3), in the file's unit, and corners of triangles (m, 3) of an OBJ file.

    Faces of more corners are cut from their first.

    Raises
    ------
    ValueError
        The file holds no face, a face names a vertex that isn't there, or a line can't be read.
    """
    points: list[tuple[float, float, float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        kind, *words = line.split() or [""]
        try:
            if kind == "v":
                x, y, z = map(float, words[:3])
                points.append((x, y, z))
            elif kind == "f":
                given = [int(word.partition("/")[0]) for word in words]
                # Counted from 1, or backwards from the last vertex so far.
                face = [n - 1 if n > 0 else len(points) + n if n < 0 else -1 for n in given]
                triangles += [(face[0], one, other) for one, other in pairwise(face[1:])]
        except ValueError:
            raise ValueError(f"can't be read in line {number}") from None
    if not triangles:
        raise ValueError("holds no faces")
    if not all(0 <= corner < len(points) for triangle in triangles for corner in triangle):
        raise ValueError("has a face with a vertex that isn't there")
    places, corners = np.array(points), np.array(triangles, dtype=np.int64)
    if not np.isfinite(places).all():
        raise ValueError("has a coordinate that isn't finite")
    return places, corners

"""STL files, binary and text, as triangles with common points."""

import re
from pathlib import Path

import numpy as np

from fmd.core.arrays import Array, IntArray

_HEADER, _RECORD = 84, 50  # bytes
_NUMBER = rb"([-+\d.eE]+)"
_VERTEX = re.compile(rb"vertex\s+" + rb"\s+".join([_NUMBER] * 3))


def read_stl(path: Path) -> tuple[Array, IntArray]:
    """Read points (n, 3), in the file's unit, equal ones once, and corners of triangles (m, 3) of an STL file.

    Raises
    ------
    ValueError
        The file holds no triangle, is cut off, or a coordinate isn't finite.
    """
    content = path.read_bytes()
    count = int.from_bytes(content[80:_HEADER], "little") if len(content) >= _HEADER else -1
    if len(content) == _HEADER + _RECORD * count:
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(content, kind, offset=_HEADER)["corners"].reshape(-1, 3)
    elif content.lstrip()[:5].lower() == b"solid":
        try:
            corners = np.array(_VERTEX.findall(content), dtype=np.float64).reshape(-1, 3)
        except ValueError:
            raise ValueError("is damaged: a vertex isn't three numbers") from None
    else:
        raise ValueError("is no STL file, or is cut off")
    if not len(corners) or len(corners) % 3:
        raise ValueError("holds no triangles, or is cut off")
    if not np.isfinite(corners).all():
        raise ValueError("has a coordinate that isn't finite")
    points, number = np.unique(corners.astype(np.float64), axis=0, return_inverse=True)
    triangles = number.reshape(-1, 3)
    distinct = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
    return points, triangles[distinct]

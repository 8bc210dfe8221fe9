"""Wavefront's OBJ files: faces by number from either end; what isn't there is refused in words."""

from pathlib import Path

import numpy as np
import pytest

from fmd.fem.formats.obj import read_obj

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def test_faces_count_from_the_first_vertex_or_back_from_the_last(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(CORNERS + "f 1/1/1 2//1 3\nf -3 -1 -2\n")
    points, triangles = read_obj(path)
    assert points.shape == (3, 3)
    np.testing.assert_array_equal(triangles, [[0, 1, 2], [0, 2, 1]])


@pytest.mark.parametrize("face", ["f 0 1 2", "f 1 2 5", "f 1 2 -4", f"f 1 2 {10**30}"])
def test_a_vertex_that_is_not_there_is_refused(tmp_path: Path, face: str) -> None:
    path = tmp_path / "a.obj"
    path.write_text(f"{CORNERS}{face}\nv 1 1 1\n")
    with pytest.raises(ValueError, match="a vertex that isn't there"):
        read_obj(path)

"""Grid points of Nastran's bulk data: systems they lie and move in, by their own fields or by GRDSET."""

import numpy as np
import pytest

from fmd.fem.formats.node_places import nastran_places
from fmd.fem.formats.raw_mesh import MeshFileError

QUARTER = "CORD2R,5,,10.,20.,30.,10.,20.,31.\n,10.,21.,30.\n"  # x along the basic y, and y against the basic x


def test_grdset_gives_the_systems_of_points_that_leave_theirs_blank():
    """A 0 in a point's own field is the basic system (MSC Nastran's Quick Reference Guide, GRDSET)."""
    found = nastran_places(QUARTER + "GRID,3,,1.,2.,3.\nGRID,4,0,1.,2.,3.,0\nGRID,6,,1.,2.,3.,0\nGRDSET,,5,,,,5")
    assert {label: x.tolist() for label, x in found.places.items()} == {
        3: [8.0, 21.0, 33.0],
        4: [1.0, 2.0, 3.0],
        6: [8.0, 21.0, 33.0],
    }
    assert list(found.axes) == [3]
    assert np.array_equal(found.axes[3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    "points", ["1.,2.,3.,1.,2.,3.\n,4.,5.,6.", "0.,0.,0.,1.,1.,1.\n,2.,2.,2.", "0.,0.,0.,0.,0.,1.\n,0.,0.,0."]
)
def test_a_system_of_three_points_on_a_line_is_refused(points: str):
    with pytest.raises(MeshFileError, match="line 3: GRID 3: coordinate system 5: its three points lie on a line"):
        nastran_places(f"CORD2R,5,,{points}\nGRID,3,5,1.,2.,3.")


def test_points_that_move_along_circles_are_refused():
    with pytest.raises(MeshFileError, match="line 3: GRID 3: moves in coordinate system 5, which is no CORD2R"):
        nastran_places("CORD2C,5,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,3,,1.,2.,3.,5")

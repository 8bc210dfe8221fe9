"""Grid points of Nastran's bulk data: systems they lie and move in, by their own fields or by GRDSET."""

import numpy as np
import pytest

from fmd.fem.formats.abaqus import read_abaqus
from fmd.fem.formats.nastran import read_nastran
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


HEAD = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n"


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ("*NODE,INPUT=nodes.inp", r"line 6: \*NODE with INPUT isn't followed; put the lines of nodes\.inp below it"),
        ("*ELEMENT,TYPE=C3D4,INPUT=e.inp", r"\*ELEMENT with INPUT isn't followed"),
        ("*NSET,NSET=A,INPUT=a.inp", r"\*NSET with INPUT isn't followed"),
        ("*EQUATION,INPUT=a.inp", r"\*EQUATION with INPUT isn't followed"),
        ("*NODE,SYSTEM=C\n5,1,90,0", "in cylindrical or spherical coordinates; Cartesian ones are read"),
        ("*SYSTEM\n0,0,1", r"\*SYSTEM isn't read; write the mesh out flat"),
        ("*NGEN\n1,9,1", r"\*NGEN isn't read"),
        ("*NFILL\nA,B,2,1", r"\*NFILL isn't read"),
        ("*NCOPY,OLD SET=A,CHANGE NUMBER=100,SHIFT\n1,0,0", r"\*NCOPY isn't read"),
        ("*NMAP,NSET=A,TYPE=CYLINDRICAL\n0,0,0,0,0,1", r"\*NMAP isn't read"),
        ("*IMPERFECTION,FILE=buckle,STEP=1\n1,0.1", r"\*IMPERFECTION isn't read"),
        ("*PARAMETER\nL=10", r"\*PARAMETER isn't read"),
        ("*SYMMETRIC MODEL GENERATION,REVOLVE", r"\*SYMMETRIC MODEL GENERATION isn't read"),
        ("*INSTANCE,NAME=A,PART=B\n1.,0.,0.", "an instance is moved"),
        ("*NODE\n1,0,0,1", "node 1 is given twice, at two places"),
    ],
)
def test_what_places_nodes_of_abaqus_otherwise_is_refused_by_name(section: str, message: str) -> None:
    with pytest.raises(MeshFileError, match=message):
        read_abaqus(f"{HEAD}{section}\n")


@pytest.mark.parametrize("kind", ["CORD1R", "CORD1C", "CORD1S", "CORD3G"])
def test_systems_of_nastran_by_grid_points_are_refused_by_name(kind: str) -> None:
    with pytest.raises(MeshFileError, match=f"grid point 4: coordinate system 7 is a {kind}; CORD2R"):
        read_nastran(f"GRID,1,,0.,0.,0.\n{kind},7,1,2,3\nGRID,4,7,1.,0.,0.\n")


def test_points_that_move_along_circles_are_refused():
    with pytest.raises(MeshFileError, match="line 3: GRID 3: moves in coordinate system 5, which is no CORD2R"):
        nastran_places("CORD2C,5,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,3,,1.,2.,3.,5")


@pytest.mark.parametrize("system", ["CORD2R,5,,0.,0.,x,0.,0.,1.\n,1.,0.,0.", "CORD2R,5,,0.,0.,0.,0.,0.,1."])
def test_a_damaged_system_is_refused_by_its_number(system: str):
    with pytest.raises(MeshFileError, match="grid point 1: coordinate system 5: CORD2R takes three points"):
        read_nastran(f"GRID,1,5,1.,2.,3.\n{system}\n")


def test_systems_in_systems_are_followed_however_deep():
    """Each is shifted by 1 along z from the one before, in which it is given."""
    deck = "".join(f"CORD2R,{k},{k - 1},0.,0.,1.,0.,0.,2.\n,1.,0.,1.\n" for k in range(1, 2001))
    assert read_nastran(f"GRID,1,2000,1.,2.,3.\n{deck}").points == pytest.approx(np.array([[1.0, 2.0, 2003.0]]))


def test_a_point_may_be_given_again_with_the_basic_system_named():
    twice = "GRID,1,,1.,2.,3.\nGRID,1,0,1.,2.,3.\n"
    assert read_nastran(twice).points.tolist() == [[1.0, 2.0, 3.0]]
    with pytest.raises(MeshFileError, match="grid point 1 is given twice, at two places"):
        read_nastran(twice + QUARTER + "GRDSET,,5\n")

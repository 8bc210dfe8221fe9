"""Abaqus input files: sets in pieces, surfaces, continued lines, and what is refused."""

import re
from pathlib import Path

import pytest

from fmd.fem.formats.abaqus import _cell_kind, read_abaqus
from fmd.fem.formats.import_mesh import read_mesh
from fmd.fem.formats.raw_mesh import MeshFileError

ABAQUS = """*Heading
 two bricks, sets in pieces, upper and lower case
*Part, name=P
*Node, nset=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, 1., 0., 1.
7, 1., 1., 1.
8, 0., 1., 1.
11, 0., 0., 2.
12, 1.D0, 0., 2.
13, 1., 1., 2.
14, 0., 1., 2.
*Element, type=c3d8r, elset=Lower
1, 1,2,3,4,5,
 6,7,8
*Element, type=C3D8, elset=upper
2, 5,6,7,8,11,12,13,14
*Elset, elset=both
lower
*Elset, elset=BOTH, generate
2, 2, 1
*Nset, nset=top, generate
11, 14
*Surface, type=ELEMENT, name=lid
upper, S2
*Surface, type=element, name=Floor
1, S1
*End Part
"""


def test_abaqus_sets_in_pieces_surfaces_and_continued_lines_are_understood(tmp_path: Path) -> None:
    path = tmp_path / "two.inp"
    path.write_text(ABAQUS)
    mesh = read_mesh(path, 1e-3)
    assert mesh.volume == pytest.approx(2e-9, rel=1e-12)
    assert {name: cells.tolist() for name, cells in mesh.parts.items()} == {"Lower": [0], "upper": [1], "both": [0, 1]}
    assert mesh.faces["top"].tolist() == [8, 9, 10, 11]
    assert mesh.faces["lid"].tolist() == [[8, 9, 10]]
    assert mesh.faces["Floor"].tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("*Part, name=P", "*Part, name=P\n*Node\n1,0,0,0\n*Part, name=Q"), "more than one part"),
        (("*Heading", "*Include, input=other.inp"), "line 1: .INCLUDE isn't read"),
        (("*Node, nset=ALL", "*Node, nset=ALL, system=C"), "cylindrical"),
        (("1, 1,2,3,4,5,", "1, 1,2,3,4,99,"), "names node 99"),
        (("2, 5,6,7,8,11,12,13,14", "2, 5,6,7,8,11,12,13"), "element 2 has fewer than the 8 nodes"),
        (("2, 5,6,7,8,11,12,13,14", "1, 5,6,7,8,11,12,13,14"), "element 1 is given twice"),
        (("12, 1.D0", "12, one"), "aren't all numbers"),
        (("upper, S2", "uper, S2"), "names the element set uper"),
        (("lower\n*Elset", "both\n*Elset"), "set both holds itself"),
    ],
)
def test_abaqus_files_that_make_no_sense_are_refused_with_the_line(change: tuple[str, str], message: str) -> None:
    assert change[0] in ABAQUS
    with pytest.raises(MeshFileError, match=message):
        read_abaqus(ABAQUS.replace(*change))


def test_an_element_section_without_elements_is_skipped() -> None:
    nodes = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n"
    raw = read_abaqus(f"{nodes}*ELEMENT,TYPE=C3D8\n*ELEMENT,TYPE=C3D4,ELSET=a\n7,1,2,3,4\n")
    assert [(kind, len(cells)) for kind, cells in raw.blocks] == [("tetra", 1)]


AS_CALCULIX_TAKES_IT = """*NODE, NSET=ALL
1, 0.D0, 0., 0.
2, 1.d0, 0., 0.
3, 0., 10.d-1, 0.
4, 0., 0., 1.
5, 2.,2.,2.
*ELEMENT, TYPE=C3D4, ELSET=E1D2
1, 1, 2, 3, 4
*ELEMENT, TYPE=MASS, ELSET=M1D2
9, 5
*MASS, ELSET=M1D2
1.5D-1
*NSET, NSET=low
1, 2, 3
*SURFACE, NAME=LOW, TYPE=NODE
low
*RIGIDBODY, NSET=LOW, REFNODE=5
"""


def test_what_decks_of_calculix_have_beside_abaqus_own_is_read(tmp_path: Path) -> None:
    """Exponents of D, names with a D between digits, a surface with the name of its set, and names without blanks."""
    raw = read_abaqus(AS_CALCULIX_TAKES_IT)
    assert raw.points[:3].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert raw.connections.masses[0].mass == 0.15
    assert raw.point_sets["low"].tolist() == [0, 1, 2]
    assert raw.connections.rigid[0].points.tolist() == [4, 0, 1, 2]
    assert set(raw.cell_sets) == {"E1D2", "M1D2"}


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("*EQUATION\nlow, 3\n", "aren't all numbers as they should be"),
        (
            "*TRANSFORM, NSET=LOW, TYPE=C\n0,0,0,0,0,1\n*EQUATION\n2\n4,1,1.,1,1,-1.\n",
            r"\*EQUATION of node 4 is in directions that \*TRANSFORM turns",
        ),
        ("*SURFACE, NAME=E\nE1D2, E3\n*TIE\nE, E\n", "the surface E, which has no facets"),
    ],
)
def test_links_that_make_no_sense_are_refused(more: str, message: str) -> None:
    with pytest.raises(MeshFileError, match=message):
        read_abaqus(AS_CALCULIX_TAKES_IT + more)


def test_what_joins_or_cuts_and_is_not_read_is_named() -> None:
    assert read_abaqus(AS_CALCULIX_TAKES_IT + "*PRE-TENSION SECTION, SURFACE=S, NODE=5\n").others == {
        "*PRE-TENSION SECTION": 1
    }
    assert read_abaqus(AS_CALCULIX_TAKES_IT + "*EQUATION, REMOVE\nlow, 3\n").others == {"*EQUATION with REMOVE": 1}


@pytest.mark.parametrize("kind", ["C3D8FOO", "C3D20RR", "C3D10MM", "C3D9"])
def test_solid_elements_of_names_that_no_program_has_are_refused(kind: str) -> None:
    n = int(re.sub(r"C3D(\d+)\D*", r"\1", kind))
    with pytest.raises(MeshFileError, match=f"elements {kind} of {n} nodes aren't read"):
        read_abaqus(f"*NODE\n1, 0, 0, 0\n*ELEMENT, TYPE={kind}\n1, 1\n")


@pytest.mark.parametrize("kind", ["S4X", "B31X", "F3D8", "SC8R", "T3D9", "COH3D8"])
def test_other_elements_of_unknown_names_are_counted_as_what_is_not_read(kind: str) -> None:
    assert read_abaqus(f"*NODE\n1, 0, 0, 0\n*ELEMENT, TYPE={kind}\n1, 1\n").others == {kind: 1}


@pytest.mark.parametrize("kind", ["C3D8RPHT", "C3D10MHT", "C3D15VH", "C3D20RI", "AC3D8R", "S4RSW", "S8R5", "B32OSH"])
def test_letters_behind_the_number_of_nodes_change_no_mesh(kind: str) -> None:
    assert _cell_kind(kind)[0] == _cell_kind(re.sub(r"(3D\d+|S\d|B32)\D.*", r"\1", kind))[0] != ""

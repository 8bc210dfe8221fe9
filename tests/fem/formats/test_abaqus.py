"""Abaqus input files: sets in pieces, surfaces, continued lines, and what is refused."""

from pathlib import Path

import pytest

from fmd.fem.formats.abaqus import read_abaqus
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

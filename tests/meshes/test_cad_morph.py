"""Meshes of CAD parts carried along as dimensions of their scripts change."""

from pathlib import Path

import numpy as np
import pytest

from fmd.fem.mesh import SolidMesh
from fmd.meshes.cad import ScriptValues, main, mesh_cad
from fmd.meshes.cad_child import CadError
from fmd.meshes.cad_mesh import CadMesh

BRACKET = """SetFactory("OpenCASCADE");
DefineConstant[ hole = 16, fillet = {6, Name "Radius"} ]; // mm
Box(1) = {0, 0, 0, 80, 30, 8};
Box(2) = {0, 0, 0, 10, 30, 50};
BooleanUnion(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Cylinder(4) = {55, 15, -1, 0, 0, 10, hole / 2};
BooleanDifference(5) = { Volume{3}; Delete; }{ Volume{4}; Delete; };
inner() = Curve In BoundingBox {9.9, -1, 7.9, 10.1, 31, 8.1};
Fillet{5}{inner()}{fillet}
Physical Surface("bore") = Surface In BoundingBox {55 - hole, 15 - hole, -1, 55 + hole, 15 + hole, 9};
"""
BOX = """SetFactory("OpenCASCADE");
DefineConstant[ length = 3 ];
DefineConstant[ width = 1 ];
Box(1) = {0, 0, 0, length, width, 1};
"""
FIRST = {"hole": 16.0, "fillet": 6.0}


def volume_of(hole: float, fillet: float) -> float:
    """Volume of the bracket by its geometry [m³]."""
    return (80 * 30 * 8 + 10 * 30 * 42 - np.pi * hole**2 / 4 * 8 + (1 - np.pi / 4) * fillet**2 * 30) * 1e-9


@pytest.fixture
def bracket(tmp_path: Path) -> Path:
    path = tmp_path / "bracket.geo"
    path.write_text(BRACKET)
    return path


def make(path: Path, first: dict[str, float], **values: float) -> CadMesh:
    return mesh_cad(path, 8e-3, 2, script=ScriptValues(1e-3, first | values, first))


def test_elements_stay_the_same_and_follow_the_geometry(bracket: Path) -> None:
    first = make(bracket, FIRST)
    assert make(bracket, FIRST, hole=16.0).points == pytest.approx(first.points, abs=1e-15)
    rng = np.random.default_rng(5)
    for hole, fillet in rng.uniform((14.0, 4.5), (18.5, 8.0), (2, 2)).tolist():
        mesh = make(bracket, FIRST, hole=hole, fillet=fillet)
        assert np.array_equal(mesh.cells, first.cells)
        assert SolidMesh(mesh.points, mesh.cells, "tetra10", {}, {}).volume == pytest.approx(
            volume_of(hole, fillet), rel=1e-4
        )
        assert mesh.volume == pytest.approx(volume_of(hole, fillet), rel=1e-9)
        corners = mesh.points[np.unique(mesh.faces["bore"])]
        assert np.hypot(corners[:, 0] - 0.055, corners[:, 1] - 0.015) == pytest.approx(hole / 2e3, rel=1e-9)
        assert mesh.centres["bore"] == pytest.approx([np.pi * hole * 8e-6, 0.055, 0.015, 0.004], rel=1e-6)


def test_a_stretched_box_has_a_stretched_mesh(tmp_path: Path) -> None:
    path = tmp_path / "box.geo"
    path.write_text(BOX)
    sides = {"length": 3.0, "width": 1.0}
    one, other = (
        mesh_cad(path, 0.5, 2, script=ScriptValues(1.0, values, sides))
        for values in (sides, {"length": 4.5, "width": 0.8})
    )
    assert other.points == pytest.approx(one.points * [1.5, 0.8, 1.0], abs=1e-12)


def test_a_change_of_faces_and_a_mesh_that_would_turn_are_refused(bracket: Path, tmp_path: Path) -> None:
    with pytest.raises(CadError, match=r"leave an element .* times its volume, where 0.1 are the least"):
        make(bracket, FIRST, hole=28.0)
    path = tmp_path / "box.geo"
    # The last line has no end, and Gmsh alone would leave its second statement out.
    bore = (
        "Cylinder(2) = {1.5, 0.6, -1, 0, 0, 3, radius}; BooleanDifference{ Volume{1}; Delete; }{ Volume{2}; Delete; }"
    )
    path.write_text(BOX + "DefineConstant[ radius = 0.3 ];\n" + bore)
    with pytest.raises(CadError, match="the part had 1 solids, 7 surfaces and 15 curves, and has 1 solids, 9 surfaces"):
        mesh_cad(path, 0.5, 1, script=ScriptValues(1.0, {"radius": 0.5}, {"radius": 0.3}))  # through a side


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        *(
            ("// mm", text, rf"^{word} is refused: a script for a part holds its geometry alone")
            for text, word in (
                ('SystemCall "touch ran";', "SystemCall"),
                ('System "touch ran";', "System"),
                ("a = 1System 'touch ran';", "System"),
                ('word = "touch ran"; System word;', "System"),
                ('System Str("touch ran");', "System"),
                ('Include "more.geo";', "Include"),
                ('Printf("text") > "ran";', "Printf"),
                ('x() = ListFromFile("/etc/hosts");', "ListFromFile"),
                ('Field[1] = ExternalProcess; Field[1].CommandLine = "touch ran";', "Field"),
                ('General.ErrorFileName = "ran";', "General"),
                ('word = GetEnv("HOME");', "GetEnv"),
                ("Mesh 3;", "Mesh"),
                ("Recombine Surface {1};", "Recombine"),
                ("Exit;", "Exit"),
                (
                    f"a = \"{1023 * 'a'} System 'touch ran'; //\";",
                    "a text without an end, or of more than 200 letters,",
                ),
            )
        ),
        ('SetFactory("OpenCASCADE");', "", "must begin with SetFactory"),
        ("hole = 16, ", "", "has no parameter 'hole', .* it has: fillet"),
        ("// mm", "hole = 12;", "sets the parameter 'hole' to another value itself"),
        ("// mm", "Box(9) = {1, 2;", "can't run it: line 2: syntax error"),
    ],
)
def test_a_script_that_is_no_geometry_with_these_parameters_is_refused(
    bracket: Path, old: str, new: str, words: str
) -> None:
    bracket.write_text(BRACKET.replace(old, new))
    with pytest.raises(CadError, match=words):
        make(bracket, FIRST)
    assert not (bracket.parent / "ran").exists()


def test_comments_may_hold_any_word_and_numbers_any_name(bracket: Path, tmp_path: Path) -> None:
    bracket.write_text(
        BRACKET.replace("// mm", "// Save, Print /* Include\nR1 = 2; For i In {0:1}\n Wide = R1 * i;\nEndFor")
    )
    given = '{"size": 0.02, "order": 1, "script": [1e-3, {"hole": 16}, {"hole": 15}]}'
    assert main([str(bracket), str(tmp_path / "mesh.npz"), "20", "0.01", given]) is None

"""`fmd mesh`: its figures, and the files that it writes."""

import json
import math

import pytest


def test_mesh_reports_counts_volume_and_mass(fmd, capsys):
    assert fmd("mesh", "beam", "--set", "body.beam.mesh.divisions=[10, 3, 2]", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["elements"] == 10 * 3 * 2
    assert result["nodes"] == 11 * 4 * 3
    assert result["parts"] == {"bar": 60}
    assert (result["element_type"], result["order"], result["min_quality"]) == ("hexahedron", 2, pytest.approx(1.0))
    assert result["volume_m3"] == pytest.approx(0.34 * 0.025 * 0.01, rel=1e-12)
    assert result["mass_kg"] == pytest.approx(0.34 * 0.025 * 0.01 * 2000, rel=1e-12)


def test_mesh_can_be_written_and_read_again(fmd, tmp_path, capsys):
    import meshio

    path = tmp_path / "beam.vtu"
    assert fmd("mesh", "beam", "--out", str(path)) == 0
    assert "elements" in capsys.readouterr().out
    assert sum(len(block.data) for block in meshio.read(path).cells) == 30 * 3


def test_mesh_refuses_an_unknown_format(fmd, tmp_path, capsys):
    assert fmd("mesh", "beam", "--out", str(tmp_path / "beam.docx")) == 2
    assert "no known mesh format" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def tube(tmp_path):
    """A STEP file of a tube of 20 and 12 mm radius and 30 mm length."""
    from fmd.meshes.gmsh_session import gmsh_model

    with gmsh_model("tube") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # else that of the model before may be written
        occ = gmsh.model.occ
        occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 30, 20))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 30, 12))])
        occ.synchronize()
        gmsh.write(str(tmp_path / "tube.step"))
    return tmp_path / "tube.step"


def test_a_cad_file_is_meshed_without_a_scene_and_its_mesh_read_again(fmd, tube, capsys):
    written = tube.with_suffix(".vtu")
    assert fmd("mesh", tube, "--size", "6 mm", "--out", written, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["volume_m3"] == pytest.approx(math.pi * (20**2 - 12**2) * 30e-9, rel=1e-3)
    assert result["size_m"] == 6e-3
    assert {"hole-1", "pin-1", "zmin", "zmax"} < set(result["faces"])
    assert fmd("mesh", written, "--unit", "m", "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert (again["elements"], again["order"]) == (result["elements"], 2)
    assert again["volume_m3"] == pytest.approx(result["volume_m3"], rel=1e-9)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["{}", "--size", "0 mm"], "--size = '0 mm': must be above zero"),
        (["{}", "--size", "3"], "--size = '3': needs a unit"),
        (["{}", "--unit", "mm"], "--unit = 'mm': belongs to a mesh file"),
        (["{}", "--set", "body.x.E=1"], "--set = 'body.x.E=1': belongs to a scene"),
        (["none.step"], "none.step: no such file"),
        (["none.inp", "--unit", "mm"], "none.inp: no such file"),
        (["{}/../mesh.inp"], "--unit: is missing"),
        (["{}/../mesh.inp", "--unit", "kg"], "--unit = 'kg': isn't a unit of length"),
        (["{}/../mesh.inp", "--size", "3 mm"], "--size = '3 mm': belongs to a CAD file"),
        (["beam", "--size", "3 mm"], "--size = '3 mm': belongs to a CAD or mesh file alone"),
        (["{}/../part.xyz", "--unit", "mm"], "part.xyz"),
        (["{}/../arm.urdf"], "is a robot, no mesh; fmd new arm.toml --from"),
    ],
)
def test_a_file_that_cant_be_meshed_is_refused(fmd, tmp_path, capsys, arguments, said):
    for name in ("tube.step", "mesh.inp", "part.xyz", "arm.urdf"):
        (tmp_path / name).touch()
    given = [text.replace("{}/..", str(tmp_path)).format(tmp_path / "tube.step") for text in arguments]
    assert fmd("mesh", *given) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("output.0.file=x.doc", "output.0.file = 'x.doc': must be a plain file name"),
        ("drive.spin_up.jiont=x", "did you mean 'joint'"),
        ("simulation.tip=beam.nose", "no such marker"),
        ("joint.hub.child=beam.rood", "no such marker"),
    ],
)
def test_a_fault_in_what_a_mesh_doesnt_need_is_told_and_no_obstacle(fmd, capsys, fault, said):
    assert fmd("mesh", "beam", "--set", "body.beam.modes.boundary='free'", "--set", fault, "--json") == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["elements"] == 90
    assert "left out, since this doesn't need it" in captured.err
    assert said in captured.err


def test_a_fault_in_the_body_itself_is_refused_whatever_else_is_wrong(fmd, capsys):
    assert fmd("mesh", "beam", "--set", "output.0.file=x.doc", "--set", "body.beam.nu=0.9") == 2
    assert "body.beam.nu" in capsys.readouterr().err

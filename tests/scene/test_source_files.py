"""Files that bodies come from: found beside the scene, known by their content."""

from pathlib import Path

import pytest

from fmd.core.errors import InputError
from fmd.scene.scene import load_scene
from fmd.scene.source_files import SourceFiles, collect_inputs, digest_files, load_repaired, named_files
from tests.scene.scenes import refused

BRACKET = """
title = "Bracket"
[body.bracket]
mesh = { file = "bracket.inp", unit = "mm" }
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
modes = { count = 6 }
"""


@pytest.fixture
def bracket(tmp_path: Path) -> Path:
    scene = tmp_path / "bracket.toml"
    scene.write_text(BRACKET)
    (tmp_path / "bracket.inp").write_text("*NODE\n")
    return scene


def source_of(scene: Path) -> SourceFiles:
    source = SourceFiles.find(load_scene(scene).flexible["bracket"], str(scene), "bracket")
    assert source is not None
    return source


def test_a_file_lies_beside_its_scene(bracket: Path):
    assert source_of(bracket).path == bracket.parent / "bracket.inp"


def test_the_files_of_a_scene_are_its_own_and_those_that_it_names(bracket: Path):
    assert named_files(load_scene(bracket)) == [bracket, bracket.parent / "bracket.inp"]


def test_a_body_of_a_shape_comes_from_no_file():
    scene = load_scene("beam")
    assert SourceFiles.find(scene.flexible["beam"], scene.file, "beam") is None
    assert digest_files(scene) == {}


def test_a_result_depends_on_the_content_of_a_file_and_not_on_its_name(bracket: Path):
    def identity():
        shape = load_scene(bracket).flexible["bracket"]
        return source_of(bracket).identity(shape.model_dump(mode="json"))

    before = identity()
    (bracket.parent / "bracket.inp").rename(bracket.parent / "other.inp")
    bracket.write_text(BRACKET.replace("bracket.inp", "other.inp"))
    assert identity() == before
    (bracket.parent / "other.inp").write_text("*NODE\n1, 0, 0, 0\n")
    assert identity() != before


def test_the_inputs_of_results_leave_out_words_and_outputs(bracket: Path):
    inputs = collect_inputs(load_scene(bracket))
    assert inputs.keys() & {"title", "source", "reference", "output"} == set()
    assert inputs["files"]["bracket"].keys() == {"file"}


def test_a_missing_file_names_its_key_and_place(bracket: Path):
    (bracket.parent / "bracket.inp").unlink()
    with refused("body.bracket.mesh.file = 'bracket.inp': can't be read: No such file or directory; it"):
        source_of(bracket)


def test_only_a_geometric_stiffness_is_of_several_files(tmp_path: Path):
    scene, given = tmp_path / "bar.toml", 'stiffness = "K.mtx", mass = "{}", nodes = "x.csv", unit = "m"'
    for name in ("K.mtx", "M.mtx", "x.csv", "kg-1.npz", "kg-2.npz"):
        (tmp_path / name).write_text("")
    files = given.format("M.mtx") + ', geometric_stiffness = "kg-*.npz"'
    body = f"matrices = {{ {files} }}\nmodes = {{ count = 2 }}\nmarker = {{ end = {{ nodes = [1] }} }}"
    scene.write_text(f'title = "bar"\n[body.bar]\n{body}\n')
    found = SourceFiles.find(load_scene(scene).flexible["bar"], str(scene), "bar")
    assert found is not None
    assert [path.name for path in found.all_of("geometric_stiffness")] == ["kg-1.npz", "kg-2.npz"]
    scene.write_text(scene.read_text().replace('"M.mtx"', '"M*.mtx"'))
    with refused("body.bar.matrices.mass = 'M*.mtx': can't be read: No such file or directory; it"):
        SourceFiles.find(load_scene(scene).flexible["bar"], str(scene), "bar")


def test_a_repaired_scene_mends_the_meshes_from_files(bracket: Path):
    assert not load_scene(bracket).flexible["bracket"].mesh.repair
    assert load_repaired(str(bracket), []).flexible["bracket"].mesh.repair
    with pytest.raises(InputError, match="--repair: no body of the scene has its mesh from a file"):
        load_repaired("beam", [])

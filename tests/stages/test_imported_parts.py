"""Scenes whose parts come from files: CAD, meshes, matrices; told by name and by place, of several materials."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from fmd import load_scene
from fmd.cli.app import main
from fmd.core.cache import Cache
from fmd.core.errors import AccuracyError, InputError
from fmd.meshes.gmsh_session import gmsh_model
from fmd.stages.pipeline import Pipeline

pytestmark = pytest.mark.slow

# A strip of two blocks of 10 × 10 × 10 mm that touch at x = 10 mm; the first has a bore of 4 mm along z.
SCENE = """
title = "strip"
[body.strip]
mesh = { cad = "strip.step", size = "5 mm" }
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
modes = { count = 3 }
[body.strip.marker]
bore = { near = ["3 mm", "5 mm", "5 mm"] }
end = { plane = "x = 20 mm" }
root = { face = "root" }
"""
VOLUME = 2 * 0.01**3 - np.pi * 0.002**2 * 0.01


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The strip as STEP, with the names that CAD programs give: of solids, of a face and its colour; and as a mesh."""
    folder = tmp_path_factory.mktemp("strip")
    with gmsh_model("strip") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # else that of the model before may be written
        occ = gmsh.model.occ
        first = occ.addBox(0, 0, 0, 10, 10, 10)
        occ.cut([(3, first)], [(3, occ.addCylinder(5, 5, -1, 0, 0, 12, 2))])
        occ.addBox(10, 0, 0, 10, 10, 10)
        occ.synchronize()
        gmsh.write(str(folder / "strip.step"))
    text = (folder / "strip.step").read_text()
    for name in ("holed", "plain"):
        text = text.replace("MANIFOLD_SOLID_BREP(''", f"MANIFOLD_SOLID_BREP('{name}'", 1)
    text = text.replace("ADVANCED_FACE(''", "ADVANCED_FACE('root'", 1)  # of a box the one at x = 0 comes first
    (folder / "strip.step").write_text(text)
    (folder / "strip.toml").write_text(SCENE)
    return folder


def pipeline(folder: Path, *overrides: str, scene: str = "strip.toml", cache: Path | None = None) -> Pipeline:
    return Pipeline(load_scene(folder / scene, overrides), Cache(cache))


def test_solids_that_touch_share_nodes_and_keep_their_names(folder: Path) -> None:
    run = pipeline(folder)
    assert run.mesh.volume == pytest.approx(VOLUME, rel=1e-5)  # the bore by curved edges
    assert set(run.mesh.parts) == {"holed", "plain"}
    first, second = (set(run.mesh.cells[cells].ravel().tolist()) for cells in run.mesh.parts.values())
    shared = run.mesh.points[sorted(first & second)]
    assert np.abs(shared[:, 0] - 0.01).max() < 1e-9
    assert len(shared) > 8


def test_faces_are_found_by_name_and_by_place(folder: Path) -> None:
    markers = pipeline(folder).part.markers
    assert markers["bore"].position == pytest.approx([0.005, 0.005, 0.005], abs=1e-7)
    assert markers["end"].position == pytest.approx([0.02, 0.005, 0.005], abs=1e-9)
    assert markers["root"].position == pytest.approx([0.0, 0.005, 0.005], abs=1e-9)


def test_each_solid_is_of_its_own_material(folder: Path) -> None:
    material = 'body.strip.material={plain={E="300 GPa",nu=0.3,rho="7800 kg/m^3"}}'
    coarse = "body.strip.mesh.size=12 mm"
    run = pipeline(folder, coarse, material)
    assert run.part.mass == pytest.approx(7800e-6 + 2700 * (run.mesh.volume - 1e-6), rel=1e-9)
    assert run.fe.mass == pytest.approx(run.part.mass, rel=1e-9)
    assert run.modes.n_rigid == 6
    # Twice as stiff and twice as heavy throughout: the same frequencies
    alike = 'body.strip.material={plain={E="140 GPa",nu=0.33,rho="5400 kg/m^3"}}'
    twice = pipeline(folder, coarse, alike, "body.strip.E=140 GPa", "body.strip.rho=5400 kg/m^3")
    assert twice.modes.omega == pytest.approx(pipeline(folder, coarse).modes.omega, rel=1e-9)
    assert run.modes.omega[0] != pytest.approx(twice.modes.omega[0], rel=0.01)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("body.strip.marker.root.face=rot", r"marker.root.face = 'rot': no such face; did you mean 'root'\?"),
        ("body.strip.marker.end.plane=x = 21 mm", "no boundary facet of the mesh lies on the face"),
        ("body.strip.mesh.cad=no.step", "mesh.cad = 'no.step': can't be read: No such file"),
        ("body.strip.mesh.size=1 um", r"gives about 1\.\de\+13 elements"),
        ('body.strip.material={x={E="1 GPa",nu=0.3,rho="1 kg/m^3"}}', "material.x.part = 'x': no such part"),
    ],
)
def test_what_is_wrong_is_told_by_its_key(folder: Path, override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        pipeline(folder, override).part.modes  # noqa: B018


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("body.strip.marker.end.plane=x", "must look like 'x = 0'"),
        ('body.strip.marker.end={face="a",plane="x = 0"}', "can't stand beside face"),
        ("body.strip.marker.end={}", "is missing: a face's name"),
        ("body.strip.marker.end={nodes=[1]}", "belong to a body that is given by its matrices"),
        ('body.strip.mesh={file="a.inp",unit="kg"}', "isn't a unit that m converts to"),
    ],
)
def test_what_is_wrong_in_the_scene_is_told_before_any_file_is_read(folder: Path, override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_scene(folder / "strip.toml", [override])


def test_results_are_kept_for_a_files_content_wherever_it_lies(folder: Path, tmp_path: Path) -> None:
    for name in ("strip.step", "strip.toml"):
        shutil.copy(folder / name, tmp_path)
    cache = tmp_path / "cache"
    assert pipeline(folder, cache=cache).mesh is not None
    (tmp_path / "strip.step").rename(tmp_path / "renamed.step")
    again = pipeline(tmp_path, "body.strip.mesh.cad=renamed.step", cache=cache)
    assert again.mesh is not None
    assert again.log.cached == ["mesh"]
    (tmp_path / "renamed.step").write_text((folder / "strip.step").read_text() + "\n")
    changed = pipeline(tmp_path, "body.strip.mesh.cad=renamed.step", cache=cache)
    assert changed.mesh is not None
    assert changed.log.run == ["mesh"]


@pytest.fixture(scope="module")
def from_files(folder: Path) -> Pipeline:
    """The strip; its mesh as an Abaqus file, its matrices in three formats, in tonnes and millimetres."""
    run = pipeline(folder, "body.strip.mesh.size=8 mm")
    from fmd.fem.formats.export import write_mesh

    write_mesh(run.mesh, folder / "strip.inp")
    K, M, x = run.fe.K / 1e3, run.fe.M / 1e3, run.fe.x * 1e3
    labels = 3 * np.arange(len(x)) + 7
    scipy.io.mmwrite(folder / "K.mtx", K)
    sp.save_npz(folder / "M.npz", sp.csr_array(M))
    lower = sp.coo_array(sp.tril(M))
    rows = zip(*lower.coords, lower.data.tolist(), strict=True)
    lines = [f"{labels[i // 3]},{i % 3 + 1}, {labels[j // 3]},{j % 3 + 1}, {v!r}\n" for i, j, v in rows]
    (folder / "M.mtx").write_text("".join(lines))
    np.savetxt(folder / "nodes.csv", np.c_[labels, x], delimiter=",", header="node, x, y, z", comments="")
    (folder / "matrices.toml").write_text(
        """
title = "strip"
[body.strip]
modes = { count = 3 }
marker.end = { plane = "x = 20 mm" }
[body.strip.matrices]
stiffness = "K.mtx"
mass = "M.npz"
nodes = "nodes.csv"
unit = "mm"
stiffness_unit = "N/mm"
mass_unit = "t"
"""
    )
    return run


def test_a_mesh_from_a_file_gives_the_same_modes(from_files: Pipeline, folder: Path) -> None:
    markers = 'body.strip.marker={bore={near=["3 mm","5 mm","5 mm"]},e={plane="x = 20 mm"}}'
    read = pipeline(folder, 'body.strip.mesh={file="strip.inp",unit="m"}', markers)
    # up to the bore's sharp edges, by its curved facets
    assert read.part.markers["bore"].position == pytest.approx([0.005, 0.005, 0.005], abs=1e-7)
    assert read.modes.omega == pytest.approx(from_files.modes.omega, rel=1e-8)


def test_a_file_without_linear_hexahedra_has_no_choice_of_formulation(from_files: Pipeline, folder: Path) -> None:
    markers = 'body.strip.marker={e={plane="x = 20 mm"}}'
    run = pipeline(folder, 'body.strip.mesh={file="strip.inp",unit="m",formulation="plain"}', markers)
    with pytest.raises(InputError, match=r"formulation.*belongs to linear hexahedra; the elements here are tet10"):
        run.fe  # noqa: B018


def test_a_file_of_second_order_has_no_elements_of_first(from_files: Pipeline, folder: Path) -> None:
    markers = 'body.strip.marker={e={plane="x = 20 mm"}}'
    run = pipeline(folder, 'body.strip.mesh={file="strip.inp",unit="m",order=1}', markers)
    with pytest.raises(InputError, match=r"body\.strip\.mesh\.order = 1: the cells are tetra10.*leave `order` out"):
        run.fe  # noqa: B018


@pytest.mark.parametrize("mass", ["M.npz", "M.mtx"])
def test_matrices_give_the_same_modes(from_files: Pipeline, folder: Path, mass: str) -> None:
    run = pipeline(folder, f"body.strip.matrices.mass={mass}", scene="matrices.toml")
    assert run.modes.omega == pytest.approx(from_files.modes.omega, rel=1e-8)
    assert run.fe.mass == pytest.approx(from_files.fe.mass, rel=1e-9)
    assert run.part.markers["end"].position == pytest.approx([0.02, 0.005, 0.005], abs=1e-3)  # the mean of the nodes


def test_without_elements_there_is_no_stress_and_that_is_said(from_files: Pipeline, folder: Path) -> None:
    picture = 'output=[{type="stress",file="s.png",body="strip"}]'
    with pytest.raises(InputError, match="given by its matrices: without elements there is no stress"):
        load_scene(folder / "matrices.toml", [picture])
    with pytest.raises(InputError, match="given by its matrices: without elements it has no mesh"):
        pipeline(folder, scene="matrices.toml").mesh  # noqa: B018


def test_matrices_that_are_not_a_free_bodys_are_refused_with_the_figure(from_files: Pipeline, folder: Path) -> None:
    K = sp.lil_array(from_files.fe.K / 1e3)
    K[0, 0] *= 2
    sp.save_npz(folder / "held.npz", sp.csr_array(K))
    with pytest.raises(AccuracyError, match=r"isn't free: \w+ \w+ \w as a whole it answers with \S+e-\d+ of its"):
        pipeline(folder, "body.strip.matrices.stiffness=held.npz", scene="matrices.toml").fe  # noqa: B018
    K = sp.lil_array(from_files.fe.K / 1e3)
    K[0, 4] += 1.0
    sp.save_npz(folder / "skew.npz", sp.csr_array(K))
    with pytest.raises(AccuracyError, match="isn't symmetric, entries differ by"):
        pipeline(folder, "body.strip.matrices.stiffness=skew.npz", scene="matrices.toml").fe  # noqa: B018
    with pytest.raises(AccuracyError, match="masses depend on the direction"):
        pipeline(folder, "body.strip.matrices.mass=held.npz", scene="matrices.toml").fe  # noqa: B018


def test_repair_is_a_switch_of_the_command_line(
    from_files: Pipeline, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (folder / "strip.inp").read_text().split("\n")
    row = next(k for k, line in enumerate(lines) if line.startswith("*ELEMENT")) + 1
    number, a, b, c, *rest = lines[row].split(",")
    lines[row] = ",".join([number, a, c, b, *[rest[k] for k in (0, 3, 2, 1, 4, 6, 5)]])  # mirrored
    (folder / "torn.inp").write_text("\n".join(lines))
    scene = [str(folder / "strip.toml"), "--no-cache", "--set", 'body.strip.marker={e={plane="x = 20 mm"}}']
    command = ["mesh", *scene, "--set", 'body.strip.mesh={file="torn.inp",unit="m"}']
    with pytest.raises(SystemExit) as stop:
        main(command)
    assert stop.value.code == 2
    assert "elements are inverted: turned" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*command, "--repair"])
    assert "mended: 1 of" in capsys.readouterr().out

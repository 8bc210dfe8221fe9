"""CAD files: solids, their names and faces, and what can't be meshed."""

from pathlib import Path

import numpy as np
import pytest

from fmd.fem.mesh import SolidMesh
from fmd.meshes.cad import main, mesh_cad
from fmd.meshes.cad_child import CadError
from fmd.meshes.cad_mesh import load, save
from fmd.meshes.gmsh_session import gmsh_model


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    """A block of 20 × 10 × 10 mm with a bore of 4 mm along z, and one of 10 mm that touches it."""
    path = tmp_path_factory.mktemp("cad") / "blocks.step"
    with gmsh_model("blocks") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # else that of the model before may be written
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(0, 0, 0, 20, 10, 10))], [(3, occ.addCylinder(5, 5, -1, 0, 0, 12, 2))])
        occ.addBox(20, 0, 0, 10, 10, 10)
        occ.synchronize()
        gmsh.write(str(path))
    return path


@pytest.mark.parametrize(("order", "n_nodes"), [(1, 4), (2, 10)])
def test_solids_in_millimetres_become_tetrahedra_in_metres(path: Path, order: int, n_nodes: int) -> None:
    mesh = mesh_cad(path, 0.004, order)
    assert mesh.cells.shape[1] == n_nodes
    assert sorted(np.concatenate(list(mesh.parts.values()))) == list(range(len(mesh.cells)))
    solid = SolidMesh(mesh.points, mesh.cells, {4: "tetra", 10: "tetra10"}[n_nodes], {}, {})
    exact = 3 * 0.01**3 - np.pi * 0.002**2 * 0.01
    assert solid.volume == pytest.approx(exact, rel={4: 5e-3, 10: 1e-5}[n_nodes])  # polygons, parabolas for circles
    assert solid.quality.min() > 0.05


def test_a_bore_is_one_face(path: Path) -> None:
    mesh = mesh_cad(path, 0.004, 1)
    radius = {name: np.hypot(*(mesh.points[np.unique(face)][:, :2] - 0.005).T) for name, face in mesh.faces.items()}
    bores = [name for name, r in radius.items() if np.abs(r - 0.002).max() < 1e-8]
    assert bores == ["face-7", "hole-1"]  # one by its number, with a name by its place
    assert np.array_equal(*(mesh.faces[name] for name in bores))


def test_a_mesh_comes_back_from_its_file(path: Path, tmp_path: Path) -> None:
    mesh = mesh_cad(path, 0.005, 1)
    save(mesh, tmp_path / "mesh.npz")
    again = load(tmp_path / "mesh.npz")
    assert np.array_equal(again.points, mesh.points)
    assert np.array_equal(again.cells, mesh.cells)
    for ours, theirs in ((mesh.parts, again.parts), (mesh.faces, again.faces)):
        assert list(ours) == list(theirs)
        assert all(np.array_equal(ours[name], theirs[name]) for name in ours)


def test_what_can_not_be_meshed_is_refused_with_the_reason(path: Path, tmp_path: Path) -> None:
    with pytest.raises(CadError, match=r"gives about \d\.\de\+\d+ elements; 3e\+06 are the most"):
        mesh_cad(path, 1e-6, 1)
    with gmsh_model("surface") as gmsh:
        gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "surface.step"))
    target = str(tmp_path / "mesh.npz")
    assert "no solid in it" in str(
        main([str(tmp_path / "surface.step"), target, "20", "0.01", '{"size": 0.1, "order": 1}'])
    )
    (tmp_path / "damaged.step").write_text("ISO-10303-21;")
    assert "can't read it: is it damaged" in str(
        main([str(tmp_path / "damaged.step"), target, "20", "0.01", '{"size": 0.1, "order": 1}'])
    )


def test_the_faces_of_a_part_become_closed_triangles_for_pictures(path: Path) -> None:
    from fmd.meshes.cad_faces import triangulate_cad

    points, triangles = triangulate_cad(path)
    assert np.ptp(points, axis=0) == pytest.approx((0.03, 0.01, 0.01))
    one, other, third = (points[triangles[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(other - one, third - one), axis=1).sum()
    bore = 2 * np.pi * 2 * 10 - 2 * np.pi * 2**2
    assert area == pytest.approx((2 * (20 * 10 * 2 + 10 * 10) + bore + 6 * 100) * 1e-6, rel=0.01)

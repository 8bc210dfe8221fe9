"""Surfaces of CAD files as shells."""

from pathlib import Path

import numpy as np
import pytest

from fmd import load_scene
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.meshes.gmsh_session import gmsh_model
from fmd.stages.meshing.cad_files import mesh_cad_sheet
from fmd.stages.pipeline import Pipeline


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An angle of 100 × 40 mm, with a hole of 16 mm, and 100 × 30 mm; a plate of 100 × 40 mm; a block."""
    folder = tmp_path_factory.mktemp("cad")
    for name in ("angle", "plate", "block"):
        with gmsh_model(name) as gmsh:
            gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
            occ = gmsh.model.occ
            if name == "block":
                occ.addBox(0, 0, 0, 10, 10, 10)
            else:
                occ.addRectangle(0, 0, 0, 100, 40)
            if name == "angle":
                occ.cut([(2, 1)], [(2, occ.addDisk(50, 20, 0, 8, 8))])
                occ.rotate([(2, occ.addRectangle(0, 0, 0, 100, 30))], 0, 0, 0, 1, 0, 0, np.pi / 2)
            occ.synchronize()
            gmsh.write(str(folder / f"{name}.step"))
    return folder


def test_surfaces_that_touch_are_one_sheet_of_quadrilaterals_with_named_faces_and_rims(folder: Path) -> None:
    mesh = mesh_cad_sheet(folder / "angle.step", 5e-3, 2e-3)
    assert mesh.cell_type == "hexahedron"  # layers of quadrilaterals alone
    assert mesh.volume == pytest.approx(2e-3 * (0.1 * 0.07 - np.pi * 0.008**2), rel=2e-3)
    assert {"face-1", "face-2"} <= set(mesh.parts)
    rims = [points for name, points in mesh.faces.items() if name.startswith("edge-")]
    assert len(rims) == 7  # three of each leg and the hole's, not the fold
    round_hole = [r for r in rims if np.ptp(np.hypot(*(mesh.points[r][:, :2] - [0.05, 0.02]).T)) < 1e-6]
    assert len(round_hole) == 1


def test_a_plate_of_cad_has_the_frequencies_of_the_ready_shape(folder: Path) -> None:
    common = """
E = "70 GPa"
nu = 0.3
rho = "2700 kg/m^3"
modes = { count = 3 }
"""
    (folder / "cad.toml").write_text(
        f'title = "cad"\n[body.p]\nmesh = {{ cad = "plate.step", size = "5 mm", shell = "2 mm" }}{common}'
    )
    (folder / "own.toml").write_text(
        'title = "own"\n[body.p]\nshape = "plate"\nlength = "100 mm"\nwidth = "40 mm"\nthickness = "2 mm"\n'
        f"mesh = {{ divisions = [20, 8] }}{common}"
    )
    cad, own = (Pipeline(load_scene(folder / f"{name}.toml"), Cache(None)).parts["p"] for name in ("cad", "own"))
    assert cad.modes.frequencies_hz == pytest.approx(own.modes.frequencies_hz, rel=5e-3)
    assert cad.mass == pytest.approx(own.mass, rel=1e-9)


def test_solids_second_order_and_sectors_are_refused_as_shells(folder: Path) -> None:
    with pytest.raises(InputError, match="it has solids, and shells are of midsurfaces"):
        mesh_cad_sheet(folder / "block.step", 5e-3, 2e-3)
    with pytest.raises(InputError, match=r"gives about \S+ elements; 3e\+06 are the most"):
        mesh_cad_sheet(folder / "plate.step", 1e-6, 2e-3)
    for more, message in (
        ("order = 2", "is of solids: shells have four nodes"),
        ("cyclic = 3, cuts = ['a', 'b']", "not of shells"),
    ):
        with pytest.raises(InputError, match=message):
            load_scene(folder / "cad.toml", [f'body.p.mesh={{cad="plate.step",size="5 mm",shell="2 mm",{more}}}'])

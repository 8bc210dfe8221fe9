"""Surfaces of CAD files as shells."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import load_scene
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.fem.assembly import assemble
from fmd.fem.material import Material
from fmd.fem.mesh import SolidMesh
from fmd.meshes.gmsh_session import gmsh_model
from fmd.output.frequencies import mode_warnings
from fmd.reduction.eigen import FreeBodySolver
from fmd.stages.meshing.cad_files import UNLIKE_SOLID, describe_cad_file, mesh_cad_file, mesh_cad_sheet
from fmd.stages.pipeline import Pipeline

METAL = """
E = "70 GPa"
nu = 0.3
rho = "2700 kg/m^3"
modes = { count = 3 }
"""


def bent_strip(occ: Any) -> None:
    """A strip of 30 × 2 mm with legs of 50 and 35 mm, turned by 90° about a radius of 3 mm within, aslant in space."""
    lines, centre = [], occ.addPoint(50, 0, 5)
    for x in (((0, 0), (50, 0), (55, 5), (55, 40)), ((0, 2), (50, 2), (53, 5), (53, 40))):
        a, b, c, d = (occ.addPoint(each[0], 0, each[1]) for each in x)
        lines.append((a, d, [occ.addLine(a, b), occ.addCircleArc(b, centre, c), occ.addLine(c, d)]))
    (a, d, outer), (e, f, inner) = lines
    face = occ.addPlaneSurface([occ.addCurveLoop([*outer, occ.addLine(d, f), *inner[::-1], occ.addLine(e, a)])])
    occ.rotate([entity for entity in occ.extrude([(2, face)], 0, 30, 0) if entity[0] == 3], 0, 0, 0, 1, 2, 3, 0.7)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An angle of 100 × 40 mm, with a hole of 16 mm, and 100 × 30 mm; a plate of 100 × 40 mm; solids."""
    folder = tmp_path_factory.mktemp("cad")
    for name in ("angle", "plate", "block", "lump", "boss", "tee", "bend", "pipe"):
        with gmsh_model(name) as gmsh:
            gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
            occ = gmsh.model.occ
            if name == "block":
                occ.addBox(0, 0, 0, 10, 10, 10)
            elif name == "lump":
                occ.fuse([(3, occ.addBox(0, 0, 0, 100, 40, 2))], [(3, occ.addBox(0, 0, 0, 10, 40, 30))])
            elif name == "boss":
                occ.fuse([(3, occ.addBox(0, 0, 0, 100, 40, 2))], [(3, occ.addBox(60, 10, 1, 5, 6, 9))])
            elif name == "tee":
                occ.fuse([(3, occ.addBox(0, 0, 0, 100, 40, 2))], [(3, occ.addBox(0, 19, 0, 100, 2, 30))])
                occ.cut([(3, 1)], [(3, occ.addCylinder(50, 10, -1, 0, 0, 5, 4))])
            elif name == "bend":
                bent_strip(occ)
            elif name == "pipe":
                occ.cut([(3, occ.addCylinder(0, 0, 0, 90, 0, 0, 20))], [(3, occ.addCylinder(0, 0, 0, 90, 0, 0, 18))])
            else:
                occ.addRectangle(0, 0, 0, 100, 40)
            if name == "angle":
                occ.cut([(2, 1)], [(2, occ.addDisk(50, 20, 0, 8, 8))])
                occ.rotate([(2, occ.addRectangle(0, 0, 0, 100, 30))], 0, 0, 0, 1, 0, 0, np.pi / 2)
            occ.synchronize()
            gmsh.write(str(folder / f"{name}.step"))
    mesh = 'mesh = { cad = "plate.step", size = "5 mm", shell = "2 mm" }'
    (folder / "cad.toml").write_text(f'title = "cad"\n[body.p]\n{mesh}{METAL}')
    return folder


def test_surfaces_that_touch_are_one_sheet_of_quadrilaterals_with_named_faces_and_rims(folder: Path) -> None:
    mesh = mesh_cad_sheet(folder / "angle.step", 5e-3, 2e-3, by_part={"face-2": 3e-3})
    assert mesh.cell_type == "hexahedron"  # layers of quadrilaterals alone
    assert mesh.volume == pytest.approx(2e-3 * (0.1 * 0.04 - np.pi * 0.008**2) + 3e-3 * 0.1 * 0.03, rel=2e-3)
    assert {"face-1", "face-2"} <= set(mesh.parts)
    rims = [points for name, points in mesh.faces.items() if name.startswith("edge-")]
    assert len(rims) == 7  # three of each leg and the hole's, not the fold
    round_hole = [r for r in rims if np.ptp(np.hypot(*(mesh.points[r][:, :2] - [0.05, 0.02]).T)) < 1e-6]
    assert len(round_hole) == 1


@pytest.mark.parametrize(
    ("name", "area"),
    [
        # Middles meet: the web of the tee ends in the middle of the flange.
        ("tee", 0.1 * (0.04 + 0.029) - np.pi * 0.004**2),
        ("pipe", 0.09 * 2 * np.pi * 0.019),
    ],
)
def test_a_solid_with_thin_walls_is_meshed_by_its_midsurface(folder: Path, name: str, area: float) -> None:
    mesh = mesh_cad_sheet(folder / f"{name}.step", 5e-3, 2e-3)
    assert middle_area(mesh) == pytest.approx(area, rel=4e-3)  # round walls by flat elements
    (note,) = (note for note in mesh.notes if "differs from the solid's by" in note)
    assert note.endswith(UNLIKE_SOLID) is (name == "tee")
    assert "no shell" not in note  # at rims, at the hole, in the corner of the tee


def test_volume_that_a_midsurface_has_too_much_is_a_warning(folder: Path) -> None:
    """The web has 1 mm of its height in the flange, 1.5 % of the whole."""
    scene = f'title = "tee"\n[body.p]\nmesh = {{ cad = "tee.step", size = "20 mm", shell = "2 mm" }}{METAL}'
    (folder / "tee.toml").write_text(scene)
    warnings = mode_warnings(Pipeline(load_scene(folder / "tee.toml"), Cache(None)))
    (text,) = (each["text"] for each in warnings if each["code"] == "midsurface-volume")
    assert "p: the volume of the midsurface with its thickness differs from the solid's by +1." in text


def test_faces_of_the_solid_that_no_shell_is_near_are_named(folder: Path) -> None:
    """A boss of 5 × 6 × 8 mm³ on the plate of 8000 mm³ is in no wall; its faces are those beyond the plate's."""
    faces = describe_cad_file(folder / "boss.step").faces
    beyond = [face.name for face in faces if face.centre[2] > 2.1e-3]
    assert len(beyond) == 5
    note = mesh_cad_sheet(folder / "boss.step", 5e-3, 2e-3).notes[-1]
    assert f"by -2.9 % (no shell is half a thickness from its faces {', '.join(beyond)})" in note
    assert note.endswith(UNLIKE_SOLID)


def middle_area(mesh: SolidMesh) -> float:
    lower, upper = np.split(mesh.points[mesh.cells], 2, axis=1)
    x = (lower + upper) / 2
    across = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    return float(np.linalg.norm(across, axis=1).sum() / 2)


def test_the_midsurface_of_a_bent_strip_has_the_solids_frequencies(folder: Path) -> None:
    steel = Material(210e9, 0.3, 7850.0)
    sheet = mesh_cad_sheet(folder / "bend.step", 4e-3, 2e-3)
    assert middle_area(sheet) == pytest.approx(0.03 * (0.05 + 0.035 + np.pi / 2 * 0.004), rel=1e-3)
    shell, solid = assemble(sheet, 1, steel), assemble(mesh_cad_file(folder / "bend.step", 8e-3, 2), 2, steel)
    one, other = (FreeBodySolver(fe).modes(5).omega for fe in (shell, solid))
    assert one == pytest.approx(other, rel=0.01)


def test_a_plate_of_cad_has_the_frequencies_of_the_ready_shape(folder: Path) -> None:
    (folder / "own.toml").write_text(
        'title = "own"\n[body.p]\nshape = "plate"\nlength = "100 mm"\nwidth = "40 mm"\nthickness = "2 mm"\n'
        f"mesh = {{ divisions = [20, 8] }}{METAL}"
    )
    cad, own = (Pipeline(load_scene(folder / f"{name}.toml"), Cache(None)).parts["p"] for name in ("cad", "own"))
    assert cad.modes.frequencies_hz == pytest.approx(own.modes.frequencies_hz, rel=5e-3)
    assert cad.mass == pytest.approx(own.mass, rel=1e-9)


def test_solids_second_order_and_sectors_are_refused_as_shells(folder: Path) -> None:
    with pytest.raises(InputError, match="no two of its faces are 2 mm apart; parallel faces are 10 mm apart"):
        mesh_cad_sheet(folder / "block.step", 5e-3, 2e-3)
    with pytest.raises(InputError, match=r"times thickness is 8000 mm³, the solid has 1\.92e\+04 mm³: walls of"):
        mesh_cad_sheet(folder / "lump.step", 5e-3, 2e-3)
    with pytest.raises(InputError, match=r"gives about \S+ elements; 3e\+06 are the most"):
        mesh_cad_sheet(folder / "plate.step", 1e-6, 2e-3)
    with pytest.raises(InputError, match=r"mesh\.thickness: is of surfaces; a solid has a midsurface by walls of one"):
        mesh_cad_sheet(folder / "boss.step", 10e-3, 2e-3, by_part={"face-1": 3e-3})
    for more, message in (
        ("order = 2", "is of solids: shells have four nodes"),
        ("cyclic = 3, cuts = ['a', 'b']", "not of shells"),
    ):
        with pytest.raises(InputError, match=message):
            load_scene(folder / "cad.toml", [f'body.p.mesh={{cad="plate.step",size="5 mm",shell="2 mm",{more}}}'])
    cad = 'body.p.mesh={cad="plate.step",size="5 mm",shell="layers"}'
    with pytest.raises(InputError, match="takes the thickness of the body's layers, and there are none"):
        load_scene(folder / "cad.toml", [cad])
    plies = {"lamina": {"a": {"E1": 9e9, "E2": 9e9, "nu12": 0.3, "G12": 3e9, "rho": 1500.0}}}
    body = {"layers": [{"material": "a", "thickness": "1 mm"}], "modes": {"count": 3}} | plies
    mesh = {"cad": str(folder / "plate.step"), "size": "5 mm", "shell": "layers", "thickness": {"face-1": "3 mm"}}
    with pytest.raises(InputError, match="is of parts that are shells; layers have their own"):
        load_scene({"title": "Plies", "body": {"p": body | {"mesh": mesh}}})
    mesh = {"cad": str(folder / "plate.step"), "size": "5 mm", "shell": "2 mm"}
    with pytest.raises(InputError, match="must be 'layers', which have the thickness of a body with layers"):
        load_scene({"title": "Plies", "body": {"p": body | {"mesh": mesh}}})

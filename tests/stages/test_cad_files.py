"""Names of CAD faces by their places, and descriptions of parts, for shapes whose faces are known."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import InputError
from fmd.dynamics.compiler.closures import closed_distances
from fmd.meshes.gmsh_session import gmsh_model
from fmd.stages.meshing.cad_files import _own_names, choose_element_size, describe_cad_file, mesh_cad_file

MM = 1e-3


def write_bracket(occ: Any) -> None:
    """A plate of 80 × 40 × 8 mm and a wall of 8 × 40 × 50 mm on it, a bore through each, and a pin on the plate."""
    plate, wall = occ.addBox(0, 0, 0, 80, 40, 8), occ.addBox(0, 0, 0, 8, 40, 50)
    solid, _ = occ.fuse([(3, plate)], [(3, wall)])
    bores = [(3, occ.addCylinder(60, 20, -1, 0, 0, 10, 6)), (3, occ.addCylinder(-1, 20, 35, 10, 0, 0, 5))]
    solid, _ = occ.cut(solid, bores)
    occ.fuse(solid, [(3, occ.addCylinder(40, 20, 8, 0, 0, 20, 5))])


def write_ring(occ: Any) -> None:
    """A tube: its outer face is a pin by what is within it, its inner one a hole; no face is at x = 0."""
    occ.cut([(3, occ.addCylinder(0, 0, 0, 0, 0, 30, 20))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 30, 12))])


def write_rounded_feet(occ: Any) -> None:
    """A table on two feet, with one edge rounded: a quarter of a cylinder is no pin."""
    top = [(3, occ.addBox(0, 0, 10, 60, 20, 10))]
    solid, _ = occ.fuse(top, [(3, occ.addBox(0, 0, 0, 10, 20, 10)), (3, occ.addBox(50, 0, 0, 10, 20, 10))])
    occ.synchronize()
    edges = [tag for _, tag in occ.getEntities(1)]
    places = {tag: occ.getCenterOfMass(1, tag) for tag in edges}
    upper = min(edges, key=lambda tag: math.dist(places[tag], (60, 10, 20)))
    occ.fillet([solid[0][1]], [upper], [4.0])


@pytest.fixture
def step(tmp_path: Path) -> Callable[..., Path]:
    def write(shape: Callable[[Any], None], suffix: str = "step") -> Path:
        path = tmp_path / f"part.{suffix}"
        with gmsh_model("part") as gmsh:
            gmsh.option.setString("Geometry.OCCTargetUnit", "MM")  # else that of the model before may be written
            shape(gmsh.model.occ)
            gmsh.model.occ.synchronize()
            gmsh.write(str(path))
        return path

    return write


@pytest.mark.parametrize("suffix", ["step", "brep"])
def test_ends_bores_and_pins_have_names(step: Callable[..., Path], suffix: str):
    part = describe_cad_file(step(write_bracket, suffix))
    scale = MM if suffix == "step" else 1.0  # BREP has no unit: its numbers are metres
    faces = {face.name: face for face in part.faces}
    named = {name for name in faces if not name.startswith("face-")}
    assert named == {"xmin", "xmax", "ymin", "ymax", "zmin", "zmax", "hole-1", "hole-2", "pin-1"}
    assert faces["hole-1"].centre == pytest.approx([4 * scale, 20 * scale, 35 * scale])  # the first along x
    assert faces["hole-2"].area == pytest.approx(2 * math.pi * 6 * 8 * scale**2)
    assert (faces["pin-1"].kind, faces["xmin"].kind) == ("cylinder", "plane")
    assert faces["pin-1"].centre == pytest.approx([40 * scale, 20 * scale, 18 * scale])
    solid = 80 * 40 * 8 + 8 * 40 * 42 - math.pi * (36 * 8 + 25 * 8 - 25 * 20)
    assert part.volume == pytest.approx(solid * scale**3, rel=1e-6)
    assert part.high == pytest.approx([80 * scale, 40 * scale, 50 * scale], rel=1e-5)
    assert part.solids == 1
    if suffix == "step":
        assert choose_element_size(part) == pytest.approx((part.volume * 6 * 2**0.5 / 4000) ** (1 / 3), rel=0.02)


def test_a_tube_is_a_hole_in_a_pin(step: Callable[..., Path]):
    faces = {face.name: face for face in describe_cad_file(step(write_ring)).faces}
    assert set(faces) == {"zmin", "zmax", "hole-1", "pin-1"}
    assert faces["hole-1"].area == pytest.approx(2 * math.pi * 12 * 30 * MM**2)
    assert faces["pin-1"].area == pytest.approx(2 * math.pi * 20 * 30 * MM**2)


def test_loose_faces_of_iges_are_sewn_and_named(step: Callable[..., Path]):
    part = describe_cad_file(step(write_ring, "igs"))
    faces = {face.name: face for face in part.faces}
    assert set(faces) == {"zmin", "zmax", "hole-1", "pin-1"}
    assert part.volume == pytest.approx(math.pi * (20**2 - 12**2) * 30 * MM**3, rel=1e-6)
    mesh = mesh_cad_file(step(write_ring, "igs"), 8 * MM, 2)
    assert mesh.volume == pytest.approx(part.volume, rel=1e-3)


def test_feet_in_one_plane_are_one_face_and_a_fillet_is_none(step: Callable[..., Path]):
    part = describe_cad_file(step(write_rounded_feet))
    faces = {face.name: face for face in part.faces}
    assert faces["zmin"].area == pytest.approx(2 * 10 * 20 * MM**2)
    assert [face.kind for face in part.faces].count("cylinder") == 1
    assert not any(name.startswith(("hole", "pin")) for name in faces)


def test_faces_of_the_mesh_have_the_same_names(step: Callable[..., Path]):
    mesh = mesh_cad_file(step(write_ring), 8 * MM, 1)
    radius = (mesh.points[mesh.faces["hole-1"]][..., :2] ** 2).sum(axis=-1) ** 0.5
    assert radius == pytest.approx(12 * MM)
    assert mesh.points[mesh.faces["zmax"]][..., 2] == pytest.approx(30 * MM)


def write_rod(occ: Any) -> None:
    """A rod of 150 mm between eyes whose bores of 10 and 8 mm go along z, and their middle planes at z = 6 mm."""
    eyes = [(3, occ.addCylinder(0, 0, 0, 0, 0, 12, 12)), (3, occ.addCylinder(150, 0, 1, 0, 0, 10, 10))]
    solid, _ = occ.fuse([(3, occ.addBox(0, -6, 2, 150, 12, 8))], eyes)
    occ.cut(solid, [(3, occ.addCylinder(0, 0, -1, 0, 0, 14, 5)), (3, occ.addCylinder(150, 0, -1, 0, 0, 14, 4))])


def test_centres_of_faces_are_those_of_the_geometry(step: Callable[..., Path]):
    """Bores' axes and middle planes to the last digits, on any mesh; a flat face's centroid by areas of its shape."""
    for size in (4, 5, 8):
        mesh = mesh_cad_file(step(write_rod), size * MM, 1)
        centres = {tuple(np.round(place[1:] / MM, 9)) for name, place in mesh.centres.items() if "hole" in name}
        assert centres == {(0.0, 0.0, 6.0), (150.0, 0.0, 6.0)}
    mesh = mesh_cad_file(step(write_bracket), 20 * MM, 1)
    area, *place = mesh.centres["xmin"]
    bore = math.pi * 5**2
    assert area == pytest.approx((40 * 50 - bore) * MM**2, rel=1e-9)
    z = (40 * 50 * 25 - bore * 35) / (40 * 50 - bore)
    assert place == pytest.approx([0.0, 20 * MM, z * MM], rel=1e-9, abs=1e-15)


SLIDER_CRANK = """
title = "slider-crank"
[body.crank]
shape = "rod"
mass = "0.3 kg"
length = "50 mm"
marker = { shaft = { at = ["0 mm", "0 mm", "0 mm"] }, pin = { at = ["50 mm", "0 mm", "0 mm"] } }
[body.rod]
shape = "cad"
E = "200 GPa"
nu = 0.3
rho = "7870 kg/m^3"
mesh = { cad = "part.step", size = "5 mm", order = 1 }
modes = { count = 2, boundary = "joint" }
marker = { big = { face = "BIG" }, small = { face = "SMALL" } }
[body.slider]
shape = "point"
mass = "0.1 kg"
marker = { pin = { at = ["0 mm", "0 mm", "0 mm"] } }
[joint.shaft]
type = "revolute"
parent = "ground"
child = "crank.shaft"
axis = [0, 0, 1]
[joint.big_end]
type = "revolute"
parent = "crank.pin"
child = "rod.big"
axis = [0, 0, 1]
[joint.guide]
type = "prismatic"
parent = "ground"
child = "slider.pin"
axis = [1, 0, 0]
position = "200 mm"
[joint.small_end]
type = "revolute"
parent = "rod.small"
child = "slider.pin"
axis = [0, 0, 1]
[simulation]
duration = "1 ms"
output_step = "1 ms"
tip = "rod.small"
run = [{ integrator = "auto" }]
"""


def test_a_slider_crank_closes_with_a_rod_of_any_mesh(step: Callable[..., Path], tmp_path: Path):
    """The pins' places are those of the bores; the facets' averages lie nanometres apart, which no motion closes."""
    bores = sorted(name for name in mesh_cad_file(step(write_rod), 8 * MM, 1).centres if name.startswith("hole"))
    (tmp_path / "scene.toml").write_text(SLIDER_CRANK.replace("BIG", bores[0]).replace("SMALL", bores[1]))
    for size in (4, 5, 8):
        run = Pipeline(load_scene(tmp_path / "scene.toml", [f"body.rod.mesh.size={size} mm"]), Cache(None))
        marker, x = run.parts["rod"].markers["small"], run.parts["rod"].space.x
        assert marker.position == pytest.approx([0.15, 0.0, 0.006], abs=1e-13)
        turn = np.array([0.2, -0.5, 0.3])  # a rigid rotation moves the marker as it moves the place
        moved, rotation = marker.translation(np.cross(turn, x)), marker.rotation(np.cross(turn, x))
        assert moved == pytest.approx(np.cross(turn, [0.15, 0.0, 0.006]), rel=1e-9)
        assert rotation == pytest.approx(turn, rel=1e-9)
    assert closed_distances(run.mechanism.rigid) == {}


def test_names_in_the_file_go_before_places(step: Callable[..., Path]):
    path = step(write_ring)
    text = path.read_text()
    flat = text.index("ADVANCED_FACE(''", text.index("ADVANCED_FACE(''") + 1)
    path.write_text(text[:flat] + text[flat:].replace("ADVANCED_FACE(''", "ADVANCED_FACE('flange'", 1))
    names = {face.name for face in describe_cad_file(path).faces}
    assert "flange" in names
    assert len(names) == 4
    assert len(names & {"zmin", "zmax", "hole-1", "pin-1"}) == 3


def test_a_file_without_a_solid_has_no_description(step: Callable[..., Path]):
    with pytest.raises(InputError, match="no solid"):
        describe_cad_file(step(lambda occ: occ.addRectangle(0, 0, 0, 1, 1)))


@pytest.mark.parametrize(
    ("given", "names"),
    [
        (["bolt-3", "bolt", "bolt"], ["bolt-3", "bolt", "bolt-4"]),
        (["Bolt", "bolt"], ["Bolt", "bolt-2"]),  # one file where case isn't distinguished
        (["part-2", "", "ground"], ["part-2", "part-2-2", "part-3"]),
        (["a b", "a_b", "a/b"], ["a-b", "a_b", "a-b-3"]),
    ],
)
def test_no_two_parts_of_an_assembly_have_one_name(given: list[str], names: list[str]) -> None:
    assert _own_names(given) == names

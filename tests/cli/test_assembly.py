"""Mechanisms from assemblies in CAD: parts with mass and inertia in closed form, joints by bores and pins."""

from collections.abc import Callable
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline
from fmd.cli.cad_assembly import read_assembly, suggest_joint
from fmd.cli.robot import Robot
from fmd.meshes.cad_places import WholeCylinder
from fmd.scene.scene import load_scene
from fmd.stages.meshing.cad_files import AssemblyPart, describe_cad_file

RHO = 7850.0


Faces = tuple[str, list[float], list[float], float, float]


def part(name: str, *faces: Faces, volume: float = 1.0) -> AssemblyPart:
    found = tuple(WholeCylinder(what, np.array(at), np.array(axis), r, length) for what, at, axis, r, length in faces)
    return AssemblyPart(name, volume, np.zeros(3), np.eye(3), found)


Z = [0.0, 0.0, 1.0]
PLATE = part("plate", ("hole", [0.0, 0.0, 0.0], Z, 0.01, 0.02))


@pytest.mark.parametrize(
    ("face", "place"),
    [
        (("pin", [0.0, 0.0, 0.01], [0.0, 0.0, -1.0], 0.0098, 0.02), 0.005),  # half of it is in the bore
        (("pin", [0.0, 0.0, 0.01], Z, 0.008, 0.02), None),  # too thin
        (("pin", [0.001, 0.0, 0.0], Z, 0.0098, 0.02), None),  # beside the axis
        (("pin", [0.0, 0.0, 0.0], [0.1, 0.0, 0.995], 0.0098, 0.02), None),  # aslant
        (("pin", [0.0, 0.0, 0.05], Z, 0.0098, 0.02), None),  # above it
        (("hole", [0.0, 0.0, 0.02], Z, 0.01, 0.02), 0.01),  # bores that touch
        (("hole", [0.0, 0.0, 0.03], Z, 0.01, 0.02), None),  # bores apart
    ],
)
def test_a_hinge_is_suggested_by_what_shares_an_axis(face, place: float | None) -> None:
    found = suggest_joint(PLATE, part("other", face))
    if place is None:
        assert found is None
    else:
        assert found is not None
        assert (found.kind, found.parts) == ("revolute", ("plate", "other"))
        np.testing.assert_allclose(found.place, [0.0, 0.0, place], atol=1e-12)
        np.testing.assert_allclose(found.axis, Z)


def test_two_pins_on_an_own_axis_each_fix_a_part_and_two_pins_in_line_do_not() -> None:
    faces = [("hole", [x, 0.0, z], Z, 0.01, 0.02) for x, z in ((0.0, 0.0), (0.1, 0.0), (0.0, 0.1))]
    pins = [("pin", at, axis, 0.0099, length) for _, at, axis, _, length in faces]
    assert suggest_joint(part("a", *faces[:2]), part("b", *pins[:2])).kind == "fixed"
    assert suggest_joint(part("a", *faces[::2]), part("b", *pins[::2])).kind == "revolute"


def bore(x: float) -> Faces:
    return ("hole", [x, 0.0, 0.0], Z, 0.01, 0.02)


def pin(x: float) -> Faces:
    return ("pin", [x, 0.0, 0.0], Z, 0.0099, 0.02)


@pytest.fixture
def robot_of(monkeypatch) -> Callable[..., Robot]:
    def read(*parts: AssemblyPart) -> Robot:
        monkeypatch.setattr("fmd.cli.cad_assembly.describe_assembly_file", lambda file, folder: [*parts])
        return read_assembly(Path("machine.brep"), Path("parts"))

    return read


def test_of_parts_joined_to_one_another_alone_the_largest_is_fixed_and_the_others_hang_on_it(robot_of) -> None:
    base, crank = part("base", volume=8.0), part("crank", bore(0.0), volume=2.0)
    rod, slider = part("rod", pin(0.0), bore(1.0)), part("slider", pin(1.0), volume=3.0)
    plate, lid = part("plate", bore(5.0), volume=0.5), part("lid", pin(5.0), volume=0.4)
    for parts in permutations((base, crank, rod, slider)):
        robot = robot_of(*parts, plate, lid)
        hung = {joint.child: (joint.kind, joint.parent) for joint in robot.joints.values()}
        assert hung == {
            "slider": ("fixed", "base"),
            "rod": ("revolute", "slider"),
            "crank": ("revolute", "rod"),
            "plate": ("fixed", "base"),
            "lid": ("revolute", "plate"),
        }
        alone = [note.split()[0] for note in robot.notes if "shares no axis" in note]
        assert alone == ["slider", "plate"]
        assert not any("not in the scene" in note for note in robot.notes)


def test_a_suggestion_that_closes_a_loop_is_noted_and_one_of_parts_that_move_as_one_is_not(robot_of) -> None:
    names = ("crank", "coupler", "rocker")
    links = [part(name, pin(x), bore(x + 1.0)) for x, name in enumerate(names)]
    robot = robot_of(part("base", bore(0.0), pin(3.0), volume=8.0), *links)
    (left,) = [note for note in robot.notes if "not in the scene" in note]
    assert {joint.kind for joint in robot.joints.values()} == {"revolute"}
    taken = {frozenset((joint.parent, joint.child)) for joint in robot.joints.values()}
    ring = [frozenset(pair) for pair in pairwise(("base", "crank", "coupler", "rocker", "base"))]
    (open_pair,) = set(ring) - taken
    assert all(name in left for name in open_pair)
    fixed = part("left", bore(0.0), bore(1.0), bore(4.0)), part("right", bore(2.0), bore(3.0), pin(4.0))
    robot = robot_of(part("base", *map(pin, (0.0, 1.0, 2.0, 3.0)), volume=8.0), *fixed)
    assert [joint.kind for joint in robot.joints.values()] == ["fixed", "fixed"]
    assert "suggested, to be confirmed: right on" in robot.notes[-1]
    assert not any("not in the scene" in note for note in robot.notes)


@pytest.fixture(scope="module")
def assembly(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wall with a bore along y, a bar whose pin is in it, and a block that touches nothing."""
    from fmd.meshes.gmsh_session import gmsh_model

    path = tmp_path_factory.mktemp("assembly") / "machine.step"
    with gmsh_model("machine") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        occ = gmsh.model.occ
        occ.cut([(3, occ.addBox(-50, 0, -50, 100, 20, 100))], [(3, occ.addCylinder(0, 0, 0, 0, 20, 0, 6))])
        occ.fuse([(3, occ.addBox(-10, -10, -150, 20, 10, 160))], [(3, occ.addCylinder(0, 0, 0, 0, 20, 0, 5.9))])
        occ.addBox(200, 0, 0, 10, 20, 30)
        occ.synchronize()
        gmsh.write(str(path))
    return path


def test_an_assembly_is_a_scene_of_its_parts_on_the_suggested_joints(assembly: Path, fmd, capsys) -> None:
    scene_file = assembly.with_name("mine.toml")
    assert fmd("new", scene_file, "--from", assembly, "--assembly") == 0
    said = capsys.readouterr().out
    assert "suggested, to be confirmed: part-2 on part-1 by a pin in a bore at (0, 10, 0) mm" in said
    assert "part-3 shares no axis with part-1 or what hangs on it: fixed to the ground, give it a joint" in said
    scene = load_scene(scene_file, ["joint.part-1-part-2.angle=0 rad", "output=[]"])
    hinge = scene.joint["part-1-part-2"]
    assert hinge.type == "revolute"
    np.testing.assert_allclose(np.abs(hinge.axis), [0, 1, 0], atol=1e-9)
    bar, pin = RHO * 20e-3 * 10e-3 * 160e-3, RHO * np.pi * 5.9e-3**2 * 20e-3
    assert scene.body["part-2"].mass == pytest.approx(bar + pin, rel=1e-6)
    about_axis = bar * ((0.02**2 + 0.16**2) / 12 + 0.07**2) + pin * 5.9e-3**2 / 2
    run = Pipeline(scene)
    assert run.system.mass_matrix(run.start[0]) == pytest.approx(np.array([[about_axis]]), rel=1e-6)
    boxes = {name: describe_cad_file(assembly.parent / "mine-parts" / f"{name}.step") for name in scene.body}
    assert boxes["part-3"].volume == pytest.approx(10e-3 * 20e-3 * 30e-3, rel=1e-9)
    np.testing.assert_allclose(
        [boxes["part-2"].low, boxes["part-2"].high], [[-0.01, -0.01, -0.15], [0.01, 0.02, 0.01]], atol=1e-6
    )


@pytest.mark.parametrize(
    ("given", "said"),
    [(["--from", "arm.urdf"], "takes the solids of a CAD file"), ([], "takes the solids of a CAD file")],
)
def test_an_assembly_is_a_cad_file(given: list[str], said: str, fmd, capsys, tmp_path: Path) -> None:
    assert fmd("new", tmp_path / "mine.toml", *given, "--assembly") == 2
    assert said in capsys.readouterr().err


def test_one_solid_is_no_assembly(assembly: Path, fmd, capsys, tmp_path: Path) -> None:
    parts = assembly.parent / "mine-parts"
    if not parts.exists():
        assert fmd("new", assembly.with_name("mine.toml"), "--from", assembly, "--assembly") == 0
    assert fmd("new", tmp_path / "one.toml", "--from", parts / "part-3.step", "--assembly") == 2
    assert "has one solid: leave --assembly out" in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]


def test_a_file_of_a_part_that_exists_is_left_alone(assembly: Path, fmd, capsys, tmp_path: Path) -> None:
    own = tmp_path / "mine-parts" / "part-2.step"
    own.parent.mkdir()
    own.write_text("mine")
    assert fmd("new", tmp_path / "mine.toml", "--from", assembly, "--assembly") == 2
    assert f"{own}: exists already and is left as it is" in capsys.readouterr().err
    assert (own.read_text(), [*tmp_path.rglob("*.*")]) == ("mine", [own])


def test_parts_that_share_a_face_are_whole_in_files_of_their_own_after_one_import(tmp_path: Path, monkeypatch) -> None:
    from fmd.meshes import cad_assembly
    from fmd.meshes.gmsh_session import gmsh_model

    with gmsh_model("row") as gmsh:
        boxes = [(3, gmsh.model.occ.addBox(k, 0, 0, 1, 1, 1 + k)) for k in range(3)]
        gmsh.model.occ.fragment(boxes[:1], boxes[1:])
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "row.brep"))
    imports, given = [], cad_assembly.import_entities
    monkeypatch.setattr(cad_assembly, "import_entities", lambda *each: imports.append(each) or given(*each))
    found = cad_assembly.describe_assembly(tmp_path / "row.brep", tmp_path)
    assert len(imports) == 1
    for number, described in enumerate(found):
        alone = describe_cad_file(tmp_path / f"{number}.step")
        assert alone.solids == 1
        assert alone.volume == pytest.approx(described["volume"], rel=1e-9)
        assert alone.low[0] == pytest.approx(described["centre"][0] - 0.5, abs=1e-6)

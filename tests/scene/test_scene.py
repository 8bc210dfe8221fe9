"""The scene file: what it may hold, and one clear message for whatever it may not."""

import json
import math
import pickle
import re
import subprocess
import sys
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from pipeline.core.errors import InputError
from pipeline.scene.reading import list_ready_scenes
from pipeline.scene.scene import Scene, load_scene

BEAM = (files("models") / "beam.toml").read_text()
SLIDER = (files("models") / "rod-slider.toml").read_text()
PLATE = """
[body.plate]
shape = "rigid"
mass = "3 kg"
inertia = ["0.1 kg m^2", "2000 kg cm^2", "0.3 kg m^2"]
marker = { a = { at = ["-5 cm", "0 m", "0 m"] } }

[joint.last]
type = "{}"
parent = "{}"
child = "plate.a"
"""
ARM = """
[body.arm]
shape = "bar"
length = "1 m"
depth = "2 cm"
width = "2 cm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = { element = "tetrahedron", size = "5 mm" }
modes = { count = 3 }
marker = { a = { face = "x-" }, b = { face = "x+" } }
"""
ELBOW = '[joint.elbow]\ntype = "revolute"\nparent = "{}"\nchild = "arm.a"\naxis = [0, 1, 0]\n'


def scene_of(folder: Path, text: str, *overrides: str) -> Scene:
    file = folder / "mine.toml"
    file.write_text(text)
    return load_scene(file, overrides)


def refused(message: str) -> Any:
    return pytest.raises(InputError, match=re.escape(message))


def test_the_beam_comes_in_si_units() -> None:
    scene = load_scene("beam")
    beam = scene.body["beam"]
    # models/beam.toml, converted by hand
    assert (beam.length, beam.depth, beam.width, beam.E, beam.rho) == (0.34, 0.025, 0.01, 722e6, 2000.0)
    assert (scene.simulation.duration, scene.simulation.step) == (0.5, 1e-5)
    assert scene.drive["spin_up"].speed == 20.0
    assert scene.reference is not None
    assert scene.reference.frequencies[0] == 131.2


def test_a_scene_knows_its_name_and_its_file(tmp_path: Path) -> None:
    assert load_scene("beam").name == "beam"
    mine = scene_of(tmp_path, BEAM)
    assert (mine.name, mine.file) == ("mine", str(tmp_path / "mine.toml"))


def test_all_ready_scenes_load() -> None:
    assert "beam" in list_ready_scenes()
    for name in list_ready_scenes():
        assert load_scene(name).name == name


def test_what_the_file_leaves_out_has_a_default(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, BEAM)
    assert (scene.joint["hub"].angle, scene.joint["hub"].rate) == (0.0, 0.0)
    assert scene.simulation.frame == "joint-conforming"
    assert [run.step for run in scene.simulation.run] == [None, None, None]


def test_the_content_of_a_scene_depends_on_its_values_alone(tmp_path: Path) -> None:
    content = load_scene("beam").model_dump(mode="json")
    assert json.loads(json.dumps(content)) == content
    assert scene_of(tmp_path, BEAM.replace("340 mm", "0.34 m")).model_dump(mode="json") == content
    assert load_scene("beam", ["body.beam.length=341mm"]).model_dump(mode="json") != content


def test_a_scene_survives_the_way_to_another_process() -> None:
    scene = load_scene("beam")
    assert pickle.loads(pickle.dumps(scene)).file == scene.file


def test_a_scene_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        load_scene("beam").title = "other"


def test_two_bodies_may_hang_on_one_another(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, BEAM + ARM + ELBOW.format("beam.tip"))
    assert scene.body["arm"].mesh.size == 5e-3


def test_the_rod_and_its_slider_come_in_si_units() -> None:
    scene = load_scene("rod-slider")
    rod, slider = scene.body["rod"], scene.body["slider"]
    # models/rod-slider.toml; all of it is in SI units there
    assert (rod.shape, rod.mass, rod.length) == ("rod", 2.0, 2.0)
    assert (slider.shape, slider.mass) == ("point", 5.0)
    assert rod.marker["rest"].at == (1.0, 0.0, 0.0)
    slide = scene.joint["slide"]
    assert (slide.parent, slide.position, slide.spring, slide.rest) == ("rod.rest", 0.15, 1000.0, 0.0)
    assert scene.drive["motor"].torque.constant == math.radians(100)  # 100 N m per degree
    assert scene.simulation.fast == ("slide",)
    assert [(output.joint, output.unit) for output in scene.output] == [("hinge", "deg"), ("slide", "m")]


def test_springs_dampers_and_starts_are_zero_if_left_out() -> None:
    hinge = load_scene("rod-slider").joint["hinge"]
    assert (hinge.angle, hinge.rate, hinge.spring, hinge.rest, hinge.damper) == (0.0,) * 5
    slide = '{type="prismatic", parent="rod.rest", child="slider.centre", axis=[1, 0, 0]}'
    slide = load_scene("rod-slider", [f"joint.slide={slide}"]).joint["slide"]
    assert (slide.position, slide.rate, slide.spring, slide.rest, slide.damper) == (0.0,) * 5
    assert load_scene("beam").simulation.fast == ()


def test_springs_and_dampers_come_in_si_units() -> None:
    set_there = ["joint.hinge.spring=2 kN m/rad", "joint.hinge.rest=180 deg", "joint.hinge.damper=3 N m s"]
    set_there += ["joint.slide.damper=4 N s/mm", "joint.slide.rate=5 mm/s", "joint.slide.spring=6 N/mm"]
    joint = load_scene("rod-slider", set_there).joint
    assert (joint["hinge"].spring, joint["hinge"].rest, joint["hinge"].damper) == (2000.0, math.pi, 3.0)
    assert (joint["slide"].damper, joint["slide"].rate, joint["slide"].spring) == (4000.0, 5e-3, 6000.0)


@pytest.mark.parametrize("parent", ["ground", "rod.rest", "slider.centre"])
@pytest.mark.parametrize("kind", ["fixed", "spherical", "free"])
def test_a_rigid_body_hangs_on_any_joint_and_any_body(tmp_path: Path, kind: str, parent: str) -> None:
    scene = scene_of(tmp_path, SLIDER + PLATE.replace('"{}"', f'"{kind}"', 1).replace("{}", parent))
    plate = scene.body["plate"]
    assert (scene.joint["last"].type, plate.centre, plate.inertia) == (kind, (0.0, 0.0, 0.0), (0.1, 0.2, 0.3))
    assert plate.marker["a"].at == (-0.05, 0.0, 0.0)


def test_a_rigid_body_hangs_on_a_flexible_one(tmp_path: Path) -> None:
    text = BEAM + PLATE.replace('"{}"', '"fixed"', 1).replace("{}", "beam.tip")
    assert scene_of(tmp_path, text).joint["last"].parent == "beam.tip"


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        (["1 kg m^2", "1 kg m^2", "2.1 kg m^2"], "isn't any body's: no moment is greater than the sum of the other"),
        (["3 kg m^2", "1 kg m^2", "1 kg m^2"], "isn't any body's: no moment is greater than the sum of the other"),
        (["1 kg m^2", "-1 kg m^2", "1 kg m^2"], "body.plate.inertia.1 = '-1 kg m^2': must not be negative"),
        (["1 kg", "1 kg m^2", "1 kg m^2"], "'1 kg' is a mass, a moment of inertia is wanted, e.g. '0.5 kg m^2'"),
        (["1 kg m^2"], "body.plate.inertia.1: is missing"),
    ],
)
def test_an_inertia_is_that_of_a_body(tmp_path: Path, inertia: list[str], message: str) -> None:
    text = SLIDER + PLATE.replace('"{}"', '"fixed"', 1).replace("{}", "rod.rest")
    with refused(message):
        scene_of(tmp_path, text, f"body.plate.inertia={json.dumps(inertia)}")


@pytest.mark.parametrize("inertia", [[0, 0, 0], [0, 2, 2]])
def test_points_and_slender_rods_have_an_inertia(tmp_path: Path, inertia: list[int]) -> None:
    text = SLIDER + PLATE.replace('"{}"', '"fixed"', 1).replace("{}", "rod.rest")
    moments = json.dumps([f"{moment} kg m^2" for moment in inertia])
    assert scene_of(tmp_path, text, f"body.plate.inertia={moments}").body["plate"].inertia == tuple(inertia)


def test_a_joint_is_driven_only_as_it_moves() -> None:
    force = 'drive.motor={type="force", joint="slide", force="2 kN"}'
    assert load_scene("rod-slider", [force]).drive["motor"].force.constant == 2000.0
    pulse = 'drive.motor={type="torque pulse", joint="hinge", duration="1 s", torque="1 N m"}'
    assert load_scene("rod-slider", [pulse]).drive["motor"].torque == 1.0
    for drive, message in {
        force.replace("slide", "hinge"): "is a revolute joint; a force needs a prismatic one",
        pulse.replace("hinge", "slide"): "is a prismatic joint; a torque pulse needs a revolute one",
        "drive.motor.joint=slide": "drive.motor.joint = 'slide': is a prismatic joint; a torque needs a revolute one",
    }.items():
        with refused(message):
            load_scene("rod-slider", [drive])


FIXED = 'joint.slide={type="fixed", parent="rod.rest", child="slider.centre"}'


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        # bodies
        (["body.rod.mass=0 kg"], "body.rod.mass = '0 kg': must be greater than zero"),
        (["body.rod.mass=2 m"], "'2 m' is a length, a mass is wanted, e.g. '2 kg'"),
        (["body.rod.length=0 m"], "body.rod.length = '0 m': must be greater than zero"),
        (["body.slider.mass=-1 kg"], "body.slider.mass = '-1 kg': must be greater than zero"),
        (["body.slider.length=1 m"], "body.slider.length = '1 m': no such key; the keys here: shape, mass, marker"),
        (["body.rod.marker.rest={face='x+'}"], "body.rod.marker.rest.face = 'x+': no such key; the keys here: at"),
        (["body.rod.marker.rest.at=['1 m', '0 m']"], "body.rod.marker.rest.at.2: is missing"),
        (["body.rod.marker.rest.at.0=1"], "body.rod.marker.rest.at.0 = 1: needs a unit"),
        # joints
        (["joint.hinge.spring=-1 N m"], "joint.hinge.spring = '-1 N m': must not be negative"),
        (["joint.hinge.damper=-1 N m s"], "joint.hinge.damper = '-1 N m s': must not be negative"),
        (["joint.hinge.spring=1 N/m"], "'1 N/m' is a translational stiffness, a rotational stiffness is wanted"),
        (["joint.hinge.damper=1 N s/m"], "'1 N s/m' is a translational damping, a rotational damping is wanted"),
        (["joint.slide.spring=-1 N/m"], "joint.slide.spring = '-1 N/m': must not be negative"),
        (["joint.slide.damper=-1 N s/m"], "joint.slide.damper = '-1 N s/m': must not be negative"),
        (["joint.slide.position=1 deg"], "'1 deg' is an angle, a length is wanted"),
        (["joint.slide.rate=1 rad/s"], "'1 rad/s' is an angular rate, a speed is wanted, e.g. '3 m/s'"),
        (["joint.slide.angle=1 rad"], "joint.slide.angle = '1 rad': no such key"),
        (["joint.slide.axis=[0, 0, 0]"], "joint.slide.axis = [0, 0, 0]: has no direction"),
        (["joint.slide.type=hinge"], "must be one of 'revolute', 'prismatic', 'fixed', 'spherical', 'free'"),
        ([FIXED.replace("}", ", axis=[1, 0, 0]}")], "joint.slide.axis = [1, 0, 0]: no such key"),
        (["joint.hinge.parent=slider.centre"], "body.rod: its joints lead round in a circle; one must lead to ground"),
        (
            ["joint.slide.parent=rod.mid"],
            "joint.slide.parent = 'rod.mid': no such marker; did you mean 'rod.hinge'? the",
        ),
        # fast joints
        (["simulation.fast=['slid']"], "simulation.fast.0 = 'slid': no such joint; did you mean 'slide'?"),
        (["simulation.fast=['hinge', 'rod']"], "simulation.fast.1 = 'rod': no such joint"),
        ([FIXED, "output=[]"], "is a fixed joint; the fast list needs a revolute or prismatic one"),
        (["simulation.fast=slide"], "simulation.fast = 'slide': must be a list"),
        # charts
        (["output.0.joint=hing"], "output.0.joint = 'hing': no such joint; did you mean 'hinge'?"),
        ([FIXED, "simulation.fast=[]"], "output.1.joint = 'slide': is a fixed joint; joint_position needs a revolute"),
        (["output.0.unit=mm"], "output.0.unit = 'mm': isn't a unit that rad converts to; 'rad' works"),
        (["output.1.unit=deg"], "output.1.unit = 'deg': isn't a unit that m converts to; 'm' works"),
        (["output.1.unit=9**9**9"], "output.1.unit = '9**9**9': isn't a unit that m converts to; 'm' works"),
        (['output.0={type="chart", file="a.png", quantity="joint_position"}'], "output.0.joint: is missing: the name"),
        (["output.0.quantity=energy"], "output.0.joint = 'hinge': belongs to"),
        (
            ['output.0={type="chart", file="a.png", quantity="energy", unit="mm"}'],
            "output.0.unit = 'mm': belongs to",
        ),
    ],
)
def test_a_fault_in_a_chain_names_its_key_and_what_would_work(overrides: list[str], message: str) -> None:
    with refused(message):
        load_scene("rod-slider", overrides)


def test_the_unit_of_a_chart_may_be_left_out() -> None:
    chart = '{type="chart", file="a.png", quantity="joint_position", joint="slide"}'
    assert load_scene("rod-slider", [f"output.0={chart}"]).output[0].unit is None


@pytest.mark.parametrize("kind", ["modes", "stress", "film"])
def test_only_a_flexible_body_has_pictures(tmp_path: Path, kind: str) -> None:
    number = {"modes": 3, "stress": 4, "film": 5}[kind]
    text = BEAM + PLATE.replace('"{}"', '"fixed"', 1).replace("{}", "beam.tip")
    message = f"output.{number}.body = 'plate': is rigid, without modes or stress; the flexible bodies: beam"
    with refused(message):
        scene_of(tmp_path, text, f"output.{number}.body=plate")


def test_overrides_replace_values_and_items_of_lists() -> None:
    scene = load_scene(
        "beam",
        [
            "body.beam.length=300mm",
            "simulation.run.1.substeps=7",
            "body.beam.mesh.divisions = [8, 2, 2]",
            "body.beam.mesh.divisions.0=9",
            "joint.hub.rate=2 rad/s",
            'title="a = b"',
            "output=[]",
        ],
    )
    assert scene.body["beam"].length == 0.3
    assert scene.simulation.run[1].model_dump()["substeps"] == 7
    assert scene.body["beam"].mesh.divisions == (9, 2, 2)
    assert scene.joint["hub"].rate == 2.0
    assert (scene.title, scene.output) == ("a = b", ())


def test_an_override_with_two_lines_of_toml_is_a_string() -> None:
    assert load_scene("beam", ["title=1\ntitle2=2"]).title == "1\ntitle2=2"


@pytest.mark.parametrize(
    ("override", "message"),
    [
        # keys
        (
            "body.beam.lenght=3mm",
            "body.beam.lenght = '3mm': no such key; did you mean 'length'? the keys here: ",
        ),
        (
            "bodies=3",
            "--set: bodies = 3: no such key; did you mean 'body'? the keys here: title, source, accuracy",
        ),
        ("drive.spin_up.jiont=x", "drive.spin_up.jiont = 'x': no such key; did you mean 'joint'?"),
        (
            "body.beam.mesh={elment=1, ordr=2, x=3}",
            "body.beam.mesh.elment = 1: no such key; did you mean 'element'",
        ),
        ("body.beam.mesh={elment=1, ordr=2, x=3}", "divisions, size (and 2 more)"),
        ('body.beam.marker."x y"={face="x+"}', "a name is a letter and up to 39 letters, digits, '_' or '-'"),
        # overrides that say nothing
        ("x", "--set = 'x': must look like body.beam.length=300mm"),
        ("=3", "must look like body.beam.length=300mm"),
        ("a..b=3", "must look like body.beam.length=300mm"),
        (
            "body.baem.length=3mm",
            "--set: body.baem.length: there is no 'baem'; did you mean 'beam'? the keys there",
        ),
        ("body.beam.length.x=3", "there is no 'x'; the keys there: none"),
        ("simulation.run.3.substeps=4", "there is no '3'; the keys there: 0, 1, 2"),
        ("output.-1=3", "there is no '-1'; did you mean '1'?"),
        # kinds and types
        ("body.beam={}", "--set: body.beam.shape: is missing"),
        ("body.beam.shape=baar", "body.beam.shape = 'baar': must be one of 'bar', 'propeller', 'rod'"),
        ("output.0.type=3", "output.0.type = 3: must be one of 'chart', 'mesh', 'modes', 'mode sheet'"),
        ("simulation.run.0.integrator=[]", "simulation.run.0.integrator = []: must be one of"),
        ("body.beam.mesh={}", "body.beam.mesh.divisions: is missing: hexahedra along x, y and z"),
        ("simulation={}", "--set: simulation.duration: is missing (and 3 more)"),
        ("body.beam=3", "body.beam = 3: must be a table"),
        ("body=3", "body = 3: must be a table"),
        ("simulation=3", "simulation = 3: must be a table"),
        ("body={}", "body = {}: must have at least 1 item"),
        ("output=3", "output = 3: must be a list"),
        ("simulation.run=[]", "simulation.run = []: must have at least 1 item"),
        ("title=3", "title = 3: must be a valid string"),
        ("body.beam.modes.count=5.0", "body.beam.modes.count = 5.0: must be a valid integer"),
        ("body.beam.modes.count=true", "body.beam.modes.count = True: must be a valid integer"),
        ("body.beam.modes.count=0", "must be greater than or equal to 1"),
        (
            "body.beam.modes.count=0x" + "f" * 6000,
            "body.beam.modes.count: must be less than or equal to 1000000",
        ),
        (
            "body.beam.modes.family=bending",
            "must be 'any', 'in-plane bending', 'out-of-plane bending', 'torsion' or",
        ),
        ("body.beam.marker.root.face=w", "= 'w': no such face; the faces: x-, x+, y-, y+, z-, z+"),
        # quantities and numbers
        ("simulation.step=10kg", "--set: simulation.step = '10kg': '10kg' is a mass, a time is wanted, e.g. '0.5 ms'"),
        ("simulation.run.1.split=10kg", "simulation.run.1.split = '10kg': '10kg' is a mass, a frequency is wanted"),
        ("body.beam.length=300", "--set: body.beam.length = 300: needs a unit, e.g. '340 mm'"),
        ("body.beam.length=300kg", "'300kg' is a mass, a length is wanted"),
        ("body.beam.length=0mm", "body.beam.length = '0mm': must be greater than zero"),
        ("drive.spin_up.start=-1s", "must not be negative"),
        ("body.beam.nu=0.5", "body.beam.nu = 0.5: must be below 0.5 (0.5 is incompressible); 0.499 works"),
        ("body.beam.nu=-1", "must be above -1"),
        ("body.beam.nu=nan", "must be a finite number"),
        ("joint.hub.axis=[0, 0, 0]", "joint.hub.axis = [0, 0, 0]: has no direction; [0, 0, 1] is the z axis"),
        ("joint.hub.axis=[0, 0]", "joint.hub.axis.2: is missing"),
        # one of two
        (
            "body.beam.mesh.size=3mm",
            "body.beam.mesh.size = '3mm': belongs to tetrahedra; hexahedra take divisions",
        ),
        (
            "body.beam.mesh.element=tetrahedron",
            "divisions = [30, 3, 1]: belongs to hexahedra; tetrahedra take a size",
        ),
        ('body.beam.mesh={element="tetrahedron"}', "body.beam.mesh.size: is missing: the edge length"),
        ("body.beam.mesh.order=3", "must be less than or equal to 2"),
        ("drive.spin_up.torque=3 N m", "drive.spin_up.torque = '3 N m': can't stand beside speed"),
        (
            'drive.spin_up={type="torque pulse", joint="hub", duration="1 s"}',
            "drive.spin_up.speed: is missing: give",
        ),
        # integrators that are no more
        (
            'simulation.run.0={integrator="generalized-alpha", tolerance=1e-6}',
            "simulation.run.0.tolerance = 1e-06: generalized-alpha takes a step; exponential-rosenbrock and",
        ),
        (
            'simulation.run.0.integrator="DOP853"',
            "simulation.run.0.integrator = 'DOP853': is no integrator of its own; take runge-kutta",
        ),
        # times
        ("simulation.step=1s", "simulation.step = '1s': must not be longer than the duration, 0.5 s"),
        (
            "simulation.output_step=1s",
            "simulation.output_step = '1s': must not be longer than the duration, 0.5 s",
        ),
        (
            "simulation.run.1.step=1s",
            "simulation.run.1.step = '1s': must not be longer than the duration, 0.5 s",
        ),
        # names of other things
        ("joint.hub.child=beam.toe", "did you mean 'beam.tip'? the markers: beam.root, beam.tip"),
        ("joint.hub.child=beam", "no such marker"),
        ("joint.hub.child=ground", "joint.hub.child = 'ground': no such body; the bodies: beam"),
        ("joint.hub.parent=beem.tip", "no such body; did you mean 'beam'? the bodies: beam"),
        (
            "drive.spin_up.joint=hup",
            "drive.spin_up.joint = 'hup': no such joint; did you mean 'hub'? the joints: hub",
        ),
        ("simulation.tip=beam.top", "simulation.tip = 'beam.top': no such marker; did you mean 'beam.tip'?"),
        ("output.5.body=baem", "output.5.body = 'baem': no such body; did you mean 'beam'?"),
        (
            "joint.hub.parent=beam.tip",
            "body.beam: its joints lead round in a circle; one must lead to ground",
        ),
        # files
        ("output.3.file=m.png", "must hold '{mode}' once"),
        ("output.0.file=m{mode}.png", "'{mode}' belongs to an output of type 'modes'"),
        ("output.1.file=FIG-09-com-position.png", "another output has this file; rename it"),
        ("output.4.file=mode-2.png", "another output has this file; rename it"),
        ("output.1.file=mode-2.png", "another output has this file; rename it"),
        ("output.5.frames=1", "must be greater than or equal to 2"),
        ("output.5.rate=0.0", "must be greater than zero"),
        ("output.5.size=[10, 10]", "output.5.size.0 = 10: must be greater than or equal to 64 (and 1 more)"),
    ],
)
def test_a_fault_names_its_key_and_what_would_work(override: str, message: str) -> None:
    with refused(message):
        load_scene("beam", [override])


@pytest.mark.parametrize(
    "file",
    [
        "../a.png",
        "a/b.png",
        "a\\b.png",
        "/a.png",
        "C:a.png",
        ".png",
        "a..png",
        "a.exe",
        "a.PNG",
        "~a.png",
        "a\n.png",
        "",
    ],
)
def test_a_file_has_a_plain_name(file: str) -> None:
    with refused("must be a plain file name without a folder, ending in .png or .pdf or .svg"):
        load_scene("beam", [f"output.0.file={json.dumps(file)}"])


def test_a_fault_in_the_file_names_the_file(tmp_path: Path) -> None:
    with refused(f"{tmp_path / 'mine.toml'}: body.beam.length = 340: needs a unit") as caught:
        scene_of(tmp_path, BEAM.replace('"340 mm"', "340"))
    error = caught.value
    assert (error.file, error.key, error.value) == (str(tmp_path / "mine.toml"), "body.beam.length", 340)


def test_a_fault_beside_an_override_is_laid_to_the_file(tmp_path: Path) -> None:
    with refused(f"{tmp_path / 'mine.toml'}: simulation.output_step"):
        scene_of(tmp_path, BEAM, "simulation.duration=0.1ms", "drive={}")


def test_of_several_faults_the_first_is_told_and_the_others_counted(tmp_path: Path) -> None:
    text = BEAM.replace('"340 mm"', "340").replace("nu = 0.34", "nu = 0.5").replace('"10 us"', '"10 kg"')
    with refused("nu = 0.5: must be below 0.5 (0.5 is incompressible); 0.499 works (and 2 more)"):
        scene_of(tmp_path, text)
    with refused("joint.hub.child = 'beam.rot': no such marker; did you mean 'beam.root'?"):
        load_scene("beam", ["joint.hub.child=beam.rot", "simulation.tip=beam.tap"])
    with refused("(and 1 more)"):
        load_scene("beam", ["joint.hub.child=beam.rot", "simulation.tip=beam.tap"])


def test_a_body_hangs_on_one_joint(tmp_path: Path) -> None:
    with refused("body.arm: hangs on no joint; give it one with child = 'arm.…'"):
        scene_of(tmp_path, BEAM + ARM)
    twice = ELBOW.format("ground") + ELBOW.format("beam.tip").replace("elbow", "other")
    with refused("joint.other.child = 'arm.a': is the child of another joint; a body has one"):
        scene_of(tmp_path, BEAM + ARM + twice)
    with refused("body.beam: its joints lead round in a circle; one must lead to ground (and 1 more)"):
        scene_of(tmp_path, BEAM + ARM + ELBOW.format("beam.tip"), "joint.hub.parent=arm.b")


def test_a_body_cannot_be_called_ground(tmp_path: Path) -> None:
    with refused("'ground' is taken"):
        scene_of(tmp_path, BEAM.replace("body.beam", "body.ground"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("title = \n", "isn't valid TOML: Invalid value (at line 1, column 9)"),
        ("a = 1\nb = [1,", "isn't valid TOML: Invalid value (at line 2, column 8)"),
        ("a = 1\na = 2", "isn't valid TOML: Cannot overwrite a value (at line 2, column 6)"),
        ("a = " + "9" * 5000, "isn't valid TOML"),
        ("a = " + "[" * 100_000, "isn't valid TOML"),
        ("", "title: is missing"),
        ("# " + "x" * 1_000_000, "is over 1 MB"),
        ('"\\n\\u001b" = 1', "mine.toml: '\\n\\x1b' = 1: no such key"),
    ],
)
def test_a_file_that_is_no_scene_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with refused(message):
        scene_of(tmp_path, text)


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    scene_of(tmp_path, "\ufeff" + BEAM)


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_bytes(b"\x89PNG\xff\xfe")
    with refused(f"{file}: isn't text in UTF-8"):
        load_scene(file)


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with refused("is a folder; give the scene file in it"):
        load_scene(tmp_path / ".")


def test_a_missing_file_names_the_ready_scenes(tmp_path: Path) -> None:
    with refused(f"none.toml: no such file; the ready scenes: {', '.join(list_ready_scenes())}"):
        load_scene(tmp_path / "none.toml")


@pytest.mark.parametrize("name", ["baem", "", "..", "beam beam"])
def test_an_unknown_name_names_the_ready_scenes(name: str) -> None:
    with refused(f"the ready scenes: {', '.join(list_ready_scenes())}"):
        load_scene(name)


def test_a_path_that_no_file_can_have_is_refused() -> None:
    with refused("no such file"):
        load_scene("a\0b.toml")


def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", forbidden)
    (tmp_path / "mine.toml").touch()
    with refused("can't be read: [Errno 13] Permission denied"):
        load_scene(tmp_path / "mine.toml")


def test_reading_a_scene_loads_no_heavy_module() -> None:
    heavy = {"pint", "gmsh", "skfem", "pyvista", "scipy", "matplotlib", "numba", "xarray"}
    code = f"import sys, pipeline.scene.scene; print(*({heavy!r} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == []


def keys_of(node: Any, path: str = "") -> list[str]:
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    below = [key for name, value in items for key in keys_of(value, f"{path}.{name}" if path else str(name))]
    return ([path] if path else []) + below


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {toml(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    return json.dumps(value) if isinstance(value, str | bool) else repr(value)


KEYS = [(name, key) for name, text in (("beam", BEAM), ("rod-slider", SLIDER)) for key in keys_of(tomllib.loads(text))]
WORDS = st.sampled_from(
    [
        "bar",
        "rod",
        "rigid",
        "revolute",
        "prismatic",
        "free",
        "torque pulse",
        "force",
        "chart",
        "film",
        "sub-cycling",
        "shape",
        "type",
        "face",
        "x+",
        "3 mm",
        "beam.tip",
    ]
)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20) | WORDS
TOML_VALUES = st.recursive(
    st.integers() | st.floats() | st.booleans() | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=8,
)


@given(st.sampled_from(KEYS), TOML_VALUES.map(toml) | st.text())
def test_any_value_at_any_key_loads_or_is_an_input_error(at: tuple[str, str], value: str) -> None:
    name, key = at
    message = ""
    try:
        assert isinstance(load_scene(name, [f"{key}={value}"]), Scene)
    except InputError as error:
        message = str(error)
    assert len(message) < 1000


@given(st.text())
def test_any_override_loads_or_is_an_input_error(text: str) -> None:
    with pytest.raises(InputError, match="--set"):
        load_scene("beam", [text])


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary() | st.dictionaries(TEXTS, TOML_VALUES).map(lambda d: toml(d)[1:-1].replace(", ", "\n").encode()))
def test_any_file_is_an_input_error(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "mine.toml"
    file.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(str(file))):
        load_scene(file)

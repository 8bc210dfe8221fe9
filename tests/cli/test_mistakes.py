"""Mistakes as users make them: one message each, with file, line, key, value and what would work; exit status 2."""

from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import pytest

from fmd import load_scene
from fmd.core.errors import InputError

PART = (files("fmd.cli.templates") / "part.toml").read_text(encoding="utf-8")
CRANK = (files("fmd.models") / "slider-crank.toml").read_text(encoding="utf-8")
MESHED = """title = "Bracket"

[body.bracket]
mesh = { file = "bracket.inp", unit = "mm" }
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
modes = { count = 6 }
marker = { foot = { face = "foot" } }
"""
PULSE = 'type = "torque pulse"\njoint = "hub"\nspeed = "10 rad/s"\nduration = "0.05 s"'
TORQUE = 'type = "torque"\njoint = "hub"\ntorque = '
SHAFT = '[joint.shaft]\ntype = "revolute"\nparent = "ground"\nchild = "crank.shaft"\naxis = [0, 0, 1]\n'
HUNG = 'parent = "ground"      # or another body\'s marker, e.g. "crank.pin"\nchild = "part.root"'
GRAVITY = '# gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]'
BIG_END = 'parent = "crank.pin"\nchild = "rod.crank"'


class Mistake(NamedTuple):
    """A change of a scene that is right, and the message: key, value if it has one, and what would work."""

    scene: str
    right: str
    wrong: str
    key: str
    value: object
    remedy: str


MISTAKES = {
    "no unit": Mistake(PART, 'length = "300 mm"', "length = 300", "body.part.length", 300, "needs a unit, e.g. "),
    "another unit": Mistake(
        PART, "kg/m^3", "kg", "body.part.rho", "2700 kg", "a density is wanted, e.g. '2780 kg/m^3'"
    ),
    "misspelt unit": Mistake(PART, "GPa", "Gpa", "body.part.E", "70 Gpa", "a stress is wanted, e.g. '722 MPa'"),
    "decimal comma": Mistake(PART, "20 mm", "20,5 mm", "body.part.depth", "20,5 mm", "a length is wanted, e.g. "),
    "SI modulus as a number": Mistake(PART, '"70 GPa"', "70e9", "body.part.E", 70e9, "needs a unit, e.g. '722 MPa'"),
    "a speed of a hinge": Mistake(
        PART, '"10 rad/s"', '"10 km/s"', "drive.motor.speed", "10 km/s", "an angular rate is wanted, e.g. '20 rad/s'"
    ),
    "negative length": Mistake(PART, "300 mm", "-300 mm", "body.part.length", "-300 mm", "must be greater than zero"),
    "incompressible": Mistake(PART, "0.33", "0.5", "body.part.nu", 0.5, "0.499 works"),
    "another program's key": Mistake(
        PART, "E = ", "Youngs_modulus = ", "body.part.Youngs_modulus", "70 GPa", "did you mean 'E'?"
    ),
    "everyday key": Mistake(PART, "rho = ", "density = ", "body.part.density", "2700 kg/m^3", "did you mean 'rho'?"),
    "another program's joint": Mistake(
        PART, '"revolute"', '"hinge"', "joint.hub.type", "hinge", "did you mean 'revolute'?"
    ),
    "another program's body": Mistake(
        PART, 'shape = "bar"', 'shape = "beam"', "body.part.shape", "beam", "did you mean 'bar'?"
    ),
    "another program's rigid body": Mistake(
        CRANK.replace('"rod"\nmass', '"rigid"\ninertia = ["1 kg m^2", "1 kg m^2", "1 kg m^2"]\nmass').replace(
            'length = "150 mm"\n', "", 1
        ),
        'shape = "rigid"',
        'shape = "box"',
        "body.crank.shape",
        "box",
        "did you mean 'rigid'?",
    ),
    "no marker's name": Mistake(PART, '"part.root"', '"root"', "joint.hub.child", "root", "the bodies: part"),
    "misspelt marker": Mistake(
        PART, "part.root", "part.rot", "joint.hub.child", "part.rot", "did you mean 'part.root'?"
    ),
    "misspelt face": Mistake(
        PART, 'face = "x+"', 'face = "+x"', "body.part.marker.tip.face", "+x", "the faces: x-, x+"
    ),
    "two bodies of one name": Mistake(
        CRANK, "[body.slider]", "[body.rod]", "", None, "two tables have one name: give one another"
    ),
    "a key twice": Mistake(PART, "nu = 0.33", "nu = 0.33\nnu = 0.3", "", None, "the key is there already: leave one"),
    "an open quotation": Mistake(PART, '"10 mm"', '"10 mm', "", None, "a text ends on its line"),
    "a comment of C": Mistake(PART, "nu = 0.33", "nu = 0.33 // Poisson", "", None, "a comment begins with #"),
    "misspelt table": Mistake(PART, "[joint.hub]", "[joints.hub]", "joints", None, "did you mean 'joint'?"),
    "time step of zero": Mistake(
        PART,
        'integrator = "auto"',
        'integrator = "central-difference"\nstep = "0 us"',
        "simulation.run.0.step",
        "0 us",
        "must be greater than zero",
    ),
    "no output in time": Mistake(
        PART, 'output_step = "1 ms"', 'output_step = "1 s"', "simulation.output_step", "1 s", "than the duration, 0.2 s"
    ),
    "axis by name": Mistake(PART, "[0, 0, 1]", '"z"', "joint.hub.axis", "z", "along x, y and z: [0, 0, 1]"),
    "axis of zeros": Mistake(PART, "[0, 0, 1]", "[0, 0, 0]", "joint.hub.axis", [0, 0, 0], "[0, 0, 1] is the z axis"),
    "gravity as a number": Mistake(
        PART, GRAVITY, "gravity = -9.81", "simulation.gravity", -9.81, '["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]'
    ),
    "child and parent swapped": Mistake(
        PART,
        HUNG,
        'parent = "part.root"\nchild = "ground"',
        "joint.hub.child",
        "ground",
        "parent = 'ground' and child = 'part.root' work",
    ),
    "a joint without marker": Mistake(
        CRANK, BIG_END, 'parent = "crank.pin"', "joint.big_end.child", None, 'is missing: "body.marker"'
    ),
    "a body on no joint": Mistake(
        CRANK.replace('joint = "shaft"', 'joint = "big_end"'),
        SHAFT,
        "",
        "body.crank",
        None,
        "hangs on no joint; give it one with child = 'crank.…'",
    ),
    "a loop that can't close": Mistake(
        CRANK,
        '[joint.guide]\ntype = "prismatic"\nparent = "ground"',
        '[ground.rail]\nat = ["0 m", "1 m", "0 m"]\n\n[joint.guide]\ntype = "prismatic"\nparent = "ground.rail"',
        "joint.small_end",
        None,
        "a residual of 0.7 m is left; check lengths, places and axes",
    ),
    "a force on a hinge": Mistake(
        PART,
        PULSE,
        'type = "force"\njoint = "hub"\nforce = "10 N"',
        "drive.motor.joint",
        "hub",
        "needs a prismatic one",
    ),
    "a stroke of a hinge": Mistake(
        CRANK,
        'angle = { formula = "150*t", unit = "rad" }',
        'position = { formula = "150*t", unit = "mm" }',
        "drive.crank.position",
        ...,
        "this one moves by its angle",
    ),
    "misspelt function": Mistake(
        PART,
        PULSE,
        TORQUE + '{ formula = "0.4*sinus(t)", unit = "N m" }',
        "drive.motor.torque.formula",
        "0.4*sinus(t)",
        "at column 5: there is no 'sinus'",
    ),
    "times that go back": Mistake(
        PART,
        PULSE,
        TORQUE + '{ times = ["0 s", "2 s", "1 s"], values = [0, 1, 0], unit = "N m" }',
        "drive.motor.torque.times.2",
        "1 s",
        "must be above the time before it",
    ),
    "a missing CSV file": Mistake(
        PART,
        PULSE,
        TORQUE + '{ file = "torque.csv", time = "t", column = "m", unit = "N m" }',
        "drive.motor.torque.file",
        "torque.csv",
        "No such file or directory; it is looked for at ",
    ),
    "a missing mesh": Mistake(MESHED, "", "", "body.bracket.mesh.file", "bracket.inp", "it is looked for at "),
    "a node by its number": Mistake(
        MESHED, '{ face = "foot" }', "{ node = 9001 }", "body.bracket.marker.foot.node", 9001, "links is link = 9001"
    ),
    "a mesh without unit": Mistake(MESHED, ', unit = "mm"', "", "body.bracket.mesh.unit", None, "is missing"),
    "a picture of no body": Mistake(
        PART,
        '"von-mises.png"\nbody = "part"',
        '"von-mises.png"\nbody = "arm"',
        "output.3.body",
        "arm",
        "the bodies: part",
    ),
    "a step that diverges": Mistake(
        PART,
        'integrator = "auto"',
        'integrator = "central-difference"\nstep = "1 ms"',
        "simulation.run.0.step",
        "0.001 s",
        "the largest stable step of this model is ",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_message_with_what_would_work(name: str, fmd, capsys, tmp_path: Path) -> None:
    made, scene = MISTAKES[name], tmp_path / "mine.toml"
    assert made.right in made.scene
    scene.write_text(made.scene.replace(made.right, made.wrong, 1))
    assert fmd("run", scene, "--no-pictures", "--no-budget", "--out", tmp_path / "out") == 2
    (message,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("fmd: ")]
    place, _, said = message.removeprefix(f"fmd: {scene}:").partition(": ")
    assert 0 < int(place) <= len(scene.read_text().splitlines())
    if made.key:
        given = "" if made.value is None else f" = {made.value!r}"
        assert said.startswith(f"{made.key} = " if made.value is ... else f"{made.key}{given}: ")
    assert made.remedy in said
    assert not (tmp_path / "out").exists()


def test_a_misspelt_kind_does_not_hide_what_else_is_wrong(fmd, capsys, tmp_path: Path) -> None:
    text = PART.replace('"bar"', '"beam"').replace("E = ", "Youngs_modulus = ").replace('"revolute"', '"hinge"')
    scene = tmp_path / "mine.toml"
    scene.write_text(text.replace("300 mm", "300").replace('"x+"', '"+x"').replace('joint = "hub"', 'joint = "hup"'))
    assert fmd("run", scene) == 2
    lines = capsys.readouterr().err.splitlines()
    keys = [line.removeprefix("fmd: ").split(": ")[1].split(" = ")[0] for line in lines]
    assert keys == [
        "body.part.shape",
        "body.part.length",
        "body.part.Youngs_modulus",
        "joint.hub.type",
        "drive.motor.joint",
        "output.1.joint",
    ]


def test_a_table_that_replaces_the_base_names_what_is_lost(fmd, capsys, tmp_path: Path) -> None:
    scene = tmp_path / "mine.toml"
    scene.write_text('title = "Mine"\nbase = "slider-crank"\n[body.crank]\nlength = "45 mm"\n')
    assert fmd("run", scene) == 2
    said = capsys.readouterr().err
    assert f"{scene}:3: body.rod: is the base's alone, whose body this one replaces: slider, too; set = ['body" in said
    scene.write_text('title = "Mine"\nbase = "slider-crank"\nset = ["body.crank.lenght=45 mm"]\n')
    assert fmd("run", scene) == 2
    assert "the base's" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["view", "four-bar", "--no-browser", "--out", "."], "--out = '.': can't be written: Is a directory"),
        (["sweep", "beam", "--vary", "body.beam.E=60GPa,70GPa", "--histories"], "--histories: keeps histories among"),
        (["run", "beam", "--no-budget", "--budget-seconds", "3"], "--budget-seconds = 3.0: can't stand beside"),
        (
            ["unbalance", "rotor", "--at", "wheel.centre", "--of", "5 g mm", "--force", "1 N", "--to", "4000 rpm"],
            "--of = '5 g mm': can't stand beside --force",
        ),
    ],
)
def test_options_that_contradict_are_one_message(fmd, capsys, tmp_path: Path, monkeypatch, arguments, message) -> None:
    monkeypatch.chdir(tmp_path)
    assert fmd(*arguments) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"fmd: {message}")
    assert not [*tmp_path.iterdir()]


def test_a_part_or_a_robot_in_place_of_a_scene_is_told_how_to_write_one(tmp_path: Path) -> None:
    (tmp_path / "bracket.step").write_text("ISO-10303-21;")
    with pytest.raises(InputError, match=r"fmd new bracket\.toml --from .*bracket\.step writes a scene"):
        load_scene(tmp_path / "bracket.step")
    (tmp_path / "bracket.igs").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"isn't text in UTF-8; .*fmd new bracket\.toml --from .*bracket\.igs"):
        load_scene(tmp_path / "bracket.igs")

"""Scenes that build on other scenes, and bodies that are like other bodies."""

from pathlib import Path

import pytest

from fmd.scene.scene import Scene, load_scene
from tests.scene.scenes import ARM, refused, scene_of

TWO = 'title = "Two"\n' + ARM + '[body.other]\nlike = "arm"\n'


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_tables_that_a_scene_leaves_out_come_from_its_base(tmp_path: Path):
    write(tmp_path, "mine.toml", 'title = "Mine"\nsource = "Here"\n' + ARM)
    scene = load_scene(write(tmp_path, "cases/long.toml", 'base = "../mine.toml"\ntitle = "Long"\n'))
    assert (scene.title, scene.source, list(scene.body)) == ("Long", "Here", ["arm"])
    longer = 'base = "long.toml"\n' + ARM.replace("1 m", "2 m")
    chained = load_scene(write(tmp_path, "cases/longer.toml", longer), ["body.arm.nu=0.2"])
    assert (chained.title, chained.source) == ("Long", "Here")
    assert (chained.body["arm"].length, chained.body["arm"].nu) == (2.0, 0.2)


def test_files_of_a_base_lie_where_the_base_says(tmp_path: Path):
    part = '[body.part]\nmesh = { file = "parts/part.inp", unit = "mm" }\nE = "1 GPa"\nnu = 0.3\nrho = "1 kg/m^3"\n'
    rod = '[body.rod]\nshape = "rod"\nmass = "1 kg"\nlength = "1 m"\nmarker = { a = { at = ["0 m", "0 m", "0 m"] } }\n'
    joint = '[joint.hinge]\ntype = "revolute"\nparent = "ground"\nchild = "rod.a"\naxis = [0, 0, 1]\n'
    drive = '[drive.x]\ntype = "torque"\njoint = "hinge"\n'
    drive += 'torque = { file = "tables/torque.csv", time = 1, column = 2, unit = "N m" }\n'
    output = '[[output]]\ntype = "mesh"\nfile = "mesh.png"\nbody = "part"\n'
    modes = "[body.part.modes]\ncount = 3\n"
    write(tmp_path, "deep/down/tables/torque.csv", "0 1\n1 2\n")
    write(tmp_path, "deep/down/mine.toml", 'title = "Mine"\n' + part + modes + rod + joint + drive + output)
    scene = load_scene(write(tmp_path, "up/variant.toml", 'base = "../deep/down/mine.toml"\n'))
    assert scene.body["part"].mesh.file == "../deep/down/parts/part.inp"
    assert scene.drive["x"].torque.values == (1.0, 2.0)
    assert scene.output[0].file == "mesh.png"


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ('"./other.toml"', "mine.toml: base = './other.toml': no such file; it is looked for at"),
        ('"beem"', "did you mean 'beam'? the ready scenes: arm, beam"),
        ("3", "mine.toml: base = 3: the ready scenes: "),
        ('"mine.toml"', "mine.toml: base = 'mine.toml': leads back to the same scene"),
    ],
)
def test_a_base_that_is_not_there_is_refused(tmp_path: Path, base: str, message: str):
    with refused(message):
        scene_of(tmp_path, f"base = {base}\n")


def test_a_fault_in_a_base_names_the_bases_file(tmp_path: Path):
    write(tmp_path, "faulty.toml", 'title = "Mine"\n' + ARM.replace("nu = 0.3", "nu = 0.6"))
    with refused("faulty.toml:9: body.arm.nu = 0.6: must be below 0.5"):
        scene_of(tmp_path, 'base = "faulty.toml"\ntitle = "Variant"\n')
    with refused("mine.toml:2: title = 3: must be a text"):
        scene_of(tmp_path, 'base = "faulty.toml"\ntitle = 3\n', "body.arm.nu=0.3")


def test_a_body_like_another_has_its_keys_except_those_of_its_own(tmp_path: Path):
    own = 'nu = 0.25\nmodes = { damping = 0.01 }\nmarker = { b = { face = "y+" }, c = { face = "z+" } }\n'
    scene = scene_of(tmp_path, TWO + own + '[body.third]\nlike = "other"\nlength = "2 m"\n')
    arm, other, third = (scene.flexible[name] for name in ("arm", "other", "third"))
    assert (other.nu, other.modes.damping, other.modes.count) == (0.25, 0.01, 3)
    assert {name: marker.face for name, marker in other.marker.items()} == {"a": "x-", "b": "y+", "c": "z+"}
    assert other.mesh == arm.mesh
    assert third == other.model_copy(update={"length": 2.0})
    assert (arm.nu, arm.modes.damping, set(arm.marker)) == (0.3, 0.0, {"a", "b"})


def test_values_from_the_command_line_reach_likenesses_and_may_differ_in_them(tmp_path: Path):
    scene: Scene = scene_of(tmp_path, TWO, "body.arm.length=3 m", "body.other.mesh.size=9 mm", "body.other.E=1 GPa")
    arm, other = scene.flexible["arm"], scene.flexible["other"]
    assert (arm.length, other.length) == (3.0, 3.0)
    assert (arm.mesh.size, other.mesh.size) == (0.005, 0.009)
    assert (arm.E, other.E) == (210e9, 1e9)
    held = TWO.replace("[body.other]", '[[body.arm.support]]\nface = "x-"\n[body.other]')
    both = scene_of(tmp_path, held, 'body.other.support.0.fixed=["y"]')
    assert [both.flexible[name].support[0].fixed for name in ("arm", "other")] == [("x", "y", "z"), ("y",)]


@pytest.mark.parametrize(
    ("text", "overrides", "message"),
    [
        (
            '[body.x]\nlike = "amr"\n',
            (),
            "body.x.like = 'amr': no such body; did you mean 'arm'? the others: arm, other",
        ),
        ('[body.x]\nlike = ["arm"]\n', (), "no such body"),
        ("", ("body.arm.like=other",), "body.other.like = 'arm': leads back to the same body"),
        ("", ("body.arm.nu=0.7",), "--set: body.arm.nu = 0.7: must be below 0.5 (0.5 is incompressible); 0.499 works"),
        ("", ("body.other.mash.size=3 mm",), "--set: body.other.mash.size: there is no 'mash'"),
    ],
)
def test_faults_of_likenesses_are_told(tmp_path: Path, text: str, overrides: tuple[str, ...], message: str):
    with refused(message):
        scene_of(tmp_path, TWO + text, *overrides)


def test_a_scene_sets_single_values_of_its_base(tmp_path: Path):
    write(tmp_path, "mine.toml", 'title = "Mine"\nset = ["body.arm.nu=0.2"]\n' + ARM)
    text = 'base = "mine.toml"\nset = ["body.arm.length=2 m", "body.arm.modes.count = 7"]\n'
    scene = load_scene(write(tmp_path, "long.toml", text), ["body.arm.modes.count=8"])
    arm = scene.flexible["arm"]
    assert (arm.length, arm.nu, arm.modes.count, arm.E) == (2.0, 0.2, 8, 210e9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ('["body.arm.nu=0.9"]', "mine.toml:2: body.arm.nu = 0.9: must be below 0.5"),
        ('["body.leg.nu=0.3"]', "mine.toml: body.leg.nu: there is no 'leg'"),
        ('["body.arm.nu"]', "mine.toml: set = 'body.arm.nu': must look like body.beam.length=300mm"),
        ('"body.arm.nu=0.3"', "mine.toml: set: must be a list of texts"),
    ],
)
def test_faults_of_single_values_name_the_file_that_sets_them(tmp_path: Path, given: str, message: str):
    write(tmp_path, "base.toml", 'title = "Base"\n' + ARM)
    with refused(message):
        scene_of(tmp_path, f'base = "base.toml"\nset = {given}\n')

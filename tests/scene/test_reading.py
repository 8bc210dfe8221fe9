"""Reading of scene files: overrides, and one clear message for whatever a file may not hold."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fmd.core.errors import InputError
from fmd.scene.scene import Scene, load_scene
from fmd.scene.toml_files import list_ready_scenes
from tests.scene.scenes import BEAM, SLIDER, refused, scene_of


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
        ("body.beam.mesh={elment=1, ordr=2, x=3}", "ordr = 2: no such key; did you mean 'order'?"),
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
        (
            "body.beam.shape=baar",
            "body.beam.shape = 'baar': must be one of 'bar', 'plate', 'tube', 'shaft', 'profile', 'propeller'",
        ),
        ("output.0.type=3", "output.0.type = 3: must be one of 'chart', 'orbit', 'frf', 'mesh', 'modes', 'mode sheet'"),
        ("simulation.run.0.integrator=[]", "simulation.run.0.integrator = []: must be one of"),
        ("body.beam.mesh={}", "body.beam.mesh.divisions: is missing: hexahedra along x, y and z"),
        (
            "simulation={}",
            "duration: is missing, e.g. '0.5 ms'\n--set: simulation.output_step: is missing, e.g. '0.5 ms'\n"
            '--set: simulation.tip: is missing: "body.marker"\n--set: simulation.run: is missing, e.g. '
            '[{"integrator" = "auto"}]',
        ),
        ("body.beam=3", "body.beam = 3: must be a table"),
        ("body=3", "body = 3: must be a table"),
        ("simulation=3", "simulation = 3: must be a table"),
        ("body={}", "body = {}: must have at least 1 item"),
        ("output=3", "output = 3: must be a list"),
        ("simulation.run=[]", "simulation.run = []: must have at least 1 item"),
        ("title=3", "title = 3: must be a text"),
        ("body.beam.modes.count=5.0", "body.beam.modes.count = 5.0: must be a whole number"),
        ("body.beam.modes.count=true", "body.beam.modes.count = True: must be a whole number"),
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
        (
            'simulation.run=[{integrator="reversible-sub-cycling",substeps=5,split="1 kHz"}]',
            "simulation.run.0.split = '1 kHz': no such key; the keys here: integrator, substeps, step",
        ),
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
        ("body.beam.mesh.formulation=plain", "formulation = 'plain': belongs to hexahedra of order 1; other elements"),
        (
            'body.beam.mesh={element="tetrahedron", size="5 mm", order=1, formulation="plain"}',
            "body.beam.mesh.formulation = 'plain': belongs to hexahedra of order 1",
        ),
        # integrators that are no more
        (
            'simulation.run.0={integrator="generalized-alpha", tolerance=1e-6}',
            "simulation.run.0.tolerance = 1e-06: generalized-alpha takes a step; exponential-rosenbrock and",
        ),
        (
            'simulation.run.0.integrator="DOP853"',
            "'LSODA', 'auto'; did you mean 'runge-kutta'?",
        ),
        ("simulation.run.0.integrator=rk4", "'LSODA', 'auto'; did you mean 'runge-kutta'?"),
        ("simulation.run.0.integrator=Newmark-beta", "'LSODA', 'auto'; did you mean 'generalized-alpha'?"),
        ("simulation.run.0.integrator=velocity_Verlet", "'LSODA', 'auto'; did you mean 'central-difference'?"),
        ("simulation.run.0.integrator=BDF", "'LSODA', 'auto'; did you mean 'Radau'?"),
        ("drive.spin_up.torque=3 N m", "drive.spin_up.torque = '3 N m': can't stand beside speed"),
        (
            'drive.spin_up={type="torque pulse", joint="hub", duration="1 s"}',
            "drive.spin_up.speed: is missing: give",
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
        ("joint.hub.child=ground", "joint.hub.child = 'ground': holds ground to itself"),
        ("joint.hub.parent=beem.tip", "no such body; did you mean 'beam'? the bodies: beam"),
        (
            "drive.spin_up.joint=hup",
            "drive.spin_up.joint = 'hup': no such joint; did you mean 'hub'? the joints: hub",
        ),
        ("simulation.tip=beam.top", "simulation.tip = 'beam.top': no such marker; did you mean 'beam.tip'?"),
        ("output.5.body=baem", "output.5.body = 'baem': no such body; did you mean 'beam'?"),
        (
            "joint.hub.parent=beam.tip",
            "holds beam to itself",
        ),
        # files
        ("output.3.file=m.png", "must hold '{mode}' once"),
        ("output.0.file=m{mode}.png", "'{mode}' belongs to an output of type 'modes'"),
        ("output.1.file=FIG-09-com-position.png", "another output has this file; rename it"),
        ("output.4.file=mode-2.png", "another output has this file; rename it"),
        ("output.1.file=mode-2.png", "another output has this file; rename it"),
        ("output.5.frames=1", "must be greater than or equal to 2"),
        ("output.5.rate=0.0", "must be greater than zero"),
        (
            "output.5.size=[10, 10]",
            "must be greater than or equal to 64\n--set: output.5.size.1 = 10: must be greater than or equal to 64",
        ),
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
    with refused(f"{tmp_path / 'mine.toml'}:10: body.beam.length = 340: needs a unit") as caught:
        scene_of(tmp_path, BEAM.replace('"340 mm"', "340"))
    error = caught.value
    assert (error.file, error.line) == (str(tmp_path / "mine.toml"), 10)
    assert (error.key, error.value) == ("body.beam.length", 340)


def test_a_fault_beside_an_override_is_laid_to_the_file(tmp_path: Path) -> None:
    with refused(f"{tmp_path / 'mine.toml'}:50: simulation.output_step"):
        scene_of(tmp_path, BEAM, "simulation.duration=0.1ms", "drive={}")


def test_all_faults_come_at_once_in_the_order_of_their_lines(tmp_path: Path) -> None:
    changes = {
        '"340 mm"': "340",  # a number without a unit, line 10
        "nu = 0.34": "nu = 0.5",  # a value out of bounds
        "rho =": "roh =",  # an unknown key, and so a missing one, which isn't told a second time
        '"2 us"': '"10 kg"',
        'type = "film"': 'type = "flim"',
        'joint = "hub"': 'joint = "hob"',  # a name that nothing has, between tables that have no other fault
    }
    text = BEAM
    for right, wrong in changes.items():
        assert right in text
        text = text.replace(right, wrong, 1)
    with pytest.raises(InputError) as caught:
        scene_of(tmp_path, text)
    found = [(error.line, error.key) for error in (caught.value, *caught.value.others)]
    lines = text.split("\n")
    assert [lines[line - 1] for line, _ in found] == [line for line in lines if line not in BEAM.split("\n")]
    assert [key.split(".")[-1] for _, key in found] == ["length", "nu", "roh", "joint", "step", "type"]
    assert len(str(caught.value).split("\n")) == len(changes)


def test_a_message_has_twenty_faults_at_most() -> None:
    with pytest.raises(InputError) as caught:
        load_scene("beam", [f"key{number}=1" for number in range(30)])
    assert len(caught.value.others) == 29
    assert str(caught.value).split("\n")[20:] == ["and 10 more"]


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
        ('"\\n\\u001b" = 1', "mine.toml:1: '\\n\\x1b' = 1: no such key"),
    ],
)
def test_a_file_that_is_no_scene_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with refused(message):
        scene_of(tmp_path, text)


def test_a_byte_order_mark_does_no_harm(tmp_path: Path) -> None:
    assert scene_of(tmp_path, "\ufeff" + BEAM).title == load_scene("beam").title


def test_a_binary_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_bytes(b"\x89PNG\xff\xfe")
    with refused(f"{file}: isn't text in UTF-8"):
        load_scene(file)


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with refused("is a folder; give the scene file, e.g. part.toml"):
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


@settings(max_examples=50)
@given(st.sampled_from(KEYS), TOML_VALUES.map(toml) | st.text())
def test_any_value_at_any_key_loads_or_is_an_input_error(at: tuple[str, str], value: str) -> None:
    name, key = at
    message = ""
    try:
        assert isinstance(load_scene(name, [f"{key}={value}"]), Scene)
    except InputError as error:
        message = str(error)
    assert max(map(len, message.split("\n"))) < 1000


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


@pytest.mark.parametrize(
    ("override", "meant"),
    [
        ("joint.hub.type=hinge", "revolute"),
        ("body.beam.Youngs_modulus=70 GPa", "E"),
        ("body.beam.poisson-ratio=0.3", "nu"),
        ("body.beam.density=2700 kg/m^3", "rho"),
        ("simulation.t_end=1 s", "duration"),
        ("simulation.dt=1 us", "step"),
        ("joint.hub.damping=1 N m s", "damper"),
        ("body.beam.shape=box", "bar"),
        ("joint.hub.type=revolut", "revolute"),
        ('joint.hub.stop={upper="9 deg", stiffness="1 N m/rad"}', "high"),
        ('controller={servo={type="pid", error="1 - hub.angle", kp=1.0}}', "proportional"),
        ('controller={servo={type="pid", reference="1", proportional=1.0}}', "error"),
        ('controller={servo={type="pid", error="1 - hub.angle", max=1.0}}', "highest"),
    ],
)
def test_words_of_other_programs_are_understood(override: str, meant: str) -> None:
    with pytest.raises(InputError, match=rf"did you mean '{meant}'\?"):
        load_scene("beam", [override])


def test_a_misspelt_kind_is_named_in_a_list_and_in_its_only_table_without_brackets() -> None:
    box = '{type="bx", size=["1 m", "1 m", "1 m"]}'
    for visual in (box, f"[{box}]"):
        with refused("did you mean 'box'?"):
            load_scene("rod-slider", [f"body.slider.visual={visual}"])

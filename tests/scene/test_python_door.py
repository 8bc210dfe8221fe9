"""Scenes that are made in Python: the classes of their tables, numbers in SI units, and tables in a dict."""

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.scene.any_body import Body
from fmd.scene.bar import Bar, BarMesh
from fmd.scene.constraints import AnyCoupler
from fmd.scene.joints.any_joint import Joint
from fmd.scene.joints.prismatic import Prismatic
from fmd.scene.joints.revolute import Revolute
from fmd.scene.loads import Drive, TorqueDrive
from fmd.scene.modes import ModeSettings, RayleighDamping, damping_ratios
from fmd.scene.outputs import Chart, FrequencyResponseChart, Output
from fmd.scene.places import MarkerPlace
from fmd.scene.reading import SceneTable
from fmd.scene.rigid_bodies import PointMarker, PointMass, Rod
from fmd.scene.runs import AutoRun, CentralDifferenceRun, Run
from fmd.scene.scene import Scene, load_scene
from fmd.scene.simulation import Simulation
from fmd.scene.visuals import BoxVisual
from tests.scene.scenes import SLIDER, refused

HINGE = PointMarker(at=[0, 0, 0])
ROD = {
    "title": "Rod",
    "body": {"rod": {"shape": "rod", "mass": 2.0, "length": "1 m", "marker": {"hinge": {"at": [0, 0, 0]}}}},
    "joint": {"hinge": {"type": "revolute", "parent": "ground", "child": "rod.hinge", "axis": [0, 0, 1]}},
    "simulation": {
        "duration": 1.0,
        "output_step": "10 ms",
        "tip": "rod.hinge",
        "gravity": (0, -9.81, 0),
        "run": [{"integrator": "auto"}],
    },
}


@pytest.mark.parametrize("zero", [{"alpha": 0}, {"beta": "0 us"}, {"alpha": "0 1/s", "beta": 0}])
def test_factors_of_nothing_are_no_damping_as_a_ratio_of_nothing_is(zero: dict[str, Any]) -> None:
    none = ModeSettings(count=2, damping=zero).damping
    assert not none
    assert damping_ratios(none, [1.0, 2.0]) == damping_ratios(0.0, [1.0, 2.0]) == [0.0, 0.0]
    assert ModeSettings(count=2, damping={"alpha": 0, "beta": "2 us"}).damping
    with pytest.raises(InputError, match="is missing: give alpha"):
        ModeSettings(count=2, damping={})


def test_numbers_are_in_si_units_and_texts_have_units() -> None:
    assert Rod(mass=2.0, length="50 cm", marker={}) == Rod(mass="2000 g", length=0.5, marker={})
    assert Rod(mass=2, length=np.float64(0.5), marker={"end": {"at": np.array([0.5, 0, 0])}}).marker == {
        "end": PointMarker(at=("500 mm", 0.0, "0 m"))
    }
    assert RayleighDamping(alpha=12, beta="2 us") == RayleighDamping(alpha="12 1/s", beta=2e-6)
    assert MarkerPlace(edge=([0, 0, 0], ["1 m", 0, 0])).edge == ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert Revolute(parent="ground", child="rod.a", axis=np.array([0.0, 0, 1]), angle=math.pi).angle == math.pi
    assert TorqueDrive(joint="hinge", torque=3).torque == TorqueDrive(joint="hinge", torque="3 N m").torque
    assert Scene(**ROD | {"accuracy": 0.02}).accuracy == Scene(**ROD | {"accuracy": "2 %"}).accuracy == 0.02


@pytest.mark.parametrize("value", [True, None, "2", "2 m", math.nan, math.inf, -1.0, 0, [2.0], "two kg"])
def test_what_is_no_mass_is_refused_in_python_too(value: object) -> None:
    with pytest.raises(InputError, match="mass"):
        Rod(mass=value, length=1.0, marker={})


def test_a_file_says_the_unit_of_each_number(tmp_path: Path) -> None:
    file = tmp_path / "rod.toml"
    file.write_text(SLIDER.replace('mass = "2 kg"', "mass = 2.0"))
    with refused("body.rod.mass = 2.0: needs a unit, e.g. '2 kg'"):
        load_scene(file)


def test_a_scene_of_classes_is_the_scene_of_the_file() -> None:
    tables = tomllib.loads(SLIDER)
    made = Scene(
        title=tables["title"],
        source=tables["source"],
        body={
            "rod": Rod(
                mass=2.0,
                length=2.0,
                marker={name: PointMarker(**at) for name, at in tables["body"]["rod"]["marker"].items()},
            ),
            "slider": PointMass(mass=5.0, marker={"centre": HINGE}),
        },
        joint={
            "hinge": Revolute(**tables["joint"]["hinge"]),
            "slide": Prismatic(**tables["joint"]["slide"] | {"position": 0.15}),
        },
        drive={name: TorqueDrive(**drive) for name, drive in tables["drive"].items()},
        simulation=Simulation(**tables["simulation"]),
        output=[Chart(**output) for output in tables["output"]],
    )
    assert made.model_dump() == load_scene("rod-slider").model_dump()
    assert (made.file, made.name) == ("", "scene")
    assert "(made in Python)" in made._repr_html_()


@pytest.mark.parametrize("name", ["beam", "arm", "plate", "stewart", "suspension"])
def test_the_tables_of_a_file_in_a_dict_are_the_scene(name: str) -> None:
    scene = load_scene(name)
    tables = tomllib.loads(Path(scene.file).read_text())
    assert load_scene(tables).model_dump() == scene.model_dump()
    assert tables == tomllib.loads(Path(scene.file).read_text())  # left as they were


def test_a_dict_takes_overrides_and_bodies_like_another() -> None:
    body = ROD["body"] | {"second": {"like": "rod", "mass": 3.0}}
    joint = ROD["joint"] | {"second": ROD["joint"]["hinge"] | {"child": "second.hinge"}}
    scene = load_scene(ROD | {"body": body, "joint": joint}, ["body.rod.length=2 m"])
    assert (scene.body["second"].mass, scene.body["second"].length) == (3.0, 2.0)
    assert (scene.file, scene.simulation.gravity) == ("", (0.0, -9.81, 0.0))
    tables = {"title": "Own", "body": {"rod": {"shape": "rod", "mass": "2 kg", "length": "1 m", "marker": {}}}}
    assert load_scene(tables, ["body.rod.mass=3 kg"]).body["rod"].mass == 3.0
    assert tables["body"]["rod"]["mass"] == "2 kg"  # the caller's own tables stay as they are
    assert load_scene({"base": "beam", "title": "Another"}).body == load_scene("beam").body


def test_a_key_that_is_a_word_of_python_has_a_name_of_its_own() -> None:
    chart = {"file": "frf.png", "input": "plate.tip.z", "output": "plate.tip.z", "to": "2 kHz"}
    assert FrequencyResponseChart(from_=10.0, **chart) == FrequencyResponseChart(**chart | {"from": "10 Hz"})
    assert FrequencyResponseChart(from_=10.0, **chart).from_ == 10.0


def test_one_shape_in_pictures_needs_no_list() -> None:
    ball = BoxVisual(size=[0.1, 0.1, 0.1])
    assert PointMass(mass=1.0, marker={}, visual=ball) == PointMass(mass=1.0, marker={}, visual=[ball])


def test_flexible_bodies_and_runs_are_made_like_others() -> None:
    made = Bar(
        length=0.34,
        depth=0.025,
        width=0.01,
        E=722e6,
        nu=0.34,
        rho=2000,
        mesh=BarMesh(divisions=(30, 3, 1)),
        modes=ModeSettings(count=5, family="in-plane bending"),
        marker={"root": MarkerPlace(face="x-"), "tip": MarkerPlace(face="x+")},
    )
    beam = load_scene("beam").body["beam"]
    assert made.model_dump(include={"length", "depth", "width", "E"}) == beam.model_dump(
        include={"length", "depth", "width", "E"}
    )
    assert Simulation(duration=1, output_step=0.1, tip="a.b", run=[AutoRun(), CentralDifferenceRun(step=1e-3)]).run[
        1
    ] == CentralDifferenceRun(step="1 ms")


def kinds(union: Any) -> list[type[SceneTable]]:
    return list(union.__args__[0].__args__)


@pytest.mark.parametrize(
    "table", [table for union in (Body, Joint, Drive, AnyCoupler, Run, Output) for table in kinds(union)]
)
def test_a_class_is_its_kind_by_itself(table: type[SceneTable]) -> None:
    key = next(key for key in ("shape", "type", "integrator") if key in table.model_fields)
    kinds_of = table.model_fields[key].annotation.__args__
    with pytest.raises(InputError) as caught:
        table(unknown=1)
    assert (f"{table.__name__}.{key}: is missing" in str(caught.value)) == (len(kinds_of) > 1)


def test_all_faults_of_a_table_come_at_once_with_the_callers_line() -> None:
    with pytest.raises(InputError) as caught:
        Rod(mas=2.0, length="2 kg", marker={"a b": HINGE})
    lines = str(caught.value).split("\n")
    place = rf"{Path(__file__).name}:{caught.traceback[0].lineno + 1}: Rod\."
    assert [re.sub(place, "", line).split(" ")[0] for line in lines] == ["mas", "length", "marker.'a"]
    assert all(re.match(place, line) for line in lines)


def test_a_class_of_another_table_and_a_key_of_another_force_element_are_told_what_is_meant() -> None:
    with refused("Rod.marker.end: must be a table or a PointMarker, not a MarkerPlace"):
        Rod(mass=1.0, length=1.0, marker={"end": MarkerPlace(at=[0, 0, 0])})
    with refused("Revolute.stiffness = '4 N m/rad': no such key; did you mean 'spring'?"):
        Revolute(parent="ground", child="rod.a", axis=[0, 0, 1], stiffness="4 N m/rad")


def test_all_faults_of_a_scene_come_at_once_in_python_too() -> None:
    faulty = ROD | {
        "output": [{"type": "chart", "file": "a.png", "quantity": "joint_rate", "joint": "hing"}],
        "titel": "",
    }
    for make in (lambda: Scene(**faulty), lambda: load_scene(faulty)):
        with pytest.raises(InputError) as caught:
            make()
        messages = [message.partition(": ")[2] for message in str(caught.value).split("\n")]
        assert messages[0].startswith("titel = '': no such key; did you mean 'title'?")
        assert messages[1].startswith("output.0.joint = 'hing': no such joint; did you mean 'hinge'?")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("body.beam.lenght='1 m'", "body.beam.lenght = '1 m': no such key; did you mean 'length'?"),
        ("body.beam.depth='2 kg'", "body.beam.depth = '2 kg': '2 kg' is a mass"),
        (
            "simulation.run.0.integrater='auto'",
            "simulation.run.0.integrater = 'auto': no such key; did you mean 'integ",
        ),
        ("simulation.run=[{ integrator = 'autom' }]", "simulation.run.0.integrator = 'autom': must be one of"),
        ("drive.turn={ type = 'motion', joint = 'hub', position = '1 m' }", "drive.turn.position = '1 m': belongs to"),
    ],
)
def test_what_only_follows_from_a_fault_is_not_listed(override: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scene("beam", ["drive={}", override])
    (line,) = str(caught.value).split("\n")
    assert message in line


def test_a_mistyped_table_is_one_fault_and_not_one_for_each_name_that_would_be_in_it() -> None:
    bodies = ROD["body"]
    with pytest.raises(InputError) as caught:
        load_scene({key: value for key, value in ROD.items() if key != "body"} | {"bodi": bodies})
    (line,) = str(caught.value).split("\n")
    assert "bodi" in line
    assert "did you mean 'body'?" in line

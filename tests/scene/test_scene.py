"""Scenes as they are loaded: values in SI units, defaults, identity."""

import json
import math
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import ValidationError

from fmd.core.errors import InputError
from fmd.scene.scene import load_scene
from fmd.scene.toml_files import list_ready_scenes
from tests.scene.scenes import ARM, BEAM, ELBOW, PLATE, SLIDER, refused, scene_of


def test_the_beam_comes_in_si_units() -> None:
    scene = load_scene("beam")
    beam = scene.body["beam"]
    # models/beam.toml, converted by hand
    assert (beam.length, beam.depth, beam.width, beam.E, beam.rho) == (0.34, 0.025, 0.01, 722e6, 2000.0)
    assert (scene.simulation.duration, scene.simulation.step) == (0.5, 2e-6)
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


def test_a_body_cannot_be_called_ground(tmp_path: Path) -> None:
    with refused("'ground' is taken"):
        scene_of(tmp_path, BEAM.replace("body.beam", "body.ground"))


def test_reading_a_scene_loads_no_heavy_module() -> None:
    heavy = {"pint", "gmsh", "skfem", "pyvista", "scipy", "matplotlib", "llvmlite", "xarray"}
    code = f"import sys, fmd.scene.scene; print(*({heavy!r} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.split() == []


def test_an_output_holds_the_only_flexible_body_if_it_names_none() -> None:
    bar = {"shape": "bar", "length": "1 m", "depth": "1 cm", "width": "1 cm", "E": "70 GPa", "nu": 0.3}
    bar |= {"rho": "2700 kg/m^3", "mesh": {"divisions": [4, 1, 1]}, "modes": {"count": 2}}
    outputs = [{"type": "mesh", "file": "a.png"}, {"type": "export", "file": "a.vtu"}]
    weight = {"shape": "point", "mass": "1 kg", "marker": {"at": {"at": ["0 m"] * 3}}}
    scene = load_scene({"title": "one", "body": {"weight": weight, "arm": bar}, "output": outputs})
    assert [output.body for output in scene.output] == ["arm", "arm"]
    with pytest.raises(InputError, match=r"output\.0\.body: is missing"):
        load_scene({"title": "two", "body": {"left": bar, "arm": bar}, "output": outputs})

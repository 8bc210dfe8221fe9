"""Dimensions of parts with free meshes: laws of scale, closed forms, parts meshed anew, fits and designs."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.cli import sensitivities
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.fitting.fit_files import write_changed_scene
from fmd.fitting.parameters import find_parameter
from tests.fitting.test_sensitivities import BAR, by_key
from tests.meshes.test_cad_morph import BRACKET, volume_of

TETRAHEDRA = BAR.replace("divisions = [10, 2, 2]", 'element = "tetrahedron", size = "40 mm"')
SHAFT = """
title = "Shaft"

[body.rotor]
shape = "shaft"
segment = [
    { length = "200 mm", diameter = "30 mm" },
    { length = "100 mm", diameter = "50 mm", bore = "20 mm" },
]
station = { disc = "250 mm" }
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = { size = "50 mm" }
modes = { count = 4 }
marker = { end = { face = "x-" } }
"""
PLATE = """SetFactory("OpenCASCADE");
DefineConstant[ scale = 1, bore = 6 ];
Box(1) = {0, 0, 0, 40 * scale, 20 * scale, 10 * scale};
Cylinder(2) = {28 * scale, 10 * scale, 0, 0, 0, 10 * scale, bore * scale};
BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
"""
SCENE = """
title = "{title}"

[body.part]
mesh = {{ cad = "part.geo", unit = "mm", size = "{size}", order = {order}, parameter = {{ {parameter} }} }}
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
modes = {{ count = 4, boundary = "joint" }}
marker = {{ wall = {{ face = "{wall}" }}, tip = {{ face = "xmax" }} }}

[joint.wall]
type = "fixed"
parent = "ground"
child = "part.wall"
"""
SIMULATION = """
[simulation]
duration = "1 ms"
output_step = "0.1 ms"
step = "auto"
tip = "part.tip"
run = [{ integrator = "auto" }]
"""
ON_PLATE = SCENE.format(title="Plate", size="10 mm", order=1, parameter='scale = "1 mm", bore = "6 mm"', wall="xmin")
ON_BRACKET = (
    SCENE.format(title="Bracket", size="8 mm", order=2, parameter='hole = "16 mm", fillet = "6 mm"', wall="zmax")
    + SIMULATION
)


def write(folder: Path, script: str, scene: str) -> Path:
    (folder / "part.geo").write_text(script)
    path = folder / "part.toml"
    path.write_text(scene)
    return path


@pytest.mark.slow
def test_a_script_in_proportion_obeys_laws_of_scale(tmp_path: Path) -> None:
    key = "body.part.mesh.parameter.scale"
    found = package.jacobian(package.load(write(tmp_path, PLATE, ON_PLATE)), ["mass", "part.frequency.1"], [key])
    # Nodes within the bore's curved face aren't in proportion, between chords that are.
    assert by_key(found, "mass")[key].relative == pytest.approx(3.0, rel=1e-4)
    assert by_key(found, "part.frequency.1")[key].relative == pytest.approx(-1.0, rel=1e-3)


@pytest.mark.parametrize(("of", "number", "stated"), [("stress", "bore", False), ("mass", "bore", True)])
def test_stress_by_dimensions_of_a_script_has_no_stated_error(
    of: str, number: str, stated: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = ON_PLATE + SIMULATION.replace("tip =", 'gravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]\ntip =')
    (found,) = package.jacobian(
        package.load(write(tmp_path, PLATE, scene)), [f"part.{of}"], [f"body.part.mesh.parameter.{number}"]
    )
    row = found.row()
    assert np.isfinite(found.error).all() == (row["interval"] is not None) == (row["unstated"] == "") == stated
    sensitivities._print([found], [row])
    assert ("not stated" in " ".join(capsys.readouterr().out.split())) is not stated


def test_dimensions_of_a_bar_of_tetrahedra_add_up_to_the_law_of_scale(tmp_path: Path) -> None:
    path = tmp_path / "bar.toml"
    path.write_text(TETRAHEDRA)
    keys = [f"body.bar.{name}" for name in ("length", "depth", "width")]
    found = package.jacobian(package.load(path), ["bar.frequency.1", "bar.frequency.3", "mass"], keys)
    for name in ("bar.frequency.1", "bar.frequency.3"):
        assert sum(each.relative for each in by_key(found, name).values()) == pytest.approx(-1.0, abs=1e-6)
    assert [each.relative for each in by_key(found, "mass").values()] == pytest.approx([1.0, 1.0, 1.0], rel=1e-9)


def test_dimensions_of_a_shaft_add_up_to_the_law_of_scale(tmp_path: Path) -> None:
    """Lengths of segments and the station's place are whole multiples of the beams' size."""
    path = tmp_path / "shaft.toml"
    path.write_text(SHAFT)
    names = ("segment.0.length", "segment.1.length", "station.disc")
    keys = [f"body.rotor.{name}" for name in (*names, "segment.0.diameter", "segment.1.diameter", "segment.1.bore")]
    found = by_key(package.jacobian(package.load(path), ["rotor.frequency.1"], keys), "rotor.frequency.1")
    # A massless station changes nothing but where beams end, which is an error of the mesh.
    assert abs(found["body.rotor.station.disc"].relative) < 1e-2
    assert sum(each.relative for each in found.values()) == pytest.approx(-1.0, abs=1e-6)


def test_a_mesh_whose_elements_change_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bar.toml"
    path.write_text(TETRAHEDRA)
    with pytest.raises(InputError, match="size: changes the elements of bar, so that results jump"):
        package.jacobian(package.load(path), ["bar.frequency.1"], ["body.bar.mesh.size"])
    with pytest.raises(InputError, match="bar has the modes 1 to"):
        package.jacobian(package.load(path), ["bar.frequency.70"], ["body.bar.E"])


@pytest.mark.parametrize("of", ["bar", "part", "rotor"])
def test_a_changed_scene_keeps_the_elements(of: str, tmp_path: Path) -> None:
    path = write(tmp_path, PLATE, {"part": ON_PLATE, "bar": TETRAHEDRA, "rotor": SHAFT}[of])
    scene = package.load_scene(path)
    keys = {"part": "body.part.mesh.parameter.bore", "bar": "body.bar.depth", "rotor": "body.rotor.segment.0.length"}
    parameter = find_parameter(scene, keys[of])
    write_changed_scene(scene, {parameter: 1.1 * parameter.value}, tmp_path / "new.toml", str(path), [])
    first, new = (package.load(each).run.wholes[of] for each in (path, tmp_path / "new.toml"))
    assert np.array_equal(new.mesh.cells, first.mesh.cells)
    assert new.mesh.volume != pytest.approx(first.mesh.volume, rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("part.geo", "part.step", "is of scripts, bracket.geo: other CAD files have their own"),
        ('size = "10 mm", order = 1', 'size = "10 mm", shell = "1 mm"', "scripts are of solids"),
        (
            "parameter = {",
            'made_at = { depth = "1 mm" }, parameter = {',
            "no such parameter; the parameters: scale, bore",
        ),
    ],
)
def test_keys_that_a_cad_file_has_no_use_for_are_refused(old: str, new: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        package.load_scene(write(tmp_path, PLATE, ON_PLATE.replace(old, new)))


@pytest.mark.long
def test_a_hole_is_fitted_and_designed(fmd: Any, tmp_path: Path) -> None:
    path, key = write(tmp_path, BRACKET, ON_BRACKET), "body.part.mesh.parameter.hole"

    def frequencies(hole: float) -> Array:
        carried = 'body.part.mesh.made_at={hole = "16 mm"}'
        return package.load(path, f"{key}={hole} mm", carried).run.wholes["part"].modes.frequencies_hz

    truth = frequencies(17.0)
    data = tmp_path / "modes.csv"
    data.write_text("frequency_hz\n" + "".join(f"{f}\n" for f in truth))
    given = ["--to", data, "--vary", f"{key}=14..18mm", "--sigma", "frequency=0.01%", "--out", tmp_path]
    assert fmd("fit", path, *given, "--json") == 0
    assert json.loads((tmp_path / "fit.json").read_text())["parameters"][0]["value"] == pytest.approx(0.017, rel=1e-5)
    again = package.load(tmp_path / "fitted.toml")
    assert again.run.wholes["part"].modes.frequencies_hz == pytest.approx(truth, rel=1e-6)
    # The second frequency grows with the hole, so that a limit of it ends what makes the part lighter.
    assert frequencies(16.5)[1] < truth[1] < frequencies(17.5)[1]
    aim = ["--minimise", "mass", "--subject", f"frequency.2 <= {float(truth[1])!r} Hz", "--vary", f"{key}=14..18mm"]
    assert fmd("optimise", path, *aim, "--out", tmp_path, "--json") == 0
    design = json.loads((tmp_path / "design.json").read_text())
    assert design["parameters"][0]["value"] == pytest.approx(0.017, rel=1e-5)
    found = package.jacobian(package.load(path), ["mass"], [key])
    assert found[0].relative == pytest.approx(-2 * np.pi * 64 * 8e-9 / volume_of(16.0, 6.0), rel=1e-3)

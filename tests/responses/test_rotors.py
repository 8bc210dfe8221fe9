"""Whirl of rotors in bearings against closed forms and a published rotor, and Campbell diagrams as files."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.accuracy.rotor_errors import estimate_frequency_errors
from fmd.core.errors import InputError
from fmd.meshes.gmsh_session import gmsh_model
from fmd.output.campbell import compute_campbell, whirl_word, write_campbell
from fmd.responses.interpolated_models import interpolate_models
from fmd.responses.state_space import Channel, StateSpace
from fmd.responses.whirl import find_circulation
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import coupled, find_vibrations
from fmd.stages.turning import require_one_axis

MASS, POLAR, ACROSS, ARM, RADIAL, DAMPER = 12.0, 0.09, 0.06, 0.2, 4e5, 150.0
SIMULATION = """
[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "TIP"

[[simulation.run]]
integrator = "auto"
"""
RIGID = f"""
title = "Rigid rotor"

[body.rotor]
shape = "rigid"
mass = "{MASS} kg"
inertia = ["{POLAR} kg m^2", "{ACROSS} kg m^2", "{ACROSS} kg m^2"]

[body.rotor.marker]
centre = {{ at = ["0 m", "0 m", "0 m"] }}
near = {{ at = ["{-ARM} m", "0 m", "0 m"] }}
far = {{ at = ["{ARM} m", "0 m", "0 m"] }}

[ground.near]
at = ["{-ARM} m", "0 m", "0 m"]

[ground.far]
at = ["{ARM} m", "0 m", "0 m"]

[joint.float]
type = "free"
parent = "ground"
child = "rotor.centre"

[bearing.near]
between = ["ground.near", "rotor.near"]
axis = [1, 0, 0]
radial = "{RADIAL} N/m"
axial = "1e5 N/m"
radial_damper = "{DAMPER} N s/m"

[bearing.far]
between = ["ground.far", "rotor.far"]
axis = [1, 0, 0]
radial = "{RADIAL} N/m"
radial_damper = "{DAMPER} N s/m"
{SIMULATION.replace("TIP", "rotor.far")}
"""


def rotor(folder: Path, text: str) -> Pipeline:
    (folder / "rotor.toml").write_text(text, encoding="utf-8")
    return Pipeline(load_scene(folder / "rotor.toml"))


def test_waves_around_a_turning_tube_have_no_whirl_and_the_frequencies_of_the_turning_frame() -> None:
    """Bryan (1890): two waves run around a ring that doesn't stretch at 4/5 of its rate above and below."""
    tube = {"shape": "tube", "length": 0.3, "radius": 0.05, "thickness": 0.0015, "E": 210e9, "nu": 0.3, "rho": 7850.0}
    tube["mesh"] = {"divisions": [4, 24]}
    tube |= {"modes": {"count": 2}, "marker": {"near": {"face": "x-"}, "far": {"face": "x+"}}}
    bearing = {
        name: {"between": [f"ground.{name}", f"tube.{name}"], "axis": [1, 0, 0], "radial": 1e6, "axial": 1e6}
        for name in ("near", "far")
    }
    scene = {
        "title": "Tube",
        "body": {"tube": tube},
        "ground": {"near": {"at": [0, 0, 0]}, "far": {"at": [0.3, 0, 0]}},
        "joint": {"float": {"type": "free", "parent": "ground.near", "child": "tube.near"}},
        "bearing": bearing,
        "simulation": {"duration": 1e-3, "output_step": 1e-3, "tip": "tube.far", "run": [{"integrator": "auto"}]},
    }
    run = Pipeline(load_scene(scene))
    at, resting = find_vibrations(coupled(run))(100.0), run.part.modes.frequencies_hz[0]
    pair = [np.abs(at.frequencies_hz - (resting + sense * 80.0 / (2 * np.pi))).argmin() for sense in (-1, 1)]
    apart = np.ptp(at.frequencies_hz[pair])
    assert apart == pytest.approx(160.0 / (2 * np.pi), rel=0.015)
    assert [whirl_word(at.whirl[k]) for k in pair] == ["none", "none"]


@pytest.mark.parametrize("rate", [10.0, 300.0, 2000.0])
def test_a_rigid_rotor_splits_into_forward_and_backward_whirl(tmp_path: Path, rate: float) -> None:
    # Translation: m s² + 2 c s + 2 k = 0. Tilt, as a complex number: I_t s² + (2 c a² − i I_p Ω) s + 2 k a² = 0
    # (Genta, Dynamics of Rotating Systems, 2005, section 4.2), whose roots are forward where they turn with Ω.
    found = find_vibrations(rotor(tmp_path, RIGID))(rate)
    translation = np.roots([MASS, 2 * DAMPER, 2 * RADIAL])
    tilt = np.roots([ACROSS, 2 * DAMPER * ARM**2 - 1j * POLAR * rate, 2 * RADIAL * ARM**2])
    slide = 1j * np.sqrt(1e5 / MASS)
    expected = sorted(
        [(abs(s.imag), np.sign(s.imag), -s.real / abs(s)) for s in (*translation, *tilt)] + [(slide.imag, 0.0, 0.0)]
    )
    omega, whirl, damping = np.array(expected).T
    np.testing.assert_allclose(2 * np.pi * found.frequencies_hz, omega, rtol=1e-9)
    np.testing.assert_allclose(np.sort(found.whirl), np.sort(whirl), atol=1e-7)
    together = np.isclose(omega, abs(translation[0].imag))  # forward and backward, in any order
    np.testing.assert_allclose(found.whirl[~together], whirl[~together], atol=1e-7)
    np.testing.assert_allclose(found.damping, damping, atol=1e-9)


def test_a_motion_to_and_fro_has_no_circulation() -> None:
    turning, line = np.array([[1.0]]), np.array([[2.0 + 0.0j]])
    assert find_circulation(turning, -1j * turning) == pytest.approx([1.0])
    assert find_circulation(turning, 1j * turning) == pytest.approx([-1.0])
    assert find_circulation(turning, line) == pytest.approx([0.0])
    assert find_circulation(0.0 * line, 0.0 * line) == pytest.approx([0.0])
    assert [whirl_word(x) for x in (0.9, -0.9, 0.0)] == ["forward", "backward", "none"]


def test_a_rotor_that_is_not_held_alike_all_around_is_refused(tmp_path: Path) -> None:
    # A spring on one side beside the bearings.
    spring = """
[ground.wall]
at = ["0 m", "1 m", "0 m"]

[spring.side]
between = ["ground.wall", "rotor.far"]
stiffness = "1e5 N/m"
length = "1.02 m"
"""
    with pytest.raises(InputError, match="vary with its angle"):
        find_vibrations(rotor(tmp_path, RIGID + spring))


def test_a_diagram_has_crossings_in_rpm_and_says_how_they_whirl(tmp_path: Path) -> None:
    # A tilting order 2 is met where I_t (2Ω)² ∓ I_p Ω 2Ω = 2 k a², for no damper.
    run = rotor(tmp_path, RIGID.replace(f"{DAMPER} N s/m", "0 N s/m"))
    rates = np.linspace(0.0, 900.0, 7)
    diagram = compute_campbell(run, rates, [2.0], in_rpm=True)
    ahead, behind = (np.sqrt(2 * RADIAL * ARM**2 / (4 * ACROSS + side * 2 * POLAR)) for side in (-1, 1))
    found = {whirl_word(at.whirl): at.rate for at in diagram.crossings if at.rate > 210.0}
    assert found["forward"] == pytest.approx(ahead, rel=1e-8)
    assert found["backward"] == pytest.approx(behind, rel=1e-8)
    assert (diagram.whirl[0] == 0.0).all()
    assert diagram.unstable == ()
    # Order 1 is met by the slide along the axis, by the translation, whose forward whirl stands still in the turning
    # frame, and by tilting backward.
    translation = np.sqrt(2 * RADIAL / MASS)
    once = [np.sqrt(1e5 / MASS), translation, translation, np.sqrt(2 * RADIAL * ARM**2 / (ACROSS + POLAR))]
    met_once = compute_campbell(run, rates, [1.0]).crossings
    assert [at.rate for at in met_once] == pytest.approx(once, rel=1e-8)
    # Each has its own frequency, that of the rotation, also where the mode stands still in the turning frame.
    assert [2 * np.pi * at.frequency_hz for at in met_once] == pytest.approx(once, rel=2e-3)
    unknown = replace(
        diagram, errors_hz=np.full_like(diagram.frequencies_hz, np.nan)
    )  # with more modes, none is beside
    assert [row["error_hz"] for row in unknown.crossing_rows()] == [None] * len(diagram.crossings)
    files = write_campbell(diagram, tmp_path)
    assert files == ["campbell.csv", "campbell.png", "crossings.csv"]
    with (tmp_path / "crossings.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["order", "mode", "rate_rad_s", "rate_rpm", "frequency_hz", "error_hz", "damping", "whirl"]
    assert [float(row[3]) for row in rows] == pytest.approx([at.rate * 30 / np.pi for at in diagram.crossings])
    with (tmp_path / "campbell.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:2] == ["rate_rpm", "mode_1_hz"]
    assert float(rows[-1][0]) == pytest.approx(900 * 30 / np.pi, rel=1e-5)


def test_the_command_tells_rates_in_rpm_where_the_user_does(
    fmd: Any, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "rotor.toml").write_text(RIGID, encoding="utf-8")
    options = ("--points", 4, "--out", tmp_path)
    assert fmd("campbell", tmp_path / "rotor.toml", "--to", "6000 rpm", "--orders", "1,2", *options, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["rate_rpm"] for row in found["rows"]] == pytest.approx([0.0, 2000.0, 4000.0, 6000.0])
    assert {"order", "rate_rpm", "frequency_hz", "whirl"} <= found["crossings"][0].keys()
    assert fmd("campbell", tmp_path / "rotor.toml", "--to", "6000 rpm", "--orders", "1,2", *options) == 0
    shown = capsys.readouterr().out
    assert "↻" in shown
    assert "↺" in shown
    assert "backward" in shown
    assert fmd("campbell", tmp_path / "rotor.toml", "--to", "6000 rpm", "--orders", "1,x", *options) == 2
    assert "numbers above zero" in capsys.readouterr().err


@pytest.mark.slow
def test_a_flexible_rotor_with_two_discs_whirls_as_a_published_one() -> None:
    # Friswell et al. 2010, example 5.9.1, by ROSS 2.3.0 with twelve Timoshenko elements at 4000 rpm [Hz], without
    # torsion and axial motion, which its beams don't have as ours; and with dampers of 500 N s/m in both bearings the
    # damping ratios by its logarithmic decrements.
    run = Pipeline(load_scene("rotor", [f"bearing.{name}.radial_damper=500 N s/m" for name in ("near", "far")]))
    found = find_vibrations(run)(4000 * np.pi / 30)
    first = np.flatnonzero(np.abs(found.whirl) > 0.5)[:4]
    undamped = Pipeline(
        load_scene("rotor", [f"bearing.{name}.radial_damper=0 N s/m" for name in ("near", "far")]), run.store.cache
    )
    without = find_vibrations(undamped)(4000 * np.pi / 30)
    rows = np.flatnonzero(np.abs(without.whirl) > 0.5)[:6]
    expected = [13.59014234, 13.97313078, 40.07219313, 46.90403415, 95.50783889, 131.57487897]
    np.testing.assert_allclose(without.frequencies_hz[rows], expected, rtol=1e-3)
    np.testing.assert_allclose(without.whirl[rows], [-1, 1, -1, 1, -1, 1], atol=1e-3)
    decrements = np.array([0.0506041013, 0.0569679582, 0.282176248, 0.267344389])
    np.testing.assert_allclose(found.damping[first], decrements / np.hypot(2 * np.pi, decrements), rtol=5e-3)


SHAFT = f"""
title = "Shaft that bends unlike in two directions"

[body.first]
shape = "bar"
length = "300 mm"
depth = "12 mm"
width = "16 mm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = {{ divisions = [6, 1, 1] }}
modes = {{ count = 2, enrich = "residual" }}
marker = {{ near = {{ face = "x-" }}, far = {{ face = "x+" }} }}

[body.last]
like = "first"

[body.disc]
shape = "rigid"
mass = "4 kg"
inertia = ["0.02 kg m^2", "0.01 kg m^2", "0.01 kg m^2"]
marker = {{ centre = {{ at = ["0 m", "0 m", "0 m"] }} }}

[ground.near]
at = ["-0.3 m", "0 m", "0 m"]

[ground.far]
at = ["0.3 m", "0 m", "0 m"]

[joint.float]
type = "free"
parent = "ground.near"
child = "first.near"

[joint.disc]
type = "fixed"
parent = "first.far"
child = "disc.centre"

[joint.back]
type = "fixed"
parent = "first.far"
child = "last.near"

[bearing.near]
between = ["ground.near", "first.near"]
axis = [1, 0, 0]
radial = "1e8 N/m"
axial = "1e6 N/m"

[bearing.far]
between = ["ground.far", "last.far"]
axis = [1, 0, 0]
radial = "1e8 N/m"
{SIMULATION.replace("TIP", "disc.centre")}
"""


@pytest.fixture(scope="module")
def shaft_command(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The command's options for a shaft on two bearings with a disc in its middle."""
    folder = tmp_path_factory.mktemp("shaft")
    (folder / "shaft.toml").write_text(SHAFT, encoding="utf-8")
    return folder / "shaft.toml", "--to", "300 rad/s", "--points", 13, "--orders", "1,3", "--out", folder


def test_no_crossing_is_said(tmp_path: Path, fmd: Any, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rotor.toml").write_text(RIGID)
    given = ["--to", "5 rad/s", "--points", "2", "--orders", "1", "--out", tmp_path]
    assert fmd("campbell", tmp_path / "rotor.toml", *given) == 0
    assert "no multiple of the rate meets a frequency up to 5 rad/s" in capsys.readouterr().out


def test_a_rotor_needs_no_simulation_for_its_whirl(tmp_path: Path) -> None:
    tables = []
    for name, text in (("with", RIGID), ("without", RIGID.replace(SIMULATION.replace("TIP", "rotor.far"), ""))):
        assert ("[simulation]" in text) == (name == "with")
        (tmp_path / f"{name}.toml").write_text(text)
        run = Pipeline(load_scene(tmp_path / f"{name}.toml"))
        tables.append(compute_campbell(run, np.array([0.0, 900.0]), []).frequencies_hz)
    np.testing.assert_allclose(tables[1], tables[0], rtol=1e-12)
    assert tables[1][0].min() == pytest.approx(np.sqrt(1e5 / MASS) / (2.0 * np.pi), rel=1e-6)  # along the axis


@pytest.mark.slow
def test_a_shaft_that_bends_unlike_in_two_directions_grows_between_its_two_critical_rates(
    fmd: Any, capsys: pytest.CaptureFixture[str], shaft_command: Any
) -> None:
    # In the turning frame (s² + ω₁² − Ω²)(s² + ω₂² − Ω²) + 4 Ω² s² = 0 has a real pole for ω₁ < Ω < ω₂
    # (Genta, Dynamics of Rotating Systems, 2005, section 6.3); ω² = 48 E I / (L³ (m + 17/35 m_shaft)), by Rayleigh.
    mass = 4.0 + 17 / 35 * 7850 * 0.012 * 0.016 * 0.6
    low, high = (np.sqrt(48 * 210e9 * b * d**3 / 12 / (0.6**3 * mass)) for b, d in ((0.016, 0.012), (0.012, 0.016)))
    rates = np.linspace(low, high, 401)[1:-1]
    roots = [np.roots([1.0, low**2 + high**2 + 2 * r**2, (low**2 - r**2) * (high**2 - r**2)]).max() for r in rates]
    assert fmd("campbell", *shaft_command, "--json", "--no-budget") == 0
    found = json.loads(capsys.readouterr().out)
    (unstable,) = found["unstable"]
    assert (unstable["from_rad_s"], unstable["to_rad_s"]) == pytest.approx((low, high), rel=5e-3)
    assert unstable["growth_1_s"] == pytest.approx(np.sqrt(max(roots)), rel=0.05)  # the largest of the rates looked at
    assert [warning["code"] for warning in found["warnings"]] == ["unstable-rotation"]
    there = next(row for row in found["rows"] if row["rate_rad_s"] == pytest.approx(175.0))
    forward = int(np.argmax(there["growth_1_s"]))
    square = np.roots([1.0, low**2 + high**2 + 2 * 175**2, (low**2 - 175**2) * (high**2 - 175**2)]).max()
    assert there["growth_1_s"][forward] == pytest.approx(np.sqrt(square), rel=0.02)
    assert there["frequency_hz"][forward] == pytest.approx(175.0 / (2 * np.pi), rel=1e-12)  # carried round
    assert there["whirl"][forward] == 1.0
    assert len({len(row["frequency_hz"]) for row in found["rows"]}) == 2  # two real poles for one pair
    few = ("--to", "350 rad/s", "--points", 3, *shaft_command[-2:])
    assert fmd("campbell", shaft_command[0], *few, "--no-budget") == 0
    assert "grows by itself, by up to 2" in capsys.readouterr().out


def test_a_diagram_is_that_of_the_models_between_which_it_is_interpolated(tmp_path: Path) -> None:
    run = rotor(tmp_path, RIGID)
    between, computed = find_vibrations(run, 2000.0), find_vibrations(run)
    for rate in (3.0, 777.0, 1999.0):
        one, other = between(rate), computed(rate)
        np.testing.assert_allclose(one.frequencies_hz, other.frequencies_hz, rtol=1e-8)
        np.testing.assert_allclose(one.growth, other.growth, rtol=1e-8, atol=1e-9)


def test_models_that_no_polynomial_follows_are_interpolated_piece_by_piece() -> None:
    def model(x: float) -> StateSpace:
        A = np.array([[0.0, 1.0], [-(100.0 + 30.0 * np.tanh(3.0 * (x - 2.0))), -0.1 * x]])
        states = (Channel("q", "m"), Channel("q.rate", "m/s"))
        return StateSpace(A, np.zeros((2, 0)), np.array([[1.0, x]]), np.zeros((1, 0)), states, (), (Channel("y", "m"),))

    at = interpolate_models(model, 0.0, 5.0)
    for x in np.linspace(0.0, 5.0, 23):
        A, C = at(float(x))
        np.testing.assert_allclose(A, model(x).A, rtol=2e-7, atol=1e-9)
        np.testing.assert_allclose(C, [[1.0, x]], atol=1e-12)


def test_a_model_that_jumps_is_computed_wherever_it_is_asked_for_near_the_jump() -> None:
    def model(x: float) -> StateSpace:
        A = np.array([[0.0, 1.0], [-(100.0 if x < 1.0 else 400.0), 0.0]])
        states = (Channel("q", "m"), Channel("q.rate", "m/s"))
        return StateSpace(A, np.zeros((2, 0)), np.zeros((0, 2)), np.zeros((0, 0)), states, (), ())

    at = interpolate_models(model, 0.0, 5.0)
    assert [at(x)[0][1, 0] for x in (0.9, 0.999, 1.0, 1.001, 4.0)] == pytest.approx([-100, -100, -400, -400, -400])


def test_a_second_hinge_off_the_axis_is_refused_before_anything_is_reduced() -> None:
    run = Pipeline(load_scene("four-bar"))
    with pytest.raises(InputError, match=r"joint\.A: what holds the rotor beside this joint isn't the same all around"):
        find_vibrations(run)
    assert not any(part.results for part in run.parts.values())
    require_one_axis(load_scene("four-bar", ['ground.D.at=["0 mm", "0 mm", "240 mm"]']))  # on the axis


ROUND = """
title = "Round shaft"
[body.shaft]
mesh = { cad = "shaft.step", size = "30 mm" }
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
modes = { count = 6 }
marker = { near = { face = "xmin" }, far = { face = "xmax" } }
[ground]
near = { at = ["0 m", "0 m", "0 m"] }
far = { at = ["150 mm", "0 m", "0 m"] }
[joint.float]
type = "free"
parent = "ground.near"
child = "shaft.near"
[bearing.near]
between = ["ground.near", "shaft.near"]
axis = [1, 0, 0]
radial = "20 N/um"
axial = "5 N/um"
[bearing.far]
between = ["ground.far", "shaft.far"]
axis = [1, 0, 0]
radial = "20 N/um"
"""


@pytest.fixture(scope="module")
def round_shaft(tmp_path_factory: pytest.TempPathFactory) -> Pipeline:
    """A round shaft of tetrahedra, whose mesh isn't the same all around."""
    folder = tmp_path_factory.mktemp("round")
    with gmsh_model("shaft") as gmsh:
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.model.occ.addCylinder(0, 0, 0, 150, 0, 0, 15)
        gmsh.model.occ.synchronize()
        gmsh.write(str(folder / "shaft.step"))
    return coupled(rotor(folder, ROUND))


@pytest.mark.slow
def test_torsion_keeps_its_frequency_at_any_rate_also_on_a_mesh_that_is_not_the_same_all_around(
    round_shaft: Pipeline,
) -> None:
    # Half a wave of torsion between free ends: √(G/ρ) / (2 L).
    torsion = np.sqrt(210e9 / 2.6 / 7850) / (2 * 0.15)
    vibrations = find_vibrations(round_shaft)
    for rate in (0.0, 200.0, 700.0):
        found = vibrations(rate)
        k = int(np.abs(found.frequencies_hz - torsion).argmin())
        assert found.frequencies_hz[k] == pytest.approx(torsion, rel=5e-4)  # as whirl it would be 3e-3 off, or more
        assert found.whirl[k] == 0.0


@pytest.mark.slow
def test_a_mesh_that_is_no_coarser_with_larger_elements_has_errors_by_recovered_stress(round_shaft: Pipeline) -> None:
    # Of 200 mm, or 400, the round faces leave nothing: both meshes are one, whose difference is 0.
    run = coupled(
        Pipeline(load_scene(round_shaft.scene.file, ["body.shaft.mesh.size=200 mm"]), round_shaft.store.cache)
    )
    own, finer = (find_vibrations(each)(0.0).frequencies_hz[:6] for each in (run, round_shaft))
    stated = estimate_frequency_errors(run, np.zeros(1), own[None])
    assert not isinstance(stated, str)
    true = np.abs(own - finer)  # from 4 to 76 %: the mesh has a few elements in all
    assert (true <= stated[0]).all()
    assert (stated[0] < 10 * true).sum() >= 3

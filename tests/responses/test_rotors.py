"""Whirl of rotors in bearings against closed forms and a published rotor, and Campbell diagrams as files."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.output.campbell import compute_campbell, whirl_word, write_campbell
from fmd.responses.whirl import find_circulation
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import find_vibrations

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
    files = write_campbell(diagram, tmp_path)
    assert files == ["campbell.csv", "campbell.png", "crossings.csv"]
    with (tmp_path / "crossings.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["order", "mode", "rate_rad_s", "rate_rpm", "frequency_hz", "damping", "whirl"]
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

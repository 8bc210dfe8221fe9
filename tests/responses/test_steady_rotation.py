"""Rotors of several bodies, linearised where they turn steadily, against beams of their own and closed forms."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline
from fmd.stages.rotor import find_vibrations
from fmd.stages.turning import TurningRotor
from tests.verification.tension_beams import beam_matrices

LENGTH, DEPTH, WIDTH, E, RHO, TIP = 1.0, 20e-3, 6e-3, 70e9, 2700.0, 0.5
ARM = f"""
title = "Arm with a mass at its tip"

[body.arm]
shape = "bar"
length = "{LENGTH} m"
depth = "{DEPTH} m"
width = "{WIDTH} m"
E = "{E} Pa"
nu = 0.0
rho = "{RHO} kg/m^3"
mesh = {{ element = "hexahedron", order = 2, divisions = [16, 1, 1] }}
modes = {{ count = 6 }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}

[body.mass]
shape = "rigid"
mass = "{TIP} kg"
inertia = ["1e-6 kg m^2", "1e-6 kg m^2", "1e-6 kg m^2"]
marker = {{ centre = {{ at = ["0 m", "0 m", "0 m"] }} }}

[joint.hub]
type = "revolute"
parent = "ground"
child = "arm.root"
axis = [0, 0, 1]

[joint.weld]
type = "fixed"
parent = "arm.tip"
child = "mass.centre"

[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "mass.centre"

[[simulation.run]]
integrator = "auto"
"""
N_BEAMS = 40


def run_of(folder: Path, text: str, *changes: str) -> Pipeline:
    (folder / "rotor.toml").write_text(text, encoding="utf-8")
    return Pipeline(load_scene(folder / "rotor.toml", list(changes)))


def bending(rate: float, depth: float, width: float) -> Array:
    """Lowest frequencies of the arm that bends across its width, if not turned [Hz]: what is outside pulls it."""
    h, line = LENGTH / N_BEAMS, RHO * depth * width
    x = (np.arange(N_BEAMS) + 0.5) * h
    tension = rate**2 * (TIP * LENGTH + 0.5 * line * (LENGTH**2 - x**2))
    K, M = beam_matrices(N_BEAMS, h, E * depth * width**3 / 12, line, tension)
    M[-2, -2] += TIP
    return np.asarray(np.sqrt(eigh(K[2:, 2:], M[2:, 2:], eigvals_only=True)[:2]) / (2 * np.pi))


TURN = """
[drive.turn]
type = "motion"
joint = "hub"
angle = { formula = "20*t", unit = "rad" }
"""


@pytest.mark.parametrize("motion", ["", TURN], ids=["free", "prescribed"])
def test_an_arm_is_pulled_by_what_it_carries(tmp_path: Path, motion: str) -> None:
    # Its modes alone have 1.82 Hz at rest with the mass, 4.94 Hz without. No load of the scene turns or stiffens it.
    vibrations = find_vibrations(run_of(tmp_path, ARM + motion))
    for rate in (0.0, 20.0, 60.0):
        found, (first, second) = vibrations(rate).frequencies_hz, bending(rate, DEPTH, WIDTH)
        assert np.abs(found / first - 1.0).min() < 2e-3
        assert np.abs(found / second - 1.0).min() < 6e-3
        if motion:  # in the plane, the pull at the tip keeps its direction from the axis
            lag = np.sqrt(bending(rate, WIDTH, DEPTH)[0] ** 2 - (rate / (2 * np.pi)) ** 2)
            assert np.abs(found / lag - 1.0).min() < 2e-3


def test_hinged_blades_flap_as_closed_form_has_it() -> None:
    # Rigid blades on hinges at e from the axis flap at Ω √(1 + 3 e / 2 L) (Johnson, Helicopter Theory, section 2-9).
    found = find_vibrations(Pipeline(load_scene("hinged-rotor")))(20.0).frequencies_hz
    assert found[:2] == pytest.approx(20.0 * np.sqrt(1 + 1.5 * 0.08 / 0.8) / (2 * np.pi), rel=2e-3)


SHAFT, SIDE, STEEL, DENSITY, SOFT = 0.8, 12e-3, 210e9, 7800.0, 4e4
DISC, POLAR, ACROSS = 2.0, 0.01, 0.0052


def overhung(turn: str = "0 deg", end: str = f'"{SHAFT} m", "0 m", "0 m"', more: str = "", axial: float = 1e6) -> str:
    """Return a rotor with its disc at the end that a soft bearing holds; its axis turned about z from x."""
    return f"""
title = "Rotor with a disc at its end"

[body.shaft]
shape = "bar"
length = "{SHAFT} m"
depth = "{SIDE} m"
width = "{SIDE} m"
E = "{STEEL} Pa"
nu = 0.0
rho = "{DENSITY} kg/m^3"
mesh = {{ element = "hexahedron", order = 2, divisions = [12, 2, 2] }}
modes = {{ count = 6 }}
marker = {{ near = {{ face = "x-" }}, far = {{ face = "x+" }} }}

[body.disc]
shape = "rigid"
mass = "{DISC} kg"
inertia = ["{POLAR} kg m^2", "{ACROSS} kg m^2", "{ACROSS} kg m^2"]
marker = {{ centre = {{ at = ["0 m", "0 m", "0 m"] }} }}

[ground.near]
at = ["0 m", "0 m", "0 m"]
rotate = ["0 deg", "0 deg", "{turn}"]

[ground.far]
at = [{end}]
rotate = ["0 deg", "0 deg", "{turn}"]

[joint.float]
type = "free"
parent = "ground.near"
child = "shaft.near"

[joint.disc]
type = "fixed"
parent = "shaft.far"
child = "disc.centre"

[bearing.near]
between = ["ground.near", "shaft.near"]
axis = [1, 0, 0]
radial = "2e6 N/m"
axial = "{axial} N/m"

[bearing.far]
between = ["ground.far", "shaft.far"]
axis = [1, 0, 0]
radial = "{SOFT} N/m"
{more}
[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "disc.centre"

[[simulation.run]]
integrator = "auto"
"""


def whirls(rate: float, tension: float = 0.0) -> Array:
    """Whirls of the overhung rotor [Hz], backward ones negative: ``M ẅ − i Ω G ẇ + K w = 0`` of complex deflections.

    Of Rayleigh's beam the polar inertia of a section is twice that across (Genta, Dynamics of Rotating Systems, 4.6).
    """
    n = 30
    h, line, second = SHAFT / n, DENSITY * SIDE**2, SIDE**4 / 12
    K, M = beam_matrices(n, h, STEEL * second, line, np.full(n, tension))
    tilt, _ = beam_matrices(n, h, 0.0, 0.0, np.full(n, DENSITY * second))
    M, G = M + tilt, 2.0 * tilt
    M[-2, -2] += DISC
    M[-1, -1] += ACROSS
    G[-1, -1] += POLAR
    K[0, 0] += 2e6
    K[-2, -2] += SOFT
    none, one = np.zeros_like(K), np.eye(len(K))
    A = np.block([[none, one], [-np.linalg.solve(M, K), 1j * rate * np.linalg.solve(M, G)]])
    poles = np.linalg.eigvals(A).imag
    return np.asarray(poles[np.argsort(np.abs(poles))][:4] / (2 * np.pi))


ALONG_Y = {"turn": "90 deg", "end": f'"0 m", "{SHAFT} m", "0 m"'}
PUSH = """
[drive.push]
type = "point force"
marker = "disc.centre"
direction = [1, 0, 0]
force = "-2000 N"
"""


@pytest.mark.parametrize(
    ("text", "tension"),
    [(overhung(), 0.0), (overhung(**ALONG_Y), 0.0), (overhung(axial=0.0), 0.0), (overhung(more=PUSH), -2000.0)],
    ids=["along x", "along y", "free to slide", "pushed"],
)
def test_an_overhung_disc_whirls_as_a_beam_of_its_own_has_it(tmp_path: Path, text: str, tension: float) -> None:
    # All terms of second order count: about the undeformed state they would make frequencies of 24 to 37 Hz.
    vibrations = find_vibrations(run_of(tmp_path, text))
    for rate in (0.0, 300.0):
        found = vibrations(rate)
        bends = np.abs(found.frequencies_hz - np.sqrt(1e6 / 2.9) / (2 * np.pi)) > 3.0  # without the axial motion
        expected = whirls(rate, tension)
        np.testing.assert_allclose(found.frequencies_hz[bends][:4], np.abs(expected), rtol=4e-3)
        if rate:
            np.testing.assert_array_equal(np.sign(found.whirl[bends][:4]), np.sign(expected))


def test_the_whole_rotor_is_at_rest_in_its_own_axes(tmp_path: Path) -> None:
    # Newton's and Euler's laws: the accelerations that are left are round-off beside those of the undeformed state.
    rotor = TurningRotor(run_of(tmp_path, overhung()), in_bearings=True)
    before, after = (np.abs(rotor.steady.accelerations(300.0, q)).max() for q in (rotor.rest, rotor.find(300.0)))
    assert before > 100.0
    assert after < 1e-9 * before


def test_a_rotor_out_of_balance_is_refused_with_its_eccentricity(tmp_path: Path) -> None:
    # About a straight axis, 1 mm would shift whirls by 6 % at 1500 rad/s. The shaft weighs little beside the disc.
    centre = 'centre = { at = ["0 m", "0 m", "0 m"] }'
    assert centre in overhung()
    text = overhung().replace(centre, 'centre = { at = ["0 m", "-1 mm", "0 m"] }')
    # Its whirl at 587 rad/s yields to it by a little: 0.99 mm / (1 + (587 / 3000)²).
    with pytest.raises(InputError, match=r"a centre of mass 0\.95 mm off the axis"):
        find_vibrations(run_of(tmp_path, text))(300.0)


def test_a_rotor_that_a_load_turns_ever_faster_is_refused(tmp_path: Path) -> None:
    torque = PUSH.replace("force", "torque").replace("-2000 N", "10 N m")
    with pytest.raises(InputError, match="no steady rotation"):
        find_vibrations(run_of(tmp_path, overhung(more=torque)))(10.0)


def test_without_a_hinge_on_the_ground_nothing_tells_the_axis(tmp_path: Path) -> None:
    text = ARM.replace('"revolute"', '"spherical"').replace("axis = [0, 0, 1]\n", "")
    with pytest.raises(InputError, match=r"joint\.hub\.type.*axis of rotation"):
        find_vibrations(run_of(tmp_path, text))


def test_a_rotor_on_a_hub_whose_spring_is_on_one_side_is_refused(tmp_path: Path) -> None:
    spring = '[spring.side]\nbetween = ["ground", "mass.centre"]\nstiffness = "10 N/m"\nlength = "0.5 m"\n'
    place = '[ground.wall]\nat = ["2 m", "0 m", "0 m"]\n'
    with pytest.raises(InputError, match="vary with the angle"):
        find_vibrations(run_of(tmp_path, ARM + place + spring.replace('"ground"', '"ground.wall"')))

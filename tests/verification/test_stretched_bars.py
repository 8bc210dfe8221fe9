"""Bars that are held at both ends: stretched by their own deflection, and buckling as their ends are guided."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from fmd import Pipeline, load_scene
from fmd.accuracy.deflection import stretching_warnings
from fmd.core.errors import InputError
from fmd.dynamics.kinematics import Kinematics
from fmd.stages.linear_model import linearise_scene
from tests.verification.tension_beams import beam_matrices

LENGTH, WIDTH, HEIGHT, E = 1.0, 0.02, 0.006, 70e9
EI, EA, LOAD = E * WIDTH * HEIGHT**3 / 12, E * WIDTH * HEIGHT, 20.0

HALF = """
[body.NAME]
shape = "bar"
depth = "20 mm"
width = "6 mm"
E = "70 GPa"
nu = 0.0
rho = "2700 kg/m^3"
length = "LENGTH m"
mesh = { element = "hexahedron", order = 2, divisions = [20, 1, 1] }
modes = { count = 4, boundary = "joint", enrich = "inertia" }
marker = { root = { face = "x-" }, tip = { face = "x+" }, middle = { at = ["0.5 m", "0 m", "0 m"] } }
"""
REST = """
[joint.root]
type = "fixed"
parent = "ground"
child = "left.root"
[ground.wall]
at = ["1 m", "0 m", "0 m"]
[drive.push]
type = "point force"
marker = "left.middle"
direction = [0, 0, 1]
force = "20 N"
[simulation]
duration = "10 ms"
output_step = "1 ms"
tip = "left.middle"
start = "equilibrium"
run = [{ integrator = "auto" }]
"""
WHOLE = HALF.replace("NAME", "left").replace("LENGTH", "1")
LEFT, RIGHT = (
    HALF.replace("NAME", name).replace("LENGTH", "0.5").replace("[20,", "[16,") for name in ("left", "right")
)
WELD = '[joint.wall]\ntype = "fixed"\nparent = "ground.wall"\nchild = "{}.tip"\n'
BUSHING = """
[bushing.wall]
between = ["ground.wall", "left.tip"]
stiffness = ["1e10 N/m", "1e10 N/m", "1e10 N/m", "1e8 N m/rad", "1e8 N m/rad", "1e8 N m/rad"]
"""
MIDDLE = '[joint.middle]\ntype = "fixed"\nparent = "left.tip"\nchild = "right.root"\n'
SCENES = {
    "a joint that closes a loop": WHOLE + REST + WELD.format("left"),
    "a stiff bushing": WHOLE + REST + BUSHING,
    "two bars in a row": LEFT + RIGHT.replace(", middle", ", other") + REST + MIDDLE + WELD.format("right"),
}


def stretched_deflection() -> float:
    """Deflection in the middle under a force there, with the tension that it causes [m].

    ``EI w‴ − N w′ = −P/2`` with w′ = 0 at the wall and in the middle, and ``N = EA/2L ∫ w′² dx`` (von Kármán).
    """
    s = np.linspace(0.0, LENGTH / 2, 2001)

    def slopes(N: float) -> np.ndarray:
        k = np.sqrt(N / EI)
        return np.asarray(LOAD / (2 * N) * (1 - np.cosh(k * (s - LENGTH / 4)) / np.cosh(k * LENGTH / 4)))

    tension = brentq(lambda N: EA / LENGTH * np.trapezoid(slopes(N) ** 2, s) - N, 1e-3 * EI, 1e4 * EI)
    return float(np.trapezoid(slopes(tension), s))


@pytest.mark.parametrize("held_by", SCENES)
def test_a_bar_between_two_walls_is_stretched_by_its_own_deflection(tmp_path: Path, held_by: str) -> None:
    file = tmp_path / "bar.toml"
    file.write_text('title = "Between walls"\n' + SCENES[held_by])
    run = Pipeline(load_scene(file))
    q, v = run.start
    found = Kinematics(run.mechanism, np.zeros(1), q[None], v[None]).displacement(0, "middle")[0, 2]
    linear, exact = LOAD * LENGTH**3 / (192 * EI), stretched_deflection()
    assert linear > 1.2 * exact
    assert found == pytest.approx(exact, rel=0.015)


# Loads along a bar between two walls ---------------------------------------------------------------------------------

UPRIGHT = ('depth = "20 mm"\nwidth = "6 mm"', 'depth = "6 mm"\nwidth = "20 mm"')
"""Sections that bend across the plane to which the scene's joints and loads keep, and in it."""


def half_loaded(load: float) -> tuple[float, float]:
    """First frequency [Hz] of a clamped bar under a load along it in its middle, and its part of the buckling load.

    By forty cubic elements: one half is pulled, one pushed, by half of the load each.
    """
    n = 40
    tension = np.where(np.arange(n) < n // 2, 0.5 * load, -0.5 * load)
    K, M = beam_matrices(n, LENGTH / n, EI, 2700.0 * WIDTH * HEIGHT, tension)
    bend, _ = beam_matrices(n, LENGTH / n, EI, 0.0, np.zeros(n))
    free = slice(2, -2)
    lowest = eigh(K[free, free], M[free, free], eigvals_only=True)[0]
    softest = eigh((K - bend)[free, free], bend[free, free], eigvals_only=True)[0]
    return float(np.sqrt(lowest) / (2 * np.pi)), -float(softest)


@pytest.mark.parametrize(
    ("section", "load"),
    [
        pytest.param(UPRIGHT[0], 4000.0, id="across"),
        pytest.param(UPRIGHT[1], -4000.0, id="in plane", marks=pytest.mark.long),
    ],
)
def test_a_load_along_a_bar_goes_to_both_walls(tmp_path: Path, section: str, load: float) -> None:
    # Rigid bodies leave it open; all of it on one wall, half the bar would be pushed twice as much, or not at all.
    text = SCENES["two bars in a row"].replace('depth = "20 mm"\nwidth = "6 mm"', section)
    text = text.replace("direction = [0, 0, 1]", "direction = [1, 0, 0]").replace("20 N", f"{load} N")
    text = text.replace("left.middle", "left.tip")
    (tmp_path / "bar.toml").write_text('title = "Between walls"\n' + text)
    run = Pipeline(load_scene(tmp_path / "bar.toml"))
    frequency, part = half_loaded(load)
    changes = run.stiffness_changes
    assert changes["right" if load > 0 else "left"].buckling == pytest.approx(part, rel=0.01)
    assert changes["left" if load > 0 else "right"].buckling < 1e-3
    poles = linearise_scene(run, [], [], "equilibrium").model.poles.imag
    assert poles[poles > 1.0].min() / (2 * np.pi) == pytest.approx(frequency, rel=0.005)


def test_a_bar_between_two_supports_is_told_how_far_off_it_is_and_what_would_be_right(tmp_path: Path) -> None:
    # Supports hold it in its own frame, where nothing takes up the stretch.
    supports = 'support = [{ face = "x-" }, { face = "x+" }]\nmesh ='
    text = WHOLE.replace("mesh =", supports).replace('boundary = "joint", ', "") + REST.replace(
        "left.root", "left.middle"
    )
    file = tmp_path / "bar.toml"
    file.write_text('title = "Between supports"\n' + text)
    (warning,) = stretching_warnings(Pipeline(load_scene(file)), 0.01)
    linear = LOAD * LENGTH**3 / (192 * EI)
    stated = float(warning["text"].split()[-2]) / 100
    assert stated == pytest.approx(linear / stretched_deflection() - 1, rel=0.1)
    assert "a fixed joint on the ground holds instead of a support" in warning["text"]


# Columns whose ends are guided ---------------------------------------------------------------------------------------

COLUMN = """
[body.left]
shape = "bar"
length = "1 m"
depth = "6 mm"
width = "20 mm"
E = "70 GPa"
nu = 0.0
rho = "2700 kg/m^3"
mesh = { element = "hexahedron", order = 2, divisions = [20, 1, 1] }
modes = { count = 4, family = "in-plane bending", boundary = "joint", enrich = "inertia" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }
[joint.root]
ROOT
parent = "ground"
child = "left.root"
[ground.wall]
at = ["1 m", "0 m", "0 m"]
[joint.wall]
GUIDE
parent = "ground.wall"
child = "left.tip"
[drive.push]
type = "point force"
marker = "left.tip"
direction = [-1, 0, 0]
force = "LOAD N"
[simulation]
duration = "1 s"
output_step = "1 ms"
tip = "left.tip"
run = [{ integrator = "auto" }]
"""
CLAMP, HINGE = 'type = "fixed"', 'type = "revolute"\naxis = [0, 0, 1]'
SLIDE, LINE = 'type = "prismatic"\naxis = [1, 0, 0]', 'type = "point-on-line"\naxis = [1, 0, 0]'


@pytest.mark.parametrize(
    ("root", "guide", "length"), [(CLAMP, SLIDE, 0.5), (HINGE, LINE, 1.0), (CLAMP, LINE, 0.699156)]
)
def test_a_guided_column_buckles_at_the_load_of_its_own_ends(
    tmp_path: Path, root: str, guide: str, length: float
) -> None:
    file, bears = tmp_path / "column.toml", np.pi**2 * EI / length**2  # the free length of Euler's cases
    for part in (0.9, 1.1):
        text = COLUMN.replace("ROOT", root).replace("GUIDE", guide).replace("LOAD", str(part * bears))
        file.write_text('title = "Column"\n' + text)
        run = Pipeline(load_scene(file))
        change = run.stiffness_changes["left"]
        assert change.buckling == pytest.approx(part, rel=0.01)
        assert (change.growth > 0.0) == (part > 1.0)
    with pytest.raises(InputError, match=r"would buckle: .* up to 1\.[01][0-9]* times what it bears"):
        _ = run.motions


WHEEL_AND_NEEDLE = """
[body.wheel]
shape = "rigid"
mass = "1000 kg"
inertia = ["500 kg m^2", "500 kg m^2", "1000 kg m^2"]
marker = { at = { at = ["0 m", "0 m", "0 m"] } }
[joint.axle]
type = "revolute"
parent = "ground"
child = "wheel.at"
axis = [0, 0, 1]
[body.needle]
shape = "rigid"
mass = "1 g"
inertia = ["1e-9 kg m^2", "1e-6 kg m^2", "1e-6 kg m^2"]
marker = { at = { at = ["0 m", "0 m", "0 m"] } }
[joint.ball]
type = "spherical"
parent = "ground"
child = "needle.at"
"""


def test_a_guided_column_bears_as_much_beside_what_turns_with_much_and_with_little_inertia(tmp_path: Path) -> None:
    """The needle's turning about its axis counted as an elastic motion without stiffness, a traceback of SciPy."""
    file, bears = tmp_path / "column.toml", np.pi**2 * EI
    text = COLUMN.replace("ROOT", HINGE).replace("GUIDE", LINE).replace("LOAD", str(0.9 * bears))
    file.write_text('title = "Column"\n' + text.replace('"1 s"', '"10 ms"') + WHEEL_AND_NEEDLE)
    change = Pipeline(load_scene(file)).stiffness_changes["left"]
    assert change.buckling == pytest.approx(0.9, rel=0.01)


# A wall that moves ---------------------------------------------------------------------------------------------------

MOVING = """
[body.car]
shape = "point"
mass = "1 kg"
marker = { at = { at = ["0 m", "0 m", "0 m"] } }
[joint.slide]
type = "prismatic"
parent = "ground.wall"
child = "car.at"
axis = [1, 0, 0]
[drive.pull]
type = "motion"
joint = "slide"
position = { formula = "0.05*t", unit = "m" }
[joint.grip]
type = "fixed"
parent = "car.at"
child = "left.tip"
"""


def first_frequency(tension: float) -> float:
    """First root ω of the characteristic equation of a clamped bar under tension [rad/s].

    With ``(a² − b²) EI = N`` and ``a² b² EI = μ ω²``, L = 1:
    ``2ab (1 − cosh a cos b) + (a² − b²) sinh a sin b = 0``.
    """
    mu, half = 2700.0 * WIDTH * HEIGHT, tension / (2 * EI)

    def lack(omega: float) -> float:
        whole = np.sqrt(half**2 + mu * omega**2 / EI)
        a, b = np.sqrt(whole + half), np.sqrt(whole - half)
        return float(2 * a * b * (1 / np.cosh(a) - np.cos(b)) + 2 * half * np.tanh(a) * np.sin(b))

    lowest = np.pi * np.sqrt(tension / mu)  # of a string without stiffness, twice which is its second one
    return float(brentq(lack, lowest, 1.7 * lowest))


def test_a_bar_that_its_wall_stretches_sounds_as_one_under_that_tension(tmp_path: Path) -> None:
    file, t = tmp_path / "bar.toml", 0.01
    text = WHOLE + REST.replace('start = "equilibrium"', "").replace("20 N", "1 mN") + MOVING
    file.write_text('title = "Between walls"\n' + text)
    model = linearise_scene(Pipeline(load_scene(file)), [], [], str(t)).model
    poles = model.poles.imag
    assert poles[poles > 1.0].min() == pytest.approx(first_frequency(EA * 0.05 * t / LENGTH), rel=0.01)


ROOT = 'type = "fixed"\nparent = "ground"'
GRIP = 'type = "fixed"\nparent = "car.at"'


def hinged(joint: str) -> str:
    return joint.replace('type = "fixed"', 'type = "revolute"\naxis = [0, 1, 0]')


def test_a_bar_on_two_hinges_sounds_as_one_under_the_tension_of_its_moving_wall(tmp_path: Path) -> None:
    # Its hinges turn, yet no turn of rigid bodies closes the gap that the wall opens. ω² μ = (π/L)² N + (π/L)⁴ EI
    file, t = tmp_path / "bar.toml", 0.01
    text = WHOLE + REST.replace('start = "equilibrium"', "").replace("20 N", "1 mN") + MOVING
    text = text.replace(ROOT, hinged(ROOT)).replace(GRIP, hinged(GRIP))
    file.write_text('title = "Between hinges"\n' + text)
    model = linearise_scene(Pipeline(load_scene(file)), [], [], str(t)).model
    poles, mu = model.poles.imag, 2700.0 * WIDTH * HEIGHT
    exact = np.sqrt(((np.pi / LENGTH) ** 2 * EA * 0.05 * t / LENGTH + (np.pi / LENGTH) ** 4 * EI) / mu)
    assert poles[poles > 1.0].min() == pytest.approx(exact, rel=2e-3)

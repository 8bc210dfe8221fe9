"""Gears, slides that move together, racks, distances and points on lines in scenes, against closed forms."""

from pathlib import Path

import numpy as np
import pytest

from fmd.core.errors import InputError
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline

WHEELS = """
title = "Wheels"

[body.pinion]
shape = "rigid"
mass = "1 kg"
inertia = ["0.01 kg m^2", "0.01 kg m^2", "0.02 kg m^2"]
marker = { hub = { at = ["0 m", "0 m", "0 m"] } }

[body.wheel]
shape = "rigid"
mass = "3 kg"
inertia = ["0.05 kg m^2", "0.05 kg m^2", "0.1 kg m^2"]
marker = { hub = { at = ["0 m", "0 m", "0 m"] } }

[body.slide]
shape = "point"
mass = "2 kg"
marker = { eye = { at = ["0 m", "0 m", "0 m"] } }

[joint.driver]
type = "revolute"
parent = "ground"
child = "pinion.hub"
axis = [0, 0, 1]

[joint.driven]
type = "revolute"
parent = "ground"
child = "wheel.hub"
axis = [0, 0, 1]

[joint.guide]
type = "prismatic"
parent = "ground"
child = "slide.eye"
axis = [1, 0, 0]

[drive.torque]
type = "torque"
joint = "driver"
torque = "0.5 N m"

[simulation]
duration = "1 s"
output_step = "0.1 s"
tip = "slide.eye"

[[simulation.run]]
integrator = "runge-kutta"
"""
GEAR = """
[coupler.gears]
type = "gear"
joint = "driven"
driver = "driver"
ratio = -0.5
"""
RACK = """
[coupler.steering]
type = "rack"
rack = "guide"
pinion = "driver"
radius = "100 mm"
"""


def run_of(folder: Path, text: str) -> Pipeline:
    (folder / "scene.toml").write_text(text)
    return Pipeline(load_scene(folder / "scene.toml"))


def test_a_gear_and_a_rack_add_their_inertia_by_the_square_of_their_ratios(tmp_path: Path) -> None:
    motion = run_of(tmp_path, WHEELS + GEAR + RACK).motion
    inertia = 0.02 + 0.1 * 0.5**2 + 2.0 * 0.1**2
    angle = 0.5 * 0.5 / inertia * motion.times**2
    assert motion.joint_position("driver") == pytest.approx(angle, abs=1e-10)
    assert motion.joint_position("driven") == pytest.approx(-0.5 * angle, abs=1e-10)
    assert motion.joint_position("guide") == pytest.approx(0.1 * angle, abs=1e-10)


JAW = """
[body.jaw]
shape = "point"
mass = "1 kg"
marker = { eye = { at = ["0 m", "0 m", "0 m"] } }

[joint.jaw]
type = "prismatic"
parent = "ground"
child = "jaw.eye"
axis = [0, 1, 0]
position = "0.2 m"

[coupler.jaws]
type = "slides"
joint = "jaw"
driver = "guide"
ratio = -3.0
offset = "0.2 m"

[drive.push]
type = "force"
joint = "guide"
force = "11 N"
"""


def test_slides_that_move_together_add_their_masses_by_the_square_of_their_ratio(tmp_path: Path) -> None:
    motion = run_of(tmp_path, WHEELS + JAW).motion
    assert motion.joint_position("guide") == pytest.approx(0.5 * 11 / (2 + 9 * 1) * motion.times**2, abs=1e-10)
    assert motion.joint_position("jaw") == pytest.approx(0.2 - 3 * motion.joint_position("guide"), abs=1e-10)


GRIPPER = """
title = "Gripper"

[body.arm]
shape = "rigid"
mass = "3 kg"
inertia = ["0.05 kg m^2", "0.05 kg m^2", "0.1 kg m^2"]
centre = ["0.2 m", "0 m", "0 m"]
marker = { hub = { at = ["0 m", "0 m", "0 m"] }, palm = { at = ["0.4 m", "0 m", "0 m"] } }

[joint.shoulder]
type = "revolute"
parent = "ground"
child = "arm.hub"
axis = [0, 1, 0]

[simulation]
duration = "0.2 s"
output_step = "10 ms"
tip = "arm.palm"
gravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]

[[simulation.run]]
integrator = "runge-kutta"
"""
DRIVEN = """
[drive.turn]
type = "motion"
joint = "shoulder"
angle = { formula = "0.1*t", unit = "rad" }
"""
STOPPED = """
[joint.shoulder.stop]
high = "0.2 rad"
stiffness = "1e6 N m/rad"
"""
FINGER = """
[body.{name}]
shape = "point"
mass = "15 g"
marker = {{ eye = {{ at = ["0 m", "0 m", "0 m"] }} }}

[joint.{name}]
type = "{type}"
parent = "arm.palm"
child = "{name}.eye"
"""


@pytest.mark.parametrize("driven", ["", DRIVEN, STOPPED])
def test_slides_that_balance_each_other_at_0_cost_no_steps(tmp_path: Path, driven: str) -> None:
    """Their rates are the round-off of an inertia that the coupler takes, not a motion to be followed."""
    ends = zip(("left", "right"), (1, -1), strict=True)
    moving = "".join(FINGER.format(name=name, type="prismatic") + f"axis = [0, 0, {sign}]\n" for name, sign in ends)
    coupler = '[coupler.jaws]\ntype = "slides"\njoint = "left"\ndriver = "right"\nratio = 1.0\n'
    fixed = "".join(FINGER.format(name=name, type="fixed") for name in ("left", "right"))
    held, free = (run_of(tmp_path, GRIPPER + driven + text).motion for text in (fixed, moving + coupler))
    assert free.joint_position("shoulder") == pytest.approx(held.joint_position("shoulder"), rel=1e-7, abs=5e-7)
    assert free.joint_position("left") == pytest.approx(0.0, abs=1e-15)
    assert free.trajectory.evaluations < max(3 * held.trajectory.evaluations, 300)


BENDING = """
[body.bar]
shape = "bar"
length = "1 m"
depth = "10 mm"
width = "10 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"
mesh = { element = "hexahedron", divisions = [12, 1, 1], order = 2 }
modes = { count = 4, family = "in-plane bending", enrich = "inertia" }
marker = { root = { face = "x-" }, tip = { face = "x+" } }

[joint.bending]
type = "revolute"
parent = "ground"
child = "bar.root"
axis = [0, 0, 1]

[coupler.bends]
type = "gear"
joint = "bending"
driver = "driver"
ratio = -0.5
"""


def test_a_gear_holds_the_section_of_a_flexible_body_and_bends_it(tmp_path: Path) -> None:
    """Its frame floats about the hinge: a gear on that would turn the body without ever bending it."""
    scene = (
        (WHEELS + BENDING)
        .replace('"slide.eye"\n\n[[', '"bar.tip"\nstiffening = "off"\n\n[[')
        .replace('"0.1 s"', '"2 ms"')
    )
    motion = run_of(tmp_path, scene).motion
    driver = motion.joint_position("driver")
    assert motion.joint_position("bending") == pytest.approx(-0.5 * driver, abs=1e-12)
    assert np.add(*motion.energies) == pytest.approx(0.5 * driver, abs=1e-7)  # the torque's work
    across = 0.27 * 1.0**4 * 11 / 120  # of the bar's tip, under a load that rises with x
    rate = motion.joint_rate("bending")[-1] / motion.times[-1]
    EI = 70e9 * 0.01**4 / 12
    assert abs(motion.tip_deflection[:, 1].mean()) == pytest.approx(across * abs(rate) / EI, rel=0.05)


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        (GEAR.replace('"driven"', '"drifen"'), "coupler.gears.joint", "did you mean 'driven'?"),
        (
            GEAR.replace('"driven"', '"guide"'),
            "coupler.gears.joint",
            "is a prismatic joint; a gear needs a revolute one",
        ),
        (GEAR.replace('"driven"', '"driver"'), "coupler.gears.driver", "couples a joint with itself"),
        (RACK.replace('"guide"', '"driven"'), "coupler.steering.rack", "needs a prismatic one"),
    ],
)
def test_couplers_of_other_joints_are_refused(tmp_path: Path, text: str, key: str, said: str) -> None:
    with pytest.raises(InputError, match=said.replace("?", r"\?")) as caught:
        run_of(tmp_path, WHEELS + text)
    assert caught.value.key == key


ROD = """
title = "Rod"

[body.rod]
shape = "rod"
mass = "1 kg"
length = "1 m"
marker = { left = { at = ["0 m", "0 m", "0 m"] }, right = { at = ["1 m", "0 m", "0 m"] } }

[joint.plane]
type = "{kind}"
parent = "ground"
child = "rod.left"
{axis}

[simulation]
duration = "0.5 s"
output_step = "0.05 s"
tip = "rod.right"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]

[[simulation.run]]
integrator = "runge-kutta"
"""
SLOT = """
[joint.slot]
type = "point-on-line"
parent = "ground.slot"
child = "rod.right"
axis = [1, 0, 0]

[ground.slot]
at = ["0 m", "-0.5 m", "0 m"]
"""
TIE = """
[joint.tie]
type = "distance"
parent = "ground.eye"
child = "rod.right"
length = "0.8 m"

[ground.eye]
at = ["0 m", "-0.5 m", "0 m"]
"""


def slide_of(extra: str) -> str:
    carriage = """
[body.carriage]
shape = "point"
mass = "0.5 kg"
marker = { eye = { at = ["0 m", "0 m", "0 m"] } }

[joint.guide]
type = "prismatic"
parent = "ground"
child = "carriage.eye"
axis = [0, 1, 0]
"""
    rod = ROD.replace("{kind}", "revolute").replace("{axis}", "axis = [0, 0, 1]").replace('"ground"', '"carriage.eye"')
    return rod.replace("[joint.plane]", carriage.lstrip() + "\n[joint.plane]") + extra


@pytest.mark.parametrize("extra", [SLOT, TIE], ids=["slot", "tie"])
def test_slots_and_ties_hold_and_keep_the_energy(tmp_path: Path, extra: str) -> None:
    motion = run_of(tmp_path, slide_of(extra)).motion
    end = motion.tip_position
    if "slot" in extra:
        assert end[:, 1] == pytest.approx(np.full(len(end), -0.5), abs=1e-13)
    else:
        assert np.linalg.norm(end - [0.0, -0.5, 0.0], axis=1) == pytest.approx(np.full(len(end), 0.8), abs=1e-13)
    assert motion.constraint_residual < 1e-13
    energy = np.add(*motion.energies)
    assert np.ptp(energy) < 1e-7
    assert np.ptp(motion.joint_position("guide")) > 0.1


def test_a_rod_on_a_wall_and_a_floor_falls_as_its_ellipse_says(tmp_path: Path) -> None:
    """A ladder of mass m and length l on a wall, with a carriage M there: (m l²/3 + M l² cos² θ) θ̇² = 2 ΔE."""
    motion = run_of(tmp_path, slide_of(SLOT).replace('"-0.5 m"', '"0 m"') + "").motion
    theta = motion.joint_position("plane")
    energy = np.add(*motion.energies)
    rate = motion.joint_rate("plane")
    inertia = 1.0 / 3.0 + 0.5 * np.cos(theta) ** 2
    height = -np.sin(theta)  # of the carriage above the floor; of the rod's middle half of it
    wanted = 0.5 * inertia * rate**2 + 9.81 * (0.5 * height + 0.5 * height)
    assert wanted == pytest.approx(energy, abs=1e-7)

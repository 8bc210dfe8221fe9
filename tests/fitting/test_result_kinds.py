"""Derivatives of each kind of result, at rest and in contact, too: against scenes solved anew and closed forms."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fmd as package
from fmd.core.errors import InputError
from fmd.fitting.frozen_run import FrozenRun
from fmd.fitting.parameters import find_parameter
from fmd.fitting.sensitivities import Sensitivity
from fmd.output.channels import ResultChannel, find_all_channels, find_channels
from tests.contact.test_contact_points import BLOCK
from tests.contact.test_rigid_contacts import BALL, RADIUS, SPEED, free, scene
from tests.fitting.test_optimise import PUSHED
from tests.fitting.test_sensitivities import OSCILLATOR
from tests.responses.test_rotors import ACROSS, ARM, DAMPER, POLAR, RADIAL, RIGID
from tests.responses.test_rotors import MASS as ROTOR_MASS

RESPONSE = {"type": "frf", "file": "frf.png", "input": "bar.tip.y", "output": ["bar.tip.y"], "to": 300.0}
RESULTS = ["tip", "stress", "life", "frequency.1", "mass", "bar.tip.velocity.y", "clamp.moment.z", "clamp.force.size"]
RESULTS += ["kinetic_energy", "bar.tip.y by bar.tip.y", "twice = 2*bar.tip.y"]


def extrapolated(tables: dict[str, Any], key: str, value: float, channels: list[ResultChannel]) -> list[Any]:
    """Return derivatives by a number's logarithm from scenes that are loaded with other values of it."""
    found = []
    for share in (2e-3, 1e-3):
        sides = [package.load(tables, f"{key}={value * (1.0 + side * share)!r}").run for side in (-1.0, 1.0)]
        low, high = ([np.asarray(each.read(run)) for each in channels] for run in sides)
        found.append([(b - a) / (2.0 * share) for a, b in zip(low, high, strict=True)])
    return [(4.0 * fine - rough) / 3.0 for rough, fine in zip(*found, strict=True)]


def require_like(found: list[Sensitivity], tables: dict[str, Any], within: float) -> None:
    """Compare derivatives by one number with those of scenes solved anew, over each result's largest."""
    parameter = found[0].parameter
    expected = extrapolated(tables, parameter.key, parameter.value, [each.channel for each in found])
    for each, slope in zip(found, expected, strict=True):
        size = max(np.abs(slope).max(), 1e-6 * np.abs(each.value).max())
        np.testing.assert_allclose(
            each.slope * parameter.value, slope, rtol=0, atol=within * size, err_msg=each.channel.name
        )


def test_all_results_of_a_pushed_bar_have_the_derivatives_of_bars_solved_anew() -> None:
    tables = copy.deepcopy(PUSHED)
    tables["output"].append(RESPONSE)
    found = package.jacobian(package.load(tables), RESULTS, ["body.bar.depth"])
    assert len(found) == len(RESULTS)
    require_like(found, tables, 1e-5)


def test_a_state_of_equilibrium_moves_with_the_numbers_as_its_closed_form() -> None:
    """A mass that hangs still on its spring stretches it by m g/k."""
    slide = OSCILLATOR["joint"]["slide"] | {"position": "0 m"}
    rest = {"start": "equilibrium", "gravity": ["9.81 m/s^2", "0 m/s^2", "0 m/s^2"], "duration": "20 ms"}
    tables = OSCILLATOR | {"joint": {"slide": slide}, "simulation": OSCILLATOR["simulation"] | rest}
    keys = ["joint.slide.spring", "body.block.mass", "simulation.gravity.0"]
    found = package.jacobian(package.load(tables), ["slide.position"], keys)
    for each, power in zip(found, (-1.0, 1.0, 1.0), strict=True):
        np.testing.assert_allclose(each.value, 2.0 * 9.81 / 800.0, rtol=1e-9)
        np.testing.assert_allclose(each.slope * each.parameter.value, power * each.value, rtol=1e-6)


def test_a_periodic_motion_has_the_derivatives_of_its_closed_form() -> None:
    """Of a driven mass on a spring with a damper, ``X = F/(k − m Ω² + i c Ω)``: the start follows the numbers, too."""
    stiffness, mass, damper, force, rate = 800.0, 2.0, 8.0, 3.0, 2.0 * np.pi / 0.25
    slide = OSCILLATOR["joint"]["slide"] | {"position": "0 m", "damper": f"{damper} N s/m"}
    push = {"type": "force", "joint": "slide", "force": {"formula": "3*cos(2*pi*t/0.25)", "unit": "N"}}
    steady = {"start": "periodic", "period": "0.25 s", "duration": "0.25 s", "step": "0.1 ms", "error": 1e-6}
    simulation = OSCILLATOR["simulation"] | steady
    tables = OSCILLATOR | {"joint": {"slide": slide}, "drive": {"push": push}, "simulation": simulation}
    keys = ["joint.slide.spring", "body.block.mass", "joint.slide.damper", "drive.push.force"]
    found = package.jacobian(package.load(tables), ["slide.position"], keys)
    X = force / (stiffness - mass * rate**2 + 1j * damper * rate)
    slopes = -(X**2) / force * np.array([stiffness, -mass * rate**2, 1j * damper * rate])
    times = package.load(tables).run.output_times
    for each, slope in zip(found, [*slopes, X], strict=True):
        expected = (slope * np.exp(1j * rate * times)).real
        size = np.abs(expected).max()
        np.testing.assert_allclose(each.slope * each.parameter.value, expected, rtol=0, atol=1e-4 * size)


def rotor(folder: Path) -> str:
    (folder / "rotor.toml").write_text(RIGID.replace(f"{DAMPER} N s/m", "0 N s/m"))
    return str(folder / "rotor.toml")


@pytest.mark.parametrize(
    ("name", "key", "power"),
    [
        ("critical_speed.2", "body.rotor.mass", -0.5),
        pytest.param("critical_speed.4", "bearing.near.radial", 0.25, marks=pytest.mark.long),
        pytest.param(
            "critical_speed.4", "body.rotor.inertia.0", -0.5 * POLAR / (ACROSS + POLAR), marks=pytest.mark.long
        ),
    ],
)
def test_critical_speeds_go_with_the_numbers_as_their_closed_forms(
    name: str, key: str, power: float, tmp_path: Path
) -> None:
    """Of a rigid rotor: that of translation is √(2 k/m), that of tilting backward √(2 k a²/(I_t + I_p))."""
    (found,) = package.jacobian(package.load(rotor(tmp_path)), [name], [key])
    squared = 2 * RADIAL / ROTOR_MASS if name.endswith("2") else 2 * RADIAL * ARM**2 / (ACROSS + POLAR)
    assert float(found.value) == pytest.approx(np.sqrt(squared), rel=1e-7)
    assert found.relative == pytest.approx(power, abs=1e-4)


def test_critical_speeds_are_found_beyond_a_slow_vibration_and_far_from_the_scenes_own(tmp_path: Path) -> None:
    """The rotor slides to and fro along its axis at 0.005 of the speed at which its bearings' springs are met."""
    run = package.load(rotor(tmp_path), "bearing.near.axial=1 N/m").run
    (channel,) = find_channels(run, "critical_speed.2")
    whirl = np.sqrt(2 * RADIAL / ROTOR_MASS)
    assert np.sqrt(1.0 / ROTOR_MASS) < whirl / 128
    assert float(channel.read(run)) == pytest.approx(whirl, rel=1e-7)
    heavier = package.load(rotor(tmp_path), "bearing.near.axial=1 N/m", f"body.rotor.mass={1.1 * ROTOR_MASS} kg").run
    assert float(channel.read(heavier)) == pytest.approx(whirl / np.sqrt(1.1), rel=1e-7)
    with pytest.raises(InputError, match="needs its number, from 1"):
        find_channels(run, "critical_speed")


def test_contact_without_friction_has_tangents_near_those_of_its_closed_form() -> None:
    """Of a ball that bounces: by Hertz's law its depth is ``A f(τ / T)``, τ from its touch of a plane at distance d on.

    A goes with ``m^2/5 v^4/5``, T with ``m^2/5 v^-1/5``, and the ball touches after d / v (Johnson, Contact Mechanics).
    """
    gap, end, keys = 1e-6, 3e-4, ["body.ball.mass", "joint.free.velocity.2", "body.ball.surface.skin.E"]
    joint = {"free": free("ball.centre", [0, 0, RADIUS + gap], [0, 0, -SPEED])}
    floor = {"between": ["ground", "ball.skin"], "normal": [0, 0, 1]}
    result = package.load(scene({"ball": BALL}, joint, {"floor": floor}, end, step=5e-7))
    found = package.jacobian(result, ["ball.centre.displacement.z"], keys)
    assert all(each.by_tangents for each in found)
    (velocity,) = find_channels(result.run, "ball.centre.velocity.z")
    tau = result.run.output_times - gap / SPEED
    touched = tau >= 0.0
    depth, rate = found[0].value + gap, velocity.read(result.run)
    by_mass = 0.4 * (depth - tau * rate)
    by_speed = 0.8 * depth + (0.2 * tau + gap / SPEED) * rate
    size = np.abs(by_speed).max()
    for each, exact in zip(found, (by_mass, by_speed, -by_mass), strict=True):
        off, error = each.slope * each.parameter.value - exact, np.abs(each.error * each.parameter.value)
        assert (np.abs(off) <= error)[touched].all()  # which is what half the steps change
        assert error.max() < 1e-3 * size


FALLING = {"position": ["0 m", "50.83 mm", "0 m"], "velocity": ["0 m/s", "-0.5 m/s", "0.1 m/s"]}
ASLANT = BLOCK["joint"]["free"] | FALLING | {"rotate": ["0.5 deg", "0 deg", "0.3 deg"]}
OFTEN = BLOCK["simulation"] | {"duration": "0.15 ms", "output_step": "10 us"}


@pytest.mark.long
@pytest.mark.parametrize("method", ["central-difference", "generalized-alpha"])
def test_contact_of_a_flexible_block_has_the_derivatives_of_marches_with_the_same_closed_points(method: str) -> None:
    """Numbers of equations, of shapes and flexibilities, of contacts and of the start, on the way into the ground."""
    keys = ["body.block.rho", "body.block.E", "body.block.width", "contact.floor.clearance"]
    keys += ["joint.free.velocity.1", "joint.free.rotate.0"]
    tables = BLOCK | {"joint": {"free": ASLANT}, "simulation": OFTEN}
    floor = "contact.floor.clearance='-5 um'"
    result = package.load(tables, f"simulation.run=[{{integrator='{method}', step='2 us'}}]", floor)
    parameters = [find_parameter(result.run.scene, key) for key in keys]
    frozen = FrozenRun(result.run)
    motion, channels = frozen.at({}, by=parameters), find_all_channels(result.run, ["block.middle.velocity", "stress"])
    pressed = motion.run.motion.contact_pressures["block"] > 0.0
    assert pressed.any()
    for parameter in parameters:
        beside, found = frozen.beside(motion, parameter), list[Any]()
        assert beside.by_tangents
        for share in (4e-5, 2e-5):
            sides = [frozen.at({parameter: parameter.value * (1.0 + side * share)}).run for side in (-1.0, 1.0)]
            for side in sides:
                np.testing.assert_array_equal(side.motion.contact_pressures["block"] > 0.0, pressed)
            found.append([(each.read(sides[1]) - each.read(sides[0])) / (2.0 * share) for each in channels])
        for each, rough, fine in zip(channels, *found, strict=True):
            slope = (each.read(beside.high) - each.read(beside.low)) / (2.0 * beside.step) * parameter.value
            size = np.abs(fine).max()
            np.testing.assert_allclose(
                slope, (4.0 * fine - rough) / 3.0, rtol=0, atol=1e-5 * size, err_msg=parameter.key
            )


def test_a_bar_that_rests_has_derivatives_by_its_load_with_implicit_steps_too() -> None:
    """Its accelerations, and those of its tangents, are round-off. Where it rests goes with force over modulus."""
    bar = {"shape": "bar", "length": "0.3 m", "depth": "10 mm", "width": "10 mm", "E": "70 GPa", "nu": 0.33}
    bar |= {"rho": "2700 kg/m^3", "mesh": {"divisions": [3, 1, 1]}, "modes": {"count": 2, "boundary": "joint"}}
    bar["marker"] = {"root": {"face": "x-"}, "tip": {"face": "x+"}}
    simulation = {"duration": "0.1 ms", "output_step": "0.02 ms", "start": "equilibrium", "tip": "bar.tip"}
    simulation["run"] = [{"integrator": "generalized-alpha", "step": "0.02 ms"}]
    pull = {"type": "point force", "marker": "bar.tip", "direction": [1, 0, 0], "force": "1600 N"}
    tables = {"title": "Bar", "body": {"bar": bar}, "drive": {"pull": pull}, "simulation": simulation}
    tables["joint"] = {"wall": {"type": "fixed", "parent": "ground", "child": "bar.root"}}
    by_force, by_modulus = package.jacobian(package.load(tables), ["tip"], ["drive.pull.force", "body.bar.E"])
    assert by_force.by_tangents
    assert by_modulus.by_tangents  # though the bar is square: its pairs are those along its sides, by any modulus
    assert by_modulus.relative_error < 1e-6
    assert by_force.relative == pytest.approx(1.0, rel=1e-3)
    assert by_force.relative == pytest.approx(-by_modulus.relative, abs=by_modulus.relative_error)

"""Loads and motions of a scene: faults of a formula are refused with drive, time and remedy, sound ones pass."""

import numpy as np
import pytest

from fmd import load_scene
from fmd.core.errors import InputError
from fmd.scene.scene import Scene
from fmd.stages.signals import find_idle_drives, require_sound_drives, signal_of


def with_torque(formula: str) -> Scene:
    drive = f'drive.motor.torque={{formula="{formula}", unit="N m"}}'
    return load_scene("rod-slider", [drive, "simulation.duration=1 s"])


def with_motion(formula: str) -> Scene:
    drive = f'drive.spin_up.angle={{formula="{formula}", unit="deg"}}'
    return load_scene("spin-up", [drive, "simulation.duration=1 s"])


@pytest.mark.parametrize(
    ("formula", "why", "time"),
    [
        ("1/t", "grows without bound", 0.0),
        ("1/(t-0.3001)", "grows without bound", 0.3001),  # between the times that are sampled
        ("(t-0.3001)**-2", "grows without bound", 0.3001),
        ("1/sqrt(abs(t-0.3217))", "grows without bound", 0.3217),
        ("tan(4*t)", "grows without bound", np.pi / 8),
        ("exp(2000*t)", "grows without bound", 0.355469),  # of 1/256 s the first after ln(1.8e308)/2000 s
        ("sin(t)/t", "has no real value", 0.0),
        ("sqrt(0.5-t) if t < 0.7 else 0", "has no real value", 129 / 256),
    ],
)
def test_a_load_without_a_finite_value_is_refused_with_its_drive_and_time(formula: str, why: str, time: float) -> None:
    with pytest.raises(InputError, match=rf"drive\.motor\.torque = .*: {why} .* at t = {time:.6g} s; leave that time"):
        require_sound_drives(with_torque(formula))


@pytest.mark.parametrize(
    "formula",
    [
        "500*exp(-((t-0.15)/0.0003)**2)",
        "1/(1e-9 + (t-0.3001)**2)",
        "1/t if t > 0.1 else 0",
        "1 if t < 0.5 else 0",
        "sqrt(t)",  # its rate isn't finite at 0, but no load's rate is needed
        "1000*sin(3000*t)",
        "0*t",
    ],
)
def test_sharp_but_finite_loads_pass(formula: str) -> None:
    scene = with_torque(formula)
    require_sound_drives(scene)
    assert np.isfinite(signal_of(scene.drive["motor"].torque).values(np.linspace(0.0, 1.0, 1001))[:, 0]).all()


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("0 if t < 0.5 else 90", r"jumps at t = 0.5 s, from 0 deg at 0 deg/s to 90 deg at 0 deg/s; .* smooth formula"),
        ("t if t < 0.5 else 0.5", r"jumps at t = 0.5 s, from 0.5 deg at 1 deg/s to 0.5 deg at 0 deg/s"),
        ("abs(t - 0.5)", r"jumps at t = 0.5 s, from \S+ deg at -1 deg/s to \S+ deg at 1 deg/s"),
        ("2*max(0, t - 0.5)", r"jumps at t = 0.5 s, from 0 deg at 0 deg/s to \S+ deg at 2 deg/s"),
        ("abs(sin(5000*t))", r"jumps at t = 0.000628319 s, .* at 5000 deg/s"),
        ("1e-9*min(t, 0.5)", r"jumps at t = 0.5 s, .* at 1e-09 deg/s to .* at 0 deg/s"),
        ("1/t", "its value grows without bound .* at t = 0 s"),
        ("sqrt(t)", "its rate grows without bound .* at t = 0 s"),
        ("t**1.5", "its acceleration grows without bound .* at t = 0 s"),
    ],
)
def test_a_motion_that_jumps_or_has_no_finite_acceleration_is_refused(formula: str, said: str) -> None:
    with pytest.raises(InputError, match=rf"drive\.spin_up\.angle = .*: {said}"):
        require_sound_drives(with_motion(formula))


@pytest.mark.parametrize(
    "formula",
    [
        "max(0, t - 0.5)**2",
        "abs(t - 0.3)*(t - 0.3)",
        "max(0, 1e4*(t - 0.5))**2",
        "abs(sin(50*t))**3",
        "tanh((t - 0.5)/1e-6)",
        "t if t < 5 else 90",  # after the end
    ],
)
def test_a_motion_with_a_kink_of_its_acceleration_passes(formula: str) -> None:
    scene = with_motion(formula)
    require_sound_drives(scene)
    assert np.isfinite(signal_of(scene.drive["spin_up"].angle).values(np.linspace(0.0, 1.0, 1001))).all()


@pytest.mark.parametrize(
    ("formula", "idle"),
    [("0 if t < 5 else 10", True), ("10 if t >= 1 else 0", True), ("0*t", True), ("10", False), ("1e-30*t", False)],
)
def test_a_load_that_is_0_up_to_the_end_is_found(formula: str, idle: bool) -> None:
    assert find_idle_drives(with_torque(formula)) == (["motor"] if idle else [])

"""A small mechanism as FMUs: a rigid crank with a flexible bar, driven by a pulse, a motion, a table and a spring."""

import os
import shutil
import zipfile
from pathlib import Path
from typing import NamedTuple

import pytest

from fmd.output.fmu import build
from fmd.output.fmu.write import write_own_fmu
from fmd.scene.scene import load_scene
from fmd.stages.pipeline import Pipeline

SCENE = """
title = "Small mechanism"

[body.crank]
shape = "rigid"
mass = "0.4 kg"
centre = ["0.1 m", "0.02 m", "0 m"]
inertia = ["1e-4 kg m^2", "2e-3 kg m^2", "2e-3 kg m^2"]

[body.crank.marker]
hinge = { at = ["0 m", "0 m", "0 m"] }
end = { at = ["0.2 m", "0 m", "0 m"] }

[body.bar]
shape = "bar"
length = "400 mm"
depth = "8 mm"
width = "12 mm"
E = "70 GPa"
nu = 0.33
rho = "2700 kg/m^3"

[body.bar.mesh]
element = "hexahedron"
order = 2
divisions = [4, 1, 1]

[body.bar.modes]
count = 3
boundary = "joint"
enrich = "none"
damping = 0.01

[body.bar.marker]
near = { face = "x-" }
far = { face = "x+" }

[body.bar.element]
root = { at = ["50 mm", "2 mm", "0 mm"] }

[body.ball]
shape = "rigid"
mass = "0.05 kg"
centre = ["30 mm", "0 mm", "5 mm"]
inertia = ["1e-5 kg m^2", "2e-5 kg m^2", "2e-5 kg m^2"]

[body.ball.marker]
socket = { at = ["0 m", "0 m", "0 m"] }

[joint.motor]
type = "revolute"
parent = "ground"
child = "crank.hinge"
axis = [0, 0, 1]

[joint.hinge]
type = "revolute"
parent = "crank.end"
child = "bar.near"
axis = [0, 1, 0]
angle = "10 deg"
spring = "15 N m"
damper = "0.01 N m s"

[joint.socket]
type = "spherical"
parent = "bar.far"
child = "ball.socket"

[drive.turn]
type = "motion"
joint = "motor"
angle = { formula = "0.5*t**2 if t < 0.05 else 0.05*t - 0.00125", unit = "rad" }

[drive.kick]
type = "torque pulse"
joint = "hinge"
torque = "0.3 N m"
start = "0.01 s"
duration = "0.02 s"

[drive.gust]
type = "point force"
marker = "bar.far"
direction = [0, 0, 1]
force = { times = ["0 s", "20 ms", "60 ms"], values = [0.0, 1.0, 0.2], unit = "N", beyond = "hold" }

[simulation]
duration = "0.1 s"
output_step = "5 ms"
gravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]
tip = "bar.far"

[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-12
"""


class Exported(NamedTuple):
    """A scene's pipeline, and its FMUs of FMI 2.0 and 3.0."""

    run: Pipeline
    fmi2: Path
    fmi3: Path


def without_effort(file: Path) -> str:
    """Write a compiler that optimises nothing; return its name, or an empty text without a compiler."""
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if not compiler:
        return ""
    file.write_text(f'#!/bin/sh\nexec {compiler} "$@" -O0\n')
    file.chmod(0o755)
    return str(file)


@pytest.fixture(scope="package")
def exported(tmp_path_factory):
    if build.own_target() is None:
        pytest.skip("this system has no FMU binaries")
    folder = tmp_path_factory.mktemp("fmu")
    (folder / "small.toml").write_text(SCENE)
    run = Pipeline(load_scene(folder / "small.toml"))
    with pytest.MonkeyPatch.context() as patch:
        # Compiling as users do takes three times as long; `fmd verify fmu` and the tests of scenes with FMUs do.
        patch.setenv("CC", without_effort(folder / "cc"))
        fmi2, fmi3 = write_own_fmu(run, folder / "small.fmu")
    with zipfile.ZipFile(fmi2) as archive:
        if not any(name.startswith("binaries/") for name in archive.namelist()):
            pytest.skip("no C compiler")
    return Exported(run, fmi2, fmi3)

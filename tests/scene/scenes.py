"""Texts of scenes for the tests of this folder, and two helpers to load them."""

import re
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from fmd.core.errors import InputError
from fmd.scene.scene import Scene, load_scene

BEAM = (files("fmd.models") / "beam.toml").read_text()
SLIDER = (files("fmd.models") / "rod-slider.toml").read_text()
PLATE = """
[body.plate]
shape = "rigid"
mass = "3 kg"
inertia = ["0.1 kg m^2", "2000 kg cm^2", "0.3 kg m^2"]
marker = { a = { at = ["-5 cm", "0 m", "0 m"] } }

[joint.last]
type = "{}"
parent = "{}"
child = "plate.a"
"""
ARM = """
[body.arm]
shape = "bar"
length = "1 m"
depth = "2 cm"
width = "2 cm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = { element = "tetrahedron", size = "5 mm" }
modes = { count = 3 }
marker = { a = { face = "x-" }, b = { face = "x+" } }
"""
ELBOW = '[joint.elbow]\ntype = "revolute"\nparent = "{}"\nchild = "arm.a"\naxis = [0, 1, 0]\n'


def scene_of(folder: Path, text: str, *overrides: str) -> Scene:
    file = folder / "mine.toml"
    file.write_text(text)
    return load_scene(file, overrides)


def refused(message: str) -> Any:
    return pytest.raises(InputError, match=re.escape(message))

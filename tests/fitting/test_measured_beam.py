"""A measured beam: seven frequencies that pyEMA identifies from hammer tests, and a fit by beam theory."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.fem.material import Material

# Of a beam on foam, from hammer tests at six places, by pyEMA's own least-squares identification:
# github.com/ladisk/pyEMA, tests/test_data.py, MIT License, Copyright (c) 2018 - 2019 Ladisk. Its size is not given.
PYEMA = (176.07332578, 476.4634351, 932.28540465, 1534.78951957, 2286.31989538, 3162.15866336, 4181.71710178)
LENGTH, WIDTH, NU, RHO = 0.5, 0.01, 0.3, 7850.0  # taken for it: frequencies have E and the depth over these alone
BEAM = f"""
title = "Measured beam"

[body.beam]
shape = "bar"
length = "{LENGTH:g} m"
depth = "10 mm"
width = "{WIDTH:g} m"
E = "140 GPa"
nu = {NU:g}
rho = "{RHO:g} kg/m^3"
mesh = {{ divisions = [40, 2, 1] }}
modes = {{ count = 7, family = "in-plane bending" }}
marker = {{ end = {{ face = "x-" }} }}

[joint.free]
type = "planar"
parent = "ground"
child = "beam.end"
axis = [0, 0, 1]

[simulation]
duration = "0.1 s"
output_step = "1 ms"
step = "auto"
tip = "beam.end"
stiffening = "off"
run = [{{ integrator = "auto" }}]
"""


@pytest.mark.long
def test_a_measured_beam_is_fitted_as_beam_theory_is(fmd: Any, tmp_path: Path, timoshenko: Callable[..., Any]) -> None:
    scene, data = tmp_path / "beam.toml", tmp_path / "modes.csv"
    scene.write_text(BEAM)
    data.write_text("frequency_hz\n" + "".join(f"{f}\n" for f in PYEMA))
    given = ["--to", data, "--vary", "body.beam.E=50..400GPa,body.beam.depth=3..30mm", "--sigma", "frequency=0.5%"]
    assert fmd("fit", scene, *given, "--out", tmp_path, "--json") == 0
    found = json.loads((tmp_path / "fit.json").read_text())
    E, depth = (each["value"] for each in found["parameters"])

    theory = timoshenko(LENGTH, depth, WIDTH, Material(E, NU, RHO)).frequencies_hz(len(PYEMA))
    fitted = np.genfromtxt(tmp_path / "fit.csv", delimiter=",", skip_header=1)[:, 3]
    assert fitted == pytest.approx(theory, rel=0.005)
    # Foam holds the lowest mode, and accelerometers load the others: no free beam is all of it.
    apart = fitted / PYEMA - 1.0
    assert np.abs(apart).max() < 0.012
    assert found["chi2"] == pytest.approx(np.sum((apart / 0.005) ** 2), rel=1e-3)
    assert not found["warnings"]

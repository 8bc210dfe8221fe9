"""Stretch of bodies that have links and lumped masses, whose nodes no element holds."""

from pathlib import Path

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.accuracy.deflection import stiffening_by_stretch
from fmd.fem.geometric_stiffness import quadratic_strain_load

STRIP = """
title = "Strip with a motor at its end"
[body.strip]
shape = "bar"
length = "300 mm"
depth = "8 mm"
width = "20 mm"
E = "210 GPa"
nu = 0.3
rho = "7850 kg/m^3"
mesh = {{ order = 2, divisions = [12, 1, 1] }}
modes = {{ count = 4, boundary = "joint" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
{more}
[joint.root]
type = "fixed"
parent = "ground"
child = "strip.root"
[drive.push]
type = "point force"
marker = "strip.tip"
direction = [0, 1, 0]
force = "200 N"
[simulation]
duration = "20 ms"
output_step = "0.5 ms"
tip = "strip.tip"
run = [{{ integrator = "auto" }}]
"""
MOTOR = """
link = {{ end = {{ face = "x+", type = "{kind}" }} }}
mass = {{ motor = {{ at = "end", mass = "0.08 kg", inertia = ["2e-6 kg m^2", "1e-6 kg m^2", "2e-6 kg m^2"] }} }}
"""


@pytest.mark.parametrize("kind", ["rigid", "average"])
def test_the_load_of_a_quadratic_strain_is_that_of_the_elements_alone(tmp_path: Path, kind: str) -> None:
    runs = []
    for name, more in (("bare", ""), ("linked", MOTOR.format(kind=kind))):
        file = tmp_path / f"{name}.toml"
        file.write_text(STRIP.format(more=more))
        runs.append(Pipeline(load_scene(file)))
    bare, linked = (run.parts["strip"].fe for run in runs)
    n, more = len(bare.x), linked.K.shape[0] // 3
    u = 1e-3 * np.random.default_rng(0).normal(size=(more, 3))
    expected, energy = quadratic_strain_load(bare, u[:n])
    load, found = quadratic_strain_load(linked, u)
    assert more > n
    np.testing.assert_allclose(load[:n], expected, atol=1e-12 * np.abs(expected).max())
    assert not load[n:].any()
    assert found == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("end", ["rigid link", "rigid face"])
def test_a_rigid_end_that_turns_stretches_nothing(tmp_path: Path, end: str) -> None:
    """As the same strip with an averaged end, which is free to contract as the strip behind it turns."""
    ratios = {}
    for kind, more in (("free", ""), ("held", MOTOR.format(kind="rigid") if end == "rigid link" else "")):
        text = STRIP.format(more=more)
        if kind == "held" and end == "rigid face":
            text = text.replace('tip = { face = "x+" }', 'tip = { face = "x+", attachment = "rigid" }')
        file = tmp_path / f"{kind}.toml"
        file.write_text(text)
        run = Pipeline(load_scene(file))
        assert run.deformations["strip"].rotation > 0.02
        ratios[kind] = stiffening_by_stretch(run, "strip")
    assert ratios["held"] < ratios["free"] + 1e-3


def test_a_strip_that_is_free_to_shorten_is_not_stretched_by_what_bends_it(tmp_path: Path) -> None:
    file = tmp_path / "strip.toml"
    file.write_text(STRIP.format(more=MOTOR.format(kind="average")))
    run = Pipeline(load_scene(file))
    assert run.deformations["strip"].rotation > 0.02
    assert stiffening_by_stretch(run, "strip") < 1e-3

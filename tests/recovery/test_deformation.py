"""Rotation and strain of an elastic field, and the error of leaving their squares out, against the elastica."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipeinc, ellipkinc

from fmd import Pipeline, load_scene
from fmd.accuracy.deflection import deflection_errors, deflection_warnings
from fmd.accuracy.quantities import motion_quantities
from fmd.core.limits.errors import SAFETY, TOO_LARGE
from fmd.dynamics.kinematics import Kinematics
from fmd.recovery.deformation import _largest, measure_deformation, node_deformation_shapes

LENGTH, DEPTH, WIDTH, MODULUS = 1.0, 0.005, 0.02, 210e9
BENDING = MODULUS * WIDTH * DEPTH**3 / 12
STRIP = f"""
title = "Strip"
[body.strip]
shape = "bar"
length = "{LENGTH} m"
depth = "{WIDTH} m"
width = "{DEPTH} m"
E = "{MODULUS} Pa"
nu = 0.0
rho = "7850 kg/m^3"
mesh = {{ element = "hexahedron", order = 2, divisions = [20, 1, 1] }}
modes = {{ count = 3, boundary = "joint", enrich = "inertia" }}
marker = {{ root = {{ face = "x-" }}, tip = {{ face = "x+" }} }}
[joint.clamp]
type = "fixed"
parent = "ground"
child = "strip.root"
[drive.load]
type = "point force"
marker = "strip.tip"
direction = [0, 0, 1]
force = "FORCE N"
[simulation]
duration = "1 ms"
output_step = "1 ms"
start = "steady"
tip = "strip.tip"
stiffening = "STIFFENING"
run = [{{ integrator = "auto" }}]
"""


def strip(folder: Any, deflection: float, stiffening: str = "off") -> Pipeline:
    """Return a clamped strip whose linear deflection under a force at its end is a part of its length."""
    file = folder / "strip.toml"
    load = repr(3 * deflection * BENDING / LENGTH**2)
    file.write_text(STRIP.replace("FORCE", load).replace("STIFFENING", stiffening))
    return Pipeline(load_scene(file))


def elastica(load: float) -> tuple[float, float]:
    """Return the place of a cantilever's end under a dead load P L²/EI, over its length, by elliptic integrals."""
    begin = np.arcsin(np.sqrt(0.5))

    def places(k: float) -> tuple[float, float, float]:
        phi = np.arcsin(np.sin(begin) / k)
        F, E = (f(np.pi / 2, k * k) - f(phi, k * k) for f in (ellipkinc, ellipeinc))
        return F, np.sqrt(2 * (2 * k * k - 1)), 1 - 2 * E / np.sqrt(load) if load else 0.0

    k = brentq(lambda k: places(k)[0] - np.sqrt(load), np.sqrt(0.5) * (1 + 1e-14), 1 - 1e-12, xtol=1e-15)
    return float(np.sqrt(2 * (2 * k * k - 1) / load)), float(places(k)[2])


@pytest.mark.parametrize("stiffening", ["off", "on"])
@pytest.mark.parametrize("deflection", [0.02, 0.05, 0.1, 0.2, 0.4])
def test_the_stated_error_of_a_large_deflection_is_one_to_five_times_the_elasticas(
    tmp_path: Any, deflection: float, stiffening: str
) -> None:
    run = strip(tmp_path, deflection, stiffening)
    x, y = elastica(3 * deflection)
    # Of beam theory, without the mesh's error: of second order is -½ ∫ w'² ds.
    shortening = 0.6 * deflection**2 if stiffening == "on" else 0.0
    exact, ours = np.array([x - 1, 0.0, y]), np.array([-shortening, 0.0, deflection])
    size = float(np.linalg.norm(exact))
    true = {
        "tip, deflection": np.linalg.norm(ours - exact) / size,
        "tip, largest deflection": abs(np.linalg.norm(ours) / size - 1),
        "strip, largest von Mises stress": 1 / x - 1,  # the moment at the root is P x
    }
    assert run.motion.tip_deflection[0] == pytest.approx(ours, rel=2e-3, abs=1e-6)
    quantities = dict.fromkeys(true, None) | motion_quantities(run.motion, run.motion)
    stated = deflection_errors(run, quantities)
    for name, error in true.items():
        assert error <= SAFETY * stated[name] <= 5 * error, name
    (warning,) = deflection_warnings(run) or [{"text": ""}]
    assert bool(warning["text"]) == (stated["tip, deflection"] > TOO_LARGE)


def test_largest_rotation_and_strain_are_those_of_beam_theory(tmp_path: Any) -> None:
    measured = strip(tmp_path, 0.1).deformations["strip"]
    assert measured.rotation == pytest.approx(1.5 * 0.1, rel=2e-3)
    assert measured.strain == pytest.approx(3 * 0.1 * DEPTH / 2 / LENGTH, rel=0.03)  # of the element at the root
    assert measured.shortening["tip"] == pytest.approx(0.6 * 0.1**2, rel=5e-3)  # ½ ∫ w'² ds


@pytest.mark.parametrize("of_matter", [True, False])
@pytest.mark.parametrize("stiffening", ["off", "on"])
def test_without_elements_nodes_and_markers_tell_rotation_and_shortening(
    tmp_path: Any, stiffening: str, of_matter: bool
) -> None:
    run = strip(tmp_path, 0.1, stiffening)
    body = run.bodies["strip"]
    measured = measure_deformation(node_deformation_shapes(body, False, of_matter), body, run.motion.modal("strip"))
    assert measured.rotation == pytest.approx(1.5 * 0.1, rel=3e-3)
    assert measured.shortening["tip"] == pytest.approx(0.6 * 0.1**2, rel=5e-3)
    if of_matter:  # between nodes an element apart along the strip, and half of one
        assert measured.strain == pytest.approx(3 * 0.1 * DEPTH / 2 / LENGTH, rel=0.05)


def test_pieces_lower_the_error_as_the_warning_says(tmp_path: Any) -> None:
    """The strip cut into as many pieces as the warning names, at a fifth of its length."""
    deflection = 0.2
    (warning,) = deflection_warnings(strip(tmp_path, deflection))
    pieces = int(warning["text"].partition("pieces = ")[2].split()[0])
    load = repr(3 * deflection * BENDING / LENGTH**2)
    divided = STRIP.replace("FORCE", load).replace("STIFFENING", "off").replace("steady", "equilibrium")
    divided = divided.replace(', boundary = "joint"', "").replace('shape = "bar"', f'shape = "bar"\npieces = {pieces}')
    (tmp_path / "divided.toml").write_text(divided)
    run = Pipeline(load_scene(tmp_path / "divided.toml"))
    (place,) = Kinematics(run.mechanism, np.zeros(1), run.start[0][None], run.start[1][None]).marker_position(
        pieces - 1, "tip"
    )
    x, y = elastica(3 * deflection)
    assert np.linalg.norm(place - [x, 0.0, y]) < 2 * TOO_LARGE * np.hypot(x - 1, y)


def test_a_strip_that_is_drawn_out_is_told_of_its_strain_which_no_pieces_lower(tmp_path: Any) -> None:
    load = 0.08 * MODULUS * WIDTH * DEPTH
    drawn = STRIP.replace("[0, 0, 1]", "[1, 0, 0]").replace("FORCE", repr(load)).replace("STIFFENING", "off")
    (tmp_path / "drawn.toml").write_text(drawn.replace("steady", "equilibrium"))
    (warning,) = deflection_warnings(Pipeline(load_scene(tmp_path / "drawn.toml")))
    assert "strained by up to 8 %" in warning["text"]
    assert "off by about 2 %" in warning["text"]
    assert "pieces don't" in warning["text"]


def test_the_largest_length_of_fields_is_that_at_all_points_and_times() -> None:
    rng = np.random.default_rng(5)
    for _ in range(60):
        n = int(rng.integers(1, 5))
        field = rng.normal(size=(int(rng.integers(1, 40)), 3, n)) * rng.lognormal(0.0, 2.0, size=n)
        q = rng.normal(size=(int(rng.integers(1, 400)), n)) * rng.choice([0.0, 1.0], size=n)
        every = np.linalg.norm(np.einsum("pan,tn->tpa", field, q), axis=2)
        assert _largest(field, q) == pytest.approx(every.max(), rel=1e-13)

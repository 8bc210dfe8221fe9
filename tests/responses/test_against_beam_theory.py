"""Poles, zeros and frequency responses of beams against the closed forms of Timoshenko's theory."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from fmd.core.arrays import Array
from fmd.fem.material import Material
from fmd.stages.linear_model import linearise_scene
from tests.responses.scenes import DEPTH, LENGTH, WIDTH, beam, fixed, pipeline_of, supported

MATERIAL = Material(E=210e9, nu=0.0, rho=7800.0)
HUB_INERTIA = 2e-3


def roots_hz(function: Callable[[float], float], highest: float) -> Array:
    """Return the frequencies at which a function of the angular frequency changes its sign [Hz]."""
    at = 2 * np.pi * np.linspace(1.0, highest, 600)
    sign = np.sign([function(omega) for omega in at])
    return np.array([brentq(function, at[k], at[k + 1], xtol=1e-9) for k in np.flatnonzero(np.diff(sign))]) / 2 / np.pi


@pytest.mark.slow
def test_a_cantilever_has_the_poles_and_zeros_of_its_closed_form(tmp_path: Path, timoshenko: Any) -> None:
    # Of two halves, so that the middle is a marker. Each keeps six modes; without static correction the zeros would be
    # off by some parts in ten thousand.
    tables = [beam("inner", LENGTH / 2, "[50, 2, 1]", more=supported("inner")), beam("outer", LENGTH / 2, "[50, 2, 1]")]
    joints = [fixed("clamp", "ground", "inner.root"), fixed("weld", "inner.tip", "outer.root")]
    run = pipeline_of(tmp_path, *tables, *joints, tip="outer.tip")
    model = linearise_scene(run, ["outer.tip.y"], ["outer.tip.y", "inner.tip.y"]).model

    theory = timoshenko(LENGTH, DEPTH, WIDTH, MATERIAL)

    def clamped(omega: float) -> float:
        return float(np.linalg.det(expm(theory.system(omega))[2:, 2:]))

    def at(part: float) -> Callable[[float], float]:
        """Displacement at a part of the length by a force at the tip, times a determinant without zeros."""

        def displacement(omega: float) -> float:
            end = expm(theory.system(omega))
            return float(expm(part * theory.system(omega))[0, 2:] @ [end[2, 3], -end[2, 2]])

        return displacement

    poles, at_tip, at_middle = (roots_hz(function, 1000.0) for function in (clamped, at(1.0), at(0.5)))
    np.testing.assert_allclose(model.poles_hz[:3], poles[:3], rtol=1e-4)
    np.testing.assert_allclose(model.zeros_hz(0, 0)[: len(at_tip)], at_tip, rtol=1e-4)
    np.testing.assert_allclose(model.zeros_hz(0, 1)[: len(at_middle)], at_middle, rtol=1e-4)
    assert (len(at_tip), len(at_middle)) == (3, 1)


def test_a_beam_on_a_turning_hub_has_its_transcendental_transfer_function(tmp_path: Path, timoshenko: Any) -> None:
    hub = f"""
[body.hub]
shape = "rigid"
mass = "1 kg"
centre = ["0 m", "0 m", "0 m"]
inertia = ["1 kg m^2", "1 kg m^2", "{HUB_INERTIA} kg m^2"]
marker = {{ shaft = {{ at = ["0 m", "0 m", "0 m"] }}, seat = {{ at = ["0 m", "0 m", "0 m"] }} }}

[joint.shaft]
type = "revolute"
parent = "ground"
child = "hub.shaft"
axis = [0, 0, 1]
"""
    tables = [hub, beam("beam", LENGTH, "[50, 2, 1]", more=supported("beam")), fixed("seat", "hub.seat", "beam.root")]
    run = pipeline_of(tmp_path, *tables)
    linear = linearise_scene(run, ["shaft.torque"], ["shaft.position"])
    theory = timoshenko(LENGTH, DEPTH, WIDTH, MATERIAL)

    def stiffness(omega: float) -> float:
        """Torque on the hub for a unit angle, ``−J ω² − M(0)``."""
        end = expm(theory.system(omega))
        moment, _ = -np.linalg.solve(end[2:, 2:], end[2:, 1])
        return float(-HUB_INERTIA * omega**2 - moment * theory.bending / LENGTH)

    # Away from its poles and zeros, which are compared by their frequencies.
    frequencies = np.array([1.0, 10.0, 25.0, 60.0, 100.0, 150.0, 250.0, 450.0, 700.0])
    expected = [1.0 / stiffness(2 * np.pi * f) for f in frequencies]
    np.testing.assert_allclose(linear.frequency_response(frequencies)[:, 0, 0].real, expected, rtol=2e-3)
    poles = roots_hz(lambda omega: stiffness(omega) * np.linalg.det(expm(theory.system(omega))[2:, 2:]), 900.0)
    np.testing.assert_allclose(linear.model.poles_hz[: len(poles)], poles, rtol=3e-4)
    assert len(poles) >= 3


def test_a_beam_that_floats_on_its_hinge_answers_the_torque_there(tmp_path: Path, timoshenko: Any) -> None:
    # No hub: the torque acts on the beam's own face, and its frame floats about the hinge.
    hinge = '[joint.shaft]\ntype = "revolute"\nparent = "ground"\nchild = "beam.root"\naxis = [0, 0, 1]\n'
    run = pipeline_of(tmp_path, beam("beam", LENGTH, "[50, 2, 1]"), hinge)
    linear = linearise_scene(run, ["shaft.torque"], ["shaft.position", "beam.tip.y"])
    theory = timoshenko(LENGTH, DEPTH, WIDTH, MATERIAL)
    frequencies = np.array([1.0, 20.0, 70.0, 200.0, 300.0, 400.0])
    expected = []
    for omega in 2 * np.pi * frequencies:
        end = expm(theory.system(omega))
        # w = 0 and M = −τ at the hinge; angle and shear so that neither moment nor shear is left at the tip.
        moment = -LENGTH / theory.bending
        angle, shear = -np.linalg.solve(end[2:][:, [1, 3]], end[2:, 2] * moment)
        tip = end[0] @ [0.0, angle, moment, shear]
        expected.append([angle, LENGTH * tip])
    found = linear.frequency_response(frequencies)[:, :, 0].real
    np.testing.assert_allclose(found, expected, rtol=3e-3)

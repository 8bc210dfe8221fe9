"""Orientations in the error budget: a body that tumbles states by how much it may be turned from where it is."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import state_errors
from fmd.accuracy.error_estimates import OrientationQuantity, Quantity
from fmd.accuracy.quantities import motion_quantities
from fmd.core.rotations import quaternion_of_matrix, rotation_matrix

INERTIA, SPIN, DURATION = np.array([1e-3, 2e-3, 2.5e-3]), np.array([1e-4, 12.0, 1e-4]), 6.0
TUMBLE = f"""
title = "Tumble"
[body.box]
shape = "rigid"
mass = "1 kg"
inertia = {[f"{x} kg m^2" for x in INERTIA]}
marker = {{ middle = {{ at = ["0 m", "0 m", "0 m"] }} }}
[joint.flight]
type = "free"
parent = "ground"
child = "box.middle"
spin = {[f"{x} rad/s" for x in SPIN]}
velocity = ["1 m/s", "0 m/s", "0 m/s"]
[simulation]
duration = "{DURATION} s"
output_step = "50 ms"
tip = "box.middle"
gravity = ["0 m/s^2", "0 m/s^2", "0 m/s^2"]
run = [{{ integrator = "auto" }}]
"""


def tumbled(times: np.ndarray) -> np.ndarray:
    """Return unit quaternions, scalar part last, of a free body by Euler's equations."""

    def slopes(t: float, y: np.ndarray) -> np.ndarray:
        e, s, w = y[:3], y[3], y[4:]
        return np.r_[0.5 * (s * w + np.cross(e, w)), -0.5 * e @ w, -np.cross(w, INERTIA * w) / INERTIA]

    start = np.r_[0.0, 0.0, 0.0, 1.0, SPIN]
    found = solve_ivp(slopes, (0.0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13).y[:4].T
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def test_the_error_of_an_orientation_is_the_angle_between_two_whatever_their_quaternions_signs() -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3
    angles = np.linspace(0.0, 5.0, 11)
    e, f = (quaternion_of_matrix(rotation_matrix((angles * factor)[:, None] * axis)) for factor in (1.0, 1.01))
    ours, theirs = (
        OrientationQuantity("joint, orientation", "rad", e),
        OrientationQuantity("joint, orientation", "rad", -f),
    )
    assert ours.sizes == pytest.approx(np.minimum(angles, 2 * np.pi - angles))
    assert ours.error(theirs) == pytest.approx(0.05 / theirs.scale)
    assert ours.error(ours) == 0.0


def test_a_body_that_tumbles_about_its_middle_axis_states_how_far_its_orientation_is_off(tmp_path: Path) -> None:
    file = tmp_path / "tumble.toml"
    file.write_text(TUMBLE)
    run = Pipeline(load_scene(file))
    found = motion_quantities(run.motion, run.fine_motion)
    assert isinstance(found["flight, orientation"], OrientationQuantity)
    exact = OrientationQuantity("flight, orientation", "rad", tumbled(run.output_times))
    assert exact.scale > 3.0  # it turns over
    true = found["flight, orientation"].error(exact)
    rows = {row.name: row for row in state_errors(run).rows}
    stated = rows["flight, orientation"].total
    assert rows["flight, orientation"].unit == "rad"
    assert 1e-6 < true <= stated < 20 * true
    moved = Quantity("flight, position", "m", np.outer(run.output_times, [1.0, 0.0, 0.0]))
    assert found["flight, position"].error(moved) < 1e-6

"""Loads by a formula of the motion: closed loops against other programs, tangents, curves, and what is refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.scene.scene import Scene
from fmd.stages.linear_model import linearise_scene

ROD = """
title = "Rod"

[body.rod]
shape = "rod"
mass = "2 kg"
length = "1 m"
marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }

[joint.hinge]
type = "revolute"
parent = "ground"
child = "rod.hinge"
axis = [0, 0, 1]

[simulation]
duration = "1 s"
output_step = "10 ms"
tip = "rod.end"
gravity = ["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]

[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-10
"""
FLOATING = "simulation.gravity=[]"
SERVO = """
[drive.servo]
type = "torque"
joint = "hinge"

[drive.servo.torque]
formula = "k*(ref(t) - q) + c*(ref.rate - rate)"
unit = "N m"

[drive.servo.torque.variables]
k = "40 N m/rad"
c = 4.0
ref = { arguments = [0, 0.5, 1], values = [0, 30, 30], unit = "deg", between = "smooth" }
"""
INERTIA = 2 / 3  # of the rod about its hinge [kg m²]
WEIGHT = 2 * 9.81 * 0.5  # moment of its weight [N m]


def scene_of(folder: Path, text: str, *overrides: str) -> Scene:
    file = folder / "mine.toml"
    file.write_text(text)
    return load_scene(file, overrides)


def torque(formula: str, variables: str = "{}") -> str:
    return (
        '\n[drive.own]\ntype = "torque"\njoint = "hinge"\n'
        f'torque = {{ formula = "{formula}", unit = "N m", variables = {variables} }}\n'
    )


def angle_of(scene: Scene) -> tuple[Array, Array]:
    motion = Pipeline(scene).motion
    return motion.times, motion.joint_position("hinge")


def closely(slope: Any, start: list[float], times: Array) -> Array:
    found = solve_ivp(slope, (0.0, times[-1]), start, rtol=1e-12, atol=1e-13, t_eval=times, method="DOP853")
    return np.asarray(found.y)


@pytest.mark.parametrize(
    ("run", "error"),
    [
        ('{ integrator = "runge-kutta", tolerance = 1e-10 }', 1e-8),
        ('{ integrator = "central-difference", step = "0.1 ms" }', 1e-6),
        ('{ integrator = "generalized-alpha", step = "0.2 ms" }', 1e-6),
        ('{ integrator = "exponential-rosenbrock", tolerance = 1e-9 }', 1e-6),
    ],
)
def test_a_servo_moves_as_the_equation_of_its_closed_loop_says(tmp_path: Path, run: str, error: float):
    times, angle = angle_of(scene_of(tmp_path, ROD + SERVO, f"simulation.run=[{run}]"))
    reference = CubicSpline([0.0, 0.5, 1.0], np.deg2rad([0, 30, 30]), bc_type="clamped")

    def slope(t: float, y: Array) -> list[float]:
        servo = 40 * (reference(t) - y[0]) + 4 * (reference(t, 1) - y[1])
        return [y[1], (servo - WEIGHT * np.cos(y[0])) / INERTIA]

    assert np.abs(angle - closely(slope, [0.0, 0.0], times)[0]).max() < error


def test_a_linear_loop_answers_a_step_as_its_matrix_exponential_does(tmp_path: Path):
    text = ROD + torque("k*(1 - q) - c*rate", "{ k = 40, c = 4 }")
    gravity = 'simulation.gravity=["0 m/s^2", "0 m/s^2", "0 m/s^2"]'
    times, angle = angle_of(scene_of(tmp_path, text, gravity))
    A = np.array([[0.0, 1.0], [-40 / INERTIA, -4 / INERTIA]])
    exact = [1.0 - (expm(A * t) @ [1.0, 0.0])[0] for t in times]
    assert np.abs(angle - exact).max() < 1e-9


def test_steps_and_frequencies_know_the_stiffness_of_a_servo(tmp_path: Path):
    spring = ('joint.hinge.spring="5 N m/rad"', 'joint.hinge.damper="1 N m s/rad"', 'joint.hinge.rest="10 deg"')
    system = Pipeline(scene_of(tmp_path, ROD + SERVO, *spring)).system
    M, K, C = system.linear_matrices
    assert (M[0, 0], K[0, 0], C[0, 0]) == pytest.approx((INERTIA, 45.0, 5.0), rel=1e-12)
    assert system.highest_frequency == pytest.approx(np.sqrt(45 / INERTIA), rel=1e-12)


def test_a_gas_torque_by_a_curve_repeats_after_two_turns(tmp_path: Path):
    angles, pressures = np.array([0, 10, 30, 60, 180, 540, 720]), np.array([40, 62, 31, 12, 3, 1, 40])
    curve = (
        f"{{ gas = {{ arguments = {angles.tolist()}, values = {pressures.tolist()}, "
        'argument_unit = "deg", unit = "bar", beyond = "repeat" } }'
    )
    text = ROD + torque("1e-5*gas(q)*abs(sin(q)) - 0.5*rate", curve)
    start = ('joint.hinge.rate="40 rad/s"', 'joint.hinge.angle="-300 deg"', "simulation.duration=0.5 s")
    scene = scene_of(tmp_path, text, *start, 'simulation.gravity=["0 m/s^2", "0 m/s^2", "0 m/s^2"]')
    times, angle = angle_of(scene)

    def slope(t: float, y: Array) -> list[float]:
        gas = 1e5 * np.interp(np.rad2deg(y[0]) % 720.0, angles, pressures)
        return [y[1], (1e-5 * gas * abs(np.sin(y[0])) - 0.5 * y[1]) / INERTIA]

    exact = solve_ivp(
        slope, (0, 0.5), [np.deg2rad(-300), 40.0], rtol=1e-9, atol=1e-10, t_eval=times, max_step=1e-4, method="DOP853"
    ).y[0]
    assert np.ptp(exact) > 4 * np.pi  # through the curve's end, and through a negative angle
    assert np.abs(angle - exact).max() < 1e-6


def test_a_force_by_a_marker_is_that_of_springs_to_the_ground(tmp_path: Path):
    pulls = "".join(
        f'\n[drive.{way}]\ntype = "point force"\nmarker = "rod.end"\ndirection = {direction}\n'
        f'force = {{ formula = "{formula}", unit = "kN" }}\n'
        for way, direction, formula in (
            ("x", [1, 0, 0], "-0.05*(rod.end.x - 0.3) - 1e-3*rod.end.vx"),
            ("y", [0, 1, 0], "-0.05*rod.end.y - 1e-3*rod.end.vy"),
        )
    )
    times, angle = angle_of(scene_of(tmp_path, ROD + pulls, 'joint.hinge.angle="20 deg"'))

    def slope(t: float, y: Array) -> list[float]:  # by the potential ½ k |x − x₀|², and a damper on the end's speed
        moment = -50 * 0.3 * np.sin(y[0]) - 1.0 * y[1]
        return [y[1], (moment - WEIGHT * np.cos(y[0])) / INERTIA]

    assert np.abs(angle - closely(slope, [np.deg2rad(20), 0.0], times)[0]).max() < 1e-8


ARM = """
title = "Two links"

[body.upper]
shape = "rod"
mass = "3 kg"
length = "0.5 m"
marker = { base = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["0.5 m", "0 m", "0 m"] } }

[body.lower]
shape = "rod"
mass = "1 kg"
length = "0.4 m"
marker = { base = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["0.4 m", "0 m", "0 m"] } }

[joint.hinge]
type = "revolute"
parent = "ground"
child = "upper.base"
axis = [0, 0, 1]

[joint.elbow]
type = "revolute"
parent = "upper.end"
child = "lower.base"
axis = [0, 0, 1]

[drive.shoulder]
type = "torque"
joint = "hinge"
torque = { formula = "max(-9, min(9, 60*(0.5*sin(3*t) - q) + 5*(1.5*cos(3*t) - rate) - 2*elbow.rate))", unit = "N m" }

[drive.elbow]
type = "torque"
joint = "elbow"
torque = { formula = "20*(sin(2*t) - q - 0.2*hinge.angle) - rate if t < 0.7 else -rate", unit = "N m" }

[simulation]
duration = "1 s"
output_step = "10 ms"
tip = "lower.end"

[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-10
"""


def test_two_saturated_and_switched_joints_move_as_their_closed_form(tmp_path: Path):
    motion = Pipeline(scene_of(tmp_path, ARM)).motion
    (m1, l1), (m2, l2) = (3.0, 0.5), (1.0, 0.4)

    def slope(t: float, y: Array) -> Array:
        a, b, u, w = y
        M = np.array(
            [
                [m1 * l1**2 / 3 + m2 * (l1**2 + l2**2 / 3 + l1 * l2 * np.cos(b)), 0.0],
                [m2 * (l2**2 / 3 + l1 * l2 / 2 * np.cos(b)), m2 * l2**2 / 3],
            ]
        )
        M[0, 1] = M[1, 0]
        h = m2 * l1 * l2 / 2 * np.sin(b)
        servo = np.clip(60 * (0.5 * np.sin(3 * t) - a) + 5 * (1.5 * np.cos(3 * t) - u) - 2 * w, -9, 9)
        other = (20 * (np.sin(2 * t) - b - 0.2 * a) if t < 0.7 else 0.0) - w
        return np.r_[u, w, np.linalg.solve(M, [servo + h * (2 * u * w + w**2), other - h * u**2])]

    first = motion.times < 0.7 - 1e-9
    before = closely(slope, [0.0] * 4, np.append(motion.times[first], 0.7))
    after = closely(lambda t, y: slope(t + 0.7, y), list(before[:, -1]), motion.times[~first] - 0.7)
    exact = np.concatenate([before[:, :-1], after], axis=1)
    for k, joint in enumerate(("hinge", "elbow")):
        assert np.abs(motion.joint_position(joint) - exact[k]).max() < 1e-6


def test_tangents_of_a_load_by_the_state_are_its_differences(tmp_path: Path):
    text = ARM + (
        '\n[drive.pull]\ntype = "point force"\nmarker = "lower.end"\ndirection = [1, 2, 0]\nfollowing = true\n'
        'force = { formula = "tanh(lower.end.x*upper.end.vy) + lower.end.y**2*t", unit = "N" }\n'
    )
    compiled = Pipeline(scene_of(tmp_path, text)).system.compiled
    q, v, a = np.array([0.3, -0.4]), np.array([0.2, 0.1]), np.array([1.0, -2.0])
    inputs, h = compiled.signal_values(0.2), 1e-6
    by_q, by_v, _ = compiled.tangents(inputs, q, v, a)
    for k, d in enumerate(h * np.eye(2)):
        change_q = (compiled.residual(0.2, q + d, v, a) - compiled.residual(0.2, q - d, v, a)) / (2 * h)
        change_v = (compiled.residual(0.2, q, v + d, a) - compiled.residual(0.2, q, v - d, a)) / (2 * h)
        assert by_q[:, k] == pytest.approx(change_q, abs=1e-7)
        assert by_v[:, k] == pytest.approx(change_v, abs=1e-7)


BEAM = ("body.beam.mesh.divisions=[12, 1, 1]", "simulation.duration=20 ms", "simulation.output_step=1 ms")
HOLD = '{ formula = "max(-0.2, min(0.2, -3*q - 0.02*rate - 5*beam.tip.y))", unit = "N m" }'


def test_sub_cycling_a_flexible_body_under_control_agrees_with_plain_steps():
    tip = load_scene("beam-paper").simulation.tip.partition(".")[2]
    drive = (
        f'drive={{ hold = {{ type = "torque", joint = "hub", torque = {HOLD.replace("beam.tip", f"beam.{tip}")} }} }}'
    )
    runs = (
        'simulation.run=[{ integrator = "central-difference", step = "2 us" }, '
        '{ integrator = "sub-cycling", step = "2 us", substeps = 5 }]'
    )
    scene = load_scene("beam-paper", [*BEAM, drive, runs, 'joint.hub.rate="20 rad/s"'])
    plain, cycled = (motion.trajectory.q for motion in Pipeline(scene).motions.values())
    assert np.abs(cycled - plain).max() < 1e-4 * np.abs(plain).max()
    assert np.abs(plain[:, 0]).max() > 0.01


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (torque("k*q"), "drive.own.torque.formula = 'k*q': at column 1: there is no 'k'"),
        (torque("elbo.rate"), "no such joint"),
        (torque("rod.tip.x"), "no such marker"),
        (torque("1 if q < 0 else 2"), "a condition compares t with a constant; of the state, min, max, abs and tanh"),
        (torque("k*q", "{ k = '3 furlong/fortnite' }"), "isn't a number with a unit"),
        (torque("k*q", "{ k = true }"), "must be a number, a quantity such as"),
        (torque("q", "{ k = 2 }"), "drive.own.torque.variables.k = 2: isn't in the formula"),
        (torque("k*q", "{ k = { values = [1, 2] } }"), "is missing: a curve has arguments and values"),
        (torque("k(q)", "{ k = { arguments = [0, 1], values = [1, 2, 3] } }"), "must hold 2 values"),
        (torque("k(q)", "{ k = { arguments = [0, 1], values = [1, 2], beyond = 'repeat' } }"), "ends as it begins"),
        (torque("1/q"), "a formula of the motion has no finite value at the start"),
        (torque("q*sqrt(t - 0.5)"), "has no real value"),
    ],
)
def test_a_formula_that_cannot_be_evaluated_is_refused(tmp_path: Path, text: str, message: str):
    with pytest.raises(InputError, match=re.escape(message)):
        Pipeline(scene_of(tmp_path, ROD + text)).mechanism  # noqa: B018


def test_a_linear_model_has_the_poles_of_the_closed_loop(tmp_path: Path):
    gravity = 'simulation.gravity=["0 m/s^2", "0 m/s^2", "0 m/s^2"]'
    run = Pipeline(scene_of(tmp_path, ROD + torque("-k*q - c*rate", "{ k = 40, c = 4 }"), gravity))
    poles = np.linalg.eigvals(linearise_scene(run, ["hinge.torque"], ["hinge.position"], "start").model.A)
    exact = np.roots([INERTIA, 4.0, 40.0])
    assert np.sort_complex(poles) == pytest.approx(np.sort_complex(exact), rel=1e-9)

"""Linear models of mechanisms: against differences of their accelerations, against marches, and in symmetries."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd.core.arrays import Array
from fmd.core.errors import InputError
from fmd.integrators.protocol import evaluate, evaluate_velocities, move_positions
from fmd.output.frequencies import rotating_table
from fmd.responses.linearisation import Linearisation
from fmd.scene.joints.free import FREE
from fmd.scene.scene import load_scene
from fmd.stability.tangent import OperatingPoint
from fmd.stages.linear_model import linearise_scene
from fmd.stages.pipeline import Pipeline
from tests.dynamics.compiler.comparison import TIME
from tests.dynamics.compiler.mechanisms import random_mechanism
from tests.responses.scenes import beam, fixed, pipeline_of, supported

NUDGE = 1e-5


def slopes(function: Any, n: int) -> Array:
    """Differentiate a function of n increments at none of them, by central differences of fourth order."""
    columns = []
    for unit in np.eye(n):
        at = [function(k * NUDGE * unit) for k in (-2, -1, 1, 2)]
        columns.append((at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * NUDGE))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("seed", range(6))
def test_a_tree_is_linearised_as_by_differences_of_its_accelerations(seed: int) -> None:
    made = random_mechanism(seed, second_order=seed % 2 == 1)
    mechanism = made.mechanism
    q, v = made.state(seed)
    for k, link in enumerate(mechanism.links):
        if link.joint == FREE:  # whose positions are taken in the body's axes, which turn
            v[mechanism.layout.rate[k] + 3 : mechanism.layout.rate[k] + 6] = 0.0
    from fmd.dynamics.compiled_system.system import CompiledSystem

    system = CompiledSystem(mechanism)
    p, n = system.parameters, mechanism.n

    def accelerations(change: Array) -> Array:
        a = np.zeros(n)
        evaluate(p, TIME, move_positions(p, q, change[:n]), v + change[n:], a)
        return a

    by_both = slopes(accelerations, 2 * n)
    model = Linearisation(mechanism, (), ()).at(OperatingPoint(TIME, q, v))
    W = free_axes(mechanism, q)
    expected = np.concatenate([W.T @ by_both[:, :n] @ W, W.T @ by_both[:, n:] @ W], axis=1)
    # Signals' own values are part of both; a given acceleration moves the bodies, but not their slopes by states.
    scale = np.abs(expected).max()
    np.testing.assert_allclose(model.A[n:] / scale, expected / scale, atol=2e-8)


def free_axes(mechanism: Any, q: Array) -> Array:
    """Return the rotation of each free joint's displacements from the body's axes into those of its place."""
    from fmd.core.rotations import matrix_of_quaternion

    W = np.eye(mechanism.n)
    for k, link in enumerate(mechanism.links):
        if link.joint == FREE:
            at, first = mechanism.layout.position[k], mechanism.layout.rate[k]
            W[first : first + 3, first : first + 3] = matrix_of_quaternion(q[None, at + 3 : at + 7])[0]
    return W


def four_bar() -> str:
    """Write a plane loop of three rods, one of which is turned by a spring and a damper and starts with a rate."""
    tables = []
    for name, length in (("crank", 0.1), ("coupler", 0.3), ("rocker", 0.25)):
        ends = f'marker = {{ a = {{ at = ["0 m", "0 m", "0 m"] }}, b = {{ at = ["{length} m", "0 m", "0 m"] }} }}'
        tables.append(f'[body.{name}]\nshape = "rod"\nmass = "{10 * length} kg"\nlength = "{length} m"\n{ends}\n')
    tables.append('[ground.far]\nat = ["0.3 m", "0 m", "0 m"]\n')
    joints = [
        ("first", "ground", "crank.a", 'angle = "70 deg"\nrate = "20 rad/s"\nspring = "3 N m"\ndamper = "0.1 N m s"')
    ]
    joints += [("second", "crank.b", "coupler.a", ""), ("third", "coupler.b", "rocker.b", "")]
    joints += [("last", "ground.far", "rocker.a", "")]
    order = [joints[0], joints[1], joints[3], joints[2]]  # the third closes the loop
    for name, parent, child, more in order:
        ends = f'parent = "{parent}"\nchild = "{child}"'
        tables.append(f'[joint.{name}]\ntype = "revolute"\n{ends}\naxis = [0, 0, 1]\n{more}\n')
    return "\n".join(tables)


def test_loops_are_linearised_as_by_differences_along_their_constraints(tmp_path: Path) -> None:
    gravity = 'simulation.gravity=["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]'
    run = pipeline_of(tmp_path, four_bar(), tip="coupler.b", overrides=(gravity,))
    mechanism, (q, v) = run.mechanism, run.start
    system = run.system
    p, n = system.parameters, mechanism.n
    linearisation = Linearisation(mechanism, (), ())
    model = linearisation.at(OperatingPoint(0.0, q, v))
    names = [name for name, _ in linearisation.state_names()]
    own = [name for name, _ in model.states[: len(model.states) // 2]]
    independent = np.array([names.index(name) for name in own])
    dependent = np.setdiff1d(np.arange(n), independent)

    def closed(change: Array) -> tuple[Array, Array]:
        """Move independent coordinates and rates; the dependent ones follow by Newton's method."""
        k = len(independent)
        step = np.zeros(n)
        step[independent] = change[:k]
        at = move_positions(p, q, step)
        for _ in range(8):
            gap, _ = system.compiled.residuals(0.0, at, v)
            J = system.compiled.constraint_jacobian(0.0, at)[:, dependent]
            back = np.zeros(n)
            back[dependent] = -np.linalg.lstsq(J, gap, rcond=1e-9)[0]
            at = move_positions(p, at, back)
        rates = v.copy()
        rates[independent] += change[k:]
        _, opening = system.compiled.residuals(0.0, at, rates)
        J = system.compiled.constraint_jacobian(0.0, at)[:, dependent]
        rates[dependent] -= np.linalg.lstsq(J, opening, rcond=1e-9)[0]
        return at, rates

    def accelerations(change: Array) -> Array:
        a = np.zeros(n)
        evaluate(p, 0.0, *closed(change), a)
        return a[independent]

    assert linearisation.accelerations(OperatingPoint(0.0, q, v)) == pytest.approx(
        _accelerations(system, q, v), rel=1e-7, abs=1e-6
    )
    expected = slopes(accelerations, 2 * len(independent))
    found = model.A[len(independent) :]
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-6)


def _accelerations(system: Any, q: Array, v: Array) -> Array:
    a, dq = np.zeros(system.n), np.zeros(system.n_positions)
    evaluate_velocities(system.parameters, q, v, dq)
    evaluate(system.parameters, 0.0, q, v, a)
    return a


def test_a_march_driven_by_a_sine_settles_to_the_response() -> None:
    hertz = 95.0
    # Twenty time constants of the slowest mode; the last ten periods are fitted by a sine.
    overrides = [
        "body.plate.mesh.divisions=[6, 4, 2]",
        "body.plate.modes.damping=0.1",
        'body.plate.modes.enrich="residual"',
        f'drive.hammer.force={{ formula = "sin(2*pi*{hertz}*t)", unit = "N" }}',
        "simulation.duration=0.4 s",
        "simulation.output_step=0.2 ms",
        'simulation.run=[{ integrator = "exponential", step = "20 us" }]',
    ]
    run = Pipeline(load_scene("plate", overrides))
    linear = linearise_scene(run, ["drive.hammer"], ["plate.tip.z", "plate.root.xx"])
    H = linear.frequency_response(np.array([hertz]))[0, :, 0]
    late = run.motion.times > 0.4 - 10 / hertz
    waves = np.exp(2j * np.pi * hertz * run.motion.times[late])
    basis = np.stack([waves.imag, waves.real], axis=1)
    histories = [run.motion.tip_deflection[:, 2], next(iter(run.element_stress("plate.root", "xx").values()))]
    for history, response in zip(histories, H, strict=True):
        sine, cosine = np.linalg.lstsq(basis, history[late], rcond=None)[0]
        assert abs(complex(sine, cosine) - response) < 1e-3 * abs(response)


def test_dashpots_count(tmp_path: Path) -> None:
    # A rigid rod on a hinge with spring and damper: ω² = k/J, 2 ζ ω = c/J.
    rod = """
[body.rod]
shape = "rod"
mass = "3 kg"
length = "1 m"
marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }

[joint.hinge]
type = "revolute"
parent = "ground"
child = "rod.hinge"
axis = [0, 0, 1]
spring = "400 N m"
damper = "2 N m s"
"""
    model = linearise_scene(pipeline_of(tmp_path, rod, tip="rod.end"), ["rod.end.y"], ["rod.end.y", "hinge.rate"]).model
    assert model.poles_hz == pytest.approx([20.0 / 2 / np.pi])
    assert model.damping == pytest.approx([2.0 / (2 * 20.0)])
    at = np.array([2.0])
    s = 2j * np.pi * at
    expected = 1.0 / (s**2 + 2.0 * s + 400.0)
    np.testing.assert_allclose(model.frequency_response(at)[:, 0, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(model.frequency_response(at)[:, 1, 0], s * expected, rtol=1e-12)


def test_a_pendulum_swings_about_its_equilibrium(tmp_path: Path) -> None:
    rod = """
[body.rod]
shape = "rod"
mass = "3 kg"
length = "1 m"
marker = { hinge = { at = ["0 m", "0 m", "0 m"] }, end = { at = ["1 m", "0 m", "0 m"] } }

[joint.hinge]
type = "revolute"
parent = "ground"
child = "rod.hinge"
axis = [0, 0, 1]
angle = "-80 deg"
"""
    run = pipeline_of(
        tmp_path, rod, tip="rod.end", overrides=('simulation.gravity=["0 m/s^2", "-9.81 m/s^2", "0 m/s^2"]',)
    )
    rest = linearise_scene(run, ["rod.end.x"], ["rod.end.x"], "equilibrium")
    assert rest.model.poles_hz == pytest.approx([np.sqrt(1.5 * 9.81) / 2 / np.pi])
    assert [warning["code"] for warning in rest.warnings] == ["undamped"]
    start = linearise_scene(run, ["rod.end.x"], ["rod.end.x"])
    assert start.model.poles_hz == pytest.approx([np.sqrt(1.5 * 9.81 * np.sin(np.radians(80))) / 2 / np.pi])
    assert "not-steady" in [warning["code"] for warning in start.warnings]


def test_transfer_functions_are_reciprocal(tmp_path: Path) -> None:
    run = pipeline_of(
        tmp_path, beam("beam", 0.5, "[10, 1, 1]", more=supported("beam")), fixed("c", "ground", "beam.root")
    )
    names = ["beam.tip.x", "beam.tip.y", "beam.tip.rz"]
    H = linearise_scene(run, names, names).frequency_response(np.array([10.0, 130.0, 700.0]))
    np.testing.assert_allclose(H, H.swapaxes(1, 2), atol=1e-12 * np.abs(H).max())


@pytest.mark.parametrize(
    ("inputs", "outputs", "about", "message"),
    [
        (["plate.side.q"], ["plate.tip.z"], "start", "no such input; the inputs: plate.root.x"),
        (["drive.hammr"], ["plate.tip.z"], "start", "did you mean 'drive.hammer'"),
        (["clamp.torque"], ["plate.tip.z"], "start", "is a fixed joint"),
        (["drive.hammer"], ["plate.root.von Mises"], "start", "isn't linear in the motion"),
        (["drive.hammer"], ["plate.top.z"], "start", "no such output"),
        (["drive.hammer"], ["clamp.position"], "start", "a marker's motion works"),
        (["drive.hammer"], ["plate.tip.z"], "later", "must be one of start, equilibrium, steady, or a time"),
        (["drive.hammer"], ["plate.tip.z"], "3", "0 … 0.06 s"),
    ],
)
def test_a_wrong_name_is_refused(inputs: list[str], outputs: list[str], about: str, message: str) -> None:
    run = Pipeline(load_scene("plate", ["body.plate.mesh.divisions=[6, 4, 2]"]))
    with pytest.raises(InputError, match=message):
        linearise_scene(run, inputs, outputs, about)


def test_a_joint_that_a_motion_drives_takes_no_torque() -> None:
    run = Pipeline(load_scene("slider-crank"))
    name = next(drive.joint for drive in run.scene.drive.values() if drive.type == "motion")
    with pytest.raises(InputError, match="moves as prescribed: 'drive"):
        linearise_scene(run, [f"{name}.torque"], [f"{name}.position"])


def test_a_scene_that_is_linear_is_the_same_about_every_time() -> None:
    run = Pipeline(load_scene("plate", ["body.plate.mesh.divisions=[6, 4, 2]"]))
    early, late = (linearise_scene(run, ["drive.hammer"], ["plate.tip.z"], about) for about in ("start", "20 ms"))
    np.testing.assert_allclose(late.model.poles_hz, early.model.poles_hz, rtol=1e-3)  # but for its stiffening
    assert (early.about, late.about) == ("start", "t = 0.02 s")
    assert [warning["code"] for warning in late.warnings] == ["not-steady"]


def test_a_steady_rotation_has_the_frequencies_of_a_turning_hub() -> None:
    # The mechanism's equations in steady rotation, deflected and with Coriolis terms, against those of the part alone.
    name = next(iter(load_scene("spin-up").drive))
    overrides = [f'drive.{name}.angle={{ formula = "6*t", unit = "rad" }}', 'body.beam.modes.enrich="residual"']
    run = Pipeline(load_scene("spin-up", overrides))
    tip = run.scene.simulation.tip
    linear = linearise_scene(run, [f"{tip}.y"], [f"{tip}.y"], "steady")
    expected = rotating_table(run, 6.0)["rotating_frequencies_hz"]
    np.testing.assert_allclose(linear.model.poles_hz[:4], expected[:4], rtol=1e-4)
    assert [warning["code"] for warning in linear.warnings] == ["undamped"]

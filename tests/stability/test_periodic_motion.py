"""Motions that repeat: against closed forms, SciPy's solver and long marches; multipliers against flows of SciPy's."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, InputError
from fmd.integrators.runge_kutta import RungeKutta
from fmd.output.mechanism_figures import periodic_figures, periodic_warnings
from fmd.stages.mechanism import place_joints

SLIDER: dict[str, Any] = {
    "title": "Slider on a spring",
    "body": {"block": {"shape": "point", "mass": 2.0, "marker": {"c": {"at": [0.0, 0.0, 0.0]}}}},
    "joint": {"slide": {"type": "prismatic", "parent": "ground", "child": "block.c", "axis": [1, 0, 0]}},
    "simulation": {
        "output_step": 1e-2,
        "tip": "block.c",
        "start": "periodic",
        "error": 1e-6,
        "run": [{"integrator": "runge-kutta"}],
    },
}
PENDULUM: dict[str, Any] = {
    "title": "Driven pendulum",
    "body": {
        "rod": {
            "shape": "rod",
            "mass": 2.0,
            "length": 1.0,
            "marker": {"hinge": {"at": [0.0, 0.0, 0.0]}, "end": {"at": [1.0, 0.0, 0.0]}},
        }
    },
    "joint": {
        "hinge": {"type": "revolute", "parent": "ground", "child": "rod.hinge", "axis": [0, 0, 1], "damper": 0.7}
    },
    "simulation": SLIDER["simulation"] | {"tip": "rod.end", "gravity": [0.0, -9.81, 0.0]},
}


def pipeline_of(scene: dict[str, Any], period: float, **tables: Any) -> Pipeline:
    simulation = scene["simulation"] | {"period": period, "duration": 2.5 * period}
    joint = {name: one | tables.pop(name, {}) for name, one in scene["joint"].items()}
    return Pipeline(load_scene(scene | {"simulation": simulation, "joint": joint} | tables))


def in_order(multipliers: Array) -> Array:
    return np.sort_complex(np.asarray(multipliers, dtype=complex))


@pytest.mark.parametrize("seed", range(3))
def test_a_driven_oscillator_has_the_closed_form(seed: int) -> None:
    """``X = F/(k − mω² + icω)``, and the multipliers are the eigenvalues of the matrix exponential."""
    rng = np.random.default_rng(seed)
    m, k, c, omega, F = 2.0, *rng.uniform([50.0, 0.1, 3.0, 1.0], [500.0, 4.0, 30.0, 9.0])
    force = {"type": "force", "joint": "slide", "force": {"formula": f"{F}*cos({omega}*t)", "unit": "N"}}
    period = 2 * np.pi / omega
    run = pipeline_of(SLIDER, period, slide={"spring": k, "damper": c}, drive={"push": force})
    found = run.periodic
    X = F / (k - m * omega**2 + 1j * c * omega)
    np.testing.assert_allclose([*found.q, *found.v], [X.real, -omega * X.imag], atol=1e-8 * abs(X) * (1 + omega))
    exact = np.linalg.eigvals(expm(np.array([[0.0, 1.0], [-k / m, -c / m]]) * period))
    np.testing.assert_allclose(in_order(run.multipliers.values), in_order(exact), atol=1e-8)


def test_a_pid_with_an_integral_repeats_though_what_it_adds_up_does_not() -> None:
    """The loop's answer to r = sin ωt is ``P/(m s² + P)`` with ``P = kp + kd s + ki/s``."""
    m, kp, ki, kd, omega = 2.0, 40.0, 60.0, 12.0, 5.0
    error = {"error": f"sin({omega}*t) - slide.position", "error_rate": f"{omega}*cos({omega}*t) - slide.rate"}
    servo = {"type": "pid", "proportional": kp, "integral": ki, "derivative": kd, **error}
    drive = {"motor": {"type": "force", "joint": "slide", "force": {"formula": "servo", "unit": "N"}}}
    run = pipeline_of(SLIDER, 2 * np.pi / omega, controller={"servo": servo}, drive=drive)
    s = 1j * omega
    answer = -1j * (kp + kd * s + ki / s) / (m * s**2 + kp + kd * s + ki / s)  # sin is Re of −i exp
    rate = [r for _, r, _ in run.mechanism.states]
    (own,) = set(range(run.mechanism.n)) - set(rate)
    found = run.periodic
    at = run.mechanism.position_of_rates[own]
    np.testing.assert_allclose([found.q[at], found.v[own]], [answer.real, (s * answer).real], atol=1e-7)
    closed = np.array([[0, 1, 0], [-kp / m, -kd / m, 1 / m], [-ki, 0, 0]])  # the integral's part of the output is last
    exact = in_order(np.linalg.eigvals(expm(closed * 2 * np.pi / omega)))
    moduli = np.sort(np.abs(run.multipliers.values))
    np.testing.assert_allclose(moduli, np.sort(np.abs(exact)), atol=1e-7)


@pytest.fixture(scope="module")
def pendulum() -> Pipeline:
    torque = {"type": "torque", "joint": "hinge", "torque": {"formula": "2.5*sin(3*t) + 1.5", "unit": "N m"}}
    return pipeline_of(PENDULUM, 2 * np.pi / 3, hinge={"angle": -1.2}, drive={"motor": torque})


def swing(t: float, x: Array) -> list[float]:
    """Return the pendulum's rates by hand, of angle and rate."""
    return [x[1], (2.5 * np.sin(3 * t) + 1.5 - 0.7 * x[1] - 9.81 * np.cos(x[0])) * 1.5]


def test_a_driven_pendulum_is_where_a_long_march_by_scipy_settles(pendulum: Pipeline) -> None:
    T, found = 2 * np.pi / 3, pendulum.periodic
    end = solve_ivp(swing, (0, 40 * T), [-1.2, 0.0], rtol=1e-11, atol=1e-12, method="DOP853").y[:, -1]
    assert np.ptp(found.states[:, 0]) > 0.8  # a wide swing
    np.testing.assert_allclose([found.q[0], found.v[0]], end, atol=1e-8)
    assert found.gap < 1e-8


def test_multipliers_of_a_pendulum_are_those_of_its_flow(pendulum: Pipeline) -> None:
    """The flow is differentiated by finite differences of SciPy's marches."""
    start, T, columns = np.array([*pendulum.periodic.q, *pendulum.periodic.v]), 2 * np.pi / 3, []
    for k in range(2):
        ends = [
            solve_ivp(swing, (0, T), start + sign * np.eye(2)[k], rtol=1e-12, atol=1e-13, method="DOP853").y[:, -1]
            for sign in (1e-5, -1e-5)
        ]
        columns.append((ends[0] - ends[1]) / 2e-5)
    exact = np.linalg.eigvals(np.array(columns).T)
    np.testing.assert_allclose(in_order(pendulum.multipliers.values), in_order(exact), atol=1e-6)


def test_an_upside_down_pendulum_repeats_and_is_called_unstable() -> None:
    torque = {"type": "torque", "joint": "hinge", "torque": {"formula": "0.02*sin(9*t)", "unit": "N m"}}
    run = pipeline_of(PENDULUM, 2 * np.pi / 9, hinge={"angle": np.pi / 2}, drive={"motor": torque})
    assert abs(run.periodic.q[0] - np.pi / 2) < 0.05
    (warning,) = periodic_warnings(run)
    growth = np.exp(2 * np.pi / 9 * (-0.525 + np.sqrt(0.525**2 + 1.5 * 9.81)))  # of the linear pendulum
    assert periodic_figures(run)["periodic"]["multipliers"][0]["modulus"] == pytest.approx(growth, rel=1e-3)
    assert warning["text"].startswith("the periodic motion is unstable")


def test_a_small_correction_does_not_stand_for_a_small_gap() -> None:
    """Upside down, disturbances grow by exp(10) within this period: a correction of 1e-5 leaves a gap of 0.27."""
    torque = {"type": "torque", "joint": "hinge", "torque": {"formula": "0.02*sin(2*t)", "unit": "N m"}}
    scene = PENDULUM | {"simulation": PENDULUM["simulation"] | {"error": 1e-2}}
    with pytest.raises(AccuracyError, match="positions or rates still differ by"):
        _ = pipeline_of(scene, np.pi, hinge={"angle": np.pi / 2}, drive={"motor": torque}).periodic


def test_a_crank_with_a_flexible_rod_repeats_as_after_a_long_march() -> None:
    """A loop whose rod goes round against the crank; what a march settles at is the same orbit."""
    few = ["body.rod.modes.count=2", "body.rod.modes.enrich=none", "body.rod.modes.damping=0.05"]
    T = 2 * np.pi / 150
    own = ['simulation.start="periodic"', f'simulation.period="{T!r} s"', "simulation.error=1e-5"]
    run = Pipeline(load_scene("slider-crank", ["body.rod.mesh.divisions=[12,1,1]", *few, *own]))
    found, system = run.periodic, run.system
    q, v = place_joints(run.divided_scene, system.mechanism)
    march = RungeKutta(1e-12).march(system, q, v, np.arange(13) * T)
    modes = np.concatenate([system.mechanism.modes_of(k) for k in range(len(system.mechanism.links))])
    size = np.abs(found.states[:, modes + system.n_positions - system.n]).max()
    np.testing.assert_allclose(found.q[modes], march.q[-1][modes], atol=1e-5 * size)
    assert found.gap < 1e-8
    assert found.marches < 20
    assert len(run.multipliers.values) == 2 * len(modes)  # the joints follow
    # Between two periods the distance x to the orbit goes on as x'' = a x' − b x, with b the modulus squared of a pair.
    x = march.q[3:8][:, modes] - found.q[modes]
    pairs = np.stack([x[1:-1].ravel(), -x[:-2].ravel()], axis=1)
    (_, b), *_ = np.linalg.lstsq(pairs, x[2:].ravel(), rcond=None)
    assert np.abs(run.multipliers.values[:2]) == pytest.approx(np.sqrt(b), rel=1e-3)


def test_a_free_rotor_with_an_unbalance_whirls_as_the_closed_form() -> None:
    """A disc on round springs: ``r = e Ω²/(ω² − Ω²)``, by turns of a quaternion; neither speed nor angle is held."""
    m, e, k, Omega = 3.0, 2e-4, 5000.0, 60.0
    disc = {"shape": "rigid", "mass": m, "centre": [e, 0.0, 0.0], "inertia": [0.02, 0.02, 0.03]}
    scene = SLIDER | {
        "body": {"disc": disc | {"marker": {"middle": {"at": [0.0, 0.0, 0.0]}}}},
        "joint": {"free": {"type": "free", "parent": "ground", "child": "disc.middle", "spin": [0.0, 0.0, Omega]}},
        "ground": {"seat": {"at": [0.0, 0.0, 0.0]}},
        "bearing": {"seat": {"between": ["ground.seat", "disc.middle"], "axis": [0, 0, 1], "radial": k}},
        "simulation": SLIDER["simulation"] | {"tip": "disc.middle"},
    }
    found = pipeline_of(scene, 2 * np.pi / Omega).periodic
    r = e * Omega**2 / (k / m - Omega**2)
    turn = 2 * np.arctan2(found.q[5], found.q[6])
    way = np.array([np.cos(turn), np.sin(turn), 0.0])
    np.testing.assert_allclose(found.q[:3], r * way, atol=1e-6 * e)
    assert abs(turn) < 1e-3
    np.testing.assert_allclose(
        found.v, [-r * Omega * way[1], r * Omega * way[0], 0, 0, 0, Omega], atol=1e-6 * e * Omega
    )


def test_what_does_not_repeat_is_said() -> None:
    push = {"push": {"type": "force", "joint": "slide", "force": {"formula": "cos(7*t)", "unit": "N"}}}
    stiff = {"slide": {"spring": 200.0, "damper": 0.4}}
    with pytest.raises(InputError, match=r"simulation.period.*isn't a period .* slide.position would accelerate"):
        _ = pipeline_of(SLIDER, 0.8, drive=push, **stiff).periodic
    with pytest.raises(AccuracyError, match=r"no motion of period .* still differ by"):  # a resonance without damping
        _ = pipeline_of(SLIDER, 2 * np.pi / 7, drive=push, slide={"spring": 98.0}).periodic
    simulation = SLIDER["simulation"] | {"duration": 2.0}
    with pytest.raises(InputError, match=r"simulation\.period.*is missing: a periodic start needs it"):
        load_scene(SLIDER | {"simulation": simulation})
    with pytest.raises(InputError, match="is for start = 'periodic' alone"):
        load_scene(SLIDER | {"simulation": simulation | {"start": "undeformed", "period": 1.0}})
    with pytest.raises(InputError, match="must not be longer than the duration"):
        load_scene(SLIDER | {"simulation": simulation | {"period": 3.0}})

"""Controllers with a memory: continuous and sampled loops against their matrix exponentials, and what is refused."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from fmd import Pipeline, jacobian, load_scene
from fmd.accuracy.solved_scene import SolvedScene
from fmd.cli.app import main
from fmd.core.arrays import Array
from fmd.core.errors import AccuracyError, ConvergenceError, InputError
from fmd.output.channels import find_channels
from fmd.output.histories import history_variables
from fmd.scene.scene import Scene
from fmd.stages.linear_model import linearise_scene
from fmd.stages.plan import Plan
from fmd.stages.sampling_check import find_unstable_sampling, state_of_start, states_of_motion
from fmd.stages.stiffening_check import rigid_motion

INERTIA = 2 / 3  # of the rod about its hinge [kg m²]
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

[drive.motor]
type = "torque"
joint = "hinge"
torque = { formula = "servo", unit = "N m" }

[simulation]
duration = "1 s"
output_step = "10 ms"
tip = "rod.end"

[[simulation.run]]
integrator = "runge-kutta"
tolerance = 1e-10
"""
PID = """
[controller.servo]
type = "pid"
error = "0.3 - hinge.angle"
error_rate = "-hinge.rate"
proportional = 40.0
integral = 60.0
derivative = 4.0
"""
SAMPLED = 'sample_time = "20 ms"\n'
FILTERED = PID.replace('error_rate = "-hinge.rate"\n', 'filter = "10 ms"\n')
LIMITS = "lowest = -3.0\nhighest = 3.0\n"
A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1 / INERTIA]])


def scene_of(folder: Path, text: str, *overrides: str) -> Scene:
    file = folder / "mine.toml"
    file.write_text(ROD + text)
    return load_scene(file, overrides)


def hold(A: Array, B: Array, time: float) -> tuple[Array, Array]:
    n, m = B.shape
    block = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * time)
    return block[:n, :n], block[:n, n:]


def exactly(A: Array, b: Array, start: list[float], times: Array) -> Array:
    block = np.block([[A, b[:, None]], [np.zeros((1, len(b) + 1))]])
    return np.array([(expm(block * t) @ [*start, 1.0])[:-1] for t in times])


def sampled_angles(control: Any, T: float, times: Array) -> Array:
    """March the rod from sample to sample, and from each to the times before the next one."""
    x, found, k = np.zeros(2), [], 0
    whole = hold(A, B, T)
    while len(found) < len(times):
        u = np.array([control(x)])
        while len(found) < len(times) and times[len(found)] < (k + 1) * T * (1 - 1e-12):
            Phi, Gamma = hold(A, B, times[len(found)] - k * T)
            found.append((Phi @ x + Gamma @ u)[0])
        x, k = whole[0] @ x + whole[1] @ u, k + 1
    return np.array(found)


@pytest.mark.parametrize(
    ("run", "error"),
    [
        ('{ integrator = "runge-kutta", tolerance = 1e-10 }', 1e-9),
        ('{ integrator = "exponential-rosenbrock", tolerance = 1e-9 }', 1e-9),
        ('{ integrator = "auto" }', 1e-5),
        ('{ integrator = "central-difference", step = "0.2 ms" }', 1e-6),
        ('{ integrator = "generalized-alpha", step = "0.2 ms" }', 1e-6),
    ],
)
def test_a_continuous_pid_loop_moves_as_its_matrix_exponential(tmp_path: Path, run: str, error: float):
    motion = Pipeline(scene_of(tmp_path, PID, f"simulation.run=[{run}]")).motion
    loop = np.array([[0, 1, 0], [-40 / INERTIA, -4 / INERTIA, 1 / INERTIA], [-60, 0, 0]])
    exact = exactly(loop, np.array([0, 12 / INERTIA, 18]), [0.0, 0.0, 0.0], motion.times)
    assert np.abs(motion.joint_position("hinge") - exact[:, 0]).max() < error
    assert [*motion.joints] == ["hinge"]  # the controller's state is no part of the mechanism's motion
    assert motion.energies[0] == pytest.approx(0.5 * INERTIA * motion.joint_rate("hinge") ** 2, abs=1e-12)


def test_a_closed_loop_moves_as_python_control_has_it(tmp_path: Path):
    """Figures of python-control 0.10.2, to be made again by

    ``G = tf([1], [2/3, 0, 0]); T = feedback(tf([40, 60], [1, 0]) * feedback(G, tf([4, 0], [1])), 1)`` and
    ``forced_response(ss(T), t, 0.3)``.
    """
    motion = Pipeline(scene_of(tmp_path, PID)).motion
    found = [motion.joint_position("hinge")[round(100 * t)] for t in (0.1, 0.25, 0.5, 1.0)]
    by_control = [0.07458803084199318, 0.30717571617837736, 0.44187687596894354, 0.26928250658992187]
    assert found == pytest.approx(by_control, abs=1e-8)


def test_limits_wind_the_integral_back_and_the_filter_starts_at_the_error(tmp_path: Path):
    motion = Pipeline(scene_of(tmp_path, FILTERED + LIMITS)).motion
    tracking = np.sqrt(4 / 60)

    def slope(_t: float, y: Array) -> list[float]:
        q, v, z, w = y
        error = 0.3 - q
        wanted = 40 * error + z + 4 * (error - w) / 0.01
        output = np.clip(wanted, -3, 3)
        return [v, output / INERTIA, 60 * error + (output - wanted) / tracking, (error - w) / 0.01]

    start = [0.0, 0.0, 0.0, 0.3]
    exact = solve_ivp(slope, (0, 1), start, rtol=1e-10, atol=1e-12, t_eval=motion.times, max_step=1e-3).y[0]
    assert np.abs(motion.joint_position("hinge") - exact).max() < 1e-7


def test_a_lag_follows_its_input(tmp_path: Path):
    lag = """
[controller.servo]
type = "lag"
input = "40*(0.3 - hinge.angle) - 4*hinge.rate"
time_constant = "50 ms"
start = 1.5
"""
    motion = Pipeline(scene_of(tmp_path, lag)).motion
    loop = np.array([[0, 1, 0], [0, 0, 1 / INERTIA], [-800, -80, -20]])
    exact = exactly(loop, np.array([0.0, 0.0, 240.0]), [0.0, 0.0, 1.5], motion.times)
    assert np.abs(motion.joint_position("hinge") - exact[:, 0]).max() < 1e-9


@pytest.mark.parametrize("run", ['{ integrator = "runge-kutta" }', '{ integrator = "auto" }'])
@pytest.mark.parametrize("output_step", ["10 ms", "7 ms"])
def test_a_sampled_loop_holds_its_output_from_sample_to_sample(tmp_path: Path, run: str, output_step: str):
    overrides = (f"simulation.run=[{run}]", f"simulation.output_step={output_step}")
    motion = Pipeline(scene_of(tmp_path, PID + SAMPLED, *overrides)).motion
    integral = 0.0

    def control(x: Array) -> float:
        nonlocal integral
        output = 40 * (0.3 - x[0]) + integral - 4 * x[1]
        integral += 60 * 0.02 * (0.3 - x[0])
        return output

    assert np.abs(motion.joint_position("hinge") - sampled_angles(control, 0.02, motion.times)).max() < 1e-10


@pytest.mark.parametrize("seed", range(6))
def test_random_sampled_controllers_with_filter_and_limits_are_those_of_a_program(tmp_path: Path, seed: int):
    random = np.random.default_rng(seed)
    kp, ki, kd, limit = random.uniform([5, 5, 0.5, 0.5], [60, 80, 5, 4])
    T, tau = random.uniform([3e-3, 2e-3], [2e-2, 3e-2])
    gains = f"proportional = {kp}\nintegral = {ki}\nderivative = {kd}\nlowest = {-limit}\nhighest = {limit}\n"
    sampled = f'filter = "{tau} s"\nsample_time = "{T} s"\n' if seed % 2 else f'sample_time = "{T} s"\n'
    text = '[controller.servo]\ntype = "pid"\nerror = "0.3 - hinge.angle"\n' + gains + sampled
    motion = Pipeline(scene_of(tmp_path, text)).motion
    z, w = 0.0, np.nan

    def control(x: Array) -> float:
        nonlocal z, w
        error = 0.3 - x[0]
        w = error if np.isnan(w) else w
        wanted = kp * error + z + kd * (error - w) / (tau if seed % 2 else T)
        output = min(max(wanted, -limit), limit)
        z += ki * T * error + min(1.0, T / np.sqrt(kd / ki)) * (output - wanted)
        w = w + (1 - np.exp(-T / tau)) * (error - w) if seed % 2 else error
        return output

    assert np.abs(motion.joint_position("hinge") - sampled_angles(control, T, motion.times)).max() < 1e-9


def test_an_inner_loop_takes_what_the_outer_one_has_just_set(tmp_path: Path):
    text = """
[controller.outer]
type = "pid"
error = "0.3 - hinge.angle"
proportional = 6.0
sample_time = "40 ms"

[controller.servo]
type = "pid"
error = "outer - hinge.rate"
proportional = 8.0
sample_time = "10 ms"
"""
    motion = Pipeline(scene_of(tmp_path, text)).motion
    wanted, count = 0.0, 0

    def control(x: Array) -> float:
        nonlocal wanted, count
        if count % 4 == 0:
            wanted = 6 * (0.3 - x[0])
        count += 1
        return float(8 * (wanted - x[1]))

    assert np.abs(motion.joint_position("hinge") - sampled_angles(control, 0.01, motion.times)).max() < 1e-10


def test_held_torques_are_among_the_loads_of_the_motion(tmp_path: Path):
    run = Pipeline(scene_of(tmp_path, PID + SAMPLED))
    loads, rate = run.motion.joint_loads, run.motion.joint_rate("hinge")
    pull = np.linalg.norm(loads.reactions["hinge"][:, 1, :3], axis=1)  # of 2 kg, whose centre is 0.5 m from the hinge
    torque = 40 * (0.3 - run.motion.joint_position("hinge"))[0]
    assert pull[0] == pytest.approx(2 * 0.5 * torque / INERTIA, rel=1e-9)
    assert pull.min() >= (2 * 0.5 * rate**2).min()


@pytest.mark.parametrize(
    ("text", "impulse"),
    [
        (PID + SAMPLED, lambda times, torque: torque[:-1] * np.diff(times)),
        (FILTERED, lambda times, torque: CubicSpline(times, torque).antiderivative()),
    ],
)
def test_what_a_controller_puts_out_is_a_history(tmp_path: Path, text: str, impulse: Any):
    """What turns the rod has its change of momentum as its integral."""
    table = 'output=[{type="table",file="a.csv",formulas={torque="servo",clock="2*t",both="servo + hinge.rate*t"}}]'
    run = Pipeline(scene_of(tmp_path, text, table, "simulation.output_step=1 ms"))
    motion = run.motion
    torque, clock, both = (each.values for each in history_variables(run, run.scene.output[0], motion))
    rate, found = motion.joint_rate("hinge"), impulse(motion.times, torque)
    found = np.cumsum(found) if isinstance(found, np.ndarray) else found(motion.times)[1:]
    assert found == pytest.approx(INERTIA * rate[1:], abs=1e-5)
    assert torque.max() - torque.min() > 3.0
    assert clock == pytest.approx(2 * motion.times)
    assert both == pytest.approx(torque + rate * motion.times)


@pytest.mark.parametrize("text", [PID, PID + SAMPLED])
def test_what_a_controller_puts_out_has_derivatives(tmp_path: Path, text: str):
    coarse = "simulation.output_step=100 ms"
    (by_mass,) = jacobian(SolvedScene(scene_of(tmp_path, text, coarse)), ["u = servo"], ["body.rod.mass"])
    scenes = [scene_of(tmp_path, text, coarse, f"body.rod.mass={mass} kg") for mass in (1.99, 2.01)]
    low, high = (find_channels(run, "u = servo")[0].read(run) for run in map(Pipeline, scenes))
    assert by_mass.slope == pytest.approx((high - low) / 0.02, abs=1e-3)
    assert np.abs(by_mass.slope).max() > 0.1


def growth(T: float) -> float:
    """Growth rate of the sampled loop by its eigenvalues."""
    Phi, Gamma = hold(A, B, T)
    loop = np.zeros((3, 3))
    loop[:2, :2], loop[:2, 2:], loop[2] = Phi - Gamma @ np.array([[40, 4]]), Gamma, [-60 * T, 0, 1]
    return float(np.log(np.abs(np.linalg.eigvals(loop)).max()) / T)


@pytest.mark.parametrize("T", [0.1, 0.19, 0.21, 0.4])
def test_a_sample_time_that_makes_the_loop_unstable_is_told_with_one_that_would_do(tmp_path: Path, T: float):
    run = Pipeline(scene_of(tmp_path, PID + f'sample_time = "{T} s"\n'))
    text = find_unstable_sampling(run, states_of_motion(run))
    assert bool(text) is (growth(T) > 0.0)
    assert bool(find_unstable_sampling(run, state_of_start(run))) is bool(text)
    if text:
        told, mend = re.search(r"grow as exp\((\S+) t\)", text), re.search(r"; (\S+) s would do", text)
        assert told is not None
        assert mend is not None
        assert float(told[1]) == pytest.approx(growth(T), rel=0.01)
        assert growth(float(mend[1])) <= 0.0 < growth(float(mend[1]) + 0.011)


@pytest.mark.parametrize("kind", [AccuracyError, ConvergenceError])
def test_a_motion_that_fails_by_its_sample_time_says_so(
    kind: type[AccuracyError], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    march = Plan.march

    def fail(plan: Plan, times: Array, *rest: Any) -> Any:
        if len(times) > 1:  # else it is compiled
            raise kind("the last two marches differ")
        return march(plan, times, *rest)

    monkeypatch.setattr(Plan, "march", fail)
    with pytest.raises(
        AccuracyError, match=r"marches differ; servo: the sample time makes.*about t = 0 s; 0\.2 s would do"
    ):
        Pipeline(scene_of(tmp_path, PID + 'sample_time = "0.3 s"\n')).motions  # noqa: B018
    with pytest.raises(AccuracyError, match=r"marches differ$"):
        Pipeline(scene_of(tmp_path, PID + 'sample_time = "0.1 s"\n')).motions  # noqa: B018


def test_loops_of_several_sample_times_grow_by_their_common_multiple(tmp_path: Path):
    text = """
[controller.outer]
type = "pid"
error = "0.3 - hinge.angle"
proportional = 30.0
sample_time = "200 ms"

[controller.servo]
type = "pid"
error = "outer - hinge.rate"
proportional = 4.0
sample_time = "100 ms"
"""
    Phi, Gamma = hold(A, B, 0.1)

    def two_samples(x: Array) -> Array:
        outer = -30 * x[0]
        for _ in range(2):
            x = Phi @ x + Gamma[:, 0] * 4 * (outer - x[1])
        return np.asarray(x)

    loop = np.stack([two_samples(e) for e in np.eye(2)], axis=1)
    exact = np.log(np.abs(np.linalg.eigvals(loop)).max()) / 0.2
    run = Pipeline(scene_of(tmp_path, text))
    told = re.search(r"grow as exp\((\S+) t\)", find_unstable_sampling(run, states_of_motion(run)))
    assert told is not None
    assert float(told[1]) == pytest.approx(exact, rel=0.01)


def test_a_linear_model_has_the_states_of_continuous_controllers(tmp_path: Path):
    model = linearise_scene(Pipeline(scene_of(tmp_path, PID)), ["hinge.torque"], ["hinge.position"]).model
    loop = np.array([[0, 1, 0], [-40 / INERTIA, -4 / INERTIA, 1 / INERTIA], [-60, 0, 0]])
    assert np.allclose(model.A, loop, rtol=1e-9, atol=1e-9)
    assert model.states[-1].name == "servo integral"


def test_a_linear_model_says_that_it_leaves_sampled_controllers_out(tmp_path: Path):
    model = linearise_scene(Pipeline(scene_of(tmp_path, PID + SAMPLED)), ["hinge.torque"], ["hinge.position"])
    assert "servo" in next(each["text"] for each in model.warnings if each["code"] == "sampled")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PID.replace("40.0", "0").replace("60.0", "0").replace("4.0", "0"), "without any gain"),
        (PID.replace('error_rate = "-hinge.rate"\n', ""), "filter: is missing: a derivative needs it, or error_rate"),
        (PID.replace("hinge.angle", "elbow.angle"), "no such joint"),
        (PID.replace("0.3 -", "other -"), "there is no 'other'"),
        (PID.replace("0.3 -", "servo -"), "there is no 'servo' before it"),
        (PID + LIMITS.replace("-3", "4"), "must be above lowest"),
        (PID + 'tracking_time = "1 s"\n', "has no effect without limits"),
        (PID.replace("[controller.servo]", "[controller.rod]"), "a body has this name"),
        (PID.replace("servo", "sin"), "a variable's name"),
        ('[controller.servo]\ntype = "lag"\ninput = "1 +"\ntime_constant = "1 s"\n', "controller.servo.input"),
        ("", "there is no 'servo'"),
    ],
)
def test_a_controller_that_means_nothing_is_refused(tmp_path: Path, text: str, message: str):
    with pytest.raises(InputError, match=re.escape(message)):
        scene_of(tmp_path, text)


def test_runs_and_starts_that_cannot_hold_a_controller_are_refused(tmp_path: Path):
    with pytest.raises(InputError, match="doesn't end its steps where controller 'servo' samples"):
        scene_of(tmp_path, PID + SAMPLED, 'simulation.run=[{ integrator = "central-difference", step = "1 ms" }]')
    for text in (PID, PID + SAMPLED):
        with pytest.raises(InputError, match="holds no controller with a memory, such as servo"):
            scene_of(tmp_path, text, "simulation.start=equilibrium")
    with pytest.raises(SystemExit) as ended:
        main(["bench", str(tmp_path / "mine.toml")])
    assert ended.value.code == 2


def test_loads_through_bodies_are_those_of_the_sampled_motion(tmp_path: Path):
    # They are found with all bodies rigid, whose motion has to be sampled, too.
    run = Pipeline(scene_of(tmp_path, PID + SAMPLED))
    found = rigid_motion(run.mechanism, *run.start, 1.0)
    times, (angle, _) = found.times, found.along_joint(0)
    integral = 0.0

    def control(x: Array) -> float:
        nonlocal integral
        output = 40 * (0.3 - x[0]) + integral - 4 * x[1]
        integral += 60 * 0.02 * (0.3 - x[0])
        return output

    assert np.abs(angle - sampled_angles(control, 0.02, times)).max() < 1e-6
    effort = found.mechanism.links[0].effort
    assert effort is not None
    torque = found.effort(effort)
    assert torque[0] == pytest.approx(40 * 0.3, rel=1e-9)
    assert np.ptp(torque) > 1.0

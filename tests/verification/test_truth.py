"""Random scenes run as a user would, each against a reference by a path of its own; `benchmarks/truth.py` has more."""

import importlib
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from fmd import Pipeline, load_scene
from fmd.accuracy.error_budget import Budget
from fmd.integrators.march_pairs import motion_difference
from fmd.integrators.runge_kutta import RungeKutta
from fmd.output.summary import _budget_warnings, summarise

pytestmark = pytest.mark.slow

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
_LONG = (pytest.param(seed, marks=pytest.mark.long) for seed in (30, 46))
COMPARED = (10, 18, *_LONG, 1004)  # rigid, rigid, planar, tree, mixed
ARMS = (2005, 2009)
CLOSE = {"position": 5e-4, "velocity": 1e-3}  # other quantities are within 1 %, largest stress at a face within 3
REFUSED = {97: "a prescribed motion must keep its position"}


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module


@pytest.mark.parametrize("seed", COMPARED)
def test_no_quantity_of_a_random_scene_is_beyond_three_times_what_is_stated(
    module: Any, tmp_path: Path, seed: int
) -> None:
    row = module("truth").judge(module("truth_scenes").random_case(seed), tmp_path)
    assert row.outcome == "compared", row.said
    assert row.quantities + row.bounded > 0
    assert row.wrong == 0, row


@pytest.mark.parametrize("seed", REFUSED)
def test_a_random_scene_that_has_no_answer_is_refused_with_one_message(module: Any, tmp_path: Path, seed: int) -> None:
    row = module("truth").judge(module("truth_scenes").random_case(seed), tmp_path)
    assert row.outcome == "refused"
    assert REFUSED[seed] in row.said


def test_a_random_scene_whose_process_only_waits_is_ended(module: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    truth = module("truth")
    monkeypatch.setattr(truth, "_work", lambda *_: time.sleep(600))
    monkeypatch.setattr(truth, "WAIT", 0.1)
    row = truth.judge_apart(module("truth_scenes").random_case(10))
    assert (row.outcome, row.said) == ("long", "it took more than 0.1 s by the clock")


def test_mixed_scenes_draw_nearly_all_pairs_of_features_and_can_be_read(module: Any, tmp_path: Path) -> None:
    features, scenes = module("truth_features"), module("truth_scenes")
    cases = [scenes.random_case(seed) for seed in range(scenes.MIXED, scenes.MIXED + 100)]
    seen, pairs, lacking = features.pairwise_coverage(cases)
    assert (pairs, seen) >= (120, 105), lacking
    file = tmp_path / "scene.toml"
    for case in cases[:30]:
        file.write_text(case.text)
        load_scene(file)


def test_two_marches_agree_within_the_wanted_error_where_vibrations_are_out_of_step(
    module: Any, tmp_path: Path
) -> None:
    """Central difference with a step four times as short differed by half of its error only: 4.3e-3 for 1e-3."""
    file = tmp_path / "scene.toml"
    file.write_text(module("truth_scenes").random_case(292).text)
    run = Pipeline(load_scene(file))
    found = run.motion.trajectory
    exact = RungeKutta(1e-9).march(run.system, *run.start, found.times)
    assert motion_difference(run.system, found.q, found.v, exact) < run.scene.simulation.error


@pytest.mark.parametrize("seed", [10, 18])
def test_the_error_of_auto_is_that_which_the_budget_finds(module: Any, tmp_path: Path, seed: int) -> None:
    """Two marches told 7.3 times the true error of seed 10, and 1.95 times that of seed 18."""
    file = tmp_path / "scene.toml"
    file.write_text(module("truth_scenes").random_case(seed).text)
    run = Pipeline(load_scene(file))
    summary, found = summarise(run, [], budget=True), run.motion.trajectory
    exact = RungeKutta(1e-10).march(run.system, *run.start, found.times)
    stated, true = summary["integrations"][0]["error"], motion_difference(run.system, found.q, found.v, exact)
    assert stated == summary["error_budget"]["integration"]
    assert true <= stated <= 4 * true
    assert not [each for each in summary["warnings"] if each["code"] == "integration-error"]


def test_a_run_without_a_budget_states_an_error_of_auto_that_holds_the_true_one() -> None:
    """Two marches of a plate that rings told a fifth of it: steps that don't follow its vibrations gain little."""
    run = Pipeline(load_scene("plate", ["simulation.duration=20 ms"]))
    found = run.motion.trajectory
    exact = RungeKutta(1e-8).march(run.system, *run.start, found.times)
    stated = summarise(run, [], budget=False)["integrations"][0]["error"]
    assert 1 < stated / motion_difference(run.system, found.q, found.v, exact) < 4


@pytest.mark.parametrize("seed", [138, 176])
def test_a_third_march_tells_the_error_of_few_steps(module: Any, tmp_path: Path, seed: int) -> None:
    """By the order of their mean steps two marches, of up to 26 steps, told a fifth of the error of 176."""
    file = tmp_path / "scene.toml"
    file.write_text(module("truth_scenes").random_case(seed).text)
    run = Pipeline(load_scene(file))
    found = run.motion.trajectory
    exact = RungeKutta(1e-10).march(run.system, *run.start, found.times)
    stated = summarise(run, [], budget=False)["integrations"][0]["error"]
    assert 1 < stated / motion_difference(run.system, found.q, found.v, exact) < 5


def test_a_run_whose_two_marches_missed_the_same_is_warned_of() -> None:
    run = Pipeline(load_scene("rod-slider", ['simulation.run=[{integrator="auto"}]']))
    budget = Budget((), integration=5 * run.scene.simulation.error)
    (warning,) = _budget_warnings(run, budget, 10.0)
    assert warning["code"] == "integration-error"
    assert "a third says 0.005" in warning["text"]


def test_the_elasticas_small_vibrations_are_those_of_a_clamped_beam(module: Any) -> None:
    cases, references = module("truth_scenes"), module("truth_references")
    case = next(
        case
        for case in map(cases.random_case, range(100))
        if case.kind == "planar" and len(case.bars) == 1 and "load" not in case.table["body"]
        and case.table["joint"]["hub"]["type"] == "fixed"
    )  # fmt: skip
    line = references.Elastica(case, 9)
    still = np.zeros(line.n)
    M, _ = references.equations(line.arrays, line.numbers, still, still, np.zeros(references.INPUTS))
    found = np.sqrt(eigh(line.stiffness, M, eigvals_only=True)[:2])
    body = case.table["body"][case.bars[0]]
    length, depth, E, rho = (references.number(body[key]) for key in ("length", "depth", "E", "rho"))
    # Roots of cos x cosh x = −1; rotary inertia is of the order of (depth / length)².
    exact = np.array([1.875104, 4.694091]) ** 2 * np.sqrt(E * depth**2 / (12 * rho)) / length**2
    np.testing.assert_allclose(found, exact, rtol=3e-3)


def test_a_beam_of_the_reference_bends_to_half_a_circle_under_a_couple(module: Any) -> None:
    """A couple bends evenly, without stretch or shear: the tip is a diameter, 2 L/π, to the side of the root."""
    arm = module("truth_beams").Arm(module("truth_scenes").random_case(2000), 8)
    arm.D[arm.bar == 1] = 0.0  # one bar alone
    bar, length, q = np.unique(arm.dofs[arm.bar == 0]), arm.sections[0].length, arm.start.copy()
    nodes = np.concatenate([arm.dofs[0, :3], *(row[3:] for row in arm.dofs[arm.bar == 0])]).reshape(-1, 3)
    turned = np.linspace(0, np.pi, len(nodes))
    q[nodes] = np.stack([np.sin(turned) * length / np.pi, (1 - np.cos(turned)) * length / np.pi, turned], axis=1)
    couple, free = np.zeros(arm.n), np.setdiff1d(bar, arm.roots[0])  # the root is clamped
    couple[arm.tips[0][2]] = np.pi * arm.sections[0].stiffness[2] / length
    for _ in range(6):
        f, K = arm.forces(q)
        change = np.linalg.solve(K[np.ix_(free, free)], (couple - f)[free])
        q[free] += change
    assert np.abs(change).max() < 1e-9
    np.testing.assert_allclose(q[arm.tips[0]], [0.0, 2 * length / np.pi, np.pi], atol=2e-4 * length)


@pytest.mark.parametrize("seed", ARMS)
def test_two_bars_on_hinges_swing_as_geometrically_exact_beams_do(
    module: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, seed: int
) -> None:
    truth, beams = module("truth"), module("truth_beams")
    monkeypatch.setattr(beams, "FINE", (5, 3))
    monkeypatch.setattr(beams, "COARSE", (4, 2))
    monkeypatch.setattr(beams, "OUTPUTS", 60)  # the first of a hundred
    case, file = module("truth_scenes").random_case(seed), tmp_path / "scene.toml"
    simulation = case.table["simulation"]
    simulation["duration"] = f"{60 * beams.number(simulation['output_step']):.5g} s"
    file.write_text(case.text)
    modes = "modes={count=6, boundary='joint', enrich='inertia'}"
    run = Pipeline(load_scene(file, [f"body.{name}.{modes}" for name in case.bars]))
    found = truth.reference_errors(case, run, file)
    assert {
        "hub.force",
        "elbow.force",
        "bar1.tip.position",
        "bar1.tip.acceleration",
        "bar1.spot, von Mises stress",
    } <= {*found}
    for name, (error, off, _) in found.items():
        close = CLOSE.get(name.rpartition(".")[2], 0.03 if "largest von Mises" in name else 0.01)
        assert error < close + 2 * off, name
        assert off < 0.06, name


def test_the_elastica_keeps_its_energy_where_nothing_drives_it(module: Any) -> None:
    cases, references = module("truth_scenes"), module("truth_references")
    case = next(
        case for case in map(cases.random_case, range(100)) if case.kind == "planar" and case.table["joint"]["hub"]
        ["type"] == "revolute" and "rate" in case.table["joint"]["hub"] and len(case.bars) == 1
    )  # fmt: skip
    case.table["drive"] = {}
    case.table["simulation"]["gravity"] = ["0 m/s^2"] * 3
    case.table["joint"]["hub"]["rate"] = "5 rad/s"
    line = references.Elastica(case, 5)
    _, motion = line.march()
    energies = []
    for y in motion[::50]:
        c, v = y[: line.n], y[line.n :]
        M, _ = references.equations(line.arrays, line.numbers, c, v, np.zeros(references.INPUTS))
        energies.append(0.5 * (v @ M @ v + c @ line.stiffness @ c))
    np.testing.assert_allclose(energies, energies[0], rtol=1e-5)


def _settled(bodies: Any, n_loads: int) -> Any:
    """Return the places of nodes at rest under loads that grow to those at 1 s, by Newton's method with differences."""
    x, R, free = bodies.x, bodies.R, bodies.free
    still, steps = np.zeros_like(bodies.v), 1e-6 * np.eye(6 * len(bodies.x))[free]

    def left(by: Any, t: float) -> Any:
        return bodies.residual(*bodies.moved(x, R, by.reshape(-1, 6)), still, still, t)[0][free]

    for t in np.arange(1, n_loads + 1) / n_loads:
        for _ in range(30):
            slopes = np.stack([(left(each, t) - left(-each, t)) / 2e-6 for each in steps], axis=1)
            by = np.zeros(still.size)
            by[free] = -np.linalg.solve(slopes, left(by, t))
            x, R = bodies.moved(x, R, min(1.0, 0.5 / np.abs(by.reshape(-1, 6)[:, 3:]).max()) * by.reshape(-1, 6))
            if np.abs(by).max() < 1e-8:
                break
    return x


@pytest.mark.long
def test_beams_in_space_bend_a_curved_cantilever_as_published(module: Any) -> None:
    """Bathe & Bolourchi's bend of 45°, whose tip goes to (15.79, 47.23, 53.37) by Simo & Vu-Quoc (1986)."""
    spatial, n = module("truth_spatial"), 4
    a = np.linspace(0, np.pi / 4, n + 1)
    tangent = np.stack([np.sin(a), np.cos(a), 0 * a], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (n + 1, 1))
    turned = np.concatenate([np.eye(3)[None], np.stack([tangent, np.cross(up, tangent), up], axis=2)])
    x = np.concatenate([np.zeros((1, 3)), 100 * np.stack([1 - np.cos(a), np.sin(a), 0 * a], axis=1)])
    stiffness = np.tile([1e7, 5e6, 5e6, 5e6 * 0.1406, 1e7 / 12, 1e7 / 12], (n, 1))
    ends = np.stack([np.arange(1, n + 1), np.arange(2, n + 2)], axis=1)
    push = (n + 1, np.zeros(3), lambda t: np.array([0.0, 0.0, 600 * t]), False)
    nothing = np.zeros((n + 2, 6))
    bend = spatial.Bodies(
        x, nothing[:, 0], np.zeros((n + 2, 3, 3)), ends, stiffness, [], [push], np.zeros(3), nothing, (0, 1), turned
    )
    assert np.abs(_settled(bend, 3)[-1] - [15.79, 47.23, 53.37]).max() < 0.004 * 100


def test_a_beam_in_flight_keeps_its_momenta_and_its_energy(module: Any) -> None:
    """Simo & Vu-Quoc's flying spaghetti (1988): a load and a couple for 5 s, then free."""
    spatial, n, over = module("truth_spatial"), 6, 2.5
    x = np.concatenate([np.zeros((1, 3)), np.linspace([6.0, 0.0, 0.0], [0.0, 8.0, 0.0], n + 1)])
    along = (x[-1] - x[1]) / 10
    R = np.tile(np.stack([along, np.cross([0, 0, 1.0], along), [0, 0, 1.0]], axis=1), (n + 2, 1, 1))
    share = np.r_[0.0, 0.5, np.ones(n - 1), 0.5]
    size = lambda t: max(0.0, 1 - abs(t / over - 1))  # noqa: E731
    pushes = [
        (1, np.zeros(3), lambda t: size(t) * np.array([20.0, 0.0, 5.0]), False),
        (n + 1, np.zeros(3), lambda t: size(t) * np.array([0.0, -8.0, 10.0]), False),
    ]
    stiffness = np.tile([1e4, 1e4, 1e4, 500.0, 500.0, 500.0], (n, 1))
    ends = np.stack([np.arange(1, n + 1), np.arange(2, n + 2)], axis=1)
    inertia = 10 * share[:, None, None] * np.eye(3)
    flying = spatial.Bodies(x, share, inertia, ends, stiffness, [], pushes, np.zeros(3), np.zeros((n + 2, 6)), R=R)
    rows = []

    def look(x: Any, R: Any, v: Any, a: Any, t: float) -> None:
        inner, _ = flying.wrenches(x, R)
        spin = (inertia @ v[:, 3:, None])[:, :, 0]
        turning = np.cross(x, share[:, None] * v[:, :3]) + (R @ spin[:, :, None])[:, :, 0]
        kinetic = 0.5 * (share @ (v[:, :3] ** 2).sum(axis=1) + (spin * v[:, 3:]).sum())
        energy = kinetic + 0.5 * (flying.lengths[:, None] * inner**2 / stiffness).sum()
        rows.append(np.r_[share @ v[:, :3], turning.sum(axis=0), energy])

    flying.march(0.1, 100, 10, look)
    free = np.array(rows)[6:]
    assert free[:, :3] == pytest.approx(np.tile([50.0, -20.0, 37.5], (len(free), 1)), rel=1e-3)
    assert np.abs(free[:, 3:] / free[0, 3:] - 1).max() < 0.01

"""`fmd stability`: its answers, and that real marches live below its limits and diverge above them."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline import Pipeline, load_scene
from pipeline.checks import StabilityError
from pipeline.cli import main
from pipeline.dynamics.linear import LinearSystem
from pipeline.integrators.central_difference import CentralDifference
from pipeline.integrators.subcycling import Subcycling
from pipeline.stability import find_limit, mass_coupling, scene_stability
from pipeline.stress_test import cases, march_all

Answer = Callable[..., dict]


@pytest.fixture
def fmd(capsys: pytest.CaptureFixture[str]) -> Answer:
    def answer(*arguments: str) -> dict:
        with pytest.raises(SystemExit) as end:
            main(["stability", *arguments, "--json"])
        assert end.value.code in (0, None)
        return json.loads(capsys.readouterr().out)

    return answer


def test_the_papers_figures_are_drawn_and_told(fmd: Answer, tmp_path: Path) -> None:
    found = fmd("--two-dof", "--substeps", "2", "--resolution", "50", "--out", str(tmp_path))
    assert (found["substeps"], found["coupling"]) == (2, 0.0)
    assert np.shape(found["map"]["rho"]) == (50, 50)
    assert found["files"] == ["two-dof-2-substeps.png"]
    assert (tmp_path / found["files"][0]).stat().st_size > 10_000
    # stable up to 2 of 2.5 in both directions, without what lies on the limit
    assert found["stable_share"] == pytest.approx(0.8**2, abs=0.04)


def test_several_couplings_are_several_maps(fmd: Answer, tmp_path: Path) -> None:
    found = fmd("--two-dof", "--coupling", "0", "--coupling", "0.3", "--resolution", "20", "--out", str(tmp_path))
    assert [row["coupling"] for row in found["maps"]] == [0.0, 0.3]
    assert found["maps"][1]["stable_share"] == 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give a scene, e.g. beam, or --two-dof"),
        (["beam", "--two-dof"], "give a scene, e.g. beam, or --two-dof"),
        (["--two-dof", "--coupling", "1"], "must be 0 ≤ β < 1"),
        (["--two-dof", "--resolution", "1"], "--resolution 2 … 2000"),
        (["beam", "--substeps", "-1"], "must be 1 … 1000"),
    ],
)
def test_wrong_options_are_told(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["stability", *arguments])
    assert message in capsys.readouterr().err


def test_a_scenes_limits_are_told(fmd: Answer) -> None:
    found = fmd("rod-slider", "--substeps", "5")
    # the slider of 2 kg on 400 N/m, 10 √2 rad/s; the rod turns freely
    assert found["critical_step_s"] == pytest.approx(2 / np.sqrt(200), rel=1e-6)
    assert [row["substeps"] for row in found["rows"]] == [1, 5]
    assert found["rows"][1]["critical_step_s"] == pytest.approx(2 / np.sqrt(200), rel=1e-6)
    assert found["coupling"] == 0.0
    assert found["recommended"]["substeps"] > 1


@pytest.mark.parametrize("m", [1, 2, 5, 20])
@pytest.mark.parametrize(
    ("name", "still"), [("rod-slider", "drive.motor.torque=0 N m"), ("beam", "drive.spin_up.speed=0 rad/s")]
)
def test_marches_live_below_the_limit_and_diverge_above_it(name: str, still: str, m: int) -> None:
    """Small motions about the reference state, which the limits are those of; nothing drives the mechanism."""
    run = Pipeline(load_scene(name, [still]))
    limit = next(row for row in scene_stability(run, [m], along=False).limits).critical_step
    system = run.mechanism
    q0, v0 = np.full(system.n, 1e-6), np.zeros(system.n)
    method = CentralDifference if m == 1 else lambda step: Subcycling(step, m)
    steps = 20_000
    lives = method(0.98 * limit).march(system, q0, v0, np.array([steps * 0.98 * limit]))
    assert np.abs(lives.q).max() < 1e4
    with pytest.raises(StabilityError):
        method(1.02 * limit).march(system, q0, v0, np.array([steps * 1.02 * limit]))


@pytest.mark.parametrize("m", [2, 3, 7])
def test_a_coupled_limit_is_where_growth_jumps(m: int) -> None:
    """Below it a cycle grows by the weak law alone, above it by orders more."""
    M, K = np.array([[1.0, 0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.diag([1e-4, 1.0, 4.0])
    limit = find_limit(M, K, 1, m)
    assert limit.critical_step == pytest.approx(1.0, rel=0.01)  # 2/ω of the fast coordinates
    assert limit.growth_rate > 0
    assert mass_coupling(M, 1) == pytest.approx(0.02)
    system = LinearSystem(M, K, 1)
    with pytest.raises(StabilityError):
        Subcycling(1.02 * limit.critical_step, m).march(system, np.ones(3), np.zeros(3), np.array([2000.0]))


def test_the_worst_state_is_looked_for_along_the_motion() -> None:
    """A pendulum of two links has its highest frequency somewhere on its way, not where it starts."""
    run = Pipeline(load_scene("arm", ["simulation.duration=0.2 s"]))
    rest, along = (scene_stability(run, [1], along=flag) for flag in (False, True))
    assert along.limits[0].critical_step <= rest.limits[0].critical_step


def test_what_the_matrix_predicts_is_what_marches_do() -> None:
    """The stress tests of `fmd bench --stability`, shorter: no prediction may fail."""
    found = cases(lambda scene, overrides: Pipeline(load_scene(scene, list(overrides))))
    rows = list(march_all((case for case in found if len(case.M) < 30), cycles=3000))
    assert len(rows) > 700
    assert {row.found for row in rows} == {"lives", "diverges"}
    assert not [row for row in rows if row.wrong]
    # short marches leave few cases undecided
    assert sum(row.predicted == "either" for row in rows) < 0.1 * len(rows)


def test_a_step_can_be_chosen_for_the_wanted_error() -> None:
    """`step = "auto"`: the error that was asked for is met, and a tighter one takes a shorter step."""
    times = np.linspace(0.0, 0.1, 11)
    exact = Pipeline(load_scene("beam")).motion.q[::20][:11]  # at 10 us, where the error is 1e-6 of the deflection
    steps = []
    for error in (1e-2, 1e-3):
        run = Pipeline(
            load_scene("beam", ["simulation.step=auto", f"simulation.error={error}", "simulation.duration=0.1 s"])
        )
        trajectory = run.motion.trajectory
        steps.append(trajectory.step)
        found = run.motion.q[np.searchsorted(run.motion.times, times - 1e-9)]
        assert np.abs(found - exact).max() < error * np.abs(exact).max()
    assert steps[1] < 0.5 * steps[0]

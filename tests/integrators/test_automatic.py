"""Automatic choice of a method: it goes on where a method fails, and says why if all do."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.errors import AccuracyError, StabilityError
from fmd.integrators.automatic import Automatic
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta

STILL = """
title = "A block on the ground"
[body.block]
shape = "rigid"
mass = "1 kg"
centre = ["0 m", "0 m", "0 m"]
inertia = ["1 kg m^2", "1 kg m^2", "1 kg m^2"]
marker = { at = { at = ["0 m", "0 m", "0 m"] } }
[joint.weld]
type = "fixed"
parent = "ground"
child = "block.at"
[simulation]
duration = "1 s"
output_step = "0.1 s"
tip = "block.at"
run = [{ integrator = "auto" }]
"""
TIMES = np.linspace(0.0, 0.3, 31)


@pytest.fixture(scope="module")
def arm() -> Pipeline:
    return Pipeline(load_scene("arm"))


def failing(message: str, calls: list[str], kind: type[AccuracyError] = StabilityError) -> Callable[..., Any]:
    def march(self: Any, *arguments: Any) -> Any:
        calls.append(self.name)
        raise kind(message)

    return march


def test_an_implicit_step_without_a_solution_makes_way_for_another_method(
    arm: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    monkeypatch.setattr(GeneralizedAlpha, "march", failing("Newton's iteration", calls, AccuracyError))
    q0, v0 = arm.start
    found = Automatic(1e-3, 5.0).march(arm.system, q0, v0, TIMES)
    exact = RungeKutta(1e-10).march(arm.system, q0, v0, TIMES)
    assert calls
    assert "generalized" not in found.integrator
    np.testing.assert_allclose(found.q, exact.q, atol=2e-3 * np.abs(exact.q).max())


def test_strong_dampers_of_light_sections_are_not_marched_by_explicit_methods() -> None:
    """Static responses make a joint's section light: its damper takes steps of 0.15 µs, vibrations 23 µs."""
    damped = ["body.forearm.modes.enrich=inertia", *(f"joint.{name}.damper=60 N m s" for name in ("shoulder", "elbow"))]
    run = Pipeline(load_scene("arm", damped))
    assert 2.0 / run.system.largest_step > 50.0 * run.system.highest_frequency
    found = Automatic(1e-3, TIMES[-1]).march(run.system, *run.start, TIMES)
    exact = GeneralizedAlpha(1e-5).march(run.system, *run.start, TIMES)
    assert found.evaluations < 1e6  # of explicit steps 2e6 at least, for each of two marches
    np.testing.assert_allclose(found.q, exact.q, atol=2e-3 * np.abs(exact.q).max())


def test_where_every_march_fails_the_reason_is_told_after_two_of_the_last_method(
    arm: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    for method in (GeneralizedAlpha, CentralDifference):
        monkeypatch.setattr(method, "march", failing("the accelerations are not finite", calls))
    for adaptive in (RungeKutta, ExponentialRosenbrock):
        monkeypatch.setattr(adaptive, "resume", failing("the accelerations are not finite", calls))
    with pytest.raises(AccuracyError, match="the accelerations are not finite"):
        Automatic(1e-3, 5.0).march(arm.system, *arm.start, TIMES)
    assert sum(name == "runge-kutta" for name in calls) == 2


def test_where_nothing_is_free_to_move_there_is_nothing_to_compare(tmp_path: Path) -> None:
    (tmp_path / "still.toml").write_text(STILL)
    found = Pipeline(load_scene(tmp_path / "still.toml")).motion
    assert found.trajectory.q.shape == (11, 0)


def test_a_march_ends_with_more_steps_than_are_worth_it(arm: Pipeline) -> None:
    with pytest.raises(StabilityError, match="exponential-rosenbrock takes more than 3 steps"):
        ExponentialRosenbrock(1e-8, most_steps=3).march(arm.system, *arm.start, TIMES)


def test_explicit_steps_are_weighed_by_the_mechanisms_own_equations(arm: Pipeline) -> None:
    """A coarse count of operations chose the Runge-Kutta method where central difference takes a third of its work."""
    for scene in ("arm", "spin-up", "rod-slider"):
        system = Pipeline(load_scene(scene)).system
        assert 0.5 < system.evaluation_cost / system.compiled.flops() < 12  # what doesn't compute is in it, too
    stiff = Pipeline(load_scene("arm", ["body.forearm.modes.enrich=none", "simulation.error=1e-4"]))
    found = Automatic(1e-4, 1.0).march(stiff.system, *stiff.start, np.linspace(0.0, 1.0, 101))
    assert found.integrator == "auto (central-difference)"
    explicit = RungeKutta(1e-6).march(stiff.system, *stiff.start, np.linspace(0.0, 1.0, 101))
    np.testing.assert_allclose(found.q, explicit.q, atol=3e-4 * np.abs(explicit.q).max())
    assert found.evaluations < 2 * explicit.evaluations


def test_two_marches_with_the_finest_tolerance_are_no_agreement(monkeypatch: pytest.MonkeyPatch) -> None:
    """A chaotic motion differs with every tolerance, and is the same again with the same one."""
    march, run, tolerances = RungeKutta.resume, Pipeline(load_scene("rod-slider")), list[float]()

    def depend_on_tolerance(self: RungeKutta, *arguments: Any) -> Any:
        found = march(self, *arguments)
        tolerances.append(self.tolerance)
        return replace(found, q=-np.log(self.tolerance) * found.q)

    monkeypatch.setattr(RungeKutta, "resume", depend_on_tolerance)
    differ = r"auto: the last two marches differ by .*, most in the motion of joint 'slide'; they agree up to t = 0 s"
    with pytest.raises(AccuracyError, match=differ):
        Automatic(1e-3, run.scene.simulation.duration).march(run.system, *run.start, run.output_times)
    assert len(tolerances) > 2
    assert min(a / b for a, b in pairwise(tolerances)) > 2

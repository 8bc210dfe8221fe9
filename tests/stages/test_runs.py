"""Runs of scenes: refused where a scheme is unstable, and steps chosen for a wanted error."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.cache import Cache
from fmd.core.errors import InputError, StabilityError
from fmd.core.limits.stability import ALLOWED_GROWTH
from fmd.integrators.automatic import Automatic
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.side_by_side import time_by_turns
from fmd.stages import run_times, runs, stiffening_check


@pytest.mark.slow
def test_a_run_that_would_grow_is_refused_with_the_step_that_works() -> None:
    """Free modes couple with the rotation by 0.84: 5:1 at 10 µs grows 281-fold over the beam's half second."""
    free = 'simulation.frame="free"'
    with pytest.raises(InputError, match=r"sub-cycling 5:1 is unstable here: .* grow by a factor of 2\d\d") as caught:
        _ = Pipeline(load_scene("beam-paper", [free])).plans
    step = re.search(r"a step of (\S+) s keeps that below 10", str(caught.value))
    assert step
    only = 'simulation.run=[{ integrator = "sub-cycling", substeps = 5 }]'
    (plan,) = Pipeline(load_scene("beam-paper", [free, only, f"simulation.step={step[1]} s"])).plans.values()
    assert 0.5 * ALLOWED_GROWTH < plan.growth < ALLOWED_GROWTH
    (plan,) = Pipeline(load_scene("beam-paper", [free, only, "simulation.step=auto"])).plans.values()
    assert plan.integrator.step == pytest.approx(float(step[1]), rel=0.02)


def test_what_grows_by_less_is_stated() -> None:
    growths = [plan.growth for plan in Pipeline(load_scene("rod-slider")).plans.values()]
    assert growths == pytest.approx([1.0, 1.0003, 1.0025], abs=3e-4)


def test_a_step_can_be_chosen_for_the_wanted_error() -> None:
    """`step = "auto"`: the error that was asked for is met, and a tighter one takes a shorter step."""
    times = np.linspace(0.0, 0.1, 11)
    # At 10 us, where the error is 1e-6 of the deflection.
    exact = Pipeline(load_scene("beam-paper")).motion.modal("beam")[::20][:11]
    steps = []
    for error in (1e-2, 1e-3):
        run = Pipeline(
            load_scene("beam-paper", ["simulation.step=auto", f"simulation.error={error}", "simulation.duration=0.1 s"])
        )
        trajectory = run.motion.trajectory
        steps.append(trajectory.step)
        found = run.motion.modal("beam")[np.searchsorted(run.motion.times, times - 1e-9)]
        assert np.abs(found - exact).max() < error * np.abs(exact).max()
    assert steps[1] < 0.5 * steps[0]


LONG = "simulation.run=[{integrator='exponential', step='1 ms'}]"  # ω h = 8.7 of the beam's highest mode


@pytest.mark.parametrize("other", ["joint.hub.damper=1e-12 N m s", "body.beam.modes.damping=1e-9"])
def test_one_rule_limits_the_exponential_method_whatever_damps_a_scene(other: str) -> None:
    """A damper that takes next to nothing changes the structure of the equations, by which such a step was refused."""
    quick = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms", LONG]
    one, two = (Pipeline(load_scene("beam-paper", given)) for given in (quick, [*quick, other]))
    assert two.motion.tip_position == pytest.approx(one.motion.tip_position, abs=1e-8)
    assert next(iter(two.plans.values())).growth < 1.01


def test_a_step_beyond_the_coupling_s_limit_is_refused_with_its_frequency() -> None:
    quick = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.frame=free", LONG.replace("1 ms", "2 ms")]
    with pytest.raises(
        InputError, match=r"exponential would diverge; .* is 0\.001049 s \(2/ω with 303\.3\d? Hz, the freq"
    ):
        Pipeline(load_scene("beam-paper", quick)).plans  # noqa: B018


SLIDER = ["simulation.run=[{integrator='exponential'}]", "simulation.duration=0.1 s", "drive.motor.torque=0 N m"]


def test_an_end_stop_limits_the_exponential_method() -> None:
    """Its stages take the stop's force explicitly: 2/ω with ω² = k/m of the mass of 5 kg on 2 MN/m."""
    stop = "joint.slide.stop={ high='0.4 m', stiffness='2e6 N/m' }"
    with pytest.raises(InputError, match=r"exponential would diverge; .* is 0\.00316\d* s \(2/ω .* and of end stops"):
        Pipeline(load_scene("rod-slider", [*SLIDER, stop, "simulation.step=4 ms"])).plans  # noqa: B018
    assert Pipeline(load_scene("rod-slider", [*SLIDER, stop, "simulation.step=3 ms"])).plans


def test_a_step_that_makes_steps_without_end_is_refused() -> None:
    with pytest.raises(InputError, match=r"makes 1e\+17 steps, .*; 1\.1e-13 s or longer does"):
        Pipeline(load_scene("rod-slider", [*SLIDER, "simulation.step=1 as"])).plans  # noqa: B018


def test_a_damper_limits_the_exponential_method() -> None:
    """Its stages are those of the Runge-Kutta method of order 4, which is stable up to 2.785 m/c."""
    damper = "joint.slide.damper=50000 N s/m"
    with pytest.raises(InputError, match=r"exponential is unstable here: .* a step of 0\.00027\d* s") as caught:
        Pipeline(load_scene("rod-slider", [*SLIDER, damper, "simulation.step=1 ms"])).plans  # noqa: B018
    assert "grow at once" in str(caught.value)


def test_a_second_run_knows_loads_and_growth_and_a_changed_scene_or_body_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    overrides = ["body.beam.mesh.divisions=[12, 2, 1]", "simulation.duration=20 ms", "simulation.step=auto"]
    first = Pipeline(load_scene("beam-paper", overrides), Cache(tmp_path))
    plans, rate = first.plans, first.stiffening_loads["beam"].largest_rate
    assert {plan.growth for plan in plans.values()} != {1.0}

    def refuse(*_: object) -> None:
        raise AssertionError("measured anew")

    monkeypatch.setattr(runs, "_measure_growth", refuse)
    monkeypatch.setattr(stiffening_check, "rigid_motion", refuse)
    again = Pipeline(load_scene("beam-paper", overrides), Cache(tmp_path))
    assert again.stiffening_loads["beam"].largest_rate == rate
    assert {label: (plan.integrator, plan.growth) for label, plan in again.plans.items()} == {
        label: (plan.integrator, plan.growth) for label, plan in plans.items()
    }
    with pytest.raises(AssertionError, match="measured anew"):
        again.with_bodies(again.bodies).plans  # noqa: B018
    with pytest.raises(AssertionError, match="measured anew"):
        Pipeline(load_scene("beam-paper", [*overrides, "simulation.duration=21 ms"]), Cache(tmp_path)).plans  # noqa: B018


def test_compared_run_times_are_measured_once_and_are_the_least_of_all_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = []
    monkeypatch.setattr(run_times, "time_by_turns", lambda *marches: measured.append(1) or time_by_turns(*marches))
    brief = ["simulation.duration=50 ms", "simulation.output_step=10 ms"]

    def run(*more: str) -> dict[str, Any]:
        motions = Pipeline(load_scene("rod-slider", [*brief, *more]), Cache(tmp_path)).motions
        return {label: motion.trajectory for label, motion in motions.items()}

    first, second = run(), run()
    assert len(measured) == 1
    assert len(first) > 1
    for label, trajectory in first.items():
        assert 0 < second[label].seconds <= trajectory.seconds
        assert second[label].spread == trajectory.spread
        np.testing.assert_array_equal(second[label].q, trajectory.q)
    run("simulation.duration=60 ms")
    assert len(measured) == 2


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_a_strong_damper_of_a_joint_counts_in_the_largest_step(tmp_path: Path, share: float) -> None:
    # A hinge with spring k and damper c and a rod of inertia J: h = 2/μ with μ² − 2 (c/J) μ − k/J = 0.
    J, k, c = 2.0 / 3.0, 600.0, 40.0
    limit = 2.0 / (c / J + np.sqrt((c / J) ** 2 + k / J))
    scene = DAMPED_HINGE.replace("STEP", f"{1e6 * share * limit:.6f} us")
    (tmp_path / "hinge.toml").write_text(scene)
    run = Pipeline(load_scene(tmp_path / "hinge.toml"))
    assert run.system.largest_step == pytest.approx(limit, rel=1e-12)
    if share < 1.0:
        assert np.abs(run.motion.joint_position("hinge")).max() <= 0.5 + 1e-12
        return
    with pytest.raises(InputError, match=r"largest stable step .*; without dampers it would be 0\.06"):
        _ = run.motion
    with pytest.raises(StabilityError):  # and so it does
        CentralDifference(share * limit).march(run.system, *run.start, np.array([0.0, 1000.0]))


DAMPED_HINGE = """
title = "Damped hinge"

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
angle = "0.5 rad"
spring = "600 N m/rad"
damper = "40 N m s/rad"

[simulation]
duration = "2 s"
output_step = "0.1 s"
step = "STEP"
tip = "rod.end"

[[simulation.run]]
integrator = "central-difference"
"""


def test_nothing_is_compiled_for_a_method_that_is_yet_to_be_chosen() -> None:
    marched: list[str] = []

    class Noted(Automatic):
        def march(self, *_: Any, **__: Any) -> Any:
            marched.append(self.name)

    (plan,) = Pipeline(load_scene("rod-slider", ['simulation.run=[{ integrator = "auto" }]'])).plans.values()
    replace(plan, integrator=Noted(1e-3, 1.0)).compile()  # a choice by no motion would be another
    assert not marched

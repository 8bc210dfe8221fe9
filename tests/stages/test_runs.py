"""Runs of scenes: refused where a scheme is unstable, and steps chosen for a wanted error."""

import re

import numpy as np
import pytest

from pipeline import Pipeline, load_scene
from pipeline.core.errors import InputError
from pipeline.stability.safe_step import ALLOWED_GROWTH


def test_a_run_that_would_grow_is_refused_with_the_step_that_works() -> None:
    """Free modes couple with the rotation by 0.84: 5:1 at 10 µs grows 281-fold over the beam's half second."""
    free = 'simulation.frame="free"'
    with pytest.raises(InputError, match=r"sub-cycling 5:1 is unstable here: .* grow by a factor of 2\d\d") as caught:
        _ = Pipeline(load_scene("beam", [free])).plans
    step = re.search(r"a step of (\S+) s keeps that below 10", str(caught.value))
    assert step
    only = 'simulation.run=[{ integrator = "sub-cycling", substeps = 5 }]'
    (plan,) = Pipeline(load_scene("beam", [free, only, f"simulation.step={step[1]} s"])).plans.values()
    assert 0.5 * ALLOWED_GROWTH < plan.growth < ALLOWED_GROWTH
    (plan,) = Pipeline(load_scene("beam", [free, only, "simulation.step=auto"])).plans.values()
    assert plan.integrator.step == pytest.approx(float(step[1]), rel=0.02)


def test_what_grows_by_less_is_told() -> None:
    growths = [plan.growth for plan in Pipeline(load_scene("rod-slider")).plans.values()]
    assert growths == pytest.approx([1.0, 1.03, 1.07], abs=0.01)


def test_a_step_can_be_chosen_for_the_wanted_error() -> None:
    """`step = "auto"`: the error that was asked for is met, and a tighter one takes a shorter step."""
    times = np.linspace(0.0, 0.1, 11)
    # At 10 us, where the error is 1e-6 of the deflection.
    exact = Pipeline(load_scene("beam")).motion.modal("beam")[::20][:11]
    steps = []
    for error in (1e-2, 1e-3):
        run = Pipeline(
            load_scene("beam", ["simulation.step=auto", f"simulation.error={error}", "simulation.duration=0.1 s"])
        )
        trajectory = run.motion.trajectory
        steps.append(trajectory.step)
        found = run.motion.modal("beam")[np.searchsorted(run.motion.times, times - 1e-9)]
        assert np.abs(found - exact).max() < error * np.abs(exact).max()
    assert steps[1] < 0.5 * steps[0]

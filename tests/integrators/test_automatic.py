"""Automatic choice of a method: it goes on where a method fails, and says why if all do."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline import Pipeline, load_scene
from pipeline.core.errors import AccuracyError, StabilityError
from pipeline.integrators.automatic import Automatic
from pipeline.integrators.generalized_alpha import GeneralizedAlpha
from pipeline.integrators.rosenbrock import ExponentialRosenbrock
from pipeline.integrators.runge_kutta import RungeKutta

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


def test_where_every_march_fails_the_reason_is_told_after_two_of_the_last_method(
    arm: Pipeline, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    for method in (GeneralizedAlpha, RungeKutta, ExponentialRosenbrock):
        monkeypatch.setattr(method, "march", failing("the accelerations are not finite", calls))
    with pytest.raises(AccuracyError, match="the accelerations are not finite"):
        Automatic(1e-3, 5.0).march(arm.system, *arm.start, TIMES)
    assert sum(name == "runge-kutta" for name in calls) == 2

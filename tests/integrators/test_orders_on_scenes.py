"""Each method's error falls at its declared order on each ready scene, against the compiled Runge-Kutta of order 8."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.core.arrays import Array
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.exponential import Exponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.step_control import groups_of
from fmd.integrators.subcycling import Subcycling

pytestmark = pytest.mark.slow


class Case(NamedTuple):
    """A scene's mechanism over a while, with steps that resolve it and end where its drive changes."""

    system: Any
    start: tuple[Array, Array]
    times: Array
    steps: Array
    exact: Array


# Duration and coarsest step: below the stability limit of sub-cycling too.
SCENES = {"rod-slider": (2.0, 4e-3), "beam-paper": (0.05, 2e-5), "arm": (0.05, 1e-4), "spin-up": (1.0, 2e-4)}
METHODS: dict[str, Callable[[float], Any]] = {
    "central-difference": CentralDifference,
    "sub-cycling 5:1": lambda step: Subcycling(step, 5),
    "reversible-sub-cycling 5:1": lambda step: ReversibleSubcycling(step, 5),
    "generalized-alpha": GeneralizedAlpha,
    "exponential": Exponential,
}


@pytest.fixture(scope="module", params=SCENES)
def case(request: pytest.FixtureRequest) -> Case:
    duration, step = SCENES[request.param]
    few = ["body.forearm.modes.enrich=none"] if request.param == "arm" else []
    run = Pipeline(load_scene(request.param, few))
    times = np.linspace(0.0, duration, 11)
    exact = RungeKutta(1e-13).march(run.system, *run.start, times).q
    return Case(run.system, run.start, times, step / 2.0 ** np.arange(4), exact)


@pytest.mark.parametrize("name", METHODS)
def test_errors_fall_at_the_declared_order(case: Case, name: str) -> None:
    groups = groups_of(case.system)[: case.system.n_positions]
    sizes = np.array([np.abs(case.exact[:, groups == group]).max() for group in groups])
    steps = case.steps * (10 if name == "exponential" and not case.system.coupled else 1)
    if name.startswith("sub-cycling") and case.system.coupled and case.system.n > 2:
        steps = steps / 20  # joints and modes couple through the mass matrix: its weak instability must not show
    marches = [METHODS[name](step).march(case.system, *case.start, case.times) for step in steps]
    errors = np.array([(np.abs(march.q - case.exact) / sizes).max() for march in marches])
    if errors[-1] < 1e-11:  # at the round-off of both
        return
    kept = errors > 1e-11
    order = np.polyfit(np.log(steps[kept]), np.log(errors[kept]), 1)[0]
    assert order > METHODS[name](1.0).order(case.system) - 0.25

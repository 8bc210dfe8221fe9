"""A march that is broken off and continued from its state, pickled in between, is one march, bit for bit."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from fmd import Pipeline, load_scene
from fmd.dynamics.signals.signal import half_sine
from fmd.integrators.central_difference import CentralDifference
from fmd.integrators.exponential import Exponential
from fmd.integrators.generalized_alpha import GeneralizedAlpha
from fmd.integrators.protocol import ResumableIntegrator
from fmd.integrators.reversible import ReversibleSubcycling
from fmd.integrators.rosenbrock import ExponentialRosenbrock
from fmd.integrators.runge_kutta import RungeKutta
from fmd.integrators.subcycling import Subcycling
from tests.dynamics.hinged_body import body_of, hinged

METHODS: dict[str, ResumableIntegrator] = {
    "central-difference": CentralDifference(2e-3),
    "sub-cycling": Subcycling(2e-3, 5),
    "reversible-sub-cycling": ReversibleSubcycling(2e-3, 5),
    "exponential": Exponential(0.02),
    "generalized-alpha": GeneralizedAlpha(0.02),
    "exponential-rosenbrock": ExponentialRosenbrock(1e-5),
    "runge-kutta": RungeKutta(1e-6),
}
EACH = pytest.mark.parametrize("method", METHODS)


@pytest.fixture(scope="module")
def rod_slider():
    pipeline = Pipeline(load_scene("rod-slider"))
    return pipeline.system, *pipeline.start


@pytest.fixture(scope="module")
def struck(rotor):
    """The beam struck from rest for 4 ms."""
    rotor = hinged(body_of(rotor), half_sine(1e-3, 4e-3, 50.0))
    return rotor, np.zeros(rotor.n), np.zeros(rotor.n)


def assert_continues(method, system, q0, v0, times, breaks):
    whole = method.march(system, q0, v0, times)
    part = method.march(system, q0, v0, times[: breaks[0]])
    for stop in [*breaks[1:], len(times)]:
        kept = pickle.dumps(part.end)
        part = method.resume(system, pickle.loads(kept), times[:stop])
        begin = pickle.loads(kept).time
        known = times[:stop] >= begin
        assert np.isnan(part.q[~known]).all()
        np.testing.assert_array_equal(part.q[known], whole.q[:stop][known])
        np.testing.assert_array_equal(part.v[known], whole.v[:stop][known])
    for name in ("step", "q", "v", "a", "time", "next_step", "memory"):
        np.testing.assert_array_equal(getattr(part.end, name), getattr(whole.end, name))
    assert known.any()
    assert part.end.time >= times[-1]


@EACH
def test_rod_and_slider_continue_bit_for_bit(rod_slider, method):
    assert_continues(METHODS[method], *rod_slider, np.linspace(0.0, 4.0, 91), (20, 21, 57))


@EACH
def test_the_struck_beam_continues_bit_for_bit_before_in_and_after_the_blow(struck, method):
    step = {"central-difference": 1e-5, "sub-cycling": 1e-5, "reversible-sub-cycling": 1e-5}
    step |= {"exponential": 1e-4, "generalized-alpha": 2e-5}
    chosen = METHODS[method]
    if method in step:
        chosen = replace(chosen, step=step[method])
    times = np.linspace(0.0, 8e-3, 65)  # the 9th and the 41st are the begin and the end of the blow
    assert_continues(chosen, *struck, times, (4, 9, 20, 41, 50))


@EACH
def test_a_state_is_left_as_it_was(rod_slider, method):
    system, q0, v0 = rod_slider
    chosen, times = METHODS[method], np.array([0.5, 1.0])
    end = chosen.march(system, q0, v0, times[:1]).end
    before = pickle.dumps(end)
    first = chosen.resume(system, end, times)
    assert pickle.dumps(end) == before
    np.testing.assert_array_equal(chosen.resume(system, end, times).q, first.q)


@pytest.mark.parametrize("method", [name for name, method in METHODS.items() if method.step])
def test_ends_of_many_states_are_those_of_marches_from_each(struck, method):
    system, q0, v0 = struck
    step = {"central-difference": 1e-5, "sub-cycling": 1e-5, "reversible-sub-cycling": 1e-5, "exponential": 1e-4}
    chosen = METHODS[method]
    if method in step:
        chosen = replace(chosen, step=step[method])
    first = chosen.march(system, q0, v0, np.array([1.2e-3])).end
    starts = [replace(first, q=first.q * scale) for scale in (1.0, 1.01, -1.0)]
    values, n = np.array([start.values for start in starts]), 3 * chosen.substeps
    steps = first.step + np.array([0, 2, 1]) * chosen.substeps  # they needn't begin together
    for start, step, end in zip(starts, steps, chosen.ends(system, first, values, steps, 3), strict=True):
        last = np.array([(step + n - 1) * chosen.step])
        one = chosen.resume(system, replace(start, step=int(step)), last).end
        assert one.step == step + n
        np.testing.assert_array_equal(end, one.values)
        back = first.with_values(end)
        assert [x.shape for x in back.arrays] == [x.shape for x in first.arrays]
        np.testing.assert_array_equal(back.values, end)
